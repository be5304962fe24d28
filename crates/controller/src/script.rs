//! Plays a scripted operator: returns the commands that are due in each period, and turns the handwheel.
//!
//! Invariant: instructions are returned in the order of the script, each at its own time; `after` counts from the end
//! of the instruction before.

use std::collections::VecDeque;

use crate::operator::{OperatorCommand, ScriptInstruction, ScriptTime};

/// The state of a script being played.
#[derive(Clone, Debug)]
pub struct ScriptPlayer {
    script: VecDeque<ScriptInstruction>,
    period_s: f64,
    /// Period in which the previous instruction ended; before the first, the period of the first call.
    since: Option<u64>,
    wheel: Option<ScriptedWheel>,
}

/// A handwheel that is being turned.
#[derive(Clone, Copy, Debug)]
struct ScriptedWheel {
    counts_per_period: f64,
    from: u64,
    counted: i64,
    until: u64,
}

impl ScriptPlayer {
    /// Plays `script` on a machine with a control period of `period_us` microseconds.
    #[must_use]
    pub fn new(script: Vec<ScriptInstruction>, period_us: u32) -> Self {
        Self { script: script.into(), period_s: f64::from(period_us) * 1e-6, since: None, wheel: None }
    }

    /// Whether nothing is left to do.
    #[must_use]
    pub fn finished(&self) -> bool {
        self.script.is_empty() && self.wheel.is_none()
    }

    /// Whether nothing can become due while the machine is at rest. A line is reached only by moving.
    #[must_use]
    pub fn waits_for_motion(&self) -> bool {
        let next = self.script.front().map(|next| next.when);
        self.wheel.is_none() && next.is_none_or(|when| matches!(when, ScriptTime::Line(_)))
    }

    /// The next instruction, if it is due in period `period`, with program line `line` being executed.
    pub fn due_instruction(&mut self, period: u64, line: u32) -> Option<ScriptInstruction> {
        // The card may have run long before.
        let since = *self.since.get_or_insert(period);
        if self.wheel.is_some() {
            return None;
        }
        let next = self.script.front()?;
        let due = match next.when {
            ScriptTime::Time(seconds) => period >= self.periods(seconds),
            ScriptTime::Line(wanted) => line >= wanted,
            ScriptTime::AfterSeconds(seconds) => period >= since + self.periods(seconds),
            ScriptTime::AfterPeriods(periods) => period >= since + periods,
        };
        if !due {
            return None;
        }
        let next = self.script.pop_front()?;
        self.since = Some(period);
        if let OperatorCommand::Wheel { counts_per_s, seconds } = next.command {
            let until = period + self.periods(seconds);
            self.wheel = Some(ScriptedWheel {
                counts_per_period: counts_per_s * self.period_s,
                from: period,
                counted: 0,
                until,
            });
        }
        Some(next)
    }

    /// Handwheel counts in this period.
    pub fn wheel_counts(&mut self, period: u64) -> i16 {
        let Some(wheel) = &mut self.wheel else { return 0 };
        if period >= wheel.until {
            self.since = Some(period);
            self.wheel = None;
            return 0;
        }
        // from the beginning each time, so that no count is lost to rounding
        let turned = wheel.counts_per_period * (period + 1 - wheel.from) as f64;
        let counts = (turned.round() as i64 - wheel.counted).clamp(i64::from(i16::MIN), i64::from(i16::MAX));
        wheel.counted += counts;
        counts as i16
    }

    fn periods(&self, seconds: f64) -> u64 {
        (seconds / self.period_s).round() as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::operator_words::parse_script;

    #[test]
    fn after_counts_from_where_the_script_begins() {
        let mut player = ScriptPlayer::new(parse_script("after 5 periods hold", "s").expect("valid"), 1000);
        let due = (1000..1010).find(|&period| player.due_instruction(period, 1).is_some());
        assert_eq!(due, Some(1005));
    }

    #[test]
    fn instructions_wait_for_each_other_and_the_wheel_for_its_time() {
        let script =
            parse_script("at 0.01s hold\nafter 5 periods resume\nat line 7 wheel -200 for 0.1s\nafter 0s leave", "s")
                .expect("valid");
        let mut player = ScriptPlayer::new(script, 1000);
        let (mut log, mut counts) = (Vec::new(), 0i64);
        for period in 0..400 {
            while let Some(i) = player.due_instruction(period, if period < 100 { 1 } else { 8 }) {
                log.push((period, i.line));
            }
            counts += i64::from(player.wheel_counts(period));
        }
        assert_eq!(log, [(10, 1), (15, 2), (100, 3), (201, 4)]);
        assert_eq!(counts, -20);
        assert!(player.finished());
    }
}
