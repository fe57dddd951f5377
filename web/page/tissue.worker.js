// The tissue: steps the scene in real time, sends positions and figures to the page, force samples to the law.
import { Scene, constants, load } from './lib/index.js';

let library, scene, law, form, timer = 0, hidden = false, sent = -1, generation = 0;
let poses = null, next = 0, load_ms = [], reportsOf = null, firstRun = null;

const messages = {
  async start({ port }) {
    law = port;
    library = await load();
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
    sent = -1;
    load_ms = [];
    firstRun = null;
    poses = null;
    const instruments = Array.from({ length: scene.instrumentCount }, (_, i) => scene.instrument(i));
    law.postMessage({ kind: 'instruments', instruments, frame_s: scene.frame_s });
    timed(true);
    postMessage({
      kind: 'opened', title: scene.title, instruments, tetCount: scene.tetCount, frame_s: scene.frame_s, dt_s: scene.dt_s, substeps: scene.substeps,
      warnings: scene.warnings, duration_s: scene.duration_s, rest: Float32Array.from(scene.rest_m),
    });
    next = performance.now();
    schedule(0);
  },
  pose({ all }) { poses = all; },
  hidden({ value }) { hidden = value; next = performance.now(); if (!hidden) schedule(0); },
  snapshot() { try { postMessage({ kind: 'snapshot', bytes: scene.save() }); } catch (error) { postMessage({ kind: 'error', message: error.message }); } },
  // Runs so many frames of another copy of the scene at once, along its hands.
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
  if (!scene || hidden) return;
  const begun = performance.now(), t_us = (performance.timeOrigin + begun) * 1000;
  let reactions;
  try {
    reactions = scene.step(poses);
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

function sample(reactions, t_us) {
  reactions.forEach((reaction, i) => {
    const patch = scene.patch(i);
    const bytes = patch ? library.bytes.slice(patch.address, patch.address + library.classOf('tm_patch').size) : null;
    law.postMessage({ kind: 'sample', instrument: i, reaction, pose: scene.pose(i), t_us, patch: bytes }, bytes ? [bytes.buffer] : []);
  });
}

function draw(reactions, t_us) {
  const u = scene.displacement_m, rest = scene.rest_m, position = new Float32Array(u.length);
  for (let i = 0; i < u.length; i++) position[i] = rest[i] + u[i];
  const surface = scene.surface, changed = surface.revision !== sent;
  const triangles = changed ? Uint32Array.from(surface.triangles) : null;
  sent = surface.revision;
  const sorted = [...load_ms].sort((a, b) => a - b), median = sorted[sorted.length >> 1];
  postMessage({
    kind: 'frame', generation, position, triangles, reactions, poses: reactions.map((_, i) => scene.pose(i)), time_s: scene.time_s, alive: scene.aliveCount,
    median_ms: median, factor: (1000 * scene.frame_s) / median, memory: library.bytes.length, t_us, stages: stages(),
  }, triangles ? [position.buffer, triangles.buffer] : [position.buffer]);
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
