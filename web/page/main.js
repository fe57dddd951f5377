// The page: choices to scene settings, pointer and keys to the instrument, figures and plots.
import { View } from './view.js';
import { SCENES, choices } from './choices.js';

const $ = (id) => document.getElementById(id);
const tissue = new Worker(new URL('./tissue.worker.js', import.meta.url), { type: 'module' });
const law = new Worker(new URL('./law.worker.js', import.meta.url), { type: 'module' });
const view = new View($('view'));
const state = { chosen: {}, opened: null, held: -1, poses: [], price: {}, last: null, ready: 0, own: null, changed: null };
// For tests and the curious. fresh(n): runs n frames of the open scene from its start, along its hands; the result is state.ran.
globalThis.tensormass = { state, view, tissue, fresh: (frames) => tissue.postMessage({ kind: 'run', frames, ...state.sent, files: state.sentFiles }) };

const channel = new MessageChannel();
tissue.postMessage({ kind: 'start', port: channel.port1 }, [channel.port1]);
law.postMessage({ kind: 'start', port: channel.port2 }, [channel.port2]);

// --- scenes ---

const files = new Map();
async function fileOf(path) {
  if (!files.has(path)) files.set(path, new Uint8Array(await (await fetch(`data/${path}`)).arrayBuffer()));
  return files.get(path);
}

async function open() {
  const name = state.chosen.scene, scene = SCENES[name];
  if (state.own?.yaml) return send(state.own.yaml, state.own.files, {});
  const mesh = state.own?.mesh ?? scene.meshes[state.chosen.mesh] ?? Object.values(scene.meshes)[0];
  const yaml = new TextDecoder().decode(await fileOf(`${name}.yaml`)), content = state.own ? state.own.files : { [mesh]: await fileOf(mesh) };
  const sets = { 'tissue.mesh': mesh, 'haptics.compliance': 'iterations', rendering: null, ...choices.sets(state.chosen) };
  return send(yaml, content, sets);
}

function send(yaml, content, sets) {
  $('status').textContent = 'Building the scene ...';
  state.sent = { yaml, sets };
  state.sentFiles = content;
  tissue.postMessage({ kind: 'open', yaml, files: content, sets });
}

// --- messages of the workers ---

const fromTissue = {
  ready({ form }) { state.form = form; begin(); },
  opened(message) {
    state.opened = message;
    state.ownGood = state.own;
    $('title').textContent = message.title;
    $('status').textContent = message.warnings.join(' ');
    $('tets').textContent = message.tetCount.toLocaleString('en');
    view.open(message.rest, message.instruments);
    state.poses = message.instruments.map((i) => ({ ...i.pose, tip_m: Array.from(i.pose.tip_m) }));
    $('which').disabled = message.instruments.length < 2;
    document.body.dataset.scene = state.chosen.scene;
    hold(state.held >= message.instruments.length ? -1 : state.held);
  },
  frame(message) {
    state.last = message;
    view.frame(message.position, message.triangles, message.poses);
    if (state.held < 0) state.poses = message.poses.map((p) => ({ ...p, tip_m: Array.from(p.tip_m) }));
    figures(message);
  },
  snapshot({ bytes }) { save(new Blob([bytes]), 'tissue.snapshot'); },
  ran(message) { state.ran = message; },
  // What was open stays open.
  error({ message }) { state.own = state.ownGood ?? null; fail(message); },
};
tissue.onmessage = ({ data }) => fromTissue[data.kind](data);
law.onmessage = ({ data }) => { if (data.kind === 'law') { state.law = data; plot(data); } else begin(); };

function begin() { if (++state.ready === 2) open().catch((error) => fail(`The page's data cannot be read: ${error.message}`)); }

function fail(message) {
  state.error = message;
  $('status').textContent = '';
  $('error').querySelector('pre').textContent = message;
  if (!$('error').open) $('error').showModal();
}

// --- figures ---

function figures({ median_ms, factor, memory, stages }) {
  const { substeps, dt_s, frame_s } = state.opened;
  $('factor').textContent = `${factor.toFixed(2)}`;
  $('frame').textContent = `${median_ms.toFixed(1)} ms of ${(1000 * frame_s).toFixed(0)} ms`;
  $('substep').textContent = `${((1000 * median_ms) / substeps).toFixed(0)} us for ${(1e6 * dt_s).toFixed(0)} us`;
  $('memory').textContent = `${(memory / 1048576).toFixed(0)} MB`;
  choices.price(state, median_ms);
  if (!stages) return;
  const rows = stages.filter((s) => s.ms > 0.005).sort((a, b) => b.ms - a.ms).slice(0, 8);
  $('stages').tBodies[0].replaceChildren(...rows.map(({ name, ms }) => {
    const row = document.createElement('tr'), head = document.createElement('th'), cell = document.createElement('td');
    head.scope = 'row';
    head.textContent = name;
    cell.textContent = `${ms.toFixed(2)} ms`;
    row.append(head, cell);
    return row;
  }));
}

function plot({ now, force, sampled, late_ms, state: name, fault }) {
  $('late').textContent = `${late_ms.toFixed(1)} ms`;
  $('state').textContent = fault || name;
  const last = force.length ? force[force.length - 1] : 0;
  $('force-now').textContent = `${last.toFixed(2)} N`;
  const canvas = $('force'), style = getComputedStyle(document.body), ratio = Math.min(devicePixelRatio, 2), w = canvas.clientWidth, h = canvas.clientHeight;
  if (canvas.width !== Math.floor(w * ratio)) { canvas.width = Math.floor(w * ratio); canvas.height = Math.floor(h * ratio); }
  const c = canvas.getContext('2d');
  let top = 0.5;
  for (let i = 1; i < force.length; i += 2) top = Math.max(top, force[i]);
  const x = (t) => w - ((now - t) / 4e6) * w, y = (f) => h - 6 - (f / (1.15 * top)) * (h - 12);
  c.setTransform(ratio, 0, 0, ratio, 0, 0);
  c.clearRect(0, 0, w, h);
  c.fillStyle = style.getPropertyValue('--soft');
  c.font = '12px system-ui';
  c.fillText(`${top.toFixed(1)} N`, 4, y(top) + 4);
  c.strokeStyle = style.getPropertyValue('--accent');
  c.lineWidth = 1.5;
  c.beginPath();
  for (let i = 0; i < force.length; i += 2) c.lineTo(x(force[i]), y(force[i + 1]));
  c.stroke();
  c.fillStyle = style.getPropertyValue('--dot');
  for (let i = 0; i < sampled.length; i += 2) c.fillRect(x(sampled[i]) - 1.5, y(sampled[i + 1]) - 1.5, 3, 3);
}

// --- the instrument in the hand ---

function hold(instrument) {
  state.held = instrument;
  const held = instrument >= 0;
  view.controls.enabled = !held;
  $('take').setAttribute('aria-pressed', held);
  $('take').textContent = held ? 'Leave the instrument' : 'Take the instrument';
  $('close').disabled = !held;
  state.poses.forEach((_, i) => law.postMessage({ kind: 'hold', instrument: i, value: held }));
  tell();
}

function tell() {
  const all = state.held < 0 ? null : state.poses.map(({ tip_m, roll_rad, grip, active }) => ({ tip_m, roll_rad, grip, active }));
  tissue.postMessage({ kind: 'pose', all });
  if (all) law.postMessage({ kind: 'target', all: all.map((p) => p.tip_m) });
}

function move(by) {
  const pose = state.poses[state.held];
  if (!pose) return;
  pose.tip_m = pose.tip_m.map((p, a) => p + by[a]);
  tell();
}

function squeeze(on) {
  const pose = state.poses[state.held];
  if (!pose) return;
  pose.grip = on ? 1 : 0;
  if (state.opened.instruments[state.held].mode === 2) pose.active = on;
  $('close').setAttribute('aria-pressed', on);
  tell();
}

// Metres that one key press moves the tip.
const STEP_M = 0.0015;
const along = (axis, sign) => () => move(view.directions()[axis].map((d) => d * sign * STEP_M));
const keys = { ArrowRight: along(0, 1), ArrowLeft: along(0, -1), ArrowUp: along(1, 1), ArrowDown: along(1, -1), PageDown: along(2, 1), PageUp: along(2, -1) };

function listen() {
  const canvas = $('view'), pointers = new Map();
  canvas.addEventListener('pointerdown', (e) => { pointers.set(e.pointerId, e); canvas.setPointerCapture(e.pointerId); canvas.focus(); });
  for (const end of ['pointerup', 'pointercancel']) canvas.addEventListener(end, (e) => pointers.delete(e.pointerId));
  canvas.addEventListener('pointermove', (e) => {
    const before = pointers.get(e.pointerId), pose = state.poses[state.held];
    if (!before || !pose) return;
    if (pointers.size > 1) move(view.directions()[2].map((d) => d * (before.clientY - e.clientY) * 0.00025)); // two fingers insert
    else {
      const from = view.pointAt(before.clientX, before.clientY, pose.tip_m), to = view.pointAt(e.clientX, e.clientY, pose.tip_m);
      if (from && to) move(to.map((p, a) => p - from[a]));
    }
    pointers.set(e.pointerId, e);
  });
  canvas.addEventListener('wheel', (e) => {
    if (state.held < 0) return;
    e.preventDefault();
    move(view.directions()[2].map((d) => d * -Math.sign(e.deltaY) * STEP_M));
  }, { passive: false });
  canvas.addEventListener('keydown', (e) => {
    if (e.key === ' ') { e.preventDefault(); squeeze($('close').getAttribute('aria-pressed') !== 'true'); }
    if (!keys[e.key] || state.held < 0) return;
    e.preventDefault();
    keys[e.key]();
  });
  $('take').onclick = () => hold(state.held < 0 ? 0 : -1);
  $('which').onclick = () => hold((state.held + 1) % state.poses.length);
  $('close').onclick = () => squeeze($('close').getAttribute('aria-pressed') !== 'true');
}

// A game pad's sticks move the tip, its trigger closes; it vibrates with changes of the force.
let padded = 0;
function pad() {
  const one = navigator.getGamepads?.().find((p) => p);
  if (!one || state.held < 0) return;
  const [x = 0, y = 0, , depth = 0] = one.axes, dead = (v) => (Math.abs(v) < 0.15 ? 0 : v), [right, up, away] = view.directions();
  if (dead(x) || dead(y) || dead(depth)) move([0, 1, 2].map((a) => 0.0008 * (right[a] * dead(x) - up[a] * dead(y) - away[a] * dead(depth))));
  const closed = one.buttons[7]?.value > 0.5;
  if (closed !== pad.closed) squeeze((pad.closed = closed));
  const f = Math.hypot(...(state.law?.vector[state.held] ?? [0])), change = Math.abs(f - padded);
  padded = f;
  if (change > 0.02) one.vibrationActuator?.playEffect?.('dual-rumble', { duration: 30, strongMagnitude: Math.min(1, f / 5), weakMagnitude: Math.min(1, 5 * change) });
}

// --- own files ---

async function take(list) {
  const content = {};
  let yaml = null, mesh = null;
  for (const file of list) {
    if (/\.ya?ml$/.test(file.name)) yaml = await file.text();
    else content[file.name] = new Uint8Array(await file.arrayBuffer());
    if (/\.(msh|vtk|vtu|mesh)$/.test(file.name)) mesh = file.name;
  }
  if (!yaml && !mesh) return fail('No mesh or scene among these files; give a .msh, .vtk, .mesh or .yaml file.');
  state.own = yaml ? { yaml, files: content } : { mesh, files: content };
  if (!yaml) return send(OWN_MESH(mesh), content, { 'haptics.compliance': 'iterations' });
  return open();
}

// A scene for a mesh alone: free tissue, without supports and instruments.
const OWN_MESH = (mesh) => `title: ${mesh}
tissue:
  mesh: ${mesh}
  materials: {"*": {young: 10 kPa, poisson: 0.4, density: 1000 kg/m3}}
damping: {rate: 40 /s}
`;

function save(blob, name) {
  const link = document.createElement('a');
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

function accept() {
  addEventListener('dragover', (e) => { e.preventDefault(); document.body.classList.add('dropping'); });
  addEventListener('dragleave', () => document.body.classList.remove('dropping'));
  addEventListener('drop', (e) => { e.preventDefault(); document.body.classList.remove('dropping'); take(e.dataTransfer.files); });
  $('file').onchange = (e) => take(e.target.files);
  $('save-yaml').onclick = () => save(new Blob([choices.written(state.sent)]), 'scene.yaml');
  $('save-snapshot').onclick = () => tissue.postMessage({ kind: 'snapshot' });
  $('save-picture').onclick = () => $('view').toBlob((blob) => save(blob, 'tissue.png'));
}

// --- start ---

document.addEventListener('visibilitychange', () => {
  for (const worker of [tissue, law]) worker.postMessage({ kind: 'hidden', value: document.hidden });
});
choices.show($('choices'), state, (name) => {
  if (name === 'extrapolator') law.postMessage({ kind: 'extrapolator', name: state.chosen.extrapolator });
  else { state.own = name === 'scene' ? null : state.own; open(); }
});
listen();
accept();
(function drawn() { pad(); view.draw(); requestAnimationFrame(drawn); })();
