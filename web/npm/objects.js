// Meshes, tissue, worlds and instruments, named as in Python (docs/python.md). SI units; arrays are views of the library's memory.
import { Ties, Touch } from './bodies.js';
import { created, fill } from './made.js';
import { TensormassError, constants } from './runtime.js';
import { poseInto, rowsOf } from './scene.js';

// linear, neo-hooke, ...: the constants TM_LAW_* of the library's table, but for the sizes
const NOT_LAWS = ['COUNT', 'CONSTANTS'];
const LAWS = () => Object.fromEntries(Object.keys(constants).filter((n) => /^TM_LAW_/.test(n)).map((n) => n.slice(7)).filter((n) => !NOT_LAWS.includes(n))
  .map((n) => [n.toLowerCase().replaceAll('_', '-'), n]));
const MODES = { probe: 'PROBE', grasper: 'GRASPER', cautery: 'CAUTERY' };
const HELD = () => ({ [constants.TM_GRASP_OPEN]: 'open', [constants.TM_GRASP_HOLDING]: 'holding', [constants.TM_GRASP_RELEASING]: 'releasing' });

function choice(value, table, prefix, what) {
  if (!(value in table)) throw new TensormassError(`${what} "${value}" is not known; use one of ${Object.keys(table).join(', ')}`);
  return constants[prefix + table[value]];
}

// An object of the library. free() destroys it; objects made on it must be freed before.
class Owned {
  own(library, pointer, destroy) { Object.assign(this, { library, pointer, destroy }); }
  free() {
    if (this.pointer && this.destroy) this.library.call(this.destroy, this.pointer);
    this.pointer = 0;
  }
}

// Rest positions and topology.
export class Mesh extends Owned {
  // vertices: [3n] rest positions, m. tets: [4m] vertices, of positive orientation. regions: [m] from 0.
  constructor(library, vertices, tets, regions = null) {
    super();
    const arrays = [library.newArray(vertices), library.newArray(tets, 'i32'), regions ? library.newArray(regions, 'i32') : 0];
    const definition = library.call('tm_mesh_def_default');
    fill(definition, { vertex_count: vertices.length / 3, vertex_m: arrays[0], tet_count: tets.length / 4, tet: arrays[1], region: arrays[2] });
    try {
      this.begin(library, created(library, 'tm_mesh_create', definition), {});
    } finally {
      arrays.forEach((a) => library.free(a));
    }
  }

  begin(library, pointer, groups) {
    this.own(library, pointer, 'tm_mesh_destroy');
    this.struct = library.at('tm_mesh', pointer);
    // Named sets of vertices, of a mesh from a file.
    this.groups = groups;
  }

  // Reads a file's text or bytes; `name` says by its ending which format: .msh, .vtk, .mesh. Lengths times `scale`.
  static read(library, content, { name = 'mesh.msh', scale = 1 } = {}) {
    const file = library.make('tm_mesh_file'), mesh = Object.create(Mesh.prototype);
    library.fs.writeFile(`/${name}`, content);
    try {
      library.checked('tm_mesh_file_load', name, scale, file);
      const groups = {}, begin = library.view(file.group_begin, file.group_count + 1, 'i32');
      const vertex = library.view(file.group_vertex, file.group_count ? begin[file.group_count] : 0, 'i32');
      for (let i = 0; i < file.group_count; i++) groups[library.text(file.group_name + 64 * i)] = vertex.slice(begin[i], begin[i + 1]).sort();
      mesh.begin(library, created(library, 'tm_mesh_file_build_numbered', file, constants.TM_NUMBERING_ORIGINAL), groups);
    } finally {
      library.call('tm_mesh_file_free', file);
      library.fs.unlink(`/${name}`);
    }
    return mesh;
  }

  // A box of `cells` [nx, ny, nz] cubes of six tetrahedra each.
  static block(library, size_m, cells, origin_m = [0, 0, 0]) {
    const [nx, ny, nz] = cells, steps = [(ny + 1) * (nz + 1), nz + 1, 1], vertices = [], tets = [];
    for (let x = 0; x <= nx; x++)
      for (let y = 0; y <= ny; y++)
        for (let z = 0; z <= nz; z++) vertices.push(...[x, y, z].map((k, a) => origin_m[a] + (size_m[a] * k) / cells[a]));
    // Along three axes, from corner to corner; odd orders of the axes are reversed.
    const orders = [[0, 1, 2, false], [0, 2, 1, true], [1, 0, 2, true], [1, 2, 0, false], [2, 0, 1, false], [2, 1, 0, true]];
    for (let x = 0; x < nx; x++)
      for (let y = 0; y < ny; y++)
        for (let z = 0; z < nz; z++)
          for (const [a, b, c, odd] of orders) {
            const p = x * steps[0] + y * steps[1] + z, q = p + steps[a], r = q + steps[b], s = r + steps[c];
            tets.push(...(odd ? [p, q, s, r] : [p, q, r, s]));
          }
    return new Mesh(library, vertices, tets);
  }

  get vertexCount() { return this.struct.vertex_count; }
  get tetCount() { return this.struct.tet_count; }
  // [3 * vertexCount] m
  get rest_m() { return this.library.view(this.struct.rest_m, 3 * this.vertexCount); }
  // [4 * tetCount]
  get tets() { return this.library.view(this.struct.tet, 4 * this.tetCount, 'i32'); }

  // Vertices within `within_m` of a plane.
  near(point_m, normal, within_m = 1e-6) {
    const rest = this.rest_m, length = Math.hypot(...normal), found = [];
    for (let v = 0; v < this.vertexCount; v++) {
      const away = normal.reduce((sum, n, a) => sum + (n / length) * (rest[3 * v + a] - point_m[a]), 0);
      if (Math.abs(away) <= within_m) found.push(v);
    }
    return Int32Array.from(found);
  }
}

// Constants of a material. young(): isotropic, from Young's modulus, Pa, and Poisson's ratio.
export class Material {
  static young(library, young_Pa, poisson, { density_kg_m3 = 1000, damping_1_s = 0 } = {}) {
    return Material.made(library, 'tm_material_young', [young_Pa, poisson], { density_kg_m3, damping_1_s });
  }

  // Transversely isotropic, from five engineering constants: E_L, E_T in Pa, nu_LT, nu_TT, G_L in Pa.
  static engineering(library, constantsOf, { density_kg_m3 = 1000, damping_1_s = 0 } = {}) {
    return Material.made(library, 'tm_material_engineering', constantsOf, { density_kg_m3, damping_1_s });
  }

  static made(library, name, values, others) {
    const material = new Material();
    material.library = library;
    material.struct = library.make('tm_material');
    library.checked(name, ...values, material.struct);
    fill(material.struct, others);
    library.checked('tm_material_check', material.struct);
    return material;
  }

  // Sets the law for large strains (docs/nonlinear-laws.md) and returns the material. stretch_max: 0 means 1.6, holzapfel 1.8. values: the law's constants, four at most.
  withLaw(law, { stretch_max = 0, values = [] } = {}) {
    const four = Float64Array.from({ length: constants.TM_LAW_CONSTANTS }, (_, i) => values[i] ?? 0);
    this.library.checked('tm_material_set_law', this.struct, choice(law, LAWS(), 'TM_LAW_', 'law'), four, stretch_max);
    return this;
  }
}

// A mesh with one material, or one for each region.
export class Tissue extends Owned {
  // options: fields of tm_tissue_def: strain_smoothing, rotation, cuttable ... fibres: [3 * tetCount] unit vectors.
  constructor(mesh, materials, { fibres = null, ...options } = {}) {
    super();
    const { library } = mesh, list = [materials].flat(), size = library.classOf('tm_material').size;
    const copies = library.allocate(size * list.length);
    list.forEach((m, i) => library.bytes.copyWithin(copies + i * size, m.struct.address, m.struct.address + size));
    const regions = list.length === 1 ? library.newArray(new Array(mesh.struct.region_count).fill(0), 'i32') : 0, fibre = fibres ? library.newArray(fibres) : 0;
    const definition = library.call('tm_tissue_def_default');
    fill(definition, { mesh: mesh.pointer, material_count: list.length, material: copies, region_material: regions, fibre, ...options });
    try {
      this.own(library, created(library, 'tm_tissue_create', definition), 'tm_tissue_destroy');
      this.mesh = mesh;
    } finally {
      [copies, regions, fibre].forEach((a) => library.free(a));
    }
  }

  // [vertexCount] lumped masses, kg
  get mass_kg() { return this.library.view(this.library.call('tm_tissue_mass_kg', this.pointer), this.mesh.vertexCount); }
  get aliveCount() { return this.library.call('tm_tissue_alive_count', this.pointer); }
}

// State and step of a tissue.
export class World extends Owned {
  // options: fields of tm_world_def: dt_s (0: of the critical step, step_fraction), damped.
  constructor(tissue, options = {}) {
    super();
    const { library } = tissue, definition = fill(library.call('tm_world_def_default'), { tissue: tissue.pointer, ...options });
    this.own(library, created(library, 'tm_world_create', definition), 'tm_world_destroy');
    this.tissue = tissue;
  }

  // The struct tm_state: u_m, u_prev_m, force_N as addresses; time_s, step.
  get state() { return this.library.at('tm_state', this.library.call('tm_world_state', this.pointer)); }
  array(address) { return this.library.view(address, 3 * this.tissue.mesh.vertexCount); }
  // [3 * vertexCount] displacements, m, and forces of the last step, N: views; get them again after a step.
  get u_m() { return this.array(this.state.u_m); }
  get force_N() { return this.array(this.state.force_N); }
  get time_s() { return this.state.time_s; }
  get dt_s() { return this.library.call('tm_world_step_s', this.pointer); }
  // Hash of the bits of the displacements.
  get hash() { return this.library.call('tm_world_hash', this.pointer).toString(16).padStart(16, '0'); }

  step(count = 1) {
    const status = this.library.call('tm_world_step', this.pointer, count);
    if (status !== constants.TM_OK) throw new TensormassError('a displacement or a force stopped being finite; the step has not happened', this.library.statusName(status));
  }

  addGravity(g_m_s2 = [0, 0, -9.81]) { this.library.checked('tm_stage_gravity', this.pointer, Float64Array.from(g_m_s2)); }

  // Holds these vertices at rest, or displaced by value_m [3].
  addSupport(vertices, value_m = [0, 0, 0]) {
    const dof = Int32Array.from({ length: 3 * vertices.length }, (_, i) => 3 * vertices[Math.floor(i / 3)] + (i % 3)), { library } = this;
    const arrays = [library.newArray(dof, 'i32'), library.newArray(Array.from(dof, (d) => value_m[d % 3]))];
    try {
      library.checked('tm_stage_support', this.pointer, fill(library.call('tm_support_def_default'), { count: dof.length, dof: arrays[0], value_m: arrays[1] }));
    } finally {
      arrays.forEach((a) => library.free(a));
    }
  }

  // instruments: {trocar_m, tip_m, mode, radius_m, contact_length_m, roll_rad, grip, active}; free with trocar_m null, then {direction}
  addContact(instruments, options = {}) { return new Contact(this, instruments, options); }
  addGrasp(contact, options = {}) { return new Grasp(this, contact, options); }
  // coefficients: [static, kinetic] of each instrument
  addFriction(contact, coefficients) {
    const { library } = this, definition = library.call('tm_friction_def_default');
    coefficients.forEach(([still, sliding], i) => Object.assign(definition.instrument[i], { mu_static: still, mu_kinetic: sliding }));
    created(library, 'tm_stage_friction', this.pointer, contact.pointer, definition);
  }
  // Lets active cauteries remove what they touch. The tissue must be cuttable.
  addCut(contact, options = {}) { this.library.checked('tm_stage_cut', this.pointer, contact.pointer, fill(this.library.call('tm_cut_def_default'), options)); }
  // Contact of tissue with tissue: bodies touch each other and themselves; see Touch.
  addTouch(bodies = null, pairs = null, friction = [0, 0], options = {}) { return new Touch(this, bodies, pairs, friction, options); }
  // Ligaments and fat between bodies; see Ties.
  addTies(ties, options = {}) { return new Ties(this, ties, options); }
  // The stages "touch" and "ties"; null: there is none.
  get touch() { return Touch.of(this.library, this.tissue.mesh.vertexCount, this.pointer); }
  get ties() { return Ties.of(this.library, this.tissue.mesh.vertexCount, this.pointer); }
}

// Contact of up to two instruments with the tissue's surface.
export class Contact {
  constructor(world, instruments, options) {
    const { library } = world, list = library.makeArray('tm_instrument_def', instruments.length);
    instruments.forEach(({ mode = 'probe', trocar_m, radius_m = 0.0025, contact_length_m = 0.1, ...pose }, i) => {
      Object.assign(list[i], { mode: choice(mode, MODES, 'TM_TOOL_', 'mode'), is_free: trocar_m === null, trocar_m: trocar_m ?? [0, 0, 0], radius_m, contact_length_m });
      poseInto(list[i].pose, pose);
    });
    const definition = fill(library.call('tm_contact_def_default'), { instrument_count: instruments.length, instrument: list[0].address, ...options });
    Object.assign(this, { library, world, instrumentCount: instruments.length, scratch: library.make('tm_tool_pose') });
    this.pointer = created(library, 'tm_stage_contact', world.pointer, definition);
  }

  // Moves every instrument to its pose over `substeps` steps of the world, and returns the reactions.
  frame(poses, substeps, average = Math.max(1, Math.floor(substeps / 10))) {
    this.library.call('tm_contact_begin_frame', this.pointer, substeps, average);
    poses.forEach((pose, i) => {
      poseInto(this.scratch, pose);
      this.library.call('tm_contact_set_target', this.pointer, i, this.scratch, substeps);
    });
    this.world.step(substeps);
    return Array.from({ length: this.instrumentCount }, (_, i) => this.reaction(i));
  }

  // {force_N, tip_m, stiffness_N_m ...}, as Scene.reaction
  reaction(instrument = 0) {
    const struct = this.library.call('tm_contact_reaction', this.pointer, instrument), copy = struct.toObject();
    struct.free();
    return copy;
  }

  // Contact rows of the last substep: {face, vertex, weight, normal, point_m, gap_m, lambda_N ...}, copied.
  rows() { return rowsOf(this.library, this.pointer); }
}

// Grasping by instruments of mode "grasper".
export class Grasp {
  constructor(world, contact, options) {
    const { library } = world;
    this.library = library;
    this.pointer = created(library, 'tm_stage_grasp', world.pointer, contact.pointer, fill(library.call('tm_grasp_def_default'), options));
  }

  // {vertices, state}: what the jaws hold; "open", "holding" or "releasing".
  vertices(instrument = 0) {
    const { library } = this, places = library.newArray([0, 0], 'pointer');
    const count = library.call('tm_grasp_vertices', this.pointer, instrument, places, places + 4);
    const [vertex, state] = library.view(places, 2, 'pointer');
    const found = { vertices: library.view(vertex, count, 'i32').slice(), state: HELD()[state] };
    library.free(places);
    return found;
  }
}
