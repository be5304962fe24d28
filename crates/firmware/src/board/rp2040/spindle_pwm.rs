//! The output for S: the speed of a spindle, or the power of a beam (RP2040 data sheet, 4.5).
//!
//! Invariant: a duty cycle of 0 forces the pin low at once; any other takes effect at the start of the counter's next
//! cycle.

use retrace_card::spindle_pwm::PwmSignal;
use retrace_firmware::rp2040::pins::SPINDLE_PWM_PIN;
use retrace_firmware::rp2040::pwm::PwmCounter;

use super::chip::FORCED_LOW;
use super::registers::{PWM_CONTROL, PWM_DIVIDER, PWM_LEVELS, PWM_TOP, pin_control};

/// Function of the pin (data sheet, 2.19.2).
const PWM: u32 = 4;
/// Bit of the control register: the counter runs.
const ENABLED: u32 = 1;

/// The output for S: what is set, and the counter for its frequency.
pub(super) struct SpindlePwm {
    signal: PwmSignal,
    counter: PwmCounter,
}

impl SpindlePwm {
    /// Starts the output, low.
    pub(super) fn start() -> Self {
        set_low();
        Self { signal: PwmSignal { hz: 0, duty: 0 }, counter: PwmCounter::of(0) }
    }

    /// Sets frequency and duty cycle; `None` is low.
    pub(super) fn set(&mut self, signal: Option<PwmSignal>) {
        let PwmSignal { hz, duty } = signal.unwrap_or(PwmSignal { duty: 0, ..self.signal });
        if hz != self.signal.hz {
            self.change_frequency(hz);
        }
        if duty != self.signal.duty {
            self.signal.duty = duty;
            PWM_LEVELS.write(u32::from(self.counter.level(duty)));
            if duty == 0 { set_low() } else { pin_control(SPINDLE_PWM_PIN).write(PWM) }
        }
    }

    fn change_frequency(&mut self, hz: u16) {
        set_low();
        (self.signal, self.counter) = (PwmSignal { hz, duty: 0 }, PwmCounter::of(hz));
        PWM_CONTROL.write(0);
        PWM_DIVIDER.write(u32::from(self.counter.divider) << 4);
        PWM_TOP.write(u32::from(self.counter.top));
        PWM_LEVELS.write(0);
        PWM_CONTROL.write(ENABLED);
    }
}

/// Sets the pin low, whatever the counter does.
pub(super) fn set_low() {
    pin_control(SPINDLE_PWM_PIN).write(FORCED_LOW | PWM);
}
