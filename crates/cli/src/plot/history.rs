//! What became of a job over time: where on its path it was, what it was doing there, and what happened.
//!
//! Invariant: moments come in the order of their times; what is to be said of them may be less than happened, and says then how much less.

use super::tool_path::ToolPath;

/// What a job was doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Activity {
    /// Normal run.
    Run,
    /// Reverse run.
    Reverse,
    /// Forward run over what was recorded.
    Forward,
    /// The handwheel.
    Wheel,
    /// On the way back to the furthest place.
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
    /// In a word.
    pub(super) fn word(self) -> &'static str {
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

    /// Is the path run over that was run before?
    #[must_use]
    pub fn is_retracing(self) -> bool {
        matches!(self, Self::Reverse | Self::Forward | Self::Wheel | Self::Return | Self::Settle)
    }
}

/// Where a job was at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HistorySample {
    /// Machine time in seconds since the job began.
    pub time_s: f64,
    /// The place, in seconds of programmed motion.
    pub place_s: f64,
    /// The furthest place ever executed, in seconds of programmed motion.
    pub reached_s: f64,
    /// What it was doing from then on.
    pub doing: Activity,
}

/// How much something matters: where there is no room, what matters less is left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Priority {
    /// It ended or interrupted the job.
    Ending,
    /// The machine stood for it.
    Standing,
    /// The operator did it.
    Operator,
    /// The program switched something.
    Switching,
    /// It went by.
    Passing,
}

/// Something that happened.
#[derive(Clone, Debug, PartialEq)]
pub struct HistoryEvent {
    /// Machine time in seconds since the job began.
    pub time_s: f64,
    /// How much it matters.
    pub rank: Priority,
    /// What happened.
    pub words: String,
}

/// What became of a job.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct History {
    /// The path that was executed, and what of it was retraced; named as the program.
    pub path: ToolPath,
    /// How it ended, and what else is to be said in a line.
    pub summary: String,
    /// Where it was over time.
    pub course: Vec<HistorySample>,
    /// What happened, in the order of time.
    pub remarks: Vec<HistoryEvent>,
    /// Where the machine stands now, X Y Z in mm.
    pub stands_mm: Option<[f64; 3]>,
}

impl History {
    /// How long the job took, in seconds of machine time.
    pub(super) fn duration_s(&self) -> f64 {
        let remarks = self.remarks.iter().map(|remark| remark.time_s);
        self.course.iter().map(|moment| moment.time_s).chain(remarks).fold(0.0, f64::max)
    }

    /// The place at a time, in seconds of programmed motion.
    pub(super) fn place_s(&self, time_s: f64) -> Option<f64> {
        let next = self.course.partition_point(|moment| moment.time_s <= time_s);
        // What is told before the first position happened there.
        let before = self.course.get(next.saturating_sub(1))?;
        let Some(after) = self.course.get(next).filter(|_| next > 0) else { return Some(before.place_s) };
        let share = (time_s - before.time_s) / (after.time_s - before.time_s);
        Some(before.place_s + (after.place_s - before.place_s) * share)
    }

    /// The stretches of time in which it was doing the same, first and last time in seconds.
    pub(super) fn stretches(&self) -> Vec<(Activity, [f64; 2])> {
        let mut stretches: Vec<(Activity, [f64; 2])> = Vec::new();
        for pair in self.course.windows(2) {
            let [from, to] = [pair[0].time_s, pair[1].time_s];
            match stretches.last_mut() {
                Some((doing, [_, end])) if *doing == pair[0].doing => *end = to,
                _ => stretches.push((pair[0].doing, [from, to])),
            }
        }
        stretches
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn moment(time_s: f64, place_s: f64, doing: Activity) -> HistorySample {
        HistorySample { time_s, place_s, reached_s: place_s, doing }
    }

    #[test]
    fn a_place_lies_between_the_moments_around_it() {
        let course =
            vec![moment(1.0, 2.0, Activity::Run), moment(3.0, 4.0, Activity::Reverse), moment(4.0, 3.0, Activity::Run)];
        let history = History { course, ..History::default() };
        let at = [0.5, 1.0, 2.0, 3.0, 3.5, 9.0].map(|time| history.place_s(time));
        assert_eq!(at, [Some(2.0), Some(2.0), Some(3.0), Some(4.0), Some(3.5), Some(3.0)]);
        assert_eq!(history.stretches(), [(Activity::Run, [1.0, 3.0]), (Activity::Reverse, [3.0, 4.0])]);
        assert!((history.duration_s() - 4.0).abs() < 1e-12);
    }
}
