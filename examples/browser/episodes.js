// Many episodes at once, and a world that takes given actions.

import { begin, beginAt, observe, over, step, succeeded } from "./zombie.js";

/** How many of `count` episodes of a style's bots succeed. */
export async function successes(bot, style, count, random, mostLikely) {
  let states = Array.from({ length: count }, () => begin(random));
  let carried = bot.begin(style, count, random);
  while (!states.every(over)) {
    const [actions, next] = await bot.act(carried, states.map(observe), random, mostLikely);
    states = states.map((state, at) => (over(state) ? state : step(state, actions[at])));
    carried = next;
  }
  return states.filter((state) => succeeded(state, style.name)).length;
}

/** What is seen and known after each of given actions, from a given start of the zombie. */
export function traced(zombie, actions) {
  let state = beginAt(zombie);
  return actions.map((action) => {
    state = step(state, action);
    return [...observe(state), state.alive ? 1 : 0, state.attacks, state.closestZombie, state.closestGoal, over(state) ? 1 : 0];
  });
}
