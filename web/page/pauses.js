// Pauses of the browser: which faults of the controller they explain. Such a fault is reset; any other stays until the user resets it.
import { constants } from './lib/index.js';

export const PAUSE_MS = 12, AFTER_MS = 50, STUCK_MS = 1000;

export class Pauses {
  constructor() { Object.assign(this, { at_ms: {}, ended_ms: -Infinity, withheld_ms: -Infinity }); }

  // Notes that this source (the law's timer, the device's states) ran at now_ms. Returns whether it had paused.
  ran(source, now_ms) {
    const paused = now_ms - (this.at_ms[source] ?? now_ms) > PAUSE_MS;
    this.at_ms[source] = now_ms;
    if (paused) this.ended_ms = now_ms;
    return paused;
  }

  // Notes that less than the law's force reached the device at now_ms (haply.worker.js withholds it in a pause, and ramps it up afterwards).
  withheld(now_ms) { this.withheld_ms = now_ms; }

  // Forgets a source that ended on purpose.
  forget(source) { delete this.at_ms[source]; }

  // Returns whether a pause explains a fault that appears at now_ms: a late tick always, a jump of the tip shortly after a pause, as ticks are then made up
  // for and the first of them moves the complete way; an encoder that stands still although the force changed, if that force did not reach the device.
  explains(fault, now_ms) {
    if (fault === constants.HRT_FAULT_ENCODER_STUCK) return now_ms - this.withheld_ms < STUCK_MS;
    return fault === constants.HRT_FAULT_TICK_LATE || (fault === constants.HRT_FAULT_ENCODER_JUMP && now_ms - this.ended_ms < AFTER_MS);
  }
}
