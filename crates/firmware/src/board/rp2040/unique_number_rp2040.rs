//! The unique number of a Pico: that of its flash, since the chip has none (RP2040 data sheet, 4.10 and 2.19.6.2; data
//! sheet of the W25Q16JV, 8.2.16 and 8.2.33).
//!
//! Invariant: nothing reads the flash's memory afterwards. The start-up code has copied everything to RAM, and a reset
//! sets up the flash again.

use super::registers::{FLASH_SELECT_CONTROL, SSI_CLOCK, SSI_CONTROL, SSI_DATA, SSI_ENABLE, SSI_STATUS};
use retrace_firmware::rp2040::unique_number;

/// In the control of the flash's select pin: driven low, and high.
const SELECTED: u32 = 2 << 8;
const DESELECTED: u32 = 3 << 8;
/// Frames of eight bits on one line, sent and received.
const BYTES: u32 = 7 << 16;
/// Cycles of the processor in one of the line: some 4 MHz.
const CYCLES: u32 = 32;
/// In the state: a byte was received.
const RECEIVED: u32 = 1 << 3;
/// Looks at the state for a byte, which takes 256 cycles of the processor.
const LOOKS: u32 = 1000;
/// Commands: identification, unique number with four bytes before it, and the end of a read that goes on without a
/// command.
const IDENTIFY: u8 = 0x9f;
const READ_UNIQUE_NUMBER: u8 = 0x4b;
const END_OF_READ: u8 = 0xff;

/// Returns the unique number; `None` if the flash has none.
pub(super) fn read() -> Option<[u32; 3]> {
    FLASH_SELECT_CONTROL.write(DESELECTED);
    SSI_ENABLE.write(0);
    SSI_CLOCK.write(CYCLES);
    SSI_CONTROL.write(BYTES);
    SSI_ENABLE.write(1);
    // high bits where the mode is expected end the read of four lines
    exchange(&mut [END_OF_READ; 2])?;
    let mut maker = [IDENTIFY, 0];
    exchange(&mut maker)?;
    let mut answer = [0; 21];
    answer[0] = READ_UNIQUE_NUMBER;
    exchange(&mut answer)?;
    unique_number::of_flash(maker[1], answer.last_chunk()?)
}

/// Sends these bytes and replaces them by those that are received. `None` if the line does not run.
fn exchange(bytes: &mut [u8]) -> Option<()> {
    FLASH_SELECT_CONTROL.write(SELECTED);
    let done = bytes.iter_mut().try_for_each(|byte| {
        SSI_DATA.write(u32::from(*byte));
        (0..LOOKS).find(|_| SSI_STATUS.has(RECEIVED))?;
        *byte = SSI_DATA.read() as u8;
        Some(())
    });
    FLASH_SELECT_CONTROL.write(DESELECTED);
    done
}
