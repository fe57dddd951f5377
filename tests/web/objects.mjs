// The objects of the package against a scene of the same tissue, and a log: node objects.mjs NPM SCENE.yaml MESH.msh [LOG] -> JSON.
import fs from 'node:fs';
import path from 'node:path';
import { pathToFileURL } from 'node:url';

const [, , npm, file, meshFile, logFile] = process.argv;
const { Material, Mesh, Scene, Tissue, TensormassError, World, load, readLog } = await import(pathToFileURL(path.join(npm, 'index.js')));
const library = await load({ form: 'plain' }), content = fs.readFileSync(meshFile);

const scene = new Scene(library, fs.readFileSync(file, 'utf8'), { files: { [`../../meshes/${path.basename(meshFile)}`]: content }, sets: { haptics: null, 'tissue.renumber': false } });
const before = library.bytesInUse;
const mesh = Mesh.read(library, content);
const tissue = new Tissue(mesh, Material.young(library, 5000, 0.4, { damping_1_s: 60 }));
const world = new World(tissue, { dt_s: scene.dt_s });
world.addSupport(mesh.groups.z_min);
const first = scene.instrument(0), contact = world.addContact([{ trocar_m: first.trocar_m, radius_m: first.radius_m, contact_length_m: first.contact_length_m, ...first.pose }]);
let force = 0;
for (let frame = 0; frame < 25; frame++) {
  const [reaction] = scene.step(), [own] = contact.frame([scene.pose(0)], scene.substeps, Math.max(1, Math.floor(scene.substeps / 4)));
  force = Math.max(force, Math.hypot(...reaction.force_N.map((f, a) => f - own.force_N[a])));
}
const seen = { scene: scene.hash, world: world.hash, force, tets: mesh.tetCount, volume: tissue.mass_kg.reduce((sum, m) => sum + m, 0) };
world.free();
tissue.free();
mesh.free();
seen.leaked = library.bytesInUse - before;

const block = Mesh.block(library, [0.1, 0.1, 0.05], [4, 4, 2]), cut = new World(new Tissue(block, Material.young(library, 5e3, 0.45).withLaw('neo-hooke'), { cuttable: true }));
cut.addSupport(block.near([0, 0, 0], [0, 0, 1]));
const both = cut.addContact([{ mode: 'grasper', trocar_m: [0, 0, 0.2], tip_m: [0.05, 0.05, 0.05] }, { mode: 'cautery', trocar_m: [0.1, 0, 0.2], tip_m: [0.08, 0.05, 0.055], active: false }]);
const grasp = cut.addGrasp(both);
cut.addFriction(both, [[0.3, 0.2], [0, 0]]);
cut.addCut(both);
for (let frame = 0; frame < 10; frame++) both.frame([{ tip_m: [0.05, 0.05, 0.046], grip: 1 }, { tip_m: [0.08, 0.05, 0.055 - 0.003 * frame], active: true }], 100);
seen.held = grasp.vertices(0);
seen.held = [seen.held.state, seen.held.vertices.length];
seen.removed = block.tetCount - cut.tissue.aliveCount;

seen.messages = [() => new Mesh(library, [0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1], [0, 2, 1, 3]), () => Mesh.read(library, 'nonsense'), () => Material.young(library, 1e3, 0.6),
  () => new Tissue(block, Material.young(library, 1e3, 0.4), { softness: 1 }), () => cut.addContact([{ mode: 'spoon', trocar_m: [0, 0, 1], tip_m: [0, 0, 0] }]),
  () => readLog(new Uint8Array(100))].map((wrong) => {
  try {
    wrong();
    return '';
  } catch (e) {
    return e instanceof TensormassError ? e.message : `not ours: ${e}`;
  }
});
if (logFile) {
  const { channels, skipped } = readLog(fs.readFileSync(logFile)), forces = channels.FORCE_0;
  seen.log = { channels: Object.fromEntries(Object.entries(channels).map(([name, all]) => [name, all.length])), skipped, last: forces.at(-1).message.force_N, type: forces[0].type,
    triangles: channels.TISSUE?.[0].message.triangle_count };
}
console.log(JSON.stringify(seen));
