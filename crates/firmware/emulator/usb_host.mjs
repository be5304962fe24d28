// A USB host with the driver of a serial port, at an emulated Pico: it enumerates the card as Linux does, and then
// carries the bytes of a pseudo-terminal.
//
// rp2040js completes a packet as soon as the firmware offers it, and checks neither the kinds of packets (DATA0, DATA1)
// nor which endpoints are enabled. So its part that moves packets is replaced here.
//
// Invariant: one transaction at a time is on the bus, each as long as its bits take; what a host would discard or wait
// for in vain is an error here.

const BUS_RESET = 1 << 19;
const SETUP_DONE = 1 << 17;
const FULL = 1 << 15;
const DATA_1 = 1 << 13;
const STALL = 1 << 11;
const AVAILABLE = 1 << 10;
const LENGTH = 0x3ff;
const ENABLED = 0x80000000;
const REPORTED = 1 << 29;
/** Cycles of a microsecond, of a millisecond, and of a byte on the bus. */
const US = 125;
const MS = 125_000;
const BYTE = (8 * US) / 12;
/** Bytes of a transaction besides its data: two tokens, the checksum, the pauses between them. */
const OVERHEAD = 13;
/** Cycles that the firmware has to wait between what is in a buffer's control and that it is valid: three of 48 MHz. */
const SETTLED = 8;
/** Part of a frame of 1 ms in which the card may offer a packet (erratum RP2040-E15), and what it may be off. */
const OFFERED = 800 * US;
const LATE = 2 * US;
/** Longest time from the card's last read of the number of the frame to its offer: 1.54 µs and an interrupt of 0.48. */
const FRAME_AGE = 2.1 * US;
/** The register with the number of the frame. */
const FRAME = 0x48;
/** Longest wait for the end of a request. */
const PATIENCE = 500 * MS;
const PACKET = 64;

const text = (bytes) => Buffer.from(bytes.slice(2)).toString('utf16le');

export class UsbHost {
  /** `receive` is called with the bytes of each packet of the card. */
  constructor(board, receive) {
    this.board = board;
    this.usb = board.mcu.usbCtrl;
    this.receive = receive;
    this.plugged = true;
    /** Whether a program has opened the port. */
    this.open = false;
    this.control = undefined;
    this.busyUntil = 0;
    this.written = new Map();
    this.usb.DPRAMUpdated = (offset, value) => this.checkWrite(offset, value);
    this.countFrames();
    this.begin();
  }

  /** A cable that is connected. */
  plugIn() {
    this.plugged = true;
    this.begin();
  }

  /** A cable that is pulled out: the bus is idle, and the card has its power from elsewhere. */
  unplug() {
    this.plugged = false;
    this.isReady = this.open = false;
    this.script = undefined;
    this.control = undefined;
  }

  /** A program opens the port, or its end closes it. */
  setOpen(open) {
    this.open = false;
    this.script = this.openOrClose(open);
    this.advance();
  }

  begin() {
    this.address = 0;
    /** Whether the driver has found the serial port. */
    this.isReady = false;
    this.script = this.enumerate();
    this.configuration = undefined;
    this.toHost = this.fromHost = 0;
    this.advance();
  }

  *reset() {
    this.address = 0;
    this.usb.sieStatus |= BUS_RESET;
    this.usb.sieStatusUpdated();
    yield { wait: 15 * MS };
    if (this.usb.addrEndp & 127) throw new Error('the card has an address after a reset of the bus');
  }

  *enumerate() {
    while (!this.isConnected()) yield { wait: MS };
    yield { wait: 100 * MS };
    yield* this.reset();
    yield { setup: [0x80, 6, 0, 1, 0, 0, 64, 0] };
    yield* this.reset();
    yield { setup: [0x00, 5, 7, 0, 0, 0, 0, 0] };
    this.address = 7;
    yield { wait: 10 * MS };
    const device = yield { setup: [0x80, 6, 0, 1, 0, 0, 18, 0] };
    // of a device of high speed: there is none
    if ((yield { setup: [0x80, 6, 0, 6, 0, 0, 10, 0] }) !== undefined) throw new Error('a qualifier was not refused');
    const [, , low, high] = yield { setup: [0x80, 6, 0, 2, 0, 0, 9, 0] };
    this.configuration = yield { setup: [0x80, 6, 0, 2, 0, 0, low, high] };
    yield { setup: [0x80, 6, 0, 3, 0, 0, 255, 0] };
    const names = [];
    for (const name of [device[14], device[15], device[16]]) names.push(text(yield { setup: [0x80, 6, name, 3, 9, 4, 255, 0] }));
    this.names = names;
    this.findEndpoints();
    yield { setup: [0x00, 9, this.configuration[5], 0, 0, 0, 0, 0] };
    this.toHost = this.fromHost = 0;
    const coding = yield { setup: [0xa1, 0x21, 0, 0, 0, 0, 7, 0] };
    if (coding.length !== 7) throw new Error(`the line coding has ${coding.length} bytes`);
    this.isReady = true;
  }

  *openOrClose(open) {
    if (open) yield { setup: [0x21, 0x20, 0, 0, 0, 0, 7, 0], data: [0x40, 0x42, 0x0f, 0, 0, 0, 8] };
    yield { setup: [0x21, 0x22, open ? 3 : 0, 0, 0, 0, 0, 0] };
    this.open = open;
  }

  findEndpoints() {
    const bytes = this.configuration;
    for (let at = 0; at < bytes.length; at += bytes[at]) {
      if (bytes[at] < 2) throw new Error('a descriptor without a length');
      if (bytes[at + 1] !== 5 || bytes[at + 3] !== 2) continue;
      if (bytes[at + 4] !== PACKET) throw new Error('a bulk endpoint of full speed has packets of 64 bytes here');
      if (bytes[at + 2] & 0x80) this.inEndpoint = bytes[at + 2] & 15;
      else this.outEndpoint = bytes[at + 2];
    }
  }

  isConnected() {
    const { mainCtrl, sieCtrl } = this.usb;
    return this.plugged && mainCtrl & 1 && sieCtrl & (1 << 16);
  }

  /** Whether a program can exchange bytes with the card. */
  get isOpen() {
    return this.plugged && this.open;
  }

  /** Whether the card has room for a packet. */
  awaitsBytes() {
    return (this.bufferControl(this.outEndpoint, 1) & AVAILABLE) !== 0;
  }

  /** Goes on with the script: `result` is that of its last request. */
  advance(result) {
    const { value, done } = this.script.next(result);
    if (done) this.script = this.control = undefined;
    else if (value.wait) this.control = { until: this.board.cycles + value.wait };
    else this.control = { ...value, phase: 'setup', got: [], kind: DATA_1, since: this.board.cycles };
  }

  /** Does what is due on the bus. Returns the number of bytes of `toCard` that the card has taken. */
  serve(toCard) {
    const now = this.board.cycles;
    if (!this.plugged || now < this.busyUntil) return 0;
    if (this.control?.until !== undefined) {
      if (now >= this.control.until) this.advance();
      return 0;
    }
    if (this.control && this.serveControl(now)) return 0;
    if (!this.open) return 0;
    if (toCard.length > 0) {
      const bytes = toCard.slice(0, PACKET);
      if (this.transferOut(this.outEndpoint, bytes, this.fromHost)) {
        this.fromHost ^= DATA_1;
        return bytes.length;
      }
    }
    const bytes = this.transferIn(this.inEndpoint, this.toHost);
    if (bytes) {
      this.toHost ^= DATA_1;
      this.receive(bytes);
    }
    return 0;
  }

  /** Tries the next transaction of a request; false if the card has no answer yet. */
  serveControl(now) {
    const { control } = this;
    const { setup, data } = control;
    if (now - control.since > PATIENCE) throw new Error(`a request has no answer: ${setup}`);
    const [isIn, length] = [setup[0] & 0x80, setup[6] | (setup[7] << 8)];
    const isStalled = () => this.usb.epStallArm !== 0 && (this.bufferControl(0, 0) | this.bufferControl(0, 1)) & STALL;
    if (control.phase === 'setup') {
      if ((this.usb.addrEndp & 127) !== this.address) throw new Error(`the card does not have address ${this.address}`);
      // a setup ends a refusal
      this.usb.epStallArm = 0;
      this.board.mcu.usbDPRAM.set(setup);
      this.usb.sieStatus |= SETUP_DONE;
      this.usb.sieStatusUpdated();
      this.occupy(8);
      control.phase = isIn ? 'in' : data ? 'out' : 'status';
      return true;
    }
    if (this.usb.sieStatus & SETUP_DONE) return false;
    if (isStalled()) {
      this.advance(undefined);
      return true;
    }
    if (control.phase === 'in') {
      const bytes = this.transferIn(0, control.kind);
      if (!bytes) return false;
      control.got.push(...bytes);
      control.kind ^= DATA_1;
      if (bytes.length < PACKET || control.got.length >= length) control.phase = 'status';
      if (control.got.length > length) throw new Error('more bytes than requested');
      return true;
    }
    if (control.phase === 'out') {
      if (!this.transferOut(0, data, DATA_1)) return false;
      control.phase = 'status';
      return true;
    }
    // the acknowledgement is in the other direction, and of the second kind
    const isDone = isIn ? this.transferOut(0, [], DATA_1) : this.transferIn(0, DATA_1);
    if (!isDone) return false;
    this.advance(control.got);
    return true;
  }

  bufferControl(endpoint, out) {
    return this.board.mcu.usbDPRAMView.getUint32(0x80 + 8 * endpoint + 4 * out, true);
  }

  setBufferControl(endpoint, out, value) {
    this.board.mcu.usbDPRAMView.setUint32(0x80 + 8 * endpoint + 4 * out, value, true);
  }

  /** Place of a buffer, of an endpoint that is as the data sheet wants it (RP2040 data sheet, 4.1.2.5). */
  bufferAt(endpoint, out) {
    if (endpoint === 0) {
      if (!(this.usb.sieCtrl & REPORTED)) throw new Error('buffers of endpoint 0 are not reported');
      return 0x100;
    }
    const control = this.board.mcu.usbDPRAMView.getUint32(8 * endpoint + 4 * out, true) >>> 0;
    if (!(control & ENABLED) || !(control & REPORTED) || ((control >>> 26) & 3) !== 2) {
      throw new Error(`endpoint ${endpoint} is not an enabled one for bulk transfers: ${control.toString(16)}`);
    }
    return control & 0xffc0;
  }

  /** The card's next packet, if it has offered one. */
  transferIn(endpoint, kind) {
    const control = this.bufferControl(endpoint, 0);
    if (!(control & AVAILABLE)) return undefined;
    if (!(control & FULL)) throw new Error('a packet is offered without its bytes');
    if ((control & DATA_1) !== kind) throw new Error(`a packet of endpoint ${endpoint} has the wrong kind`);
    const at = this.bufferAt(endpoint, 0);
    const bytes = [...this.board.mcu.usbDPRAM.slice(at, at + (control & LENGTH))];
    if (endpoint > 0 && bytes.length >= PACKET) throw new Error('a full packet makes the host wait for the next one');
    this.setBufferControl(endpoint, 0, control & ~(AVAILABLE | FULL));
    this.occupy(bytes.length);
    this.usb.indicateBufferReady(endpoint, false);
    return bytes;
  }

  /** Whether the card has taken a packet. */
  transferOut(endpoint, bytes, kind) {
    const control = this.bufferControl(endpoint, 1);
    if (!(control & AVAILABLE)) return false;
    if ((control & DATA_1) !== kind) throw new Error(`endpoint ${endpoint} expects a packet of the other kind`);
    if (bytes.length > (control & LENGTH)) throw new Error('a packet has no room');
    this.board.mcu.usbDPRAM.set(bytes, this.bufferAt(endpoint, 1));
    this.setBufferControl(endpoint, 1, (control & ~(AVAILABLE | LENGTH)) | FULL | bytes.length);
    this.occupy(bytes.length);
    this.usb.indicateBufferReady(endpoint, true);
    return true;
  }

  /** Returns the number of the frame at the time of each read. It does not change while the cable is unplugged. */
  countFrames() {
    const read = this.usb.readUint32.bind(this.usb);
    let number = 0;
    this.usb.readUint32 = (offset) => {
      if (offset !== FRAME) return read(offset);
      this.frameReadAt = this.board.cycles;
      if (this.plugged) number = Math.floor(this.board.cycles / MS) & 0x7ff;
      return number;
    };
  }

  occupy(bytes) {
    this.busyUntil = this.board.cycles + Math.ceil((bytes + OVERHEAD) * BYTE);
  }

  /** Holds writes of a buffer's control to their order: first all of it, then, later, that it is valid. */
  checkWrite(offset, value) {
    if (offset < 0x80 || offset >= 0x100) return;
    const before = this.written.get(offset);
    this.written.set(offset, { value, at: this.board.cycles });
    if (!(value & AVAILABLE)) return;
    const isToHost = this.inEndpoint > 0 && offset === 0x80 + 8 * this.inEndpoint;
    const frameAge = this.board.cycles - this.frameReadAt;
    if (isToHost && this.isOpen && frameAge > FRAME_AGE) {
      throw new Error(`a packet is offered ${frameAge / US} µs after the card last read the number of the frame`);
    }
    if (isToHost && this.isOpen && this.board.cycles % MS > OFFERED + LATE) {
      throw new Error(`a packet is offered ${(this.board.cycles % MS) / US} µs after the start of a frame`);
    }
    if (before?.value !== (value & ~AVAILABLE) || this.board.cycles - before.at < SETTLED) {
      throw new Error(`a buffer's control at ${offset.toString(16)} is valid before it is settled`);
    }
  }
}
