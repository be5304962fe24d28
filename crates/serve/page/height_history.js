// Keeps the last minute of arc voltage, target and height of the tool.
//
// Invariant: it has room for so many samples, once and for all; a new one replaces the oldest. A figure that is not
// known is NaN.

/** Time that is kept, ms. */
export const HISTORY_MS = 60_000;
/** A minute of live messages, at most 60 a second, with room to spare. */
const CAPACITY = 4096;
/** At rest, what is not reported anew for this time has not changed. In motion such a gap is one of a slow link. */
const UNCHANGED_MS = 150;

/** The torch is on. */
export const TORCH_ON = 1;
/** Height control holds the height. */
export const HEIGHT_HELD = 2;
/** The torch cuts: its height and its voltage are those that matter. */
export const CUTTING = 4;
/** The machine is at rest. */
export const AT_REST = 8;

/** Samples in the order of their times. */
export class HeightHistory {
  constructor() {
    this.times = new Float64Array(CAPACITY);
    this.volts = new Float32Array(CAPACITY);
    this.targets = new Float32Array(CAPACITY);
    this.heights = new Float32Array(CAPACITY);
    this.marks = new Uint8Array(CAPACITY);
    this.first = this.length = 0;
  }

  get capacity() {
    return CAPACITY;
  }

  /** Place of a sample in the arrays, counted from the oldest one. */
  slot(index) {
    return (this.first + index) % CAPACITY;
  }

  /** Adds a sample. At rest the one before it is right until shortly before. */
  add(time, volts, target, height, marks) {
    if (this.length > 0) {
      const last = this.slot(this.length - 1);
      if ((this.marks[last] & AT_REST) !== 0 && time - this.times[last] > UNCHANGED_MS) {
        this.push(time - 1, this.volts[last], this.targets[last], this.heights[last], this.marks[last]);
      }
    }
    this.push(time, volts, target, height, marks);
  }

  push(time, volts, target, height, marks) {
    if (this.length === CAPACITY) {
      this.first = this.slot(1);
      this.length--;
    }
    const slot = this.slot(this.length++);
    this.times[slot] = time;
    this.volts[slot] = volts;
    this.targets[slot] = target;
    this.heights[slot] = height;
    this.marks[slot] = marks;
  }

  /** Forgets what is older than is kept, up to the sample that was right at that time. */
  trim(now) {
    while (this.length > 1 && this.times[this.slot(1)] < now - HISTORY_MS) {
      this.first = this.slot(1);
      this.length--;
    }
  }
}
