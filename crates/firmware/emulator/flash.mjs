// The flash of a Pico on its line, as far as the firmware talks to it itself: a W25Q16JV (data sheet, 8.2.16 and
// 8.2.33; RP2040 data sheet, 4.10.13). What the second stage of the boot does with it is left to the emulator.
//
// Invariant: it answers only while it is selected, and no command before the read without commands, in which the
// second stage leaves it, has been ended.

const SSI = 0x18000;
const PINS = 0x40018;
const SELECT_CONTROL = 0x0c;
const [CONTROL, ENABLE, CLOCK, STATUS, DATA] = [0x00, 0x08, 0x14, 0x28, 0x60];
const RECEIVED = 1 << 3;
const [SELECTED, DESELECTED] = [2, 3];
const [IDENTIFY, READ_UNIQUE_NUMBER, END_OF_READ] = [0x9f, 0x4b, 0xff];
const MAKER = 0xef;

export class Flash {
  /** `number`: the eight bytes of its unique number. */
  constructor(board, number) {
    this.board = board;
    this.number = number;
    this.select = 0;
    this.readsWithoutCommands = true;
    this.sent = [];
    this.received = [];
    this.readyAt = 0;
    this.registers = new Map();
    const { peripherals } = board.mcu;
    const [line, pins] = [peripherals[SSI], peripherals[PINS]];
    const [read, write, writePin] = [line, line, pins].map((of, n) => of[n ? 'writeUint32' : 'readUint32'].bind(of));
    pins.writeUint32 = (offset, value) => (offset === SELECT_CONTROL ? this.setSelect((value >>> 8) & 3) : writePin(offset, value));
    line.writeUint32 = (offset, value) => {
      this.registers.set(offset, value);
      if (offset === DATA && this.select !== 0) this.exchange(value);
      else write(offset, value);
    };
    line.readUint32 = (offset) => {
      if (this.select === 0) return read(offset);
      if (offset === STATUS) return this.received.length > 0 && board.cycles >= this.readyAt ? RECEIVED : 0;
      return offset === DATA ? this.received.shift() : read(offset);
    };
  }

  setSelect(select) {
    if (this.select === SELECTED && this.sent[0] === END_OF_READ) this.readsWithoutCommands = false;
    if (select === DESELECTED || select === SELECTED) this.sent = [];
    this.select = select;
  }

  /** A byte in both directions, which takes the time of the line. */
  exchange(value) {
    const isByte = this.registers.get(CONTROL) === 7 << 16 && this.registers.get(ENABLE) === 1;
    if (!isByte || this.select !== SELECTED) return;
    const answer = this.readsWithoutCommands ? 0x55 : this.answer(this.sent.length);
    this.sent.push(value);
    this.received.push(answer);
    this.readyAt = this.board.cycles + 8 * this.registers.get(CLOCK);
  }

  answer(at) {
    const [command] = this.sent;
    if (command === IDENTIFY) return [0, MAKER, 0x40, 0x15][at] ?? 0;
    // behind its number it sends anything
    if (command === READ_UNIQUE_NUMBER && at >= 5) return this.number[at - 5] ?? Math.floor(256 * Math.random());
    return 0xff;
  }
}
