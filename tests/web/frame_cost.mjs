// Processor time of frames under node: node tests/web/frame_cost.mjs build/web/npm apps/scenes/liver-cut.yaml FRAMES. Without haptics, as
// tm-sim --lockstep --force plain --unset haptics --json FILE (frame_processor_us), to be run at the same time.
import fs from 'node:fs';
import path from 'node:path';
import { pathToFileURL } from 'node:url';

const [, , npm, file, frames] = process.argv, yaml = fs.readFileSync(file, 'utf8'), mesh = /mesh: (\S+\.msh)/.exec(yaml)[1];
const { load, Scene } = await import(pathToFileURL(path.join(path.resolve(npm), 'index.js')));
const library = await load(), ms = [];
const scene = new Scene(library, yaml, { files: { [mesh]: fs.readFileSync(path.join(path.dirname(file), mesh)) }, sets: { haptics: null, ...(/^rendering:/m.test(yaml) ? { rendering: null } : {}) } });
for (let i = 0; i < Number(frames); i++) {
  const before = process.cpuUsage();
  scene.step();
  const { user, system } = process.cpuUsage(before);
  ms.push((user + system) / 1000);
}
ms.sort((a, b) => a - b);
const [p50_ms, p99_ms] = [0.5, 0.99].map((p) => ms[Math.floor(p * (ms.length - 1))]);
console.log(JSON.stringify({ form: library.form, tetrahedra: scene.tetCount, alive: scene.aliveCount, p50_ms, p99_ms, hash: scene.hash }));
