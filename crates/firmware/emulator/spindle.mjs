// A spindle with an encoder at the pins of inputs 0, 1 and 2: it turns as the card's outputs ask for, with a swing of its
// speed, and what an axis does in a thread is compared with its true angle.
//
// Invariant: it sees the pins alone, and the axis is judged by the true angle, not by what the encoder shows.

const [A, B, INDEX] = [16, 17, 18];
const [CLOCKWISE, COUNTERCLOCKWISE] = [14, 15];
const HERTZ = 125e6;
/** Cycles of a step of the model. */
const STEP = 500;
/** Acceleration and coasting, in revolutions per second squared. */
const ACCELERATION = 200;
/** Levels of A (bit 0) and B (bit 1) of four counts up. */
const CIRCLE = [0b00, 0b01, 0b11, 0b10];
/** The axis that cuts, and its places between which it has the thread's pitch, in pulses. */
const AXIS = 2;
const AT_PITCH = [-1700, 700];

export class Spindle {
  /**
   * `words`: counts a turn, revolutions per minute at the full output for S, the part of the speed by which it swings, and
   * the pitch of the thread in pulses.
   */
  constructor(board, scope, words) {
    [this.counts, this.most, this.swing, this.pitch] = words.split(',').map(Number);
    [this.board, this.scope] = [board, scope];
    /** In revolutions, and per second; the index is at every whole one. */
    [this.angle, this.speed, this.count] = [0.35, 0, undefined];
    this.begin = this.next = board.cycles;
    this.isDead = false;
    /** By pass: revolutions per minute, control periods, and the places of the axis less those of its helix, in pulses. */
    this.passes = [];
    this.show();
    board.spindle = this;
    board.mcu.gpio[25].addListener(() => board.mcu.gpio[25].value === 1 && this.judge());
  }

  /** Angle in this cycle. */
  angleAt(cycle) {
    return this.angle + (this.speed * (cycle - this.begin)) / HERTZ;
  }

  /** Does what is due until this cycle: an edge, or a step of the model. */
  drive(end) {
    while (this.next <= end) {
      if (this.next >= this.begin + STEP) this.step();
      this.show(this.next);
      this.next = Math.min(this.begin + STEP, this.nextEdge());
    }
  }

  step() {
    const { gpio } = this.board.mcu;
    this.angle = this.angleAt(this.begin + STEP);
    this.begin += STEP;
    const direction = (gpio[CLOCKWISE].value === 1) - (gpio[COUNTERCLOCKWISE].value === 1);
    const [high, all] = this.scope.pwmCycle();
    const swing = 1 + this.swing * Math.sin((2 * Math.PI * 5 * this.begin) / HERTZ);
    const asked = (direction * (this.most / 60) * swing * high) / all;
    const change = (ACCELERATION * STEP) / HERTZ;
    this.speed += Math.max(-change, Math.min(change, asked - this.speed));
  }

  /** The cycle of the next count, within this step or behind it. */
  nextEdge() {
    if (this.speed === 0) return Infinity;
    const bound = this.speed > 0 ? this.count + 1 : this.count;
    const cycle = this.begin + ((bound / this.counts - this.angle) * HERTZ) / this.speed;
    // just behind the edge
    return Math.max(this.next + 1, Math.ceil(cycle + 1e-3));
  }

  show(cycle = this.begin) {
    const count = Math.floor(this.angleAt(cycle) * this.counts);
    if (this.isDead || count === this.count) return;
    this.count = count;
    const { gpio } = this.board.mcu;
    const levels = CIRCLE[count & 3];
    gpio[A].setInputValue((levels & 1) !== 0);
    gpio[B].setInputValue((levels & 2) !== 0);
    gpio[INDEX].setInputValue(count % this.counts === 0);
  }

  /** At the begin of a control period. */
  judge() {
    const at = this.scope.net[AXIS];
    const isCutting = at < this.at && at > AT_PITCH[0] && at < AT_PITCH[1];
    if (isCutting && !this.isCutting) this.passes.push({ rpm: 0, periods: 0, off: [Infinity, -Infinity] });
    this.isCutting = isCutting;
    this.at = at;
    if (!isCutting || this.isDead) return;
    const pass = this.passes.at(-1);
    const place = at + this.pitch * this.angleAt(this.board.cycles);
    // in the last pitch, so that passes can be compared
    this.helix ??= place;
    const off = ((place - this.helix + this.pitch * 1000.5) % this.pitch) - this.pitch / 2;
    pass.off = [Math.min(pass.off[0], off), Math.max(pass.off[1], off)];
    pass.rpm += (60 * this.speed - pass.rpm) / ++pass.periods;
  }
}
