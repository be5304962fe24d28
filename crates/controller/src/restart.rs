//! The plan of a restart: outputs are restored by the instructions that switched them, in program order, each with its
//! duration and its input (CUT-17, DNC-9).
//!
//! Invariant: a cutter is lit last and put out first; no output is switched that agrees already.

use retrace_config::SpindleReady;
use retrace_core::RecordIndex;
use retrace_link::{InputWait, LayerMove, MAX_CHANGES, OutputAction, OutputChange, Outputs, channel};

/// The instruction that switched an output last.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct OutputOrigin {
    /// Number of the instruction in program order; 0 where none of the program's instructions switched it.
    sequence: u32,
    code: &'static str,
    line: u32,
    place: RecordIndex,
    periods: u32,
    until: Option<InputWait>,
    layer: Option<LayerMove>,
}

/// One instruction to execute again.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RestartStep {
    /// Code as written in the program: `M3`, `M64` …
    pub code: &'static str,
    /// Program line; 0 where no instruction of the program switched the output.
    pub line: u32,
    /// Outputs to switch; the first `count` of them are valid.
    pub changes: [OutputChange; MAX_CHANGES],
    /// Number of valid `changes`.
    pub count: u8,
    /// Minimum duration in control periods.
    pub periods: u32,
    /// Input that it waits for.
    pub until: Option<InputWait>,
    /// Moves of the layer before and behind the switching.
    pub layer: Option<LayerMove>,
}

impl RestartStep {
    /// The valid changes.
    #[must_use]
    pub fn changes(&self) -> &[OutputChange] {
        &self.changes[..usize::from(self.count).min(MAX_CHANGES)]
    }
}

/// Adds the wait for a spindle without an encoder to the last step that switches it on or changes its speed (SPN-6).
pub(crate) fn await_spindle(steps: &mut [RestartStep], wants: &Outputs, ready: SpindleReady) {
    let concerns = |change: &OutputChange| matches!(change.channel, channel::SPINDLE | channel::SPEED);
    let last = steps.iter_mut().rev().find(|step| step.changes().iter().any(concerns));
    if let Some(step) = last.filter(|_| wants[usize::from(channel::SPINDLE)] != 0) {
        step.periods = step.periods.max(ready.periods);
        step.until = step.until.or(ready.until);
    }
}

/// The instructions that switched each output last, off and on.
#[derive(Clone, Debug)]
pub(crate) struct OutputOrigins {
    of: [[OutputOrigin; 2]; channel::COUNT],
    sequence: u32,
}

impl Default for OutputOrigins {
    fn default() -> Self {
        Self { of: [[OutputOrigin::default(); 2]; channel::COUNT], sequence: 0 }
    }
}

impl OutputOrigins {
    /// Records that an instruction of the program has switched these outputs before the record at `place`.
    pub(crate) fn record_switching(
        &mut self,
        changes: &[OutputChange],
        (code, line, place): (&'static str, u32, RecordIndex),
        (periods, until, layer): (u32, Option<InputWait>, Option<LayerMove>),
    ) {
        self.sequence = self.sequence.saturating_add(1);
        let origin = OutputOrigin { sequence: self.sequence, code, line, place, periods, until, layer };
        for change in changes {
            if let Some(slot) = self.of.get_mut(usize::from(change.channel)) {
                slot[usize::from(change.value != 0)] = origin;
            }
        }
    }

    /// Records that the program has switched an output without a stop.
    pub(crate) fn record_action(&mut self, action: &OutputAction, line: u32) {
        let code = match action.after {
            _ if channel::is_analog(action.channel) => "M67",
            0 => "M63",
            _ => "M62",
        };
        let change = OutputChange { channel: action.channel, value: action.after };
        self.record_switching(&[change], (code, line, action.place), (0, None, None));
    }

    /// Records a dwell before the record at `place`. Where a cutter was lit at this very place it is the pierce, and
    /// belongs to the start of the cutter: to what of it was switched last, and not to the abrasive that leads a jet.
    pub(crate) fn record_dwell(&mut self, place: RecordIndex, periods: u32, expected: &Outputs, cutting: &[u8]) {
        let is_on = |channel: u8| expected.get(usize::from(channel)).is_some_and(|&value| value != 0);
        let started = |origin: &OutputOrigin| origin.sequence != 0 && origin.place == place;
        let sequence = |&channel: &u8| self.of.get(usize::from(channel)).map_or(0, |[_, origin]| origin.sequence);
        let Some(&last) = cutting.iter().filter(|&&channel| is_on(channel)).max_by_key(|channel| sequence(channel))
        else {
            return;
        };
        if let Some([_, origin]) = self.of.get_mut(usize::from(last)).filter(|[_, origin]| started(origin)) {
            match &mut origin.until {
                Some(InputWait { ignition: Some(ignition), .. }) => {
                    ignition.delay_periods = ignition.delay_periods.saturating_add(periods);
                }
                _ => origin.periods = origin.periods.saturating_add(periods),
            }
        }
    }

    /// Code and line of the program that switched this output to such a value last: on, or off. `("", 0)` where none
    /// did.
    pub(crate) fn origin_of(&self, channel: u8, value: i32) -> (&'static str, u32) {
        let origin =
            self.of.get(usize::from(channel)).map_or(OutputOrigin::default(), |of| of[usize::from(value != 0)]);
        (origin.code, origin.line)
    }

    /// Replaces the contents of `steps` by what brings the outputs from `are` to `wants`, for the channels selected by
    /// `concerned`: first what goes off, the cutters before anything else; then what comes on, in program order, the
    /// cutters last. Does not allocate where `steps` has capacity for all channels.
    pub(crate) fn plan_restart(
        &self,
        are: &Outputs,
        wants: &Outputs,
        cutting: &[u8],
        concerned: impl Fn(u8) -> bool,
        steps: &mut Vec<RestartStep>,
    ) {
        steps.clear();
        let mut channels = [0u8; channel::COUNT];
        let mut count = 0;
        for channel in (0..channel::COUNT as u8).filter(|&c| concerned(c)) {
            if are[usize::from(channel)] != wants[usize::from(channel)] {
                channels[count] = channel;
                count += 1;
            }
        }
        let origin_of = |channel: u8| {
            let at = usize::from(channel);
            self.of[at][usize::from(wants[at] != 0)]
        };
        let key = |channel: u8| {
            let (sequence, fires) = (origin_of(channel).sequence, cutting.contains(&channel));
            match wants[usize::from(channel)] {
                0 => (false, !fires, u32::MAX - sequence),
                _ => (true, fires, sequence),
            }
        };
        let channels = &mut channels[..count];
        channels.sort_unstable_by_key(|&channel| (key(channel), channel));
        let mut last = None;
        for &channel in &*channels {
            let change = OutputChange { channel, value: wants[usize::from(channel)] };
            let origin = origin_of(channel);
            match steps.last_mut() {
                Some(step)
                    if last == Some(key(channel)) && origin.sequence != 0 && usize::from(step.count) < MAX_CHANGES =>
                {
                    step.changes[usize::from(step.count)] = change;
                    step.count += 1;
                }
                _ => {
                    let mut changes = [OutputChange::default(); MAX_CHANGES];
                    changes[0] = change;
                    let OutputOrigin { code, line, periods, until, layer, .. } = origin;
                    let code = if code.is_empty() { "output" } else { code };
                    steps.push(RestartStep { code, line, changes, count: 1, periods, until, layer });
                }
            }
            last = Some(key(channel));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use channel::{FLOOD, SPEED, SPINDLE};

    fn outputs(on: &[(u8, i32)]) -> Outputs {
        let mut outputs = [0; channel::COUNT];
        for &(channel, value) in on {
            outputs[usize::from(channel)] = value;
        }
        outputs
    }

    fn change(channel: u8, value: i32) -> OutputChange {
        OutputChange { channel, value }
    }

    fn steps(origins: &OutputOrigins, are: &Outputs, wants: &Outputs) -> Vec<(&'static str, Vec<OutputChange>, u32)> {
        let mut steps = Vec::new();
        origins.plan_restart(are, wants, &[3], |_| true, &mut steps);
        steps.iter().map(|step| (step.code, step.changes().to_vec(), step.periods)).collect()
    }

    #[test]
    fn outputs_come_back_in_program_order_with_their_durations_and_the_cutter_last() {
        let mut origins = OutputOrigins::default();
        origins.record_switching(&[change(3, 1)], ("M101", 2, RecordIndex::new(0)), (1500, None, None));
        origins.record_switching(&[change(SPEED, 900_000)], ("S", 3, RecordIndex::new(0)), (0, None, None));
        origins.record_switching(
            &[change(SPINDLE, 1), change(4, 1)],
            ("M3", 4, RecordIndex::new(0)),
            (800, None, None),
        );
        origins.record_switching(&[change(FLOOD, 1)], ("M8", 5, RecordIndex::new(0)), (20, None, None));
        let wants = outputs(&[(3, 1), (SPEED, 900_000), (SPINDLE, 1), (4, 1), (FLOOD, 1)]);
        let all = steps(&origins, &outputs(&[]), &wants);
        let expected = vec![
            ("S", vec![change(SPEED, 900_000)], 0),
            ("M3", vec![change(4, 1), change(SPINDLE, 1)], 800),
            ("M8", vec![change(FLOOD, 1)], 20),
            ("M101", vec![change(3, 1)], 1500),
        ];
        assert_eq!(all, expected);
        // outputs that agree are not switched
        let are = outputs(&[(3, 1), (SPEED, 900_000), (SPINDLE, 1), (FLOOD, 1)]);
        assert_eq!(steps(&origins, &are, &wants), vec![("M3", vec![change(4, 1)], 800)]);
    }

    #[test]
    fn what_is_on_by_hand_goes_off_first_the_cutter_before_anything_else() {
        let mut origins = OutputOrigins::default();
        origins.record_switching(&[change(FLOOD, 0)], ("M9", 2, RecordIndex::new(0)), (10, None, None));
        origins.record_switching(&[change(SPINDLE, 1)], ("M3", 3, RecordIndex::new(0)), (800, None, None));
        let wants = outputs(&[(SPINDLE, 1)]);
        let all = steps(&origins, &outputs(&[(3, 1), (FLOOD, 1), (5, 1)]), &wants);
        let codes: Vec<_> = all.iter().map(|(code, ..)| *code).collect();
        assert_eq!(codes, ["output", "M9", "output", "M3"], "{all:?}");
        assert_eq!(all[0].1, vec![change(3, 0)]);
    }

    #[test]
    fn a_dwell_is_the_pierce_of_what_was_switched_last_and_an_abrasive_leads_as_before() {
        let (mut origins, place) = (OutputOrigins::default(), RecordIndex::new(70));
        origins.record_switching(&[change(4, 1)], ("M3", 2, place), (300, None, None));
        origins.record_switching(&[change(3, 1)], ("M3", 2, place), (0, None, None));
        let wants = outputs(&[(3, 1), (4, 1)]);
        origins.record_dwell(place, 500, &wants, &[3, 4]);
        let mut steps = Vec::new();
        origins.plan_restart(&outputs(&[]), &wants, &[3, 4], |_| true, &mut steps);
        let order: Vec<(u8, u32)> = steps.iter().map(|step| (step.changes()[0].channel, step.periods)).collect();
        assert_eq!(order, [(4, 300), (3, 500)]);
    }

    #[test]
    fn a_dwell_where_the_cutter_was_lit_is_its_pierce() {
        let mut origins = OutputOrigins::default();
        origins.record_switching(&[change(3, 1)], ("M64", 2, RecordIndex::new(70)), (0, None, None));
        let wants = outputs(&[(3, 1)]);
        origins.record_dwell(RecordIndex::new(70), 500, &wants, &[3]);
        origins.record_dwell(RecordIndex::new(90), 500, &wants, &[3]);
        assert_eq!(steps(&origins, &outputs(&[]), &wants), vec![("M64", vec![change(3, 1)], 500)]);
    }
}
