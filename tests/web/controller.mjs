// Runs scene and controller together under node: node controller.mjs NPM SCENE.yaml MESH EXTRAPOLATOR -> JSON of the last second.
import fs from 'node:fs';
import path from 'node:path';
import { pathToFileURL } from 'node:url';

const [, , npm, file, mesh, extrapolator] = process.argv;
const { load, Scene, Controller, TensormassError } = await import(pathToFileURL(path.join(npm, 'index.js')));
const library = await load();
const files = { [`../../meshes/${path.basename(mesh)}`]: fs.readFileSync(mesh) };
const scene = new Scene(library, fs.readFileSync(file, 'utf8'), { files, sets: { 'haptics.compliance': 'iterations' } });
const { trocar_m, pose } = scene.instrument(0);
const controller = new Controller(library, { trocar_m, axis: pose.tip_m.map((p, a) => p - trocar_m[a]), extrapolator });
let t = 1e6, from = pose.tip_m, error = 0, largest = 0, patches = 0;
for (let frame = 0; frame < 35; frame++) {
  const [reaction] = scene.step(), to = scene.pose(0).tip_m;
  // At the newest sample's position the controller must give that sample's force.
  const rejected = controller.sample(reaction, t, scene.patch(0));
  if (rejected) throw new Error(rejected);
  patches += scene.patch(0) !== null;
  for (let tick = 1; tick <= 20; tick++) controller.tick((t += 2000), from.map((x, a) => x + ((to[a] - x) * tick) / 20));
  from = to;
  const force = Math.hypot(...reaction.force_N);
  largest = Math.max(largest, force);
  if (frame > 20) error = Math.max(error, Math.abs(Math.hypot(...controller.result.force_N) - force));
}
const { state } = controller;
for (let tick = 0; tick < 500; tick++) controller.tick((t += 2000), from);
const silent = [controller.state, Math.hypot(...controller.result.force_N)];
const messages = [];
for (const wrong of [() => controller.select('psychic'), () => new Controller(library, { values: { force_max_N: -1 } }), () => new Controller(library, { up: [0, 0, 1] }),
  () => scene.reaction(7), () => new Scene(library, 'tissue:\n  mesh: none.msh\n  materials: {"*": {young: 1 kPa, poisson: 0.4, density: 1000 kg/m3}}\n'), () => library.checked('tm_material_young', 1000, 0.7, library.make('tm_material'))]) {
  try {
    wrong();
    messages.push('');
  } catch (e) {
    messages.push(e instanceof TensormassError ? e.message : `not ours: ${e}`);
  }
}
console.log(JSON.stringify({ state, error, largest, patches, silent, messages }));
