// A plasma torch over a sheet that rises with X, and a voltage module at UART0, which sends the arc's voltage about
// once in a millisecond: sentences of docs/firmware.md, "A voltage from a module".
//
// Invariant: it sees the pins alone. What the module sends depends on where X is, so that a run is the same each time.
// Nothing is sent before the chip has configured UART0; the module of a real machine sends all the time, too.

const [X, Z] = [0, 2];
const [FIRE_PIN, OK_PIN, CONTACT_PIN] = [14, 18, 16];
const PULSES_PER_MM = 400;
const SHEET_MM = -5;
/** Rise of the sheet in mm for each mm of X. */
const RISE = 1 / 30;
/** Height of the cut, and the arc: volts at the sheet, and for each mm of height. */
const [CUT_MM, ARC_V, ARC_V_PER_MM] = [1.5, 100, 10];
/** Cycles between two sentences, which is not the control period, and of a byte. */
const [INTERVAL, BYTE] = [116_000, 1_250];

/** What the module sends up to which X, in mm; and from which X on the torch is to follow the sheet, or to stay. */
const PARTS = [
  { name: 'follows', to: 25, from: 18, sends: (volts) => sentence(volts) },
  { name: 'silence', to: 33, from: 29, sends: () => [] },
  { name: 'follows_behind_silence', to: 42, from: 38, sends: (volts) => sentence(volts) },
  { name: 'noise', to: 50, from: 46, sends: (_, noise) => [...noise(20), ...damaged(250), ...other(250)] },
  { name: 'follows_with_noise', to: 60, from: 56, sends: (volts, noise) => [...noise(20), ...damaged(250), ...sentence(volts)] },
  { name: 'end', to: Infinity, from: Infinity, sends: (volts) => sentence(volts) },
];

const bytes = (text) => [...Buffer.from(text, 'latin1')];
const framed = (covered, wrong = 0) => {
  const sum = bytes(covered).reduce((sum, byte) => sum ^ byte, wrong);
  return bytes(`$${covered}*${sum.toString(16).toUpperCase().padStart(2, '0')}\r\n`);
};
const sentence = (volts) => framed(`PRTV,${volts.toFixed(2)}`);
/** With another checksum. */
const damaged = (volts) => framed(`PRTV,${volts.toFixed(2)}`, 1);
/** Of another kind. */
const other = (volts) => framed(`PRTI,${volts.toFixed(2)}`);

export class Torch {
  constructor(board, scope) {
    this.board = board;
    this.scope = scope;
    this.waiting = [];
    this.nextByte = this.nextSentence = 0;
    this.random = 1;
    this.found = Object.fromEntries(PARTS.map(({ name }) => [name, { above_mm: -Infinity, below_mm: Infinity, z: [] }]));
    scope.onPulse = () => this.move();
  }

  get x() {
    return this.scope.net[X] / PULSES_PER_MM;
  }

  /** Height of the tip over the sheet, in mm. */
  get height() {
    return this.scope.net[Z] / PULSES_PER_MM - (SHEET_MM + RISE * this.x);
  }

  get isLit() {
    return this.board.mcu.gpio[FIRE_PIN].value === 1;
  }

  move() {
    const { gpio } = this.board.mcu;
    // contacts to ground; the proof of the arc is one, too
    gpio[CONTACT_PIN].setInputValue(this.height > 0);
    const part = PARTS.find(({ to }) => this.x < to);
    if (!this.isLit || this.x < part.from) return;
    const seen = this.found[part.name];
    seen.above_mm = Math.max(seen.above_mm, this.height - CUT_MM);
    seen.below_mm = Math.min(seen.below_mm, this.height - CUT_MM);
    const z = this.scope.net[Z];
    if (seen.z.at(-1) !== z) seen.z.push(z);
  }

  /** Random bytes without a dollar sign, zeros among them. */
  noise = (count) => {
    const next = () => (this.random = (Math.imul(this.random, 1_664_525) + 1_013_904_223) >>> 0) >>> 24;
    return Array.from({ length: count }, next).map((byte) => (byte === 0x24 ? 0 : byte));
  };

  /** To be called often: sends what is due. */
  run() {
    const { mcu, cycles } = this.board;
    mcu.gpio[OK_PIN].setInputValue(!this.isLit);
    const uart = mcu.uart[0];
    if (!uart.enabled) return;
    if (cycles >= this.nextSentence) {
      const volts = this.isLit ? Math.max(0, ARC_V + ARC_V_PER_MM * this.height) : 0;
      this.waiting.push(...PARTS.find(({ to }) => this.x < to).sends(volts, this.noise));
      this.nextSentence = cycles + INTERVAL;
    }
    if (this.waiting.length === 0 || cycles < this.nextByte || uart.rxFIFO.full) return;
    this.nextByte = cycles + BYTE;
    uart.feedByte(this.waiting.shift());
  }

  /** What was seen in each part of the cut: the deviation of the height, and how many places the tool axis had. */
  findings() {
    const parts = Object.entries(this.found).filter(([, { z }]) => z.length > 0);
    return Object.fromEntries(
      parts.map(([name, { above_mm, below_mm, z }]) => [name, { above_mm, below_mm, places: z.length }]),
    );
  }
}
