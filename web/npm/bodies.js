// Bodies of one mesh: contact of tissue with tissue, and ties between surfaces, named as in Python (docs/bodies.md). SI units.
import { TensormassError, constants } from './runtime.js';
import { created, fill } from './made.js';

// Options of a definition without those that other arguments set.
function others(options, own, instead) {
  const twice = own.filter((name) => name in options);
  if (twice.length) throw new TensormassError(`${twice.join(', ')}: give ${instead} instead`);
  return options;
}

function counted(values, count, name) {
  if (values.length !== count) throw new TensormassError(`${name}: ${values.length} values; give ${count}`);
  return values;
}

// Contact of bodies with each other and with themselves. Add it after contact, if there is any.
export class Touch {
  // bodies: [tetCount] body of each tetrahedron, from 0; null: one body. pairs: the pairs [a, b] of bodies that touch, a === b for a body that touches itself;
  // null: all. friction: [static, kinetic]. Options (tm_touching_def): thickness_m (0.5e-3), compliance_m_N (0.5e-3), sweeps (10), max_rows (4096),
  // max_candidates (65536), force_cap_N (50).
  constructor(world, bodies = null, pairs = null, friction = [0, 0], options = {}) {
    others(options, ['body_count', 'tet_body', 'pair', 'mu_static', 'mu_kinetic'], 'bodies, pairs and friction');
    const { library } = world, count = bodies ? bodies.reduce((most, body) => Math.max(most, body + 1), 1) : 1;
    const table = pairs && pairTable(pairs, count), arrays = [0, 0];
    if (bodies) arrays[0] = library.newArray(counted(bodies, world.tissue.mesh.tetCount, 'bodies'), 'i32');
    if (table) arrays[1] = library.newArray(table, 'u8');
    const [mu_static, mu_kinetic] = friction;
    try {
      const definition = fill(library.call('tm_touching_def_default'), { ...options, body_count: count, tet_body: arrays[0], pair: arrays[1], mu_static, mu_kinetic });
      this.own(library, world.tissue.mesh.vertexCount, created(library, 'tm_stage_touch', world.pointer, definition));
    } finally {
      arrays.forEach((a) => library.free(a));
    }
  }

  own(library, vertexCount, pointer) { Object.assign(this, { library, vertexCount, pointer }); }

  // The stage "touch" of a world by its address, such as a scene's; null: there is none.
  static of(library, vertexCount, world) { return stageOf(Touch, 'tm_world_touching', library, vertexCount, world); }

  // Rows of the last substep: {edges, a, b, vertex, weight, normal, thickness_m, gap_m, lambda_N, across_N}, copied. Vertex j bears
  // weight[j] * (lambda_N * normal + across_N), N.
  rows() {
    const { library } = this, place = library.newArray([0], 'pointer'), count = library.call('tm_touching_rows', this.pointer, place);
    const first = library.view(place, 1, 'pointer')[0], { size } = library.classOf('tm_touching_row');
    library.free(place);
    return Array.from({ length: count }, (_, i) => library.at('tm_touching_row', first + i * size).toObject());
  }

  // [3 * vertexCount] force of the last substep's contact on each vertex, N.
  get force_N() {
    const force = new Float64Array(3 * this.vertexCount);
    for (const { vertex, weight, normal, lambda_N, across_N } of this.rows())
      vertex.forEach((v, j) => { for (let a = 0; a < 3; a++) force[3 * v + a] += weight[j] * (lambda_N * normal[a] + across_N[a]); });
    return force;
  }

  // {rows, candidates, gathers, overflowed, deepest_m} of the last substep (tm_touching_report).
  get report() {
    const struct = this.library.call('tm_touching_get_report', this.pointer), copy = struct.toObject();
    struct.free();
    return { ...copy, gathers: Number(copy.gathers) };
  }
}

// The symmetric table [count * count] of pairs that touch.
function pairTable(pairs, count) {
  const table = new Uint8Array(count * count);
  for (const [a, b] of pairs) {
    if (![a, b].every((body) => Number.isInteger(body) && body >= 0 && body < count))
      throw new TensormassError(`pairs: (${a}, ${b}) names no two of ${count} bodies; give 0 to ${count - 1}`);
    table[a * count + b] = table[b * count + a] = 1;
  }
  return table;
}

// A spring that pulls and never pushes, from a vertex to a point of another surface: the point of the vertices other [3] with the barycentric weight [3].
// rest_m: length up to which it is slack. break_N: breaking load, 0: none.
export class Tie {
  constructor(vertex, other, weight, rest_m, stiffness_N_m, break_N = 0) { Object.assign(this, { vertex, other, weight, rest_m, stiffness_N_m, break_N }); }

  // The tie from a vertex to the nearest point, at rest, of `triangles` [3n], slack up to that distance. null: each triangle has the vertex.
  static toNearest(mesh, vertex, triangles, stiffness_N_m, break_N = 0) {
    const { library } = mesh, listed = Int32Array.from(triangles), last = mesh.vertexCount - 1;
    if (![vertex, ...triangles].every((v) => Number.isInteger(v) && v >= 0 && v <= last)) throw new TensormassError(`vertex or triangles: outside 0 to ${last}`);
    const tie = library.make('tm_tie');
    try {
      if (!library.call('tm_tie_lead', mesh.pointer, vertex, listed, listed.length / 3, tie)) return null;
      return new Tie(vertex, Array.from(tie.other), Array.from(tie.weight), tie.rest_m, stiffness_N_m, break_N);
    } finally {
      tie.free();
    }
  }
}

// Ligaments and fat between bodies: springs that pull and never push. Add them after contact, if there is any.
export class Ties {
  // ties: a list of Tie. Options (tm_ties_def): sweeps (10; with contact, contact's).
  constructor(world, ties, options = {}) {
    others(options, ['count', 'tie'], 'the list of ties');
    const { library } = world, list = library.makeArray('tm_tie', Math.max(1, ties.length));
    try {
      ties.forEach(({ vertex, other, weight, rest_m, stiffness_N_m, break_N = 0 }, i) =>
        Object.assign(list[i], { vertex, other: counted(other, 3, 'other'), weight: counted(weight, 3, 'weight'), rest_m, stiffness_N_m, break_N }));
      const definition = fill(library.call('tm_ties_def_default'), { ...options, count: ties.length, tie: list[0].address });
      this.own(library, world.tissue.mesh.vertexCount, created(library, 'tm_stage_ties', world.pointer, definition));
    } finally {
      list[0].free();
    }
  }

  own(library, vertexCount, pointer) { Object.assign(this, { library, vertexCount, pointer }); }

  // The stage "ties" of a world by its address, such as a scene's; null: there is none.
  static of(library, vertexCount, world) { return stageOf(Ties, 'tm_world_ties', library, vertexCount, world); }

  get count() { return this.library.call('tm_ties_count', this.pointer); }
  // [count] whether each holds: neither broken nor cut.
  get whole() { return Array.from({ length: this.count }, (_, i) => this.library.call('tm_ties_is_whole', this.pointer, i)); }
  // [count] tension of each in the last substep, N; 0 if it is gone.
  get force_N() { return Float64Array.from({ length: this.count }, (_, i) => this.library.call('tm_ties_force_N', this.pointer, i, 0, 0)); }

  // [6 * count] ends of each now, m: its vertex, and its point of the other surface. If `whole`, only of those that hold.
  ends_m({ whole = false } = {}) {
    const { library, pointer, count } = this, place = library.allocate(48), ends = [];
    for (let i = 0; i < count; i++) {
      if (whole && !library.call('tm_ties_is_whole', pointer, i)) continue;
      library.call('tm_ties_force_N', pointer, i, place, place + 24);
      ends.push(...library.view(place, 6));
    }
    library.free(place);
    return Float64Array.from(ends);
  }

  // {tie, why}: ties that went since the last call, and the instrument that cut each; -1: its load broke it, -2: the tissue at an end went. In a Scene each frame
  // has fetched them: see `whole`.
  fetchCut() {
    const { library, count } = this, place = library.allocate(8 * count);
    const found = library.call('tm_ties_fetch_cut', this.pointer, place, place + 4 * count, count);
    const [tie, why] = [0, 4 * count].map((offset) => library.view(place + offset, found, 'i32').slice());
    library.free(place);
    return { tie, why };
  }
}

function stageOf(kind, name, library, vertexCount, world) {
  const pointer = world ? library.call(name, world) : 0;
  if (!pointer) return null;
  const stage = Object.create(kind.prototype);
  stage.own(library, vertexCount, pointer);
  return stage;
}
