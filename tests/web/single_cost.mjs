// Processor time of frames in single precision relative to double, of soft tissue that rotates throughout, in turn: node single_cost.mjs NPM MESH -> JSON.
import fs from 'node:fs';
import path from 'node:path';
import { pathToFileURL } from 'node:url';

const [, , npm, mesh] = process.argv, { load, Scene } = await import(pathToFileURL(path.join(npm, 'index.js')));
const YAML = `tissue: {mesh: m.msh, materials: {"*": {young: 1 kPa, poisson: 0.4}}}
damping: {rate: 60 /s}
gravity:
rotation:
supports: [{group: z_max}]
time: {frame_rate: 25 Hz}`;
const library = await load({ form: 'simd' }), files = { 'm.msh': fs.readFileSync(mesh) };
const scenes = ['double', 'single'].map((precision) => new Scene(library, YAML, { files, sets: { 'tissue.precision': precision } })), used = [0, 0];
for (let frame = 0; frame < 40; frame++) {
  scenes.forEach((scene, i) => {
    const before = process.cpuUsage();
    scene.step();
    const { user, system } = process.cpuUsage(before);
    if (frame >= 10) used[i] += user + system; // compiled by then, and bent
  });
}
console.log(JSON.stringify({ single: used[1] / used[0], far_m: Math.max(...scenes.map((scene) => Math.max(...scene.displacement_m.map(Math.abs)))) }));
