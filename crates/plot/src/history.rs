//! History of a job over time: its place on the path, its activity, and its events.
//!
//! Invariant: samples are in the order of their times. The labels may cover fewer events than happened, and state how
//! many are missing.

use crate::tool_path::ToolPath;

/// Activity of a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Activity {
    /// Normal run.
    Run,
    /// Reverse run.
    Reverse,
    /// Forward run over recorded motion.
    Forward,
    /// Handwheel.
    Wheel,
    /// Return to the furthest place.
    Return,
    /// At the furthest place, where outputs differ.
    Settle,
    /// Held.
    Hold,
    /// At a program stop.
    ProgramStop,
    /// At the end of a single block.
    SingleBlock,
    /// Paused at a breakpoint.
    Paused,
}

impl Activity {
    /// Label in a word.
    pub(crate) fn word(self) -> &'static str {
        match self {
            Self::Run => "run",
            Self::Reverse => "reverse",
            Self::Forward => "forward",
            Self::Wheel => "wheel",
            Self::Return => "rejoin",
            Self::Settle => "outputs",
            Self::Hold => "held",
            Self::ProgramStop => "stop",
            Self::SingleBlock => "single",
            Self::Paused => "paused",
        }
    }

    /// Whether the activity repeats recorded motion.
    #[must_use]
    pub fn is_retracing(self) -> bool {
        matches!(self, Self::Reverse | Self::Forward | Self::Wheel | Self::Return | Self::Settle)
    }
}

/// Place of a job at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HistorySample {
    /// Machine time in seconds since the job started.
    pub time_s: f64,
    /// Place, in seconds of programmed motion.
    pub place_s: f64,
    /// Furthest place ever executed, in seconds of programmed motion.
    pub reached_s: f64,
    /// Activity from then on.
    pub activity: Activity,
}

/// Priority of a label: where there is no space, lower ones are left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Priority {
    /// The event ended or interrupted the job.
    Ending,
    /// The machine stopped for it.
    Standing,
    /// The operator caused it.
    Operator,
    /// The program switched something.
    Switching,
    /// The event has no effect on the motion.
    Passing,
}

/// Event in a history.
#[derive(Clone, Debug, PartialEq)]
pub struct HistoryEvent {
    /// Machine time in seconds since the job started.
    pub time_s: f64,
    /// Priority of the label.
    pub priority: Priority,
    /// Label.
    pub label: String,
}

/// History of a job.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct History {
    /// Path that was executed, with its retraced sections; it has the name of the program.
    pub path: ToolPath,
    /// Result of the job, in one line.
    pub summary: String,
    /// Places over time.
    pub samples: Vec<HistorySample>,
    /// Events in the order of time.
    pub events: Vec<HistoryEvent>,
    /// Current position of the machine, X Y Z in mm.
    pub stands_mm: Option<[f64; 3]>,
}

impl History {
    /// Duration of the job, in seconds of machine time.
    pub(crate) fn duration_s(&self) -> f64 {
        let remarks = self.events.iter().map(|remark| remark.time_s);
        self.samples.iter().map(|moment| moment.time_s).chain(remarks).fold(0.0, f64::max)
    }

    /// Place at a time, in seconds of programmed motion.
    pub(crate) fn place_s(&self, time_s: f64) -> Option<f64> {
        let next = self.samples.partition_point(|moment| moment.time_s <= time_s);
        // Events before the first position are placed there.
        let before = self.samples.get(next.saturating_sub(1))?;
        let Some(after) = self.samples.get(next).filter(|_| next > 0) else { return Some(before.place_s) };
        let share = (time_s - before.time_s) / (after.time_s - before.time_s);
        Some(before.place_s + (after.place_s - before.place_s) * share)
    }

    /// Sections of time with the same activity: first and last time in seconds.
    pub(crate) fn stretches(&self) -> Vec<(Activity, [f64; 2])> {
        let mut stretches: Vec<(Activity, [f64; 2])> = Vec::new();
        for pair in self.samples.windows(2) {
            let [from, to] = [pair[0].time_s, pair[1].time_s];
            match stretches.last_mut() {
                Some((doing, [_, end])) if *doing == pair[0].activity => *end = to,
                _ => stretches.push((pair[0].activity, [from, to])),
            }
        }
        stretches
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn moment(time_s: f64, place_s: f64, doing: Activity) -> HistorySample {
        HistorySample { time_s, place_s, reached_s: place_s, activity: doing }
    }

    #[test]
    fn a_place_lies_between_the_moments_around_it() {
        let course =
            vec![moment(1.0, 2.0, Activity::Run), moment(3.0, 4.0, Activity::Reverse), moment(4.0, 3.0, Activity::Run)];
        let history = History { samples: course, ..History::default() };
        let at = [0.5, 1.0, 2.0, 3.0, 3.5, 9.0].map(|time| history.place_s(time));
        assert_eq!(at, [Some(2.0), Some(2.0), Some(3.0), Some(4.0), Some(3.5), Some(3.0)]);
        assert_eq!(history.stretches(), [(Activity::Run, [1.0, 3.0]), (Activity::Reverse, [3.0, 4.0])]);
        assert!((history.duration_s() - 4.0).abs() < 1e-12);
    }
}
