//! The registers of the USB controller OTG FS that the line uses, as a device without DMA (RM0090, 34.16; RM0368 and
//! RM0383, 22.16).
//!
//! Invariant: an offset is that of a register of the chip's, in bytes; a constant of bits belongs to the register above
//! it.

/// Access to the controller's registers: those of the chip, or of its model.
pub trait OtgRegisters {
    /// Reads the register at this offset. A read of the queue's status or of a queue takes what it returns.
    fn read(&self, offset: u32) -> u32;
    /// Writes the register at this offset.
    fn write(&self, offset: u32, value: u32);
}

/// Configuration of the USB: device mode for sure, the full-speed transceiver, and the answer time for an AHB of at
/// least 32 MHz.
pub const GUSBCFG: u32 = 0x00c;
/// See [`GUSBCFG`].
pub const DEVICE_MODE: u32 = 1 << 30;
/// See [`GUSBCFG`].
pub const FULL_SPEED_PHY: u32 = 1 << 6;
/// See [`GUSBCFG`].
pub const ANSWER_TIME: u32 = 6 << 10;

/// Reset of the core, and emptying of the queues: of received packets, of those to be sent, and of which.
pub const GRSTCTL: u32 = 0x010;
/// See [`GRSTCTL`].
pub const CORE_RESET: u32 = 1;
/// See [`GRSTCTL`].
pub const FLUSH_RECEIVED: u32 = 1 << 4;
/// See [`GRSTCTL`].
pub const FLUSH_TO_SEND: u32 = 1 << 5;
/// All queues, in the number of the queue to be emptied.
pub const EVERY_QUEUE: u32 = 0x10;
/// See [`GRSTCTL`].
pub const BUS_IDLE: u32 = 1 << 31;

/// What has happened: in host mode, something received, a reset of the bus, and its end.
pub const GINTSTS: u32 = 0x014;
/// See [`GINTSTS`].
pub const HOST_MODE: u32 = 1;
/// See [`GINTSTS`].
pub const RECEIVED: u32 = 1 << 4;
/// See [`GINTSTS`].
pub const BUS_RESET: u32 = 1 << 12;
/// See [`GINTSTS`].
pub const SPEED_KNOWN: u32 = 1 << 13;

/// The next entry of what was received, which it takes: endpoint, number of bytes, and kind.
pub const GRXSTSP: u32 = 0x020;
/// Kinds of entries.
pub const OUT_PACKET: u32 = 0b0010;
/// See [`OUT_PACKET`].
pub const OUT_COMPLETED: u32 = 0b0011;
/// See [`OUT_PACKET`].
pub const SETUP_COMPLETED: u32 = 0b0100;
/// See [`OUT_PACKET`].
pub const SETUP_PACKET: u32 = 0b0110;

/// Words of the queue of what was received.
pub const GRXFSIZ: u32 = 0x024;
/// Begin and words of the queue of endpoint 0.
pub const DIEPTXF0: u32 = 0x028;
/// Power of the transceiver, without a look at the bus's.
pub const GCCFG: u32 = 0x038;
/// See [`GCCFG`].
pub const POWERED: u32 = 1 << 16;
/// See [`GCCFG`].
pub const NO_VBUS_SENSING: u32 = 1 << 21;

/// Returns the register of the begin and words of the queue of an endpoint from 1 on.
#[must_use]
pub const fn dieptxf(endpoint: u32) -> u32 {
    0x104 + 4 * (endpoint - 1)
}

/// Speed, and the address.
pub const DCFG: u32 = 0x800;
/// See [`DCFG`].
pub const FULL_SPEED: u32 = 0b11;
/// Position of the address in [`DCFG`].
pub const ADDRESS_AT: u32 = 4;
/// Whether the device is hidden from the host.
pub const DCTL: u32 = 0x804;
/// See [`DCTL`].
pub const HIDDEN: u32 = 1 << 1;

/// An endpoint's direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// To the host.
    In = 0x900,
    /// From the host.
    Out = 0xb00,
}

/// Returns the control of an endpoint.
#[must_use]
pub const fn control(direction: Direction, endpoint: u32) -> u32 {
    direction as u32 + 0x20 * endpoint
}
/// In the control of an endpoint: it exists, it answers NAK, it refuses; begin of its packets, and of its transfer.
pub const ACTIVE: u32 = 1 << 15;
/// See [`ACTIVE`].
pub const ANSWERS_NAK: u32 = 1 << 17;
/// See [`ACTIVE`].
pub const BULK: u32 = 0b10 << 18;
/// See [`ACTIVE`].
pub const INTERRUPT: u32 = 0b11 << 18;
/// See [`ACTIVE`].
pub const STALL: u32 = 1 << 21;
/// Position of the number of the queue.
pub const QUEUE_AT: u32 = 22;
/// See [`ACTIVE`].
pub const CLEAR_NAK: u32 = 1 << 26;
/// See [`ACTIVE`].
pub const SET_NAK: u32 = 1 << 27;
/// See [`ACTIVE`].
pub const SET_DATA_0: u32 = 1 << 28;
/// See [`ACTIVE`].
pub const DISABLE: u32 = 1 << 30;
/// See [`ACTIVE`].
pub const ENABLE: u32 = 1 << 31;

/// Returns the register of what has happened at an endpoint: its transfer is complete, it is disabled, its NAK is in
/// effect.
#[must_use]
pub const fn interrupts(direction: Direction, endpoint: u32) -> u32 {
    control(direction, endpoint) + 8
}
/// See [`interrupts`].
pub const COMPLETED: u32 = 1;
/// See [`interrupts`].
pub const DISABLED: u32 = 1 << 1;
/// See [`interrupts`].
pub const NAK_EFFECTIVE: u32 = 1 << 6;

/// Returns the register of the packets and bytes of a transfer.
#[must_use]
pub const fn transfer(direction: Direction, endpoint: u32) -> u32 {
    control(direction, endpoint) + 0x10
}
/// One packet, in [`transfer`].
pub const ONE_PACKET: u32 = 1 << 19;
/// Three requests may follow each other, in [`transfer`] of endpoint 0.
pub const THREE_SETUPS: u32 = 3 << 29;

/// Clocks of the core.
pub const PCGCCTL: u32 = 0xe00;

/// Returns the queue of an endpoint; what is read is the queue of what was received.
#[must_use]
pub const fn queue(endpoint: u32) -> u32 {
    0x1000 * (endpoint + 1)
}
