// A block pressed by a probe, in node: make web && node examples/web/press.mjs
import { Material, Mesh, Tissue, World, load } from '../../build/web/npm/index.js'; // 'tensormass', where the package is installed

const library = await load();
const mesh = Mesh.block(library, [0.06, 0.06, 0.03], [12, 12, 6]);
const tissue = new Tissue(mesh, Material.young(library, 5e3, 0.45, { density_kg_m3: 1060, damping_1_s: 40 }));
const world = new World(tissue);
world.addSupport(mesh.near([0, 0, 0], [0, 0, 1])); // the floor
const contact = world.addContact([{ trocar_m: [0.03, 0.03, 0.15], tip_m: [0.03, 0.03, 0.035] }]);
const substeps = Math.ceil(0.04 / world.dt_s); // a frame of 40 ms

for (let frame = 0; frame <= 25; frame++) {
  const [reaction] = contact.frame([{ tip_m: [0.03, 0.03, 0.035 - 0.0003 * frame] }], substeps);
  if (frame % 5 === 0) console.log(`${world.time_s.toFixed(2)} s  ${reaction.force_N.map((f) => f.toFixed(3)).join('  ')} N`);
}
