// The page: choices to scene settings, messages of the workers to view, figures and plots.
import { choices } from './choices.js';
import { device } from './device.js';
import { figures, plot, tied } from './figures.js';
import { accept, save } from './files.js';
import { hold, listen, pad, place } from './hand.js';
import { Pace } from './pace.js';
import { choicesOf, filesOf, setsOf } from './scenes.js';
import { $, fail, law, state, tissue, view } from './state.js';

// For tests and the curious. fresh(n): runs n frames of the open scene from its start, along its hands; the result is state.ran.
globalThis.tensormass = { state, view, tissue, law, fresh: (frames) => tissue.postMessage({ kind: 'run', frames, ...state.sent, files: state.sentFiles }) };

view.start();

// --- scenes ---

const { fileOf } = globalThis.boot;

async function open() {
  const name = state.chosen.scene;
  if (state.own?.yaml) return send(state.own.yaml, state.own.files, {});
  if (state.own?.mesh) return tissue.postMessage({ kind: 'mesh', name: state.own.mesh, files: state.own.files, sets: choices.sets(state.chosen) });
  const meshes = filesOf(name, state.chosen.mesh), [text, ...contents] = await Promise.all([`${name}.yaml`, ...meshes].map(fileOf)), yaml = new TextDecoder().decode(text);
  const files = Object.fromEntries(meshes.map((mesh, i) => [mesh, contents[i]]));
  return send(yaml, files, { 'haptics.compliance': 'iterations', ...(/^rendering:/m.test(yaml) ? { rendering: null } : {}), ...setsOf(name, meshes, state.chosen), ...choicesOf(name, choices.sets(state.chosen)) });
}

function send(yaml, content, sets) {
  $('status').textContent = 'Building the scene ...';
  state.sent = { yaml, sets };
  state.sentFiles = content;
  tissue.postMessage({ kind: 'open', yaml, files: content, sets });
}

function choose(name) {
  if (name === 'extrapolator') return law.postMessage({ kind: 'extrapolator', name: state.chosen.extrapolator });
  if (name === 'hard') for (const worker of [tissue, law]) worker.postMessage({ kind: 'trouble', value: state.chosen.hard });
  state.own = name === 'scene' ? null : state.own;
  if (name === 'scene') tissue.postMessage({ kind: 'live' });
  return open();
}

// --- messages of the workers ---

const pace = new Pace();
function tellPace({ time_s, median_ms }) {
  const text = pace.frame({ at_ms: performance.now(), time_s, ms: median_ms, frame_s: state.opened.frame_s });
  $('slow').hidden = !text;
  if (text && $('slow').textContent !== text) $('slow').textContent = text;
}
function forgetPace() {
  pace.forget();
  $('slow').hidden = true;
}

const fromTissue = {
  ready({ form }) {
    state.form = form;
    open().catch((error) => fail(`The page's data cannot be read: ${error.message}`));
  },
  made({ yaml }) { state.sent = { yaml, sets: choices.sets(state.chosen) }; state.sentFiles = state.own.files; },
  opened(message) {
    law.start();
    state.opened = { ...message, number: (state.opened?.number ?? 0) + 1 };
    state.ownGood = state.own;
    state.opening = false;
    state.played = null;
    forgetPace();
    $('live').hidden = true;
    choices.tell(state);
    $('title').textContent = message.title;
    $('status').textContent = message.warnings.join(' ');
    $('tets').textContent = message.tetCount.toLocaleString('en');
    view.open(message);
    state.poses = message.instruments.map((i) => ({ ...i.pose, tip_m: Array.from(i.pose.tip_m) }));
    $('which').disabled = message.instruments.length < 2;
    document.body.dataset.scene = state.chosen.scene;
    hold(state.held >= message.instruments.length ? -1 : state.held);
  },
  frame(message) {
    tissue.postMessage({ kind: 'taken' });
    if (state.played || state.opening) return; // of another surface
    state.last = message;
    if (state.held < 0) state.poses = message.poses.map((p) => ({ ...p, tip_m: Array.from(p.tip_m) }));
    figures(message);
    tellPace(message);
  },
  // A frame of a recorded session.
  played(message) {
    if (message.first || !state.played) {
      forgetPace();
      view.open(message);
      $('live').hidden = false;
    }
    state.played = message;
    tied(message.ties);
    $('title').textContent = `Recorded session: frame ${message.frame + 1} of ${message.frames}, ${message.time_s.toFixed(2)} s`;
    $('force-now').textContent = `${Math.hypot(...(message.forces[0] ?? [0])).toFixed(2)} N`;
  },
  live() { if (state.played) { state.played = null; state.opening = true; open(); } },
  snapshot({ bytes }) { save(new Blob([bytes]), 'tissue.snapshot'); },
  ran(message) { state.ran = message; },
  // The previous scene stays open.
  error({ message }) { state.own = state.ownGood ?? null; fail(message); },
};
const fromLaw = {
  ready() {},
  law(message) { law.postMessage({ kind: 'taken' }); state.law = message; plot(message); },
  cursor({ tip_m, closed }) { place(tip_m, closed); },
};
const fromDevice = {
  device({ text }) { state.device = text; $('device').textContent = text; if (text.startsWith('Inverse3') && state.held < 0) hold(0); },
  sent(message) {
    state.force = message;
    $('device').textContent = `${state.device}: ${message.sent_N.toFixed(2)} N sent, ${message.sent} messages, interrupted ${message.trips} times${message.why ? `; no force, as ${message.why}` : ''}`;
  },
};
tissue.onmessage = ({ data }) => fromTissue[data.kind](data);
law.onmessage = ({ data }) => fromLaw[data.kind](data);

// --- start ---

document.addEventListener('visibilitychange', () => {
  for (const worker of [tissue, law]) worker.postMessage({ kind: 'hidden', value: document.hidden });
  device.hidden(document.hidden);
  forgetPace();
});
addEventListener('pagehide', () => device.hidden(true));
$('connect').onclick = () => {
  const on = $('connect').getAttribute('aria-pressed') !== 'true';
  $('connect').setAttribute('aria-pressed', on);
  $('connect').textContent = on ? 'Disconnect' : 'Connect';
  if (on) device.connect($('service').value, (message) => fromDevice[message.kind](message));
  else device.disconnect();
  state.device = $('device').textContent = on ? 'connecting' : 'not connected';
};
const shown = {};
for (const kind of ['supports', 'patch', 'rows']) {
  $(`show-${kind}`).onclick = ({ target }) => {
    shown[kind] = target.getAttribute('aria-pressed') !== 'true';
    target.setAttribute('aria-pressed', shown[kind]);
    view.show(kind, shown[kind]);
    $('contact-row').hidden = !shown.rows;
    tissue.postMessage({ kind: 'show', marks: shown });
  };
}
$('reset').onclick = () => law.postMessage({ kind: 'reset' });
$('live').onclick = () => tissue.postMessage({ kind: 'live' });
choices.show($('choices'), state, choose);
if (state.chosen.hard !== 'none') for (const worker of [tissue, law]) worker.postMessage({ kind: 'trouble', value: state.chosen.hard });
law.postMessage({ kind: 'extrapolator', name: state.chosen.extrapolator });
listen();
accept();
(function drawn() { pad(); view.controls.update(); requestAnimationFrame(drawn); })();
