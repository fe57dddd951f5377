// Scenes: the YAML files that tm-sim runs, advanced frame by frame.
import { Ties, Touch } from './bodies.js';
import { TensormassError, constants } from './runtime.js';

let opened = 0;

// One scene. Instruments follow the scene's hands or the poses that you give. Vertices keep the numbers of the mesh file.
export class Scene {
  // yaml: text of the scene. files: {path: text or bytes} that the scene names, by paths relative to it. sets: values that replace the scene's,
  // {"time.frame_rate": 50, "gravity": null} (null removes a key); one thread unless they say otherwise. Throws with "scene.yaml:line: what; what to do". Warnings are in `warnings`.
  constructor(library, yaml, { files = {}, sets = {}, name = 'scene.yaml', progress = null } = {}) {
    this.library = library;
    this.warnings = [];
    this.folder = `/scene${opened++}`;
    writeFiles(library.fs, this.folder, { ...files, [name]: yaml });
    this.diagnostics = library.make('tm_diagnostics');
    this.pointer = this.open(`${this.folder}/${name}`, sets, progress);
    this.info = library.call('tm_scene_get_info', this.pointer);
  }

  open(path, sets, progress) {
    const { library } = this, definition = library.call('tm_scene_def_default');
    const lines = Object.entries({ threads: 1, ...sets }).map(([key, value]) => library.newText(value === null ? key : `${key}=${yamlOf(value)}`));
    const list = library.newArray(lines, 'pointer'), file = library.newText(path), place = library.newArray([0], 'pointer');
    let callback = 0;
    if (progress) callback = library.module.addFunction((user, what, done, left) => Number(progress(library.text(what), done, left) !== false), 'iiidd');
    definition.file = file;
    definition.set = list;
    definition.set_count = lines.length;
    definition.diagnostics = this.diagnostics.address;
    definition.progress = callback;
    library.fs.chdir(this.folder); // paths in `sets` are relative to the scene, too
    const status = library.call('tm_scene_open', definition, place), pointer = library.view(place, 1, 'pointer')[0];
    library.fs.chdir('/');
    if (callback) library.module.removeFunction(callback);
    [...lines, list, file, place].forEach((address) => library.free(address));
    this.raise(status);
    return pointer;
  }

  // Reads the diagnostics since the last call; throws if `status` is an error.
  raise(status, sentence = '') {
    const { library, diagnostics } = this, faults = [], text = library.allocate(8192);
    for (let i = 0; i < diagnostics.count; i++) {
      const item = library.at('tm_diagnostic', diagnostics.item + i * library.classOf('tm_diagnostic').size);
      library.call('tm_diagnostic_format', item, text, 8192);
      const line = library.text(text).replaceAll(`${this.folder}/`, '');
      if (item.severity === constants.TM_FAULT) faults.push(line);
      else this.warnings.push(line);
    }
    library.free(text);
    library.call('tm_diagnostics_clear', diagnostics);
    if (status !== constants.TM_OK) throw new TensormassError(faults.join('\n') || sentence || library.statusName(status), library.statusName(status));
  }

  get title() { return this.info.title; }
  get model() { return this.info.model; }
  get vertexCount() { return this.info.vertex_count; }
  get tetCount() { return this.info.tet_count; }
  get instrumentCount() { return this.info.instrument_count; }
  get frame_s() { return this.info.frame_s; }
  get dt_s() { return this.info.dt_s; }
  get substeps() { return this.info.substeps; }
  get duration_s() { return this.info.duration_s; }
  // Simulated time, s; frames that are done; active tetrahedra.
  get time_s() { return this.now().time_s; }
  get frames() { return Number(this.now().frames); }
  get aliveCount() { return this.now().alive_count; }

  now() {
    const info = this.library.call('tm_scene_get_info', this.pointer), copy = info.toObject();
    info.free();
    return copy;
  }

  // Advances one frame: moves each instrument to its pose {tip_m, roll_rad, grip, active}, or along the scene's hand (none given). Returns the reactions.
  step(poses = null) {
    const { library } = this;
    let to = null;
    if (poses) {
      if (poses.length !== this.instrumentCount) throw new TensormassError(`${poses.length} poses for ${this.instrumentCount} instruments; give one each`);
      this.poses ??= library.makeArray('tm_tool_pose', this.instrumentCount);
      poses.forEach((pose, i) => poseInto(this.poses[i], pose));
      to = this.poses[0] ?? null;
    }
    const status = library.call('tm_scene_step', this.pointer, to);
    this.raise(status, `frame ${this.frames + 1}: a displacement or a force stopped being finite; the frame has not happened`);
    return Array.from({ length: this.instrumentCount }, (_, i) => this.reaction(i));
  }

  // Runs complete frames for this long (none: the scene's duration). each(scene) is called after every frame; false stops.
  run(seconds = this.duration_s, each = null) {
    const total = Math.floor(seconds / this.frame_s + 0.5);
    for (let i = 0; i < total; i++) {
      this.step();
      if (each && each(this) === false) break;
    }
    return this;
  }

  // {time_s, tip_m, force_N, resultant_N, stiffness_N_m, stiffness_kind, row_count, flags}: reaction on the tool in the last frame.
  reaction(instrument = 0) { return this.read('tm_scene_reaction', instrument); }
  // {tip_m, roll_rad, grip, active} at the end of the last frame.
  pose(instrument = 0) { return this.read('tm_scene_pose', instrument); }
  // {mode, trocar_m, radius_m, contact_length_m, pose}: the instrument at its first pose.
  instrument(instrument = 0) { return this.read('tm_scene_instrument', instrument); }

  read(name, instrument) {
    if (!(instrument >= 0 && instrument < this.instrumentCount)) throw new TensormassError(`instrument ${instrument} does not exist; give 0 to ${this.instrumentCount - 1}`);
    const struct = this.library.call(name, this.pointer, instrument), copy = struct.toObject();
    struct.free();
    return copy;
  }

  // The struct tm_patch of the last frame for Controller, null if the scene sends none or no surface is near. Valid until the next frame.
  patch(instrument = 0) {
    const address = this.library.call('tm_scene_patch', this.pointer, instrument);
    return address ? this.library.at('tm_patch', address) : null;
  }

  // Contact rows of the last substep, as Contact.rows; none in the precomputed model.
  rows() {
    const contact = this.library.call('tm_scene_contact', this.pointer);
    return contact ? rowsOf(this.library, contact) : [];
  }

  // [{name, rigid, vertex_begin, vertex_end, tet_begin, tet_end}]: ranges of each body's vertices and tetrahedra; none with tissue.mesh.
  get bodies() {
    const { library } = this, found = library.makeArray('tm_scene_body', constants.TM_MAX_BODIES);
    const count = library.call('tm_scene_get_bodies', this.pointer, found[0], found.length), bodies = found.slice(0, count).map((body) => body.toObject());
    found[0].free();
    return bodies;
  }
  // Contact of tissue with tissue, and ties, of the scene; null: it names none.
  get touch() { return Touch.of(this.library, this.vertexCount, this.library.call('tm_scene_world', this.pointer)); }
  get ties() { return Ties.of(this.library, this.vertexCount, this.library.call('tm_scene_world', this.pointer)); }

  // [3 * vertexCount] displacements, m: a view; get it again after a frame.
  get displacement_m() { return this.library.view(this.library.call('tm_scene_displacement', this.pointer), 3 * this.vertexCount); }

  // [3 * vertexCount] rest positions, m: a view.
  get rest_m() { return this.library.view(this.meshStruct.rest_m, 3 * this.vertexCount); }
  // [4 * tetCount] vertices of the tetrahedra: a view.
  get tets() { return this.library.view(this.meshStruct.tet, 4 * this.tetCount, 'i32'); }
  get meshStruct() { return this.library.at('tm_mesh', this.library.call('tm_scene_mesh', this.pointer)); }

  // {count, revision, triangles, faces}: the surface that can be touched; [3 * count] vertices, normals outward. Views: get it again after a frame.
  get surface() {
    const s = this.library.call('tm_scene_surface', this.pointer), { count, revision, triangle, face } = s;
    s.free();
    return { count, revision, triangles: this.library.view(triangle, 3 * count, 'i32'), faces: this.library.view(face, count, 'i32') };
  }

  // Hash of the state's bits, as tm-sim prints it.
  get hash() { return this.library.call('tm_scene_hash', this.pointer).toString(16).padStart(16, '0'); }

  // Returns a snapshot, as tm-sim --snapshot writes it.
  save() {
    const path = `${this.folder}/snapshot`;
    this.raise(this.library.call('tm_scene_save', this.pointer, path));
    const bytes = this.library.fs.readFile(path);
    this.library.fs.unlink(path);
    return bytes;
  }

  // Restores a snapshot of the same scene; a damaged one throws and changes nothing.
  restore(bytes) {
    const path = `${this.folder}/snapshot`;
    this.library.fs.writeFile(path, bytes);
    try {
      this.raise(this.library.call('tm_scene_restore', this.pointer, path));
    } finally {
      this.library.fs.unlink(path);
    }
  }

  // Frees the scene. Its views are invalid afterwards.
  close() {
    if (!this.pointer) return;
    this.library.call('tm_scene_close', this.pointer);
    this.pointer = 0;
    for (const struct of [this.info, this.diagnostics, this.poses?.[0]]) struct?.free();
    removeFolder(this.library.fs, this.folder);
  }
}

// Contact rows of a tm_contact: {face, vertex, instrument, station, feature, share, weight, normal, point_m, gap_m, lambda_N}, copied.
export function rowsOf(library, contact) {
  const place = library.newArray([0], 'pointer'), count = library.call('tm_contact_rows', contact, place), first = library.view(place, 1, 'pointer')[0];
  library.free(place);
  return Array.from({ length: count }, (_, i) => library.at('tm_contact_row', first + i * library.classOf('tm_contact_row').size).toObject());
}

// Writes a pose {tip_m, roll_rad, grip, active, direction of a free instrument} to a struct tm_tool_pose.
export function poseInto(struct, { tip_m, roll_rad = 0, grip = 0, active = true, direction = [0, 0, -1] }) {
  struct.tip_m = tip_m;
  struct.roll_rad = roll_rad;
  struct.grip = grip;
  struct.active = active;
  struct.direction = direction;
}

function yamlOf(value) {
  if (Array.isArray(value)) return `[${value.map(yamlOf).join(', ')}]`;
  return typeof value === 'boolean' ? (value ? 'yes' : 'no') : String(value);
}

// Writes files below a folder of the module's memory; ".." in a name stays within the root.
function writeFiles(fs, folder, files) {
  for (const [name, content] of Object.entries(files)) {
    const parts = `${folder}/${name}`.split('/').reduce((path, part) => (part === '..' ? path.slice(0, -1) : part && part !== '.' ? [...path, part] : path), []);
    for (let i = 1; i < parts.length; i++) if (!fs.analyzePath(`/${parts.slice(0, i).join('/')}`).exists) fs.mkdir(`/${parts.slice(0, i).join('/')}`);
    fs.writeFile(`/${parts.join('/')}`, content);
  }
}

function removeFolder(fs, folder) {
  if (!fs.analyzePath(folder).exists) return;
  for (const name of fs.readdir(folder).filter((n) => n !== '.' && n !== '..')) {
    const path = `${folder}/${name}`;
    if (fs.isDir(fs.stat(path).mode)) removeFolder(fs, path);
    else fs.unlink(path);
  }
  fs.rmdir(folder);
}
