// The instrument in the hand: pointer, touch, keys, game pad.
import { $, law, state, tissue, view } from './state.js';

export function hold(instrument) {
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

// A device's newest place of the tip; its button closes.
export function place(tip_m, closed) {
  const pose = state.poses[0];
  if (!pose || state.held !== 0) return;
  pose.tip_m = tip_m;
  tissue.postMessage({ kind: 'pose', all: state.poses.map(({ tip_m: at, roll_rad, grip, active }) => ({ tip_m: at, roll_rad, grip, active })) });
  if (closed !== place.closed) squeeze((place.closed = closed));
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

export function listen() {
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
export function pad() {
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

