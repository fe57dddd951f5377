// The law's worker under a clock of its own: node law.mjs WORKER -> JSON: the controller's state and fault after jumps of the tip, with and without pauses.
import { pathToFileURL } from 'node:url';

const AXIS = 2, seen = {};
let clock_ms = 1000, run, told, cursor_m = [0, 0, 0], ready;
Object.defineProperty(globalThis, 'performance', { value: { timeOrigin: 1.7e12, now: () => clock_ms } });
globalThis.setInterval = (f) => { run = f; };
globalThis.onmessage = null;
globalThis.postMessage = (message) => {
  if (message.kind === 'ready') ready();
  if (message.kind !== 'law') return;
  told = message;
  onmessage({ data: { kind: 'taken' } });
};
const send = (kind, more = {}) => onmessage({ data: { kind, ...more } });
await import(pathToFileURL(process.argv[2]));
await new Promise((resolve) => { ready = resolve; send('start', { port: {} }); });
const trocar_m = [0.05, 0.05, 0.18], tip_m = [0.05, 0.05, 0.1], device = { postMessage() {}, close() {} };
send('instruments', { instruments: [{ trocar_m, pose: { tip_m }, mode: 0 }] });

const move = (m) => { cursor_m = cursor_m.map((x, a) => (a === AXIS ? x + m : x)); };
// Runs the worker for this long, a tick's timer every millisecond, a device's state (if there is one) every second one.
function pass(ms) {
  for (let i = 0; i < ms; i++) {
    clock_ms++;
    if (device.onmessage && i % 2 === 0) device.onmessage({ data: { tip_m: cursor_m, buttons: { a: false }, gain: 1 } });
    run();
  }
  return [told.state, told.fault];
}
seen.start = pass(500);
send('target', { all: [[0.05, 0.05, 0.05]] });
seen.pointer = pass(500); // the pointer's hand follows at a hand's speed
send('device', { port: device });
seen.device = pass(500);
move(-0.02);
seen.jump = pass(2000); // nothing explains it
send('reset');
seen.reset = pass(500);
clock_ms += 60;
move(0.02);
seen.pause = pass(500); // the ticks of 60 ms are made up for
pass(200);
clock_ms += 400;
seen.late = pass(500);
move(-0.02);
seen.again = pass(500);
console.log(JSON.stringify(seen));
process.exit(0);
