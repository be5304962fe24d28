// The card on an emulated Raspberry Pi Pico: its line is at standard input and output. It ends with its input, and
// writes what was seen at the pins to standard error, as one line of JSON.
//
// Standard output is a sequence of messages: a byte 0, a length of two bytes (low byte first) and so many bytes of the
// card; a byte 1 and the number of bytes that the card has received since the last one, in two bytes; or a byte 2 and 1
// with the event, 2 once it is over, 3 once the card can be reached. The other side keeps 256 bytes under way at most:
// a buffer between a host that is in real time and a slow card would only delay acknowledgements.
//
// Invariant: a byte takes the time of the line in either direction; between bytes nothing waits for this computer.
//
// RETRACE_WAVE_HZ drives the pin of input 5, whose frequency the card measures, with a square wave; RETRACE_STEP_WIRE is
// the number of an axis whose step output is wired to it. RETRACE_PROBE is a probe (probe.mjs), RETRACE_SPINDLE a spindle
// with an encoder (spindle.mjs). RETRACE_TORCH is a torch with a voltage module at UART0 (torch.mjs), where the line is
// USB. RETRACE_FLASH_NUMBER are the 16 hexadecimal digits of the flash's unique number.
//
// Usage: node card.mjs IMAGE uart|usb [EVENT PULSES] EVENT happens in motion, once so many pulses were seen at the pins
// and the spindle is on: `freeze` (the processor does nothing any more), `stuck` (the state machine that begins the
// control periods stops), `panic` (the firmware finds a defect of its own), `cut` (the line is cut, in both
// directions), `unplug` (the USB cable is pulled out, the card keeps its power), `kill` (the other side is to end the
// host; what it sends meanwhile is lost, and its port is closed), `reset` (the supply breaks down for a moment: every pin
// is an input at once, and the chip starts anew; over UART0, whose adapter stays), `encoder` (the spindle's encoder shows
// no count any more). It is over half a second of the chip's time later, a tenth after `encoder`, with the reset by the
// watchdog, or, after `unplug`, once the card is found again. The run ends then; after `unplug`, `kill` and `reset` the
// card can be reached again, and the run continues.
import { writeSync } from 'node:fs';
import { Board } from './board.mjs';
import { findings } from './findings.mjs';
import { Flash } from './flash.mjs';
import { Probe } from './probe.mjs';
import { Scope } from './scope.mjs';
import { Spindle } from './spindle.mjs';
import { Torch } from './torch.mjs';
import { UsbHost } from './usb_host.mjs';

const [, , image, line, event, pulses] = process.argv;
const BYTE = 1250;
const SLICE = 12500;
const AFTER_EVENT = 62_500_000;
const AFTER_DEATH = 12_500_000;
const SPINDLE = 14;
const [FIRST_STEP_PIN, FREQUENCY_PIN] = [2, 21];
const INPUTS = [16, 17, 18, 19, 20, 21, 27, 28];
const CUTS = ['cut', 'unplug', 'kill'];
const GOES_ON = ['unplug', 'kill', 'reset'];

let board = new Board(image);
let scope = new Scope(board);
connect();
if (process.env.RETRACE_WAVE_HZ) board.startWave(FREQUENCY_PIN, +process.env.RETRACE_WAVE_HZ);
if (process.env.RETRACE_STEP_WIRE) board.wire(FIRST_STEP_PIN + +process.env.RETRACE_STEP_WIRE, FREQUENCY_PIN);
if (process.env.RETRACE_PROBE) new Probe(board, scope, process.env.RETRACE_PROBE);
const torch = process.env.RETRACE_TORCH ? new Torch(board, scope) : undefined;
const spindle = process.env.RETRACE_SPINDLE && new Spindle(board, scope, process.env.RETRACE_SPINDLE);

const toCard = [];
const fromCard = [];
let [ended, cut, isOver, isReady, nextByte, received, happened] = [false, false, false, false, 0, 0, undefined];
/** Cycles from the event until the spindle was off. */
let spindleOff;
const usb = line === 'usb' ? new UsbHost(board, (bytes) => fromCard.push(...bytes)) : undefined;
process.stdin.on('data', (bytes) => bytes.forEach((byte) => toCard.push(byte)));
process.stdin.on('end', () => (ended = true));

function connect() {
  const { gpio, uart } = board.mcu;
  const number = process.env.RETRACE_FLASH_NUMBER;
  if (number) new Flash(board, Buffer.from(number, 'hex'));
  // open contacts: the pull-ups hold them high
  for (const pin of INPUTS) gpio[pin].setInputValue(true);
  uart[0].onByte = (byte) => !cut && line === 'uart' && fromCard.push(byte);
}

/** Another chip in its place, with the same image: nothing of the RAM is left. */
function startAnew() {
  board = new Board(image);
  scope = new Scope(board);
  happened = { at: 0, pulses: 0 };
  nextByte = 0;
  connect();
}

const spindleIsOn = () => board.mcu.gpio[SPINDLE].value === 1;

function happen() {
  happened = { at: board.cycles, pulses: scope.pulses };
  cut = CUTS.includes(event);
  if (event === 'unplug') usb.unplug();
  if (event === 'kill') usb.setOpen(false);
  if (event === 'freeze') board.frozen = true;
  if (event === 'stuck') board.stopFrameMachine();
  if (event === 'reset') startAnew();
  if (event === 'encoder') spindle.isDead = true;
  if (event === 'panic') board.mcu.core.PC = board.addressOf('rust_begin_unwind') & ~1;
  send(2, 1, []);
}

function endEvent() {
  isOver = true;
  cut = false;
  happened.pulses_after = scope.pulses - happened.pulses;
  happened.steps_ended = Math.max(0, scope.lastEdge - happened.at);
  if (event === 'unplug') {
    // it is over once the card is found again
    usb.plugIn();
    isReady = false;
  } else send(2, 2, []);
}

function feed() {
  const uart = board.mcu.uart[0];
  // what a host sends into a line that is cut is gone: the host's clock is faster than the card's
  if (cut) received += toCard.splice(0).length;
  if (usb) return feedUsb();
  if (toCard.length === 0 || board.cycles < nextByte || uart.rxFIFO.full) return;
  const byte = toCard.shift();
  nextByte = board.cycles + BYTE;
  received++;
  // a chip that starts hears nothing yet
  if (uart.enabled && uart.rxEnabled) uart.feedByte(byte);
}

function feedUsb() {
  // a program opens the port before it sends something
  if (toCard.length > 0 && usb.isReady && !usb.isOpen && !usb.control) usb.setOpen(true);
  const taken = usb.serve(toCard);
  toCard.splice(0, taken);
  received += taken;
}

function send(kind, count, bytes) {
  try {
    writeSync(1, Uint8Array.from([kind, count & 255, count >> 8, ...bytes]));
  } catch (error) {
    // the other side has ended, and the input will
    if (error.code !== 'EPIPE') throw error;
  }
}

function slice() {
  for (const end = board.cycles + SLICE; board.cycles < end; ) {
    feed();
    torch?.run();
    board.run(Math.min(end, board.cycles + BYTE / 2));
    if (happened && !spindleIsOn()) spindleOff ??= board.cycles - happened.at;
    if (event && !happened && scope.pulses >= +pulses && spindleIsOn()) {
      happen();
      // the clock may have begun anew
      break;
    }
  }
  if (!isReady && (!usb || usb.isReady)) {
    isReady = true;
    send(2, happened ? 2 : 3, []);
  }
  if (fromCard.length > 0) send(0, fromCard.length, fromCard.splice(0));
  if (received > 0) send(1, received, []);
  received = 0;
  if (happened && !isOver && board.cycles - happened.at > (event === 'encoder' ? AFTER_DEATH : AFTER_EVENT)) endEvent();
  const goesOn = !happened || GOES_ON.includes(event);
  if ((goesOn ? ended : isOver) || board.watchdogAt !== undefined) return report();
  setImmediate(slice);
}

function report() {
  if (happened && !isOver) endEvent();
  const found = {
    ...findings(board, scope, began), usb: usb?.names ?? null, torch: torch?.findings() ?? null,
    event: happened && {
      name: event,
      steps_ended: happened.steps_ended,
      pulses_after: happened.pulses_after,
      spindle_off: spindleOff ?? null,
      pwm_off: scope.pwm.fell > scope.pwm.rose ? Math.max(0, scope.pwm.fell - happened.at) : null,
      watchdog: board.watchdogAt === undefined ? null : board.watchdogAt - happened.at,
      high_pins: scope.highPins(),
    },
    thread: spindle ? spindle.passes : null,
    watchdog_at: board.watchdogAt ?? null,
  };
  console.error(JSON.stringify(found));
  process.exit(0);
}

const began = performance.now();
slice();
