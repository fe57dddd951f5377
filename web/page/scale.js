// The resolution of pictures, chosen by the time that one takes. Tissue and law have priority: if the tissue is late, pictures become coarser.

// Shares of the screen's resolution; above 1 edges are smoothed.
export const SCALES = [0.35, 0.5, 0.7, 1, 2];
// SLOW_MS, FAST_MS: a picture that takes longer, or less. AT_LEAST: share of the time between two pictures that drawing must take for lateness of the tissue to
// be its fault.
const SLOW_MS = 36, FAST_MS = 12, AT_LEAST = 0.2, SLOW_COUNT = 3, FAST_COUNT = 15, PATIENCE = 40;

export class Scale {
  constructor() { Object.assign(this, { at: 1, slow: 0, fast: 0, needed: FAST_COUNT }); }

  get value() { return SCALES[this.at]; }

  // Notes a picture: its time, the time since the one before, whether the tissue was late. pixel_limit: largest useful scale.
  drawn(ms, since_ms, late) {
    const tooSlow = ms > SLOW_MS || (late && ms > AT_LEAST * since_ms);
    this.slow = tooSlow ? this.slow + 1 : 0;
    this.fast = !tooSlow && ms < FAST_MS ? this.fast + 1 : 0;
    if (this.slow >= SLOW_COUNT && this.at > 0) this.change(-1);
    // A finer scale that was too slow is tried again much later.
    else if (this.fast >= this.needed && this.at < SCALES.length - 1) this.change(1);
  }

  change(by) {
    if (by < 0) this.needed = Math.min(FAST_COUNT * PATIENCE * PATIENCE, this.needed * PATIENCE);
    Object.assign(this, { at: this.at + by, slow: 0, fast: 0 });
  }
}
