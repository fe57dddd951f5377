// Whether the tissue keeps up with real time, and what follows if it does not, in words.
const PAST_MS = 2000, SLOW = 0.9, FAST = 0.95;
// Age of a sample from which the controller fades its force (docs/controller.md).
const FADES_MS = 100;

export class Pace {
  constructor() { this.forget(); }
  // Another scene, or a pause: nothing is known.
  forget() { Object.assign(this, { seen: [], rate: null, slow: false }); }
  // A frame was shown at at_ms, with the simulated time time_s; computed in ms, to be frame_s long. Returns the sentences, '' if it keeps up or not enough was seen.
  frame({ at_ms, time_s, ms, frame_s }) {
    this.seen.push([at_ms, time_s]);
    while (this.seen.length > 2 && this.seen[1][0] <= at_ms - PAST_MS) this.seen.shift();
    const [from_ms, from_s] = this.seen[0];
    if (at_ms - from_ms < PAST_MS) return '';
    this.rate = (1000 * (time_s - from_s)) / (at_ms - from_ms);
    this.slow = this.rate < (this.slow ? FAST : SLOW);
    return this.slow ? this.words(ms, frame_s) : '';
  }
  words(ms, frame_s) {
    const oldest_ms = ms + (1000 * frame_s) / Math.max(this.rate, 0.001);
    return `Too slow for real time: ${this.rate.toFixed(2)} s are simulated in a second, so tissue and scripted hands move in slow motion. `
      + `The force at the hand follows samples that become about ${oldest_ms.toFixed(0)} ms old; beyond ${FADES_MS} ms it fades to zero until the next sample. Choose a coarser mesh or a cheaper law, or close other programs.`;
  }
}
