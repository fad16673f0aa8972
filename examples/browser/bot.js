// Bots of anything that `tvae export` wrote and that has styles: policy_step.onnx and manifest.json, run by ONNX
// Runtime Web.

import * as ort from "onnxruntime-web";

ort.env.wasm.numThreads = 1; // a page needs special headers for more, and a step is far too small for them

/** Uniform numbers in [0, 1) that a seed settles (mulberry32). */
export function uniform(seed) {
  let state = seed >>> 0;
  return () => {
    state = (state + 0x6d2b79f5) >>> 0;
    let bits = Math.imul(state ^ (state >>> 15), state | 1);
    bits ^= bits + Math.imul(bits ^ (bits >>> 7), bits | 61);
    return ((bits ^ (bits >>> 14)) >>> 0) / 2 ** 32;
  };
}

const normal = (random) => Math.sqrt(-2 * Math.log(1 - random())) * Math.cos(2 * Math.PI * random());

export class Bot {
  /** The bot whose export lies in a directory of the server. */
  static async load(directory) {
    const answer = await fetch(`${directory}/manifest.json`);
    if (!answer.ok) throw new Error(`no export of tvae at ${directory}: manifest.json gave ${answer.status}`);
    const manifest = await answer.json();
    if (manifest.format !== "tvae-onnx") throw new Error(`manifest.json at ${directory} is not of an export of tvae`);
    const step = manifest.graphs.policy_step;
    const session = await ort.InferenceSession.create(`${directory}/${step.file}`, { executionProviders: ["wasm"] });
    return new Bot(manifest, session);
  }

  constructor(manifest, session) {
    this.styles = manifest.styles;
    this.session = session;
    this.sizes = Object.fromEntries(
      manifest.graphs.policy_step.inputs.map((port) => [port.name, port.shape[port.shape.length - 1]]),
    );
    this.columns = manifest.action.length;
  }

  /** What bots of a style carry through their episodes: a z of a member of the style each, and an empty memory. */
  begin(style, count, random) {
    const { means, deviations } = style.z.members;
    const z = new Float32Array(count * means[0].length);
    for (let bot = 0; bot < count; bot += 1) {
      const one = Math.floor(random() * means.length);
      means[one].forEach((mean, at) => {
        z[bot * means[one].length + at] = mean + deviations[one][at] * normal(random);
      });
    }
    return { count, z, memory: new Float32Array(count * this.sizes.memory) };
  }

  /** What each bot does, given what each sees (an array for each), and what they carry after it. */
  async act(carried, observations, random, mostLikely) {
    const { count, z, memory } = carried;
    const rows = (numbers) => new ort.Tensor("float32", numbers, [count, numbers.length / count]);
    const found = await this.session.run(
      {
        observation: rows(Float32Array.from(observations.flat())),
        z: rows(z),
        memory: rows(memory),
        noise: rows(Float32Array.from({ length: count * this.sizes.noise }, random)),
        most_likely: new ort.Tensor("float32", [mostLikely ? 1 : 0], [1]),
      },
      ["action", "memory_out"],
    );
    const flat = found.action.data;
    const actions = observations.map((_, bot) => flat.slice(bot * this.columns, (bot + 1) * this.columns));
    return [actions, { count, z, memory: found.memory_out.data }];
  }
}
