// What the pins of the card do: pulses by control period, compared with the words that the firmware has put for it.
//
// Invariant: it sees levels and cycles alone; the words are decoded here, not by the firmware.

const AXES = 4;
const FIRST_STEP = 2;
const FIRST_DIRECTION = 6;
const GATE = 25;
export const OUTPUTS = [10, 11, 12, 13, 14, 15, 26];
export const SPINDLE_PWM = 22;
const FRAME_TICKS = 7;
/** Cycles without an edge of the output for S after which it is steady: two of its cycles at 5 kHz. */
const STEADY = 50_000;

const none = () => Array(AXES).fill(0);

export class Scope {
  constructor(board) {
    this.board = board;
    this.direction = none();
    this.net = none();
    this.pulses = 0;
    this.wrong = [];
    this.late = { opening: 0, motion: 0, at: [] };
    this.worst = { high: Infinity, low: Infinity, before: Infinity, behind: Infinity, most: 0 };
    this.rose = none().fill(-Infinity);
    this.fell = none().fill(-Infinity);
    this.turned = none().fill(-Infinity);
    this.lastEdge = 0;
    /** Net pulses that were put for the period that is being filled. */
    this.filling = none();
    this.ordered = [];
    this.periods = 0;
    this.seen = undefined;
    /** Called with the net pulses of every period at its end. */
    this.onPeriod = undefined;
    /** Called with the axis of every pulse. */
    this.onPulse = undefined;
    /** The output for S: its last edges, the begin of the cycle under way, and the last whole one, high and in all. */
    this.pwm = { rose: -Infinity, fell: -Infinity, began: undefined, last: [0, 1] };
    this.watchWords();
    this.watchPins();
  }

  watchWords() {
    const [steps, frame] = this.board.mcu.pio;
    this.hook(steps, (axis, word) => {
      const pulses = (word >>> 1) & 1023;
      this.filling[axis] += word & 1 ? pulses : -pulses;
    });
    this.hook(frame, (machine, word) => {
      const cycles = (word + FRAME_TICKS) * frame.machines[machine].clockDivInt;
      this.ordered.push({ net: this.filling, cycles });
      this.filling = none();
    });
  }

  hook(pio, put) {
    const write = pio.writeUint32.bind(pio);
    pio.writeUint32 = (offset, value) => {
      if (offset >= 0x10 && offset < 0x20) put((offset - 0x10) >> 2, value >>> 0);
      write(offset, value);
    };
  }

  watchPins() {
    const { gpio } = this.board.mcu;
    gpio[GATE].addListener(() => gpio[GATE].value === 1 && this.beginPeriod());
    const pwm = gpio[SPINDLE_PWM];
    pwm.addListener(() => this.pwmEdge(pwm.value === 1));
    for (let axis = 0; axis < AXES; axis++) {
      const [step, direction] = [gpio[FIRST_STEP + axis], gpio[FIRST_DIRECTION + axis]];
      direction.addListener(() => this.turn(axis, direction.value === 1));
      step.addListener(() => this.edge(axis, step.value === 1));
    }
  }

  beginPeriod() {
    const now = this.board.cycles;
    const last = this.seen;
    const order = this.ordered.shift();
    if (last) {
      this.onPeriod?.(last.net);
      if (last.net.some((net, axis) => net !== last.order.net[axis])) {
        this.wrong.push({ period: this.periods, seen: last.net, ordered: last.order.net });
      }
      if (now - last.at > last.order.cycles) {
        const moves = [...last.order.net, ...order.net].some((net) => net !== 0);
        this.late[moves ? 'motion' : 'opening']++;
        if (this.late.at.length < 20) this.late.at.push([this.periods, now - last.at - last.order.cycles, moves]);
      }
    }
    this.periods++;
    this.seen = { at: now, order, net: none(), count: none() };
  }

  turn(axis, high) {
    this.direction[axis] = high ? 1 : -1;
    this.turned[axis] = this.board.cycles;
    this.worst.behind = Math.min(this.worst.behind, this.board.cycles - this.fell[axis]);
  }

  edge(axis, high) {
    const now = this.board.cycles;
    // a pin that becomes an output is no edge
    if (high || this.rose[axis] > -Infinity) this.lastEdge = now;
    if (high) {
      const sign = this.direction[axis];
      this.rose[axis] = now;
      this.net[axis] += sign;
      this.pulses++;
      this.onPulse?.(axis);
      this.worst.low = Math.min(this.worst.low, now - this.fell[axis]);
      this.worst.before = Math.min(this.worst.before, now - this.turned[axis]);
      if (!this.seen) return;
      this.seen.net[axis] += sign;
      this.worst.most = Math.max(this.worst.most, ++this.seen.count[axis]);
    } else if (this.rose[axis] > -Infinity) {
      this.fell[axis] = now;
      this.worst.high = Math.min(this.worst.high, now - this.rose[axis]);
    }
  }

  pwmEdge(high) {
    const now = this.board.cycles;
    const { pwm } = this;
    if (now - Math.max(pwm.rose, pwm.fell) > STEADY) {
      pwm.last = [high ? 0 : 1, 1];
      pwm.began = undefined;
    } else if (high && pwm.began !== undefined) {
      pwm.last = [pwm.fell - pwm.began, now - pwm.began];
    }
    if (high) [pwm.rose, pwm.began] = [now, now];
    else if (pwm.rose > -Infinity) pwm.fell = now;
  }

  /** The last cycle of the output for S: cycles that it was high, and in all; its level where that does not change. */
  pwmCycle() {
    const { rose, fell, last } = this.pwm;
    const level = this.board.mcu.gpio[SPINDLE_PWM].value === 1 ? 1 : 0;
    return this.board.cycles - Math.max(rose, fell) > STEADY ? [level, 1] : last;
  }

  /** Pins of outputs and steps that are driven high. */
  highPins() {
    const pins = [...OUTPUTS, SPINDLE_PWM, ...none().map((_, axis) => FIRST_STEP + axis)];
    return pins.filter((pin) => this.board.mcu.gpio[pin].value === 1);
  }
}
