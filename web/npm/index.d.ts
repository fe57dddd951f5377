export type Vector = ArrayLike<number> & Iterable<number>;

/** An error of the library: what is wrong; what to do. */
export class TensormassError extends Error {
  status: string;
  entity: number;
}

/** The loaded library. Only one thread may use it; a worker loads its own. */
export class Library {
  readonly form: 'simd' | 'plain';
  /** Bytes that the library's objects use. */
  readonly bytesInUse: number;
  /** Bytes of all allocated blocks, also those of structs that were made here. */
  readonly bytesUsed: number;
  /** Calls a function of the C interface by name. */
  call(name: string, ...values: unknown[]): any;
  /** Calls a set-up function, whose last argument is the error, and throws that error. */
  checked(name: string, ...values: unknown[]): void;
  /** Returns a zeroed struct of the C interface, with a property for each field. */
  make(name: string): any;
}

export function load(options?: { form?: 'best' | 'simd' | 'plain'; wasmBinary?: BufferSource; wasmModule?: WebAssembly.Module }): Promise<Library>;
/** Whether this machine's WebAssembly has 128-bit vectors. */
export function hasSimd(): boolean;
export const constants: Readonly<Record<string, number>>;

export interface Pose {
  /** m, world */
  tip_m: Vector;
  roll_rad?: number;
  /** 0 open to 1 closed */
  grip?: number;
  active?: boolean;
  /** of a free instrument: along the shaft, towards the tip */
  direction?: Vector;
}

export interface Reaction {
  time_s: number;
  tip_m: number[];
  /** On the tool, N. */
  force_N: number[];
  resultant_N: number[];
  /** dF/dP, row by row, N/m. */
  stiffness_N_m: number[];
  stiffness_kind: number;
  row_count: number;
  flags: number;
}

/** A station of an instrument against a feature of the surface, in the last substep. */
export interface ContactRow {
  face: number;
  vertex: number[];
  instrument: number;
  station: number;
  feature: number;
  share: number;
  /** Barycentric, of `vertex`. */
  weight: number[];
  /** Unit vector from the tool to the tissue. */
  normal: number[];
  /** Centre of the station on the tool's axis, m. */
  point_m: number[];
  gap_m: number;
  /** Force on the tissue along the normal, N. */
  lambda_N: number;
}

export interface Instrument {
  mode: number;
  is_free: boolean;
  trocar_m: number[];
  radius_m: number;
  contact_length_m: number;
  pose: Required<Pose>;
}

export interface Surface {
  count: number;
  /** Increases by one with every change. */
  revision: number;
  /** [3 * count] vertices, normals outward. */
  triangles: Int32Array;
  /** [count] persistent ids. */
  faces: Int32Array;
}

export interface SceneOptions {
  /** Files that the scene names, by paths relative to it. */
  files?: Record<string, string | Uint8Array>;
  /** Values that replace the scene's; null removes a key. */
  sets?: Record<string, unknown>;
  name?: string;
  progress?: (what: string, fraction: number, secondsLeft: number) => boolean | void;
}

export class Scene {
  constructor(library: Library, yaml: string, options?: SceneOptions);
  readonly warnings: string[];
  readonly title: string;
  readonly model: string;
  readonly vertexCount: number;
  readonly tetCount: number;
  readonly instrumentCount: number;
  readonly frame_s: number;
  readonly dt_s: number;
  readonly substeps: number;
  readonly duration_s: number;
  readonly time_s: number;
  readonly frames: number;
  readonly aliveCount: number;
  readonly displacement_m: Float64Array;
  readonly rest_m: Float64Array;
  readonly tets: Int32Array;
  readonly surface: Surface;
  readonly hash: string;
  step(poses?: Pose[] | null): Reaction[];
  run(seconds?: number, each?: ((scene: Scene) => boolean | void) | null): this;
  reaction(instrument?: number): Reaction;
  pose(instrument?: number): Required<Pose>;
  instrument(instrument?: number): Instrument;
  /** The struct tm_patch of the last frame, null if there is none. Valid until the next frame. */
  patch(instrument?: number): any;
  rows(): ContactRow[];
  /** Ranges of each body's vertices and tetrahedra; none with tissue.mesh. */
  readonly bodies: { name: string; rigid: boolean; vertex_begin: number; vertex_end: number; tet_begin: number; tet_end: number }[];
  readonly touch: Touch | null;
  readonly ties: Ties | null;
  save(): Uint8Array;
  restore(bytes: Uint8Array): void;
  close(): void;
}

export type Extrapolator = 'hold' | 'time' | 'position' | 'broyden' | 'tangent' | 'local_model' | 'paper_position' | 'adaptive';
export const extrapolators: Extrapolator[];

export class Controller {
  constructor(library: Library, options?: {
    axis?: Vector; up?: Vector; trocar_m?: Vector; extrapolator?: Extrapolator; values?: Record<string, number | number[]>; session?: bigint;
  });
  readonly state: 'boot' | 'self_test' | 'idle' | 'engaged' | 'stale' | 'fault';
  readonly fault: string;
  select(name: Extrapolator): void;
  joints(tip_m: Vector): number[] | null;
  sample(reaction: Reaction, t_us: number, patch?: any, unilateral?: boolean): string;
  tick(t_us: number, tip_m: number[], options?: { enable?: boolean; passivity?: boolean; coupling?: boolean; reset?: boolean; bus_ok?: boolean }): any;
  free(): void;
}

/** Rest positions and topology, named as in Python. free() objects in the reverse order of their creation. */
export class Mesh {
  constructor(library: Library, vertices: ArrayLike<number>, tets: ArrayLike<number>, regions?: ArrayLike<number> | null);
  static read(library: Library, content: string | Uint8Array, options?: { name?: string; scale?: number }): Mesh;
  /** A box of cubes of six tetrahedra each. */
  static block(library: Library, size_m: number[], cells: number[], origin_m?: number[]): Mesh;
  readonly vertexCount: number;
  readonly tetCount: number;
  /** [3 * vertexCount] m */
  readonly rest_m: Float64Array;
  readonly tets: Int32Array;
  readonly groups: Record<string, Int32Array>;
  /** Vertices within within_m of a plane. */
  near(point_m: number[], normal: number[], within_m?: number): Int32Array;
  free(): void;
}

export type Law = 'linear' | 'neo-hooke' | 'st-venant-kirchhoff' | 'mooney-rivlin' | 'fung' | 'holzapfel';

export class Material {
  static young(library: Library, young_Pa: number, poisson: number, options?: { density_kg_m3?: number; damping_1_s?: number }): Material;
  /** E_L, E_T in Pa, nu_LT, nu_TT, G_L in Pa. */
  static engineering(library: Library, constants: number[], options?: { density_kg_m3?: number; damping_1_s?: number }): Material;
  withLaw(law: Law, options?: { stretch_max?: number; values?: number[] }): this;
}

export class Tissue {
  /** options: fields of tm_tissue_def. */
  constructor(mesh: Mesh, materials: Material | Material[], options?: { fibres?: ArrayLike<number> | null; [field: string]: unknown });
  readonly mesh: Mesh;
  readonly mass_kg: Float64Array;
  readonly aliveCount: number;
  free(): void;
}

export interface InstrumentDefinition extends Pose {
  mode?: 'probe' | 'grasper' | 'cautery';
  /** null: no trocar; the pose holds the shaft's direction. */
  trocar_m: Vector | null;
  radius_m?: number;
  contact_length_m?: number;
}

export class World {
  /** options: fields of tm_world_def. */
  constructor(tissue: Tissue, options?: Record<string, unknown>);
  readonly tissue: Tissue;
  /** [3 * vertexCount] m: a view; get it again after a step. */
  readonly u_m: Float64Array;
  readonly force_N: Float64Array;
  readonly time_s: number;
  readonly dt_s: number;
  readonly hash: string;
  step(count?: number): void;
  addGravity(g_m_s2?: number[]): void;
  addSupport(vertices: ArrayLike<number>, value_m?: number[]): void;
  addContact(instruments: InstrumentDefinition[], options?: Record<string, unknown>): Contact;
  addGrasp(contact: Contact, options?: Record<string, unknown>): Grasp;
  addFriction(contact: Contact, coefficients: [number, number][]): void;
  addCut(contact: Contact, options?: Record<string, unknown>): void;
  /** See Touch. */
  addTouch(bodies?: ArrayLike<number> | null, pairs?: [number, number][] | null, friction?: [number, number], options?: Record<string, unknown>): Touch;
  addTies(ties: Tie[], options?: Record<string, unknown>): Ties;
  readonly touch: Touch | null;
  readonly ties: Ties | null;
  free(): void;
}

export class Contact {
  readonly instrumentCount: number;
  frame(poses: Pose[], substeps: number, average?: number): Reaction[];
  reaction(instrument?: number): Reaction;
  rows(): ContactRow[];
}

export class Grasp {
  vertices(instrument?: number): { vertices: Int32Array; state: 'open' | 'holding' | 'releasing' };
}

/** A vertex against a face (vertex[0] against the others), or an edge against an edge (vertex[2], vertex[3] against vertex[0], vertex[1]). */
export interface TouchRow {
  edges: number;
  a: number;
  b: number;
  vertex: number[];
  weight: number[];
  normal: number[];
  thickness_m: number;
  gap_m: number;
  lambda_N: number;
  across_N: number[];
}

/** Contact of bodies with each other and with themselves. Add it after contact, if there is any. */
export class Touch {
  /** bodies: [tetCount] body of each tetrahedron, from 0; null: one body. pairs: those that touch, a body twice for itself; null: all.
   * friction: [static, kinetic]. options: fields of tm_touching_def. */
  constructor(world: World, bodies?: ArrayLike<number> | null, pairs?: [number, number][] | null, friction?: [number, number], options?: Record<string, unknown>);
  /** Copies; vertex j bears weight[j] * (lambda_N * normal + across_N), N. */
  rows(): TouchRow[];
  /** [3 * vertexCount] N, of the last substep. */
  readonly force_N: Float64Array;
  readonly report: { rows: number; candidates: number; gathers: number; overflowed: boolean; deepest_m: number };
}

/** A spring that pulls and never pushes, from a vertex to a point of another surface. */
export class Tie {
  /** The point of the vertices other [3] with the barycentric weight [3]. rest_m: length up to which it is slack. break_N: breaking load, 0: none. */
  constructor(vertex: number, other: number[], weight: number[], rest_m: number, stiffness_N_m: number, break_N?: number);
  /** To the nearest point, at rest, of triangles [3n]. null: each triangle has the vertex. */
  static toNearest(mesh: Mesh, vertex: number, triangles: ArrayLike<number> & Iterable<number>, stiffness_N_m: number, break_N?: number): Tie | null;
  vertex: number;
  other: number[];
  weight: number[];
  rest_m: number;
  stiffness_N_m: number;
  break_N: number;
}

/** Ligaments and fat between bodies. Add them after contact, if there is any. */
export class Ties {
  /** options: fields of tm_ties_def. */
  constructor(world: World, ties: Tie[], options?: Record<string, unknown>);
  readonly count: number;
  readonly whole: boolean[];
  /** [count] N, of the last substep. */
  readonly force_N: Float64Array;
  /** [6 * count] both ends of each, m; with whole, only of those that hold. */
  ends_m(options?: { whole?: boolean }): Float64Array;
  /** Ties that went since the last call; why: the instrument that cut it, -1: its load broke it, -2: the tissue at an end went. */
  fetchCut(): { tie: Int32Array; why: Int32Array };
}

/** An LCM log (tm-sim --record, lcm-logger) as messages, one list a channel. */
export function readLog(bytes: Uint8Array): { channels: Record<string, { utime_us: number; type: string; message: any }[]>; skipped: number };
