// The tissue: steps the scene in real time, sends pictures to the painter, figures to the page, force samples to the law.
import { Mesh, Scene, constants, load, readLog } from './lib/index.js';
import { sceneFor } from './own_mesh.js';

let library, scene, law, pictures, form, timer = 0, hidden = false, sent = -1, generation = 0;
let poses = null, next = 0, load_ms = [], reportsOf = null, firstRun = null, trouble = 'none', away = 0, playing = null, shown = {}, waiting = false, flying = 0;
// Frames that are on their way to the painter: one may be drawn while the next is computed.
const FLYING_MAX = 3;

const messages = {
  // form, module: of the library, compiled; undefined: it is loaded here.
  async start({ port, pictures: painter, form, module }) {
    law = port;
    pictures = painter;
    pictures.onmessage = () => { flying--; }; // the painter has drawn a frame, or has a newer one
    library = await load({ form, wasmModule: module });
    postMessage({ kind: 'ready', form: library.form });
  },
  open({ yaml, files, sets, name }) {
    clearTimeout(timer);
    const before = scene;
    try {
      scene = new Scene(library, yaml, { files, sets, name });
    } catch (error) {
      scene = before;
      postMessage({ kind: 'error', message: error.message });
      schedule(0);
      return;
    }
    before?.close();
    generation++;
    load_ms = [];
    firstRun = null;
    poses = null;
    const instruments = Array.from({ length: scene.instrumentCount }, (_, i) => scene.instrument(i));
    law.postMessage({ kind: 'instruments', instruments, frame_s: scene.frame_s });
    timed(true);
    present(instruments);
    postMessage({
      kind: 'opened', generation, title: scene.title, instruments, tetCount: scene.tetCount, frame_s: scene.frame_s, dt_s: scene.dt_s, substeps: scene.substeps,
      warnings: scene.warnings, duration_s: scene.duration_s, ...corners(scene.rest_m),
    });
    next = performance.now();
    schedule(0);
  },
  // A mesh by itself: a scene is made for it.
  mesh({ name, files, sets }) {
    try {
      const mesh = Mesh.read(library, files[name], { name }), yaml = sceneFor(name, mesh.rest_m);
      mesh.free();
      postMessage({ kind: 'made', yaml });
      messages.open({ yaml, files, sets });
    } catch (error) {
      postMessage({ kind: 'error', message: error.message });
    }
  },
  // Plays a recorded session: its tissue, tools and forces, at its own pace.
  play({ bytes }) {
    try {
      const { channels, skipped } = readLog(bytes);
      if (!channels.TISSUE) throw new Error(`the log has no TISSUE channel, only ${Object.keys(channels).join(', ')}; record a scene with 'rendering:'`);
      playing = { channels, frame: 0, skipped };
      schedule(0);
    } catch (error) {
      postMessage({ kind: 'error', message: error.message });
    }
  },
  live() {
    if (playing) present(Array.from({ length: scene.instrumentCount }, (_, i) => scene.instrument(i)));
    playing = null;
    next = performance.now();
    postMessage({ kind: 'live' });
    schedule(0);
  },
  trouble({ value }) { trouble = value; },
  // The page has shown the last figures. A slow page receives fewer, so that none queue up.
  taken() { waiting = false; },
  // Which marks the page shows: {patch, rows}.
  show({ marks }) { shown = marks; },
  pose({ all }) { poses = all; },
  hidden({ value }) { hidden = value; next = performance.now(); if (!hidden) schedule(0); },
  snapshot() { try { postMessage({ kind: 'snapshot', bytes: scene.save() }); } catch (error) { postMessage({ kind: 'error', message: error.message }); } },
  // Runs this many frames of another copy of the scene at once, along its hands.
  run({ frames, yaml, files, sets }) {
    const copy = new Scene(library, yaml, { files, sets });
    for (let i = 0; i < frames; i++) copy.step();
    postMessage({ kind: 'ran', hash: copy.hash, force: copy.reaction(0).force_N, frames: copy.frames });
    copy.close();
  },
};
onmessage = ({ data }) => messages[data.kind](data);

function timed(on) {
  const world = library.call('tm_scene_world', scene.pointer);
  if (world) library.call('tm_world_set_timing', world, on);
}

function schedule(ms) { clearTimeout(timer); timer = setTimeout(frame, Math.max(0, ms)); }

function frame() {
  if (hidden) return;
  if (playing) { play(); return; }
  if (!scene) return;
  const begun = performance.now(), t_us = (performance.timeOrigin + begun) * 1000;
  let reactions;
  try {
    reactions = scene.step(troubled());
  } catch (error) {
    postMessage({ kind: 'error', message: error.message });
    return;
  }
  const ms = performance.now() - begun;
  load_ms.push(ms);
  if (load_ms.length > 50) load_ms.shift();
  sample(reactions, t_us);
  draw(reactions, t_us);
  next = Math.max(next + 1000 * scene.frame_s, performance.now() - 100);
  schedule(next - performance.now());
}

// The poses of this frame. A tool that jumps does so once a second, by 15 mm; one that stands still stays where it is.
function troubled() {
  if (trouble !== 'jumps' && trouble !== 'still') return poses;
  const now = (poses ?? Array.from({ length: scene.instrumentCount }, (_, i) => scene.pose(i))).map((p) => ({ ...p, tip_m: Array.from(p.tip_m) }));
  const jump = trouble === 'jumps' && scene.frames % Math.round(1 / scene.frame_s) === 0;
  if (jump) away = away ? 0 : 0.015;
  return jump ? now.map((p) => ({ ...p, tip_m: p.tip_m.map((x, a) => (a === 2 ? x + (away ? 0.015 : -0.015) : x)) })) : now;
}

// Triangles of a recorded surface: those that cuts exposed last.
function recorded({ triangle, triangle_kind }) {
  const parts = [[], []];
  triangle_kind.forEach((kind, i) => parts[kind ? 1 : 0].push(triangle[3 * i], triangle[3 * i + 1], triangle[3 * i + 2]));
  return { triangles: Uint32Array.from(parts.flat()), own: parts[0].length / 3 };
}

// Instruments {trocar_m, radius_m, mode, tip_m, force_N} of a SIM_STATUS; none: it is missing.
function toolsOf(status) {
  const three = (values, i) => values.slice(3 * i, 3 * i + 3);
  return Array.from({ length: status?.instrument_count ?? 0 }, (_, i) =>
    ({ trocar_m: three(status.trocar_m, i), radius_m: status.radius_m[i], mode: status.mode[i], tip_m: three(status.tip_m, i), force_N: three(status.force_N, i) }));
}

// Shows one frame of a recorded session, and asks for the next.
function play() {
  const all = playing.channels.TISSUE, { message, utime_us } = all[playing.frame], first = !playing.shown;
  const tools = toolsOf((playing.channels.SIM_STATUS ?? []).filter((m) => m.utime_us <= utime_us).at(-1)?.message), tips = tools.map((tool) => tool.tip_m);
  const position = Float32Array.from(message.vertex_m), held = Float32Array.from(message.tie_m);
  if (first) pictures.postMessage({ kind: 'open', rest: position, instruments: tools, supports: new Float32Array(0), ties: held, ...corners(position) });
  playing.shown = true;
  flying++;
  pictures.postMessage({ kind: 'frame', position, ...recorded(message), tips, ties: held });
  postMessage({
    kind: 'played', triangles: message.triangle_count, ties: message.tie_total ? [message.tie_count, message.tie_total] : null, forces: tools.map((tool) => tool.force_N),
    frame: playing.frame, frames: all.length, time_s: Number(message.sim_utime) / 1e6, first, ...corners(position),
  });
  playing.frame = (playing.frame + 1) % all.length;
  const wait_ms = playing.frame ? (all[playing.frame].utime_us - utime_us) / 1000 : 1000;
  schedule(Math.min(1000, wait_ms));
}

function sample(reactions, t_us) {
  reactions.forEach((reaction, i) => {
    const patch = scene.patch(i);
    const bytes = patch ? library.bytes.slice(patch.address, patch.address + library.classOf('tm_patch').size) : null;
    law.postMessage({ kind: 'sample', instrument: i, reaction, pose: scene.pose(i), t_us, patch: bytes }, bytes ? [bytes.buffer] : []);
  });
}

let original = new Set(), ties = null;

// Triangles of the organ's own surface first, then those that cuts exposed; own: number of the first.
function sorted({ count, triangles, faces }) {
  if (sent < 0) original = new Set(faces);
  const first = [], last = [];
  for (let i = 0; i < count; i++) (original.has(faces[i]) ? first : last).push(triangles[3 * i], triangles[3 * i + 1], triangles[3 * i + 2]);
  return { triangles: Uint32Array.from(first.concat(last)), own: first.length / 3 };
}

// {bodies: the body of each vertex, colours: of bodies but for the largest, which has that of tissue; rigid ones are grey}; nothing for one body.
const OTHERS = [0x6f8a3a, 0x3f8080, 0x8a5092, 0xa9762d, 0x55649c];
function tints() {
  const { bodies } = scene, size = (body) => (body.rigid ? 0 : body.tet_end - body.tet_begin), largest = bodies.reduce((most, body, b) => (size(body) > size(bodies[most]) ? b : most), 0);
  if (!bodies.length) return {};
  const of = new Uint8Array(scene.vertexCount);
  bodies.forEach(({ vertex_begin, vertex_end }, b) => of.fill(b, vertex_begin, vertex_end));
  let other = 0;
  return { bodies: of, colours: bodies.map(({ rigid }, b) => (rigid ? 0x9a9c9e : b === largest ? null : OTHERS[other++ % OTHERS.length])) };
}

// Ends of the ties that hold, [6n] m.
const holding = () => (ties ? Float32Array.from(ties.ends_m({ whole: true })) : new Float32Array(0));

// Vertices of the patch of instrument 0, [3n] m, if they are shown.
function patchOf() {
  const patch = shown.patch && scene.instrumentCount ? scene.patch(0) : null;
  return patch ? Float32Array.from(patch.vertex_m.subarray(0, 3 * patch.vertex_count)) : new Float32Array(0);
}

// Contact rows of the last substep, if they are shown: point on the surface, m; normal from the tool to the tissue; force on the tissue, N; seven numbers each.
function rowsOf() {
  if (!shown.rows) return new Float32Array(0);
  const rows = scene.rows(), u = scene.displacement_m, rest = scene.rest_m; // views last: a call may move the memory
  return Float32Array.from(rows.flatMap(({ vertex, weight, normal, lambda_N }) =>
    [...[0, 1, 2].map((a) => vertex.reduce((sum, v, k) => sum + weight[k] * (rest[3 * v + a] + u[3 * v + a]), 0)), ...normal, lambda_N]));
}

// Rest positions of vertices with a prescribed component.
function supported() {
  const world = library.call('tm_scene_world', scene.pointer), count = 3 * scene.vertexCount, found = [];
  if (!world) return new Float32Array(0);
  const mask = library.allocate(count);
  library.view(mask, count, 'u8').fill(0);
  library.call('tm_support_mask', world, mask);
  const rest = scene.rest_m;
  for (let i = 0; i < rest.length; i += 3) if (library.bytes[mask + i] || library.bytes[mask + i + 1] || library.bytes[mask + i + 2]) found.push(rest[i], rest[i + 1], rest[i + 2]);
  library.free(mask);
  return Float32Array.from(found);
}

// Gives the painter the scene's organ and instruments.
function present(instruments) {
  sent = -1;
  ties = scene.ties;
  const position = positions(), surface = sorted(scene.surface);
  sent = scene.surface.revision;
  pictures.postMessage({ kind: 'open', rest: position, ...surface, instruments, supports: supported(), ties: holding(), ...tints(), ...corners(scene.rest_m) }, [position.buffer, surface.triangles.buffer]);
}

// Corners of the box around positions [3n].
function corners(position) {
  const low_m = [Infinity, Infinity, Infinity], high_m = [-Infinity, -Infinity, -Infinity];
  position.forEach((x, i) => { low_m[i % 3] = Math.min(low_m[i % 3], x); high_m[i % 3] = Math.max(high_m[i % 3], x); });
  return { low_m, high_m };
}

function draw(reactions, t_us) {
  if (waiting && flying >= FLYING_MAX) return;
  const poses = reactions.map((_, i) => scene.pose(i)), rows = rowsOf();
  if (flying < FLYING_MAX) picture(poses, rows);
  if (!waiting) figures(reactions, poses, rows, t_us);
}

// Positions of all vertices, [3n] m.
function positions() {
  const u = scene.displacement_m, rest = scene.rest_m, position = new Float32Array(u.length);
  for (let i = 0; i < u.length; i++) position[i] = rest[i] + u[i];
  return position;
}

// Sends the positions to the painter, and the triangles if they changed.
function picture(poses, rows) {
  flying++;
  const position = positions(), late = performance.now() > next + 1000 * scene.frame_s;
  const surface = scene.surface, changed = surface.revision !== sent;
  const parts = changed ? sorted(surface) : { triangles: null };
  sent = surface.revision;
  pictures.postMessage({ kind: 'frame', position, ...parts, tips: poses.map((p) => p.tip_m), ties: holding(), patch: patchOf(), rows, late }, changed ? [position.buffer, parts.triangles.buffer] : [position.buffer]);
}

function figures(reactions, poses, rows, t_us) {
  waiting = true;
  const times = [...load_ms].sort((a, b) => a - b), median = times[times.length >> 1];
  postMessage({
    kind: 'frame', generation, rows, ties: ties && [ties.whole.filter(Boolean).length, ties.count], energy: balance(), reactions, poses, time_s: scene.time_s, alive: scene.aliveCount,
    median_ms: median, factor: (1000 * scene.frame_s) / median, memory: library.bytes.length, used: library.bytesUsed, t_us, stages: stages(),
  });
}

// Energy that contact generated and that no term explains, of all that hands did, J; null if the scene has no account.
function balance() {
  const world = library.call('tm_scene_world', scene.pointer), account = (balance.account ??= library.make('tm_energy'));
  if (!world || library.call('tm_world_energy', world, account, null) !== constants.TM_OK) return null;
  return { generated_J: account.generated_J, residual_J: account.residual_J, put_in_J: account.tool_work_J.reduce((sum, w) => sum + Math.abs(w), 0) };
}

// Mean time of each stage in a frame, ms; null between its updates.
function stages() {
  const world = library.call('tm_scene_world', scene.pointer);
  if (!world || scene.frames % 10) return null;
  const reports = (reportsOf ??= library.makeArray('tm_stage_report', constants.TM_MAX_STAGES));
  const count = library.call('tm_world_stages', world, reports[0]), first = firstRun ?? { frames: 0, seconds: {} };
  const now = Object.fromEntries(reports.slice(0, count).map((r) => [r.name, r.seconds]));
  const frames = scene.frames - first.frames;
  firstRun = { frames: scene.frames, seconds: now };
  return Object.entries(now).map(([name, seconds]) => ({ name, ms: (1000 * (seconds - (first.seconds[name] ?? 0))) / frames }));
}
