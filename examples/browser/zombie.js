// The world of the zombie task, the same law as src/tvae/envs/zombie_dynamics.py (a zombie that chases).
// `python scripts/browser_success.py` compares the two step by step.

export const GOAL = [5, 5];
export const GOAL_RADIUS = 0.5;
export const AGENT_STEP = 0.5;
export const ZOMBIE_SPEED = 0.3;
export const RANGE = 1;
export const FREE_RADIUS = 2;
export const NUM_STEPS = 30;
export const START_LOW = -2.5;
export const START_HIGH = 5;

const between = (from, to) => [to[0] - from[0], to[1] - from[1]];
const length = ([x, y]) => Math.hypot(x, y);
const bearing = ([x, y]) => Math.atan2(y, x);

/** An episode's start, with the zombie where uniform numbers in [0, 1) put it, not too near to the agent. */
export function begin(random) {
  const place = () => START_LOW + (START_HIGH - START_LOW) * random();
  let zombie = [place(), place()];
  while (length(zombie) < FREE_RADIUS) zombie = [place(), place()];
  return beginAt(zombie);
}

/** An episode's start with the zombie at a place. */
export function beginAt(zombie) {
  return {
    time: 0,
    agent: [0, 0],
    zombie,
    alive: true,
    attacks: 0,
    closestZombie: length(zombie),
    closestGoal: length(GOAL),
  };
}

/** Distance and bearing (radians) of the goal, and of the zombie. */
export function observe(state) {
  const goal = between(state.agent, GOAL);
  const zombie = between(state.agent, state.zombie);
  return [length(goal), bearing(goal), length(zombie), bearing(zombie)];
}

/** The state after an action: whether to attack (1 or 0), and the heading of the agent's move in radians. */
export function step(state, [attack, heading]) {
  const attacks = attack === 1;
  const hit = attacks && length(between(state.agent, state.zombie)) < RANGE;
  const alive = state.alive && !hit;
  const agent = [state.agent[0] + AGENT_STEP * Math.cos(heading), state.agent[1] + AGENT_STEP * Math.sin(heading)];
  const zombie = alive ? towards(state.zombie, agent, ZOMBIE_SPEED) : state.zombie;
  return {
    time: state.time + 1,
    agent,
    zombie,
    alive,
    attacks: state.attacks + attacks,
    closestZombie: alive ? Math.min(state.closestZombie, length(between(agent, zombie))) : state.closestZombie,
    closestGoal: Math.min(state.closestGoal, length(between(agent, GOAL))),
  };
}

export const reached = (state) => length(between(state.agent, GOAL)) < GOAL_RADIUS;

export const over = (state) => reached(state) || state.time >= NUM_STEPS;

/** Whether an episode that is over did what its style is for: `attack`, `avoid`, or any other, which need reach the goal. */
export function succeeded(state, style) {
  if (style === "attack") return reached(state) && !state.alive;
  if (style === "avoid") return reached(state) && state.closestZombie >= RANGE;
  return reached(state);
}

function towards(position, target, distance) {
  const vector = between(position, target);
  const left = length(vector);
  const share = left > 0 ? Math.min(distance, left) / left : 0;
  return [position[0] + share * vector[0], position[1] + share * vector[1]];
}
