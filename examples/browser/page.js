// The page: one bot that plays one episode after another, drawn from above.

import { Bot, uniform } from "./bot.js";
import { successes } from "./episodes.js";
import { GOAL, GOAL_RADIUS, RANGE, START_HIGH, START_LOW, begin, observe, over, step, succeeded } from "./zombie.js";

const STEP = 120; // milliseconds
const REST = 900; // after an episode
const MANY = 1000;

const [controls, style, play, likely, many, words, canvas, count, error] = [
  "controls", "style", "play", "likely", "many", "words", "world", "count", "error",
].map((id) => document.getElementById(id));
const options = new URLSearchParams(location.search);
const random = uniform(Number(options.get("seed") ?? Date.now()));

let playing = true;
let tally = { played: 0, succeeded: 0 };
let round = 0; // rises when what is played is changed, which ends the episode under way

const wait = (milliseconds) => new Promise((done) => setTimeout(done, milliseconds));
const chosen = (bot) => bot.styles[style.selectedIndex];

function show(text = "") {
  const { played, succeeded: well } = tally;
  const share = played ? ` (${((100 * well) / played).toFixed(1)} %)` : "";
  count.textContent = `${well} of ${played} episodes succeeded${share}${text}`;
}

function restart(bot) {
  round += 1;
  tally = { played: 0, succeeded: 0 };
  words.replaceChildren(
    ...chosen(bot).words.map((sentence) => Object.assign(document.createElement("li"), { textContent: sentence })),
  );
  show();
}

async function watch(bot) {
  for (;;) {
    const now = round;
    const states = [begin(random)];
    let carried = bot.begin(chosen(bot), 1, random);
    draw(states);
    while (now === round && !over(states.at(-1))) {
      await wait(STEP);
      if (!playing || now !== round) continue;
      const [actions, next] = await bot.act(carried, [observe(states.at(-1))], random, likely.checked);
      carried = next;
      states.push(step(states.at(-1), actions[0]));
      draw(states, actions[0]);
    }
    if (now !== round) continue;
    tally.played += 1;
    tally.succeeded += succeeded(states.at(-1), chosen(bot).name);
    show();
    await wait(REST);
  }
}

async function playMany(bot) {
  const now = round;
  many.disabled = true;
  show(" …");
  const well = await successes(bot, chosen(bot), MANY, random, likely.checked);
  many.disabled = false;
  if (now !== round) return;
  tally.played += MANY;
  tally.succeeded += well;
  show();
}

function draw(states, action) {
  const colour = (name) => getComputedStyle(canvas).getPropertyValue(`--${name}`);
  const context = canvas.getContext("2d");
  const [low, high] = [START_LOW - 1, START_HIGH + 1];
  const scale = canvas.width / (high - low);
  const at = ([x, y]) => [(x - low) * scale, canvas.height - (y - low) * scale];
  const present = states.at(-1);
  context.clearRect(0, 0, canvas.width, canvas.height);
  context.lineWidth = 3;

  function circle(place, radius, fill, stroke) {
    context.beginPath();
    context.arc(...at(place), radius, 0, 2 * Math.PI);
    if (fill) context.fillStyle = fill;
    if (fill) context.fill();
    if (stroke) context.strokeStyle = stroke;
    if (stroke) context.stroke();
  }

  function path(places, stroke) {
    context.beginPath();
    places.forEach((place) => context.lineTo(...at(place)));
    context.strokeStyle = stroke;
    context.stroke();
  }

  context.globalAlpha = 0.4;
  circle(GOAL, GOAL_RADIUS * scale, colour("goal"));
  path(states.map((state) => state.zombie), colour("zombie"));
  context.globalAlpha = 1;
  path(states.map((state) => state.agent), colour("agent"));
  if (present.alive) {
    context.setLineDash([4, 6]);
    circle(present.zombie, RANGE * scale, null, colour("zombie"));
    context.setLineDash([]);
  }
  circle(present.zombie, 10, colour(present.alive ? "zombie" : "dead"));
  circle(present.agent, 10, colour("agent"));
  if (action?.[0] === 1) circle(present.agent, 18, null, colour("agent"));
}

try {
  const bot = await Bot.load(options.get("export") ?? "exports/zombie");
  bot.styles.forEach(({ name }) => style.add(new Option(name)));
  controls.addEventListener("submit", (event) => event.preventDefault());
  style.addEventListener("change", () => restart(bot));
  likely.addEventListener("change", () => restart(bot));
  many.addEventListener("click", () => playMany(bot).catch(fail));
  play.addEventListener("click", () => {
    playing = !playing;
    play.textContent = playing ? "Pause" : "Play";
  });
  for (const control of [style, play, many]) control.disabled = false;
  restart(bot);
  await watch(bot);
} catch (problem) {
  fail(problem);
}

function fail(problem) {
  error.textContent = `${problem.message ?? problem}`;
  if (style.disabled) count.textContent = "";
}
