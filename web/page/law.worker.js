// The force law: haptic-rt's tick, 500 times a second, between the simulation's samples. Without a device the hand is the pointer.
import { Controller, load } from './lib/index.js';

const TICK_US = 2000, HISTORY = 2000;
let library, controllers = [], tips = [], targets = [], extrapolator = 'adaptive', tick_us = 0, hidden = false, told = 0;
let late = [], force = [], sampled = [];

const messages = {
  async start({ port }) {
    library = await load();
    port.onmessage = ({ data }) => messages[data.kind](data);
    setInterval(run, 1);
    postMessage({ kind: 'ready' });
  },
  instruments({ instruments }) {
    controllers.forEach((c) => c.free());
    tips = instruments.map((i) => Array.from(i.pose.tip_m));
    targets = tips.map((t) => [...t]);
    controllers = instruments.map((i) => controllerOf(i));
    force = [];
    sampled = [];
  },
  extrapolator({ name }) {
    extrapolator = name;
    controllers.forEach((c) => c.select(name));
  },
  // The pointer's or script's newest target of each tip; the tip follows with a time constant of 20 ms, as a hand does.
  target({ all }) { all.forEach((tip, i) => { if (targets[i]) targets[i] = tip; }); },
  hidden({ value }) { hidden = value; },
  sample({ instrument, reaction, pose, t_us, patch }) {
    const c = controllers[instrument];
    if (!c || hidden) return;
    if (patch) library.bytes.set(patch, c.received.address);
    c.sample(reaction, t_us, patch ? c.received : null, c.unilateral);
    if (!c.held) targets[instrument] = Array.from(pose.tip_m);
    if (instrument === 0) sampled.push([t_us, Math.hypot(...reaction.force_N)]);
    if (sampled.length > 200) sampled.shift();
  },
  hold({ instrument, value }) { if (controllers[instrument]) controllers[instrument].held = value; },
};
onmessage = ({ data }) => messages[data.kind](data);

function controllerOf({ trocar_m, pose, mode }) {
  const axis = pose.tip_m.map((p, a) => p - trocar_m[a]), up = Math.abs(axis[2]) > 0.9 * Math.hypot(...axis) ? [0, 1, 0] : [0, 0, 1];
  const c = new Controller(library, { trocar_m, axis, up, extrapolator });
  c.received = library.make('tm_patch');
  c.unilateral = mode === 0;
  c.held = false;
  return c;
}

const now_us = () => (performance.timeOrigin + performance.now()) * 1000;

// Ticks that are due; after a pause of more than 100 ms they are not made up for.
function run() {
  const now = now_us();
  if (hidden || now - tick_us > 100000) tick_us = now - TICK_US;
  if (hidden) force = [];
  for (; tick_us + TICK_US <= now; ) {
    tick_us += TICK_US;
    late.push(now - tick_us);
    controllers.forEach((c, i) => {
      tips[i] = tips[i].map((x, a) => x + (targets[i][a] - x) * 0.1);
      const result = c.tick(tick_us, tips[i], { enable: !hidden });
      if (i === 0) force.push([tick_us, Math.hypot(...result.force_N)]);
    });
  }
  if (late.length > 2000) late.splice(0, late.length - 2000);
  if (force.length > HISTORY) force.splice(0, force.length - HISTORY);
  if (now - told > 50000) report(now);
}

function report(now) {
  told = now;
  const sorted = [...late].sort((a, b) => a - b);
  postMessage({
    kind: 'law', now, force: new Float64Array(force.flat()), sampled: new Float64Array(sampled.flat()), late_ms: (sorted[Math.floor(sorted.length * 0.99)] ?? 0) / 1000,
    state: controllers[0]?.state ?? '-', fault: controllers[0]?.fault ?? '', vector: controllers.map((c) => Array.from(c.result.force_N)),
  });
}
