// Bodies of the package: contact of tissue and ties, of worlds and of a scene. node bodies.mjs NPM SCENE.yaml MESH.msh -> JSON.
import fs from 'node:fs';
import path from 'node:path';
import { pathToFileURL } from 'node:url';

const [, , npm, sceneFile, meshFile] = process.argv;
const { Material, Mesh, Scene, TensormassError, Tie, Tissue, World, load } = await import(pathToFileURL(path.join(npm, 'index.js')));
const library = await load({ form: 'plain' }), liver = Material.young(library, 5e3, 0.4, { damping_1_s: 60 }), seen = {};

// Two meshes as one; the second is moved.
function joined(low, high, move_m, regions = null) {
  const moved = Float64Array.from(high.rest_m, (x, i) => x + move_m[i % 3]), shifted = Int32Array.from(high.tets, (v) => v + low.vertexCount);
  return new Mesh(library, [...low.rest_m, ...moved], [...low.tets, ...shifted], regions);
}

// A block on the floor and a smaller one above it.
function twoBlocks() {
  const low = Mesh.block(library, [0.04, 0.04, 0.02], [4, 4, 2]), high = Mesh.block(library, [0.02, 0.02, 0.01], [2, 2, 1]);
  const body = [...new Array(low.tetCount).fill(0), ...new Array(high.tetCount).fill(1)], mesh = joined(low, high, [0.011, 0.009, 0.021], body);
  const world = new World(new Tissue(mesh, [liver, liver]));
  world.addSupport(mesh.near([0, 0, 0], [0, 0, 1]));
  world.addGravity();
  return { world, body, mesh, above: low.vertexCount };
}

// The smaller block hangs by ties from a frame that is fixed above it.
function hung(break_N) {
  const frame = Mesh.block(library, [0.02, 0.02, 0.01], [2, 2, 1], [0, 0, 0.02]), mesh = joined(frame, Mesh.block(library, [0.02, 0.02, 0.01], [2, 2, 1]), [0, 0, 0]);
  const world = new World(new Tissue(mesh, liver)), rest = mesh.rest_m, faces = [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]];
  world.addSupport(Int32Array.from({ length: frame.vertexCount }, (_, i) => i));
  world.addGravity();
  const under = [], top = mesh.near([0, 0, 0.01], [0, 0, 1]);
  for (let t = 0; t < frame.tetCount; t++)
    for (const face of faces) {
      const corners = face.map((k) => mesh.tets[4 * t + k]);
      if (corners.every((v) => Math.abs(rest[3 * v + 2] - 0.02) < 1e-9)) under.push(...corners);
    }
  const ties = Array.from(top, (v) => Tie.toNearest(mesh, v, under, 50, break_N));
  return { world, mesh, ties: world.addTies(ties), given: ties, none: Tie.toNearest(mesh, top[0], [], 1) };
}

const sum = (values) => values.reduce((a, b) => a + b, 0), message = (wrong) => {
  try {
    wrong();
    return '';
  } catch (e) {
    return e instanceof TensormassError ? e.message : `not ours: ${e}`;
  }
};

{
  const { world, body, above } = twoBlocks(), before = world.touch, touch = world.addTouch(body, null, [0.2, 0.1]);
  world.step(4000);
  const force = touch.force_N, upper = Array.from(force.subarray(3 * above));
  seen.contact = {
    before, weight_N: 9.81 * sum(Array.from(world.tissue.mass_kg.subarray(above))), force_N: sum(upper.filter((_, i) => i % 3 === 2)), all_N: Math.abs(sum(Array.from(force))),
    rows: touch.rows().length, again: world.touch.rows().length, report: touch.report, weights: Math.max(...touch.rows().map((r) => Math.abs(sum(r.weight)))),
  };
  const apart = twoBlocks(), lone = apart.world.addTouch(apart.body, [[0, 0], [1, 1]]);
  apart.world.step(400);
  seen.apart = { rows: lone.rows().length, sunk_m: -Math.max(...Array.from(apart.world.u_m.subarray(3 * apart.above)).filter((_, i) => i % 3 === 2)) };
  const { world: other } = twoBlocks();
  seen.messages = [() => other.addTouch(body, [[0, 2]]), () => other.addTouch(body, null, [0.1, 0.2]), () => other.addTouch(body, null, [0, 0], { mu_static: 0.1 }),
    () => other.addTouch(body, null, [0, 0], { thick: 1 }), () => other.addTouch([0, 1])].map(message);
}
{
  const { world, ties, given, none, mesh } = hung(0), free = library.bytesUsed;
  world.step(20000);
  const ends = ties.ends_m(), length = ties.whole.map((_, i) => Math.hypot(...[0, 1, 2].map((a) => ends[6 * i + a] - ends[6 * i + 3 + a])));
  seen.ties = {
    count: ties.count, again: world.ties.count, whole: ties.whole.every(Boolean), rest_m: given.map((tie) => tie.rest_m), none, force_N: Array.from(ties.force_N), length_m: length,
    weight_N: (9.81 * sum(Array.from(world.tissue.mass_kg))) / 2, leaked: library.bytesUsed - free,
  };
  const weak = hung(1e-3), none_yet = weak.ties.fetchCut().tie.length;
  weak.world.step(600);
  const { tie, why } = weak.ties.fetchCut();
  seen.broken = { none_yet, tie: Array.from(tie).sort(), why: [...new Set(why)], whole: weak.ties.whole.some(Boolean), ends: weak.ties.ends_m({ whole: true }).length, again: weak.ties.fetchCut().tie.length };
  seen.messages.push(...[() => hung(0).world.addTies([]), () => Tie.toNearest(mesh, 10 ** 6, [0, 1, 2], 50), () => new World(world.tissue).addTies([new Tie(0, [1, 2, 10 ** 6], [1, 0, 0], 0.01, 50)]),
    () => new World(world.tissue).addTies([new Tie(0, [1, 2], [1, 0, 0], 0.01, 50)]), () => new World(world.tissue).addTies([], { count: 1 })].map(message));
}
{
  const scene = new Scene(library, fs.readFileSync(sceneFile, 'utf8'), { files: { [path.basename(meshFile)]: fs.readFileSync(meshFile) } });
  scene.run(0.2);
  seen.scene = { hash: scene.hash, bodies: scene.bodies.map((b) => [b.name, b.rigid, b.vertex_end - b.vertex_begin]), rows: scene.touch.rows().length, ties: scene.ties.count };
}
console.log(JSON.stringify(seen));
