//! Why a cutter went off: identifiers and texts.
//!
//! Invariant: a reason that the operator can do something about says what.

use retrace_link::CutterOffCause;

/// Reason why a cutting output, or the spindle at the end of a job, was switched off.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CutterOffReason {
    /// The card switched it off.
    Card(CutterOffCause),
    /// The operator switched it off.
    Operator,
    /// The path is about to be retraced.
    Retrace,
    /// The program has ended.
    ProgramEnd,
    /// The job has ended before its program.
    JobStopped,
    /// It was started in motion, and was not proven where the cut had ended.
    NotLatched,
    /// The cut has come to a part of the contour that is cut already.
    Kerf,
}

impl CutterOffReason {
    /// Identifier for JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Card(CutterOffCause::Standing) => "at_rest",
            Self::Card(CutterOffCause::Reverse) | Self::Retrace => "reverse",
            Self::Card(CutterOffCause::Inhibited) => "dry_run",
            Self::Card(CutterOffCause::Alarm) => "alarm",
            Self::Card(CutterOffCause::HostSilent) => "host_silent",
            Self::Card(CutterOffCause::EpochClosed | CutterOffCause::EpochOpened) => "epoch",
            Self::Card(CutterOffCause::Lost) | Self::NotLatched => "lost",
            Self::Card(CutterOffCause::NotStarted) => "not_started",
            Self::Card(CutterOffCause::Collision) => "collision",
            Self::Card(CutterOffCause::NoSheet) => "no_sheet",
            Self::Card(CutterOffCause::SheetContact) => "sheet_contact",
            Self::Card(CutterOffCause::HeightLimit) => "height_limit",
            Self::Operator => "operator",
            Self::ProgramEnd => "program_end",
            Self::JobStopped => "job_stopped",
            Self::Kerf => "kerf",
        }
    }

    /// Whether the cut waits for `recover`: its end is neither the program's nor the operator's.
    #[must_use]
    pub const fn waits_for_recovery(self) -> bool {
        match self {
            Self::Card(cause) => match cause {
                CutterOffCause::Standing
                | CutterOffCause::Lost
                | CutterOffCause::NotStarted
                | CutterOffCause::NoSheet
                | CutterOffCause::SheetContact
                | CutterOffCause::HeightLimit => true,
                // A collision is an alarm, which ends the job.
                CutterOffCause::Reverse
                | CutterOffCause::Inhibited
                | CutterOffCause::Alarm
                | CutterOffCause::HostSilent
                | CutterOffCause::EpochClosed
                | CutterOffCause::EpochOpened
                | CutterOffCause::Collision => false,
            },
            Self::NotLatched => true,
            Self::Operator | Self::Retrace | Self::ProgramEnd | Self::JobStopped | Self::Kerf => false,
        }
    }

    /// Text behind "off: ".
    pub(crate) const fn text(self) -> &'static str {
        match self {
            Self::Card(CutterOffCause::Standing) => "the machine is at rest; `recover` starts it again and resumes",
            Self::Card(CutterOffCause::Reverse) | Self::Retrace => "the path is retraced",
            Self::Card(CutterOffCause::Inhibited) => "dry run",
            Self::Card(CutterOffCause::Alarm) => "alarm",
            Self::Card(CutterOffCause::HostSilent) => "no message from the computer",
            Self::Card(CutterOffCause::EpochClosed | CutterOffCause::EpochOpened) => "the path was left",
            Self::Card(CutterOffCause::Lost) => {
                "E3024: it was lost in the cut; `recover` goes back to the end of the cut and cuts on, `back to cut \
                 end` only goes there"
            }
            Self::Card(CutterOffCause::NotStarted) => {
                "E3025: it did not start in any attempt; check the consumables and the earth clamp, `recover` tries \
                 again"
            }
            Self::Card(CutterOffCause::Collision) => "a collision input is active",
            Self::Card(CutterOffCause::NoSheet) => "no sheet was found; `recover` tries again, `skip contour` goes on",
            Self::Card(CutterOffCause::SheetContact) => {
                "the contact for sensing is closed over the sheet, or stays closed; check it, then `recover`"
            }
            Self::Card(CutterOffCause::HeightLimit) => {
                "E3036: the torch reached the end of its height range; check the sheet, the voltage of the material \
                 and the consumables, then `recover`"
            }
            Self::NotLatched => {
                "E3024: it did not take hold where the cut ended; `recover` tries again, `back to pierce` and `cut` \
                 pierce anew"
            }
            Self::Operator => "by the operator",
            Self::ProgramEnd => "the program has ended",
            Self::JobStopped => "the job has ended",
            Self::Kerf => "the contour is cut already from here on",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Where the text names `recover`, the job waits for it, and nowhere else.
    #[test]
    fn what_waits_for_recovery_says_so() {
        let causes = [
            CutterOffCause::Standing,
            CutterOffCause::Reverse,
            CutterOffCause::Inhibited,
            CutterOffCause::Alarm,
            CutterOffCause::HostSilent,
            CutterOffCause::EpochClosed,
            CutterOffCause::EpochOpened,
            CutterOffCause::Lost,
            CutterOffCause::NotStarted,
            CutterOffCause::Collision,
            CutterOffCause::NoSheet,
            CutterOffCause::SheetContact,
            CutterOffCause::HeightLimit,
        ];
        let by_host = [
            CutterOffReason::Operator,
            CutterOffReason::Retrace,
            CutterOffReason::ProgramEnd,
            CutterOffReason::JobStopped,
            CutterOffReason::NotLatched,
            CutterOffReason::Kerf,
        ];
        for reason in causes.map(CutterOffReason::Card).into_iter().chain(by_host) {
            assert_eq!(reason.waits_for_recovery(), reason.text().contains("`recover`"), "{reason:?}");
        }
    }
}
