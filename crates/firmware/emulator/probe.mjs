// A probe and the surfaces under it: its contact closes where an axis has made so many pulses.
//
// Invariant: it sees the pins alone. The contact closes a given time after the pulse that reaches the surface, and opens
// with the pulse that leaves it; the next surface is in force once the axis has gone back over it.

/** Pulses that the axis goes back until the next surface is in force. */
const BACK = 10;

export class Probe {
  /** `words`: the axis, the input's pin, and the surfaces, each as pulses below the start, `:`, and cycles of delay. */
  constructor(board, scope, words) {
    const [axis, pin, ...surfaces] = words.split(',');
    this.axis = +axis;
    this.pin = board.mcu.gpio[+pin];
    this.surfaces = surfaces.map((surface) => surface.split(':').map(Number));
    this.closed = false;
    this.net = 0;
    scope.onPulse = (of) => of === this.axis && this.move(board, scope.net[of]);
  }

  move(board, net) {
    if (this.surfaces.length === 0) return;
    const [depth, delay] = this.surfaces[0];
    const goesDown = net < this.net;
    this.net = net;
    if (!this.closed && goesDown && net === -depth) {
      this.closed = true;
      board.after(delay, () => this.pin.setInputValue(!this.closed));
    } else if (this.closed && net > -depth) {
      this.pin.setInputValue(true);
      if (net >= -depth + BACK) {
        this.closed = false;
        this.surfaces.shift();
      }
    }
  }
}
