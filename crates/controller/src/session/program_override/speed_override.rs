//! The operator's override of the speed of the spindle (SPN-7), which acts through S: the card has none of its own.
//!
//! Invariant: only the value of S is changed, and only while the spindle turns: nothing here starts or stops it. What
//! the program commands stays what outputs are compared with. In a thread and in a tap, and on the way to the next one,
//! S is that of the program; so it is where M49 or M51 P0 is in force.

use retrace_core::Rate;
use retrace_core::mode::{Mode, ModeOutput};
use retrace_gcode::{ActiveCodes, FeedMode};
use retrace_link::{CardStatus, MotionCard, OutputChange, Outputs, channel};

use crate::operator::CommandError;
use crate::record_streamer::SpeedShare;
use crate::session::Session;

const NO_SPINDLE: CommandError = CommandError::NotNow("S is the power of a beam on this machine, and has no override");
const OUT_OF_RANGE: CommandError = CommandError::NotNow("a speed override is 10 … 200 %");

/// Override of the speed.
#[derive(Clone, Copy, Debug)]
pub(in crate::session) struct SpeedOverride {
    /// What the operator asks for, per cent.
    asked: i64,
    /// Whether the program has switched it off (M49, M51 P0).
    is_off: bool,
    /// Whether the feed is per turn (G95).
    feeds_per_turn: bool,
    /// The value of S that was sent last, if any.
    sent: Option<i32>,
}

impl Default for SpeedOverride {
    fn default() -> Self {
        Self { asked: 100, is_off: false, feeds_per_turn: false, sent: None }
    }
}

impl<const A: usize, C: MotionCard<A>> Session<'_, A, C> {
    /// Sets the speed override.
    pub(in crate::session) fn set_speed_override(&mut self, rate: Rate) -> Result<(), CommandError> {
        if self.recovery.machine().powered_beam().is_some() {
            return Err(NO_SPINDLE);
        }
        let percent = (f64::from(rate) * 100.0).round() as i64;
        if !(10..=200).contains(&percent) {
            return Err(OUT_OF_RANGE);
        }
        self.program_override.speed.asked = percent;
        Ok(())
    }

    /// The speed override that the operator asks for.
    pub(in crate::session) fn asked_speed_override(&self) -> Rate {
        Rate::percent(self.program_override.speed.asked)
    }

    /// Notes the modes that are in force from here on.
    pub(in crate::session) fn note_speed_modes(&mut self, active: &ActiveCodes) {
        let speed = &mut self.program_override.speed;
        speed.is_off = !active.speed_override;
        speed.feeds_per_turn = active.feed_mode == FeedMode::UnitsPerRevolution;
    }

    /// The share of the programmed S that applies now.
    fn speed_share(&self) -> SpeedShare {
        let (speed, spindle) = (&self.program_override.speed, &self.recovery.machine().spindle);
        let place = self.card.status().place.record;
        let is_geared = self.is_engaged() || self.geared.is_in_thread(place) || self.streamer.gear_is_next();
        let percent = match speed.is_off {
            false if is_geared => self.speed_override_in_thread().unwrap_or(100),
            false => speed.asked,
            true => 100,
        };
        let thousandths = |rpm: f64| (rpm * 1000.0).min(f64::from(i32::MAX)) as i32;
        SpeedShare { percent, range: [spindle.min_rpm, spindle.max_rpm].map(thousandths) }
    }

    /// The speed override in a thread that follows the spindle, in percent, at most that of the speed it is planned
    /// for; `None` where it does not act. The helix does not depend on it (SPN-20).
    fn speed_override_in_thread(&self) -> Option<i64> {
        let encoder = self.recovery.machine().encoder.filter(|encoder| encoder.overrides_thread)?;
        let most = (encoder.thread_margin * 100.0) as i64;
        (self.is_engaged() && !self.probing.is_active()).then_some(self.program_override.speed.asked.min(most))
    }

    /// Sets what S is multiplied with where it is sent.
    pub(in crate::session) fn apply_speed_share(&mut self) {
        let share = self.speed_share();
        self.streamer.set_speed_share(share);
    }

    /// Scales S in these changes, which an instruction makes.
    pub(in crate::session) fn scale_speed(&mut self, changes: &mut [OutputChange]) {
        let share = self.speed_share();
        for change in changes.iter_mut().filter(|change| change.channel == channel::SPEED) {
            change.value = share.of(change.value);
            self.program_override.speed.sent = Some(change.value);
        }
    }

    /// Sends S where the override has changed, or the program has switched S since.
    pub(in crate::session) fn watch_speed_override(&mut self, status: &CardStatus<A>) {
        let [turns, is] = [channel::SPINDLE, channel::SPEED].map(|of| status.outputs[usize::from(of)]);
        let is_untouched = self.program_override.speed.sent.is_none() && self.program_override.speed.asked == 100;
        let is_busy = self.executing.is_some() || self.restart.is_active() || self.manual_outputs.has_unreported();
        let is_elsewhere = self.dnc.is_paused() || self.mode_controller.mode() != Mode::Run;
        let is_geared = self.is_engaged() && self.speed_override_in_thread().is_none();
        if is_untouched || is_busy || turns == 0 || is_geared || is_elsewhere {
            return;
        }
        let value = self.speed_share().of(self.streamer.expected()[usize::from(channel::SPEED)]);
        if value != is && self.send_manual_output(OutputChange { channel: channel::SPEED, value }) {
            self.program_override.speed.sent = Some(value);
        }
    }

    /// The outputs, with S as the program commands it where the override alone makes it differ.
    pub(in crate::session) fn without_speed_override(&self, mut outputs: Outputs, wants: &Outputs) -> Outputs {
        let at = usize::from(channel::SPEED);
        let is_overridden = |is: i32| self.program_override.speed.sent == Some(is);
        if is_overridden(outputs[at]) || outputs[at] == self.speed_share().of(wants[at]) {
            outputs[at] = wants[at];
        }
        outputs
    }

    /// Takes the feed per turn with a spindle that is slower than programmed.
    pub(in crate::session) fn with_feed_per_turn(&self, mut demand: ModeOutput) -> ModeOutput {
        let percent = self.speed_share().percent.min(100);
        let feed = demand.target.feed;
        if percent < 100 && self.program_override.speed.feeds_per_turn && feed > Rate::ZERO {
            demand.target.feed = Rate::from_units(feed.units() * percent / 100);
        }
        demand
    }
}
