// Processor time of frames under node: node tests/web/frame_cost.mjs build/web/npm apps/scenes/liver-cut.yaml FRAMES [PATH[=VALUE]]... Without haptics, as
// tm-sim --lockstep --force plain --unset haptics --json FILE (frame_processor_us), to be run at the same time. A path without a value is left out.
import fs from 'node:fs';
import path from 'node:path';
import { pathToFileURL } from 'node:url';

const [, , npm, file, frames, ...sets] = process.argv, yaml = fs.readFileSync(file, 'utf8'), meshes = [...yaml.matchAll(/mesh: (\S+\.msh)/g)].map((found) => found[1]);
const given = Object.fromEntries(sets.map((s) => [s.split('=')[0], s.includes('=') ? s.slice(s.indexOf('=') + 1) : null]));
const { load, Scene } = await import(pathToFileURL(path.join(path.resolve(npm), 'index.js')));
const library = await load(), ms = [];
const scene = new Scene(library, yaml, { files: Object.fromEntries(meshes.map((mesh) => [mesh, fs.readFileSync(path.join(path.dirname(file), mesh))])), sets: { ...(/^haptics:/m.test(yaml) ? { haptics: null } : {}), ...(/^rendering:/m.test(yaml) ? { rendering: null } : {}), ...given } });
for (let i = 0; i < Number(frames); i++) {
  const before = process.cpuUsage();
  scene.step();
  const { user, system } = process.cpuUsage(before);
  ms.push((user + system) / 1000);
}
ms.sort((a, b) => a - b);
const [p50_ms, p99_ms] = [0.5, 0.99].map((p) => ms[Math.floor(p * (ms.length - 1))]);
console.log(JSON.stringify({ form: library.form, tetrahedra: scene.tetCount, alive: scene.aliveCount, mean_ms: ms.reduce((sum, x) => sum + x) / ms.length, p50_ms, p99_ms, hash: scene.hash }));
