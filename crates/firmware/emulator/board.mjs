// A Raspberry Pi Pico in rp2040js, with what that emulator's state machines lack: one clock with the processor, delays,
// dividers, the enable bits, joined queues, and outputs that other state machines read. Its counters of edges see every
// pin of their slice, and none once any output of the PWM is used: they see the pin that is given to the PWM.
//
// Invariant: everything happens in cycles of the chip's clock; nothing depends on the time of this computer.
//
// Requires the npm package rp2040js 1.4.1; RETRACE_RP2040JS names its folder.
import { readFileSync } from 'node:fs';
import { join } from 'node:path';
import { pathToFileURL } from 'node:url';

const modules = join(process.env.RETRACE_RP2040JS ?? '', 'dist/esm');
const load = (name) => import(pathToFileURL(join(modules, name)).href);
const { RP2040, ConsoleLogger, LogLevel } = await load('index.js');
const { FIFO } = await load('utils/fifo.js');

const FLASH = 0x10000000;
const RAM = 0x20000000;
const NANOSECONDS = 8;
/** Where the boot ROM puts the second stage of the boot, and the bytes of it that its checksum covers. */
const STAGE_2 = 0x20041f00;
const STAGE_2_CHECKED = 252;
const WATCHDOG = 0x40058;
/** Function of a pin: the PWM. */
const PWM = 4;
/** Cycles at a time while the processor does nothing. */
const FROZEN_TURN = 25;

/** Loaded segments of an ELF file by their addresses in flash, and its symbols by name. */
function readElf(path) {
  const file = readFileSync(path);
  const words = (at, count) => Array.from({ length: count }, (_, n) => file.readUInt32LE(at + 4 * n));
  const segments = [];
  for (let n = 0; n < file.readUInt16LE(44); n++) {
    const [kind, offset, , address, size] = words(file.readUInt32LE(28) + n * file.readUInt16LE(42), 5);
    if (kind === 1 && size > 0) segments.push({ address, bytes: file.subarray(offset, offset + size) });
  }
  const symbols = new Map();
  const table = file.readUInt32LE(32);
  for (let n = 0; n < file.readUInt16LE(48); n++) {
    const [, kind, , , offset, size, link] = words(table + 40 * n, 7);
    if (kind !== 2) continue;
    const names = file.readUInt32LE(table + 40 * link + 16);
    for (let at = offset; at < offset + size; at += 16) {
      const name = names + file.readUInt32LE(at);
      symbols.set(file.toString('latin1', name, file.indexOf(0, name)), file.readUInt32LE(at + 4));
    }
  }
  return { segments, symbols };
}

/** The checksum that the boot ROM expects behind the second stage (RP2040 data sheet, 2.8.1.3.1). */
function checksum(bytes) {
  let sum = 0xffffffff;
  for (const byte of bytes) {
    sum ^= byte << 24;
    for (let bit = 0; bit < 8; bit++) sum = sum & 0x80000000 ? (sum << 1) ^ 0x04c11db7 : sum << 1;
  }
  return sum >>> 0;
}

export class Board {
  constructor(path) {
    this.mcu = new RP2040();
    this.mcu.logger = new ConsoleLogger(LogLevel.Error, true);
    this.image = readElf(path);
    this.cycles = 0;
    /** Whether the processor does nothing any more, as in an endless loop. */
    this.frozen = false;
    /** A pin that is driven with a frequency: the pin, the cycles between two edges, the next one, and its level. */
    this.wave = undefined;
    /** A spindle with an encoder (spindle.mjs). */
    this.spindle = undefined;
    /** What is to be done once, and the cycle. */
    this.later = undefined;
    /** Cycle in which the watchdog reset the chip. */
    this.watchdogAt = undefined;
    for (const { address, bytes } of this.image.segments) this.mcu.flash.set(bytes, address - FLASH);
    this.mcu.pio.forEach((pio) => this.amend(pio));
    this.amendPwm();
    // what is driven is also read; an input keeps the level that it is given
    for (const pin of this.mcu.gpio) pin.addListener(() => pin.value <= 1 && pin.setInputValue(pin.value === 1));
    const watchdog = this.mcu.peripherals[WATCHDOG];
    watchdog.onWatchdogTrigger = () => {
      this.watchdogAt ??= this.cycles;
      watchdog.alarm.enable = false;
    };
    this.boot();
  }

  /** Does what the boot ROM does: checks the second stage, copies it to RAM, and runs it. */
  boot() {
    const { mcu } = this;
    const stage = mcu.flash.subarray(0, 256);
    const expected = mcu.flashView.getUint32(STAGE_2_CHECKED, true);
    if (checksum(stage.subarray(0, STAGE_2_CHECKED)) !== expected) throw new Error('the second stage has no checksum');
    mcu.sram.set(stage, STAGE_2 - RAM);
    mcu.core.SP = STAGE_2;
    mcu.core.LR = 0;
    mcu.core.PC = STAGE_2;
  }

  amendPwm() {
    const { pwm, gpio } = this.mcu;
    const isInput = (pin) => gpio[pin]?.functionSelect === PWM && !(pwm.gpioDirection & (1 << pin));
    for (const channel of pwm.channels) {
      const pins = () => [channel.pinB1, channel.pinB2].filter(isInput);
      Object.defineProperty(channel, 'gpioBValue', { get: () => pins().some((pin) => gpio[pin].inputValue) });
    }
    pwm.gpioOnInput = (pin) => pwm.channels[(pin >> 1) & 7].gpioBChanged();
  }

  amend(pio) {
    // its own loop runs by the computer's timer
    pio.run = () => {};
    for (const machine of pio.machines) {
      machine.freeAt = 0;
      const write = machine.writeUint32.bind(machine);
      machine.writeUint32 = (offset, value) => {
        write(offset, value);
        if (offset !== 8) return;
        const [joinedTx, joinedRx] = [(value >>> 30) & 1, (value >>> 31) & 1];
        machine.txFIFO = new FIFO(joinedTx ? 8 : joinedRx ? 0 : 4);
        machine.rxFIFO = new FIFO(joinedRx ? 8 : joinedTx ? 0 : 4);
      };
    }
  }

  /** Runs the machines of a block that are free in this cycle. */
  runMachines(pio, now) {
    for (const machine of pio.machines) {
      if (!machine.enabled || machine.waiting || now < machine.freeAt) continue;
      const { cycles, pc } = machine;
      const instruction = pio.instructions[pc];
      machine.step();
      const spent = Math.max(1, machine.cycles - cycles);
      machine.freeAt = now + spent * machine.clockDivInt;
      // a jump to itself that counts Y down: all of its turns but the last at once
      if ((instruction & 0xe0ff) === (0x80 | pc) && machine.pc === pc && machine.y > 0 && machine.y < 0xffffffff) {
        machine.freeAt += machine.y * spent * machine.clockDivInt;
        machine.y = 0;
      }
    }
    pio.checkChangedPins();
  }

  /** The next cycle in which a machine is free. */
  nextDue() {
    let due = Infinity;
    for (const pio of this.mcu.pio) {
      for (const machine of pio.machines) {
        if (machine.enabled && !machine.waiting && machine.freeAt < due) due = machine.freeAt;
      }
    }
    return due;
  }

  /** Runs until this cycle. */
  run(until) {
    const { core, clock } = this.mcu;
    const [steps, frame] = this.mcu.pio;
    while (this.cycles < until) {
      const spent = this.frozen ? FROZEN_TURN : core.waiting ? 1 : core.executeInstruction();
      const end = this.cycles + spent;
      clock.tick(spent * NANOSECONDS);
      for (let due = this.nextDue(); due <= end; due = this.nextDue()) {
        this.cycles = Math.max(this.cycles + 1, due);
        if (this.cycles > end) break;
        this.runMachines(frame, this.cycles);
        this.runMachines(steps, this.cycles);
      }
      this.cycles = end;
      if (this.wave && this.wave.next <= end) this.driveWave(end);
      if (this.spindle && this.spindle.next <= end) this.spindle.drive(end);
      if (this.later && this.later.at <= end) this.doLater();
    }
  }

  /** Drives a pin with a square wave of this frequency. */
  startWave(pin, hertz) {
    const half = 1e9 / NANOSECONDS / hertz / 2;
    this.wave = { pin: this.mcu.gpio[pin], half, next: this.cycles + half, level: false };
  }

  /** Does this once so many cycles have passed. */
  after(cycles, what) {
    this.later = { at: this.cycles + cycles, what };
  }

  doLater() {
    const { what } = this.later;
    this.later = undefined;
    what();
  }

  /** Wires an output to an input. */
  wire(output, input) {
    const { gpio } = this.mcu;
    const follow = () => gpio[input].setInputValue(gpio[output].value === 1);
    gpio[output].addListener(follow);
    follow();
  }

  /** Makes the edges that are due. */
  driveWave(end) {
    const { wave } = this;
    for (; wave.next <= end; wave.next += wave.half) {
      wave.level = !wave.level;
      wave.pin.setInputValue(wave.level);
    }
  }

  /** Stops the state machine that begins the control periods, as a defect of the chip or of its clock would. */
  stopFrameMachine() {
    const [, frame] = this.mcu.pio;
    frame.machines[0].enabled = false;
  }

  /** The address of the only symbol whose name contains this part. */
  addressOf(part) {
    for (const [name, address] of this.image.symbols) if (name.includes(part)) return address;
    throw new Error(`the image has no ${part}`);
  }

  /** Words of the memory, from a symbol on. */
  words(symbol, count) {
    const address = this.addressOf(symbol);
    return Array.from({ length: count }, (_, n) => this.mcu.readUint32(address + 4 * n));
  }

  /** Greatest depth of the stack, in bytes: RAM that was never written is zero. The second stage's RAM is above it. */
  stackDepth() {
    const end = this.addressOf('_stack_end');
    let at = end;
    while (this.mcu.readUint32(at) === 0) at += 4;
    return this.addressOf('_stack_start') - at;
  }
}
