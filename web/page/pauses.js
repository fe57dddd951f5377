// Pauses of the browser: which faults of the controller they explain. Such a fault is reset; any other stays until the user resets it.
import { constants } from './lib/index.js';

export const PAUSE_MS = 15, AFTER_MS = 50;

export class Pauses {
  constructor() { Object.assign(this, { at_ms: {}, ended_ms: -Infinity }); }

  // Notes that this source (the law's timer, the device's states) ran at now_ms. Returns whether it had paused.
  ran(source, now_ms) {
    const paused = now_ms - (this.at_ms[source] ?? now_ms) > PAUSE_MS;
    this.at_ms[source] = now_ms;
    if (paused) this.ended_ms = now_ms;
    return paused;
  }

  // Forgets a source that ended on purpose.
  forget(source) { delete this.at_ms[source]; }

  // Returns whether a pause explains a fault that appears at now_ms: a late tick always, a jump of the tip shortly after a pause, as ticks are then made up
  // for and the first of them moves the complete way.
  explains(fault, now_ms) {
    return fault === constants.HRT_FAULT_TICK_LATE || (fault === constants.HRT_FAULT_ENCODER_JUMP && now_ms - this.ended_ms < AFTER_MS);
  }
}
