// The card on an emulated Raspberry Pi Pico, control period by control period, for a comparison with another card that
// is given the same bytes before the same periods. The line is USB.
//
// Each line of standard input is a request in JSON: `bytes` for the card, `inputs`, the levels of inputs 0 … 5, one bit
// each, and `steps`, counts by which the handwheel's encoder turns. The card takes all of that, and then computes one
// control period; the answer is a line of JSON: `us`, the chip's time, `computed`, false before the first byte, `bytes`
// of the card, `nets`, the net pulses at the pins in each period that has ended since, `outputs`, the levels of the
// output pins, and `pwm`, the last cycle of the output for S: clock cycles that it was high, and in all. The end of the
// input ends the run; a report is written to standard error.
//
// Invariant: no control period is computed while the card has bytes or commands of a request. Where that would be, the
// step generator seems to be full until they are done, and the period is late: `held` counts that.
//
// Usage: node lockstep.mjs IMAGE
import { writeSync } from 'node:fs';
import { createInterface } from 'node:readline';
import { Board } from './board.mjs';
import { findings } from './findings.mjs';
import { OUTPUTS, Scope } from './scope.mjs';
import { UsbHost } from './usb_host.mjs';

const SLICE = 250;
/** Cycles between counts of the encoder, whose interval of samples is 100 µs. */
const COUNT = 130 * 125;
/** Longest time that a request takes: the braking tables of an opening are computed in it. */
const PATIENCE = 125_000_000;
const FIRST_INPUT = 16;
const INPUT_COUNT = 6;
const ENCODER = [27, 28];
/** Levels of A and B (bits 0 and 1) as the count grows. */
const FORWARD = [0b00, 0b01, 0b11, 0b10];
/** In the queues' state: the queue of the frame's machine is empty. */
const QUEUE_EMPTY = 1 << 24;
const QUEUE_STATUS = 4;
const SIE_STATUS = 0x50;
const COMPUTED = 4;

const board = new Board(process.argv[2]);
const scope = new Scope(board);
const { gpio, pio, usbCtrl } = board.mcu;
const periods = board.addressOf('DIAGNOSTICS') + 4 * COMPUTED;
const computed = () => board.mcu.readUint32(periods);

let [fromCard, nets, toCard] = [[], [], []];
let [holding, isIdle, held, wasHeld, started] = [true, false, 0, false, false];
scope.onPeriod = (net) => nets.push(net);
const usb = new UsbHost(board, (bytes) => fromCard.push(...bytes));

const readQueues = pio[1].readUint32.bind(pio[1]);
pio[1].readUint32 = (offset) => {
  const value = readQueues(offset);
  if (!holding || offset !== QUEUE_STATUS || !(value & QUEUE_EMPTY)) return value;
  wasHeld = true;
  return value & ~QUEUE_EMPTY;
};
const readUsb = usbCtrl.readUint32.bind(usbCtrl);
usbCtrl.readUint32 = (offset) => {
  // the main loop looks at the line only when it has no command; the card has taken the last packet if it awaits one
  if (offset === SIE_STATUS && toCard.length === 0 && usb.isOpen && usb.awaitsBytes()) isIdle = true;
  return readUsb(offset);
};

let phase = FORWARD.indexOf(0b11);
function turn(step) {
  phase = (phase + step) & 3;
  ENCODER.forEach((pin, bit) => gpio[pin].setInputValue(((FORWARD[phase] >> bit) & 1) === 1));
}
const setInputs = (levels) => {
  for (let n = 0; n < INPUT_COUNT; n++) gpio[FIRST_INPUT + n].setInputValue(((levels >> n) & 1) === 1);
};
setInputs(63);
turn(0);

function run() {
  board.run(board.cycles + SLICE);
  toCard.splice(0, usb.serve(toCard));
}

/** Opens the port, once the card has been found. */
function open() {
  while (!usb.isReady) run();
  usb.setOpen(true);
  while (!usb.isOpen) run();
}

function answer({ bytes, inputs, steps }) {
  holding = true;
  isIdle = wasHeld = false;
  setInputs(inputs);
  toCard = bytes;
  const before = computed();
  const until = board.cycles + PATIENCE;
  for (let left = Math.abs(steps), next = board.cycles; ; ) {
    if (left > 0 && board.cycles >= next) {
      turn(Math.sign(steps));
      left--;
      next = board.cycles + COUNT;
    }
    started ||= bytes.length > 0;
    run();
    if (isIdle && left === 0 && (steps === 0 || board.cycles >= next)) break;
    if (board.cycles > until) throw new Error('the card does not take its bytes');
  }
  holding = false;
  held += wasHeld ? 1 : 0;
  if (!started) board.run(board.cycles + 125_000);
  while (started && computed() === before) {
    run();
    if (board.cycles > until) throw new Error('the card computes no period');
  }
  const outputs = OUTPUTS.reduce((levels, pin, n) => levels | ((gpio[pin].value === 1 ? 1 : 0) << n), 0);
  const us = Math.floor(board.cycles / 125);
  const line = { us, computed: started, bytes: fromCard, nets, outputs, pwm: scope.pwmCycle() };
  [fromCard, nets] = [[], []];
  writeSync(1, `${JSON.stringify(line)}\n`);
}

const began = performance.now();
open();
const lines = createInterface({ input: process.stdin });
lines.on('line', (line) => answer(JSON.parse(line)));
lines.on('close', () => {
  console.error(JSON.stringify({ ...findings(board, scope, began), held }));
  process.exit(0);
});
