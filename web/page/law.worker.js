// The force law: haptic-rt's tick, 500 times a second, between the simulation's samples. Without a device the pointer acts as the hand.
import { Controller, load } from './lib/index.js';
import { Pauses } from './pauses.js';

// SHARE: of the way to the pointer's target that the tip moves in a tick, a time constant of 20 ms, as a hand has; at most STEP_MAX_M (1 m/s).
const TICK_US = 2000, HISTORY = 2000, SHARE = 0.1, STEP_MAX_M = 0.002;
let library, controllers = [], tips = [], targets = [], extrapolator = 'adaptive', tick_us = 0, hidden = false, told = 0, trouble = 'none', count = 0;
let late = [], force = [], sampled = [], device = null, cursor = null, reasons = {}, waiting = false, pauses = new Pauses();

const messages = {
  // form, module: of the library, compiled; undefined: it is loaded here.
  async start({ port, form, module }) {
    library = await load({ form, wasmModule: module });
    port.onmessage = ({ data }) => messages[data.kind](data);
    setInterval(run, 1);
    postMessage({ kind: 'ready' });
  },
  instruments({ instruments }) {
    controllers.forEach((c) => { c.received.free(); c.free(); });
    tips = instruments.map((i) => Array.from(i.pose.tip_m));
    targets = tips.map((t) => [...t]);
    controllers = instruments.map((i) => controllerOf(i));
    force = [];
    sampled = [];
    cursor = null;
  },
  extrapolator({ name }) {
    extrapolator = name;
    controllers.forEach((c) => c.select(name));
  },
  // The pointer's or script's newest target of each tip.
  target({ all }) { all.forEach((tip, i) => { if (targets[i]) targets[i] = tip; }); },
  hidden({ value }) { hidden = value; },
  // The user resets the fault of each controller.
  reset() { controllers.forEach((c) => { c.reset = true; }); },
  trouble({ value }) { trouble = value; },
  sample(message) {
    count++;
    const delay = { late: 100, lost: count % 2 ? Infinity : 0 }[trouble] ?? 0;
    if (delay === Infinity) return;
    if (delay) setTimeout(take, delay, message);
    else take(trouble === 'forged' && count % 3 === 0 ? { ...message, reaction: { ...message.reaction, force_N: [NaN, 1e9, 0] } } : message);
  },
  // The page has shown the last report.
  taken() { waiting = false; },
  hold({ instrument, value }) { if (controllers[instrument]) controllers[instrument].held = value; },
  // A device holds instrument 0. port: to the worker that owns its connection (haply.worker.js); null: there is none.
  device({ port }) {
    device?.close();
    device = port;
    cursor = null;
    pauses.forget('device');
    if (port) port.onmessage = ({ data }) => felt(data.tip_m, data.buttons, data.gain);
  },
};
onmessage = ({ data }) => messages[data.kind](data);

function take({ instrument, reaction, pose, t_us, patch }) {
  const c = controllers[instrument];
  if (!c || hidden) return;
  if (patch) library.bytes.set(patch, c.received.address);
  const why = c.sample(reaction, t_us, patch ? c.received : null, c.unilateral);
  if (why) reasons[why] = (reasons[why] ?? 0) + 1;
  if (!c.held && !device) targets[instrument] = Array.from(pose.tip_m);
  if (instrument === 0 && !why) sampled.push([t_us, Math.hypot(...reaction.force_N)]);
  if (sampled.length > 200) sampled.shift();
}

// A new state of the device: the tip moves as far as the cursor did since it was taken. The page is told 50 times a second, and of the button at once.
// gain: share of the force that reaches the device.
function felt(at_m, buttons, gain) {
  pauses.ran('device', performance.now());
  if (gain < 1) pauses.withheld(performance.now());
  if (!targets[0]) return;
  cursor ??= { from_m: at_m.map((x, a) => x - targets[0][a]), told_ms: -Infinity, closed: false };
  targets[0] = at_m.map((x, a) => x - cursor.from_m[a]);
  tips[0] = [...targets[0]];
  const now = performance.now();
  if (now - cursor.told_ms < 20 && buttons.a === cursor.closed) return;
  Object.assign(cursor, { told_ms: now, closed: buttons.a });
  postMessage({ kind: 'cursor', tip_m: targets[0], closed: buttons.a });
}

function controllerOf({ trocar_m, pose, mode }) {
  const axis = pose.tip_m.map((p, a) => p - trocar_m[a]), up = Math.abs(axis[2]) > 0.9 * Math.hypot(...axis) ? [0, 1, 0] : [0, 0, 1];
  const c = new Controller(library, { trocar_m, axis, up, extrapolator });
  c.received = library.make('tm_patch');
  c.unilateral = mode === 0;
  c.held = c.reset = false;
  return c;
}

const now_us = () => (performance.timeOrigin + performance.now()) * 1000;

// Ticks that are due; after a pause of 0.1 s they are not made up for. A device's worker receives the newest force with the time of its tick.
function run() {
  const now = now_us();
  pauses.ran('law', performance.now());
  if (hidden || now - tick_us > 100000) tick_us = now - TICK_US;
  if (hidden) force = [];
  for (; tick_us + TICK_US <= now; ) {
    tick_us += TICK_US;
    late.push(now - tick_us);
    controllers.forEach((c, i) => tick(c, i));
  }
  device?.postMessage({ N: controllers[0] ? Array.from(controllers[0].result.force_N) : [0, 0, 0], at_ms: performance.now() });
  if (late.length > 2000) late.splice(0, late.length - 2000);
  if (force.length > HISTORY) force.splice(0, force.length - HISTORY);
  if (!waiting && now - told > 50000) report(now);
}

function tick(c, i) {
  const way = targets[i].map((x, a) => x - tips[i][a]), share = Math.min(SHARE, STEP_MAX_M / Math.hypot(...way));
  tips[i] = tips[i].map((x, a) => x + way[a] * share);
  const before = c.result.fault, result = c.tick(tick_us, tips[i], { enable: !hidden, reset: c.reset });
  c.reset = result.fault !== before && pauses.explains(result.fault, performance.now());
  if (i === 0) force.push([tick_us, Math.hypot(...result.force_N)]);
}

function report(now) {
  told = now;
  waiting = true;
  const sorted = [...late].sort((a, b) => a - b);
  postMessage({
    kind: 'law', now, force: new Float64Array(force.flat()), sampled: new Float64Array(sampled.flat()), late_ms: (sorted[Math.floor(sorted.length * 0.99)] ?? 0) / 1000,
    state: controllers[0]?.state ?? '-', fault: controllers[0]?.fault ?? '', vector: controllers.map((c) => Array.from(c.result.force_N)), reasons: { ...reasons },
    memory: library.bytes.length, used: library.bytesUsed,
  });
}
