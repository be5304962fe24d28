//! Height control: the layer follows the arc voltage, or two inputs, while the torch cuts (CUT-49 to CUT-53).
//!
//! Invariant: the machine is where the path and the layer are, in every period; the table asserts it.

use proptest::prelude::*;
use retrace_card::InputLevels;
use retrace_core::{FeedShare, Flags, Place, Rate, Record, RecordIndex};
use retrace_link::{
    CardCore, CardSettings, CardStatus, CommandRefusal, CutterOffCause, CuttingChannel, HeightControlSettings,
    HeightSource, HeightState, HostCommand, InputSetting, Instruction, LayerMove, OutputAction, OutputChange,
    PathStart, ProofInput, channel,
};

use crate::common::STOP;
use crate::layer::{START, TORCH, Table, Z, instruction, layer_settings};

const SHEET: i64 = -900;
/// Where the torch is when it begins to cut.
const CUT: i64 = SHEET + 1 + 45;
/// Reading at the cutting height, and for a pulse.
const TARGET: u16 = 30_000;
const PER_PULSE: i64 = 40;

/// Two pulses per period at most; a tenth of the error in pulses per period.
pub(crate) const VOLTS: HeightControlSettings = HeightControlSettings {
    source: HeightSource::Volts { input: 1 },
    target: TARGET,
    speed: 2 << 16,
    gain: ((1 << 32) / (10 * PER_PULSE)) as i32,
    filter: 1 << 14,
    band: 40,
    slope: 200 << 16,
    void_periods: 500,
    up: 200,
    down: 150,
    delay_periods: 40,
    samples: 10,
    hold_below: FeedShare::from_units(29_491),
    look_periods: 30,
    limit_periods: 50,
};

/// A torch that cuts along a path.
struct Cut {
    table: Table,
    /// Speed of each record of the path, in units of 2⁻¹⁵ of the feed.
    share: fn(u32) -> u16,
    /// What each record moves the tool axis by.
    path: fn(u32) -> i16,
    /// Height of the sheet over the one that was sensed, by place.
    sheet: fn(u32) -> i64,
    /// What the arc adds to a reading, by place.
    noise: fn(u32) -> i64,
    records: u32,
}

impl Cut {
    fn new(control: HeightControlSettings, records: u32) -> Self {
        Self::with(control, records, layer_settings(1))
    }

    fn with(control: HeightControlSettings, records: u32, mut settings: CardSettings<2>) -> Self {
        let LayerMove::Start { start, lowest, pierce, cut, sheet, .. } = START else { unreachable!() };
        let start = LayerMove::Start { start, lowest, pierce, cut, sheet, control: [control] };
        settings.inputs[3] = InputSetting::default();
        let mut table = Table::with(Some(SHEET), &settings);
        table.send(HostCommand::Trim { high: RecordIndex::new(0) });
        table.instruct(1, Some(1), start);
        table.send(HostCommand::rate(Rate::ONE));
        let mut cut =
            Self { table, share: |_| FeedShare::FEED.units(), path: |_| 0, sheet: |_| 0, noise: |_| 0, records };
        cut.fill();
        cut.table.until_executed(1);
        assert_eq!(cut.table.position, CUT);
        cut.table.increments.clear();
        cut
    }

    fn with_share(mut self, share: fn(u32) -> u16) -> Self {
        self.share = share;
        self.table.send(HostCommand::Trim { high: RecordIndex::new(8) });
        self
    }

    fn with_path(mut self, path: fn(u32) -> i16) -> Self {
        self.path = path;
        self.table.send(HostCommand::Trim { high: RecordIndex::new(8) });
        self
    }

    fn fill(&mut self) {
        for place in self.table.status().high.number()..self.records {
            let flags = if place + 1 == self.records { Flags::REST } else { Flags::NONE };
            let share = (self.share)(place);
            let increments = [((5 * u32::from(share)) >> 15) as i16, (self.path)(place)];
            let record = Record { increments, flags, feed_share: FeedShare::from_units(share), ..Record::default() };
            if self.table.card.accept(HostCommand::Ahead { place: RecordIndex::new(place), record }).is_err() {
                return;
            }
        }
    }

    fn place(&self) -> u32 {
        self.table.status().place.record.number()
    }

    /// Height of the torch over the one at which the cut began.
    fn error(&self) -> i64 {
        self.table.position - CUT - (self.sheet)(self.place())
    }

    fn period(&mut self) -> CardStatus<2> {
        self.fill();
        let reading = i64::from(TARGET) + PER_PULSE * self.error() + (self.noise)(self.place());
        self.table.reading = Some(reading.clamp(0, 65_535) as u16);
        self.table.period()
    }

    fn periods(&mut self, count: u32) -> CardStatus<2> {
        for _ in 0..count {
            self.period();
        }
        self.table.status()
    }

    /// Runs to the end of the path; returns the errors and the statuses.
    fn run_to_end(&mut self) -> Vec<(u32, i64, CardStatus<2>)> {
        let mut seen = Vec::new();
        while self.table.status().place != Place::start_of(RecordIndex::new(self.records)) {
            let status = self.period();
            seen.push((self.place(), self.error(), status));
            assert!(seen.len() < 20_000, "{status:?}");
        }
        seen
    }
}

/// A sheet that rises by a pulse in 12 periods, then falls: the torch stays within 3 pulses of its height, the path is
/// the same to the pulse, and the axis is within its limits.
#[test]
fn the_torch_follows_a_warped_sheet() {
    let warped = |place: u32| i64::from(place.min(1000)) / 12 - i64::from(place.max(1000) - 1000) / 12;
    let mut cut = Cut::new(VOLTS, 2000);
    cut.sheet = warped;
    cut.noise = |place| i64::from(place * 7919 % 61) - 30;
    let seen = cut.run_to_end();
    let behind_the_delay = seen.iter().filter(|seen| seen.0 > 120);
    let worst = behind_the_delay.map(|&(_, error, _)| error.abs()).max().unwrap_or_default();
    assert!(worst <= 3, "{worst} pulses");
    assert_eq!(seen.last().map(|seen| seen.2.counts), Some([5 * 2000, 0]), "the path is exact");
    assert!(seen.iter().any(|seen| seen.2.height_state() == HeightState::Active));
    let layer = seen[0].2.layer;
    assert!(seen[1..40].iter().all(|seen| seen.2.height_state() == HeightState::Waiting && seen.2.layer == layer));
    cut.table.assert_limits();
    // The end of the cut goes where it would have gone.
    let mut end = instruction(2, Some(0), LayerMove::To { layer: 0 });
    end.place = RecordIndex::new(2000);
    cut.table.send(HostCommand::Instruction(end));
    cut.table.until_executed(2);
    assert_eq!(
        (cut.table.position, cut.table.status().layer, cut.table.status().height_state()),
        (0, 0, HeightState::Off)
    );
}

/// The mean reading where the control takes over is the target, whatever the operator adds to it.
#[test]
fn a_target_is_sampled_and_the_operator_adds_to_it() {
    let mut cut = Cut::new(HeightControlSettings { target: 0, ..VOLTS }, 2000);
    cut.noise = |_| 4_000;
    let layer = cut.table.status().layer;
    cut.periods(300);
    assert_eq!(cut.table.status().layer, layer, "the voltage is what it was");
    let by = OutputChange { channel: channel::HEIGHT_OFFSET, value: 20 * PER_PULSE as i32 };
    cut.table.send(HostCommand::ManualOutput(by));
    let status = cut.periods(300);
    assert!((19..=20).contains(&(status.layer - layer)), "{} pulses higher", status.layer - layer);
    // A known target is another height.
    let mut cut = Cut::new(VOLTS, 2000);
    cut.noise = |_| 4_000;
    let down = layer - cut.periods(500).layer;
    assert!((98..=100).contains(&down), "{down} pulses lower");
}

/// A corner: the sheet seems to rise, as it does where an arc is slow, and the height does not change by a pulse from
/// before the corner until the feed is reached again.
#[test]
fn the_height_stays_in_a_corner() {
    let mut cut = Cut::new(HeightControlSettings { slope: 0, ..VOLTS }, 1200)
        .with_share(|place| if (600..640).contains(&place) { 16_384 } else { 1 << 15 });
    cut.noise = |place| if (590..660).contains(&place) { -3_000 } else { 0 };
    let seen = cut.run_to_end();
    let in_corner = seen.iter().filter(|seen| (595..=640).contains(&seen.0));
    let layers: Vec<i32> = in_corner.clone().map(|seen| seen.2.layer).collect();
    assert!(layers.iter().all(|&layer| layer == layers[0]), "{layers:?}");
    assert!(in_corner.clone().all(|seen| seen.2.height_state() == HeightState::Held));
    assert!(seen.iter().any(|seen| seen.0 > 645 && seen.2.layer != layers[0]), "and then it is controlled again");
}

/// The override of the operator slows the feed down: the height stays.
#[test]
fn the_height_stays_while_the_feed_is_reduced() {
    let mut cut = Cut::new(HeightControlSettings { slope: 0, ..VOLTS }, 2000);
    cut.periods(200);
    cut.table.send(HostCommand::rate(Rate::ONE / 2));
    cut.periods(60);
    cut.noise = |_| 3_000;
    let layer = cut.table.status().layer;
    assert_eq!((cut.periods(200).layer, cut.table.status().height_state()), (layer, HeightState::Held));
    cut.table.send(HostCommand::rate(Rate::ONE));
    assert_ne!(cut.periods(200).layer, layer);
}

/// A void: the voltage jumps, stays, and comes back. The torch does not dive.
#[test]
fn the_height_stays_over_a_void() {
    for length in [30, 400] {
        let mut cut = Cut::new(VOLTS, 1200);
        cut.noise = if length == 30 {
            |place| if (500..530).contains(&place) { 6_000 } else { 0 }
        } else {
            |place| if (500..900).contains(&place) { 6_000 } else { 0 }
        };
        let seen = cut.run_to_end();
        let dive = seen.iter().filter(|seen| seen.0 > 120).map(|seen| -seen.1).max().unwrap_or_default();
        assert!(dive <= 2, "{dive} pulses");
        assert!(seen.iter().any(|seen| (505..530).contains(&seen.0) && seen.2.height_state() == HeightState::Held));
        assert!(
            seen.iter().any(|seen| seen.0 > 950 && seen.2.height_state() == HeightState::Active),
            "and then it goes on"
        );
    }
}

/// A voltage that does not come back is that of another height, behind the longest void.
#[test]
fn a_void_is_not_endless() {
    let mut cut = Cut::new(VOLTS, 3000);
    cut.periods(300);
    cut.noise = |_| 3_000;
    let layer = cut.table.status().layer;
    let status = cut.periods(480);
    assert!((0..=3).contains(&(layer - status.layer)) && status.height_state() == HeightState::Held, "{status:?}");
    assert!((74..=76).contains(&(layer - cut.periods(400).layer)));
}

/// The program, or a kerf that is crossed: the channel holds the height, to the pulse; so does the operator.
#[test]
fn the_height_stays_where_the_path_says_so() {
    let mut cut = Cut::new(HeightControlSettings { slope: 0, ..VOLTS }, 1200);
    cut.periods(200);
    for (channel, value) in [(channel::HEIGHT_HOLD, 1), (channel::HEIGHT_OFFSET, channel::HEIGHT_STAYS)] {
        cut.noise = |_| 0;
        cut.periods(100);
        cut.table.send(HostCommand::ManualOutput(OutputChange { channel, value }));
        cut.periods(30);
        cut.noise = |_| -3_000;
        let layer = cut.table.status().layer;
        assert_eq!((cut.periods(200).layer, cut.table.status().height_state()), (layer, HeightState::Held));
        cut.table.send(HostCommand::ManualOutput(OutputChange { channel, value: 0 }));
        assert!(cut.periods(100).layer > layer);
    }
}

/// The sheet falls away: the torch stops at the end of its range, and the cut is interrupted there.
#[test]
fn the_range_ends_the_cut() {
    for (falls, range) in [(true, -150), (false, 200)] {
        let mut cut = Cut::new(VOLTS, 3000);
        cut.periods(200);
        cut.noise = if falls { |_| 9_500 } else { |_| -9_500 };
        let layer = cut.table.status().layer;
        // Slowly enough not to be a void.
        let mut off = None;
        let mut lit = 0;
        cut.noise = if falls { |place| i64::from(place - 200) * 30 } else { |place| -i64::from(place - 200) * 30 };
        for _ in 0..1500 {
            let status = cut.period();
            assert!(if falls { status.layer >= layer + range - 1 } else { status.layer <= layer + range + 1 });
            lit += u32::from(status.height_state() == HeightState::AtLimit);
            off = off.or(status.cutter_off);
        }
        let off = off.expect("the cut is interrupted, which the host tells as E3036");
        assert_eq!((off.cause, off.channels), (CutterOffCause::HeightLimit, 1));
        let status = cut.table.status();
        assert!(status.blocked && status.at_rest && status.outputs[usize::from(TORCH)] == 0);
        assert!((48..=51).contains(&lit), "{lit} periods at the limit");
        assert_eq!(status.counts[Z], 0);
        cut.table.assert_limits();
    }
}

/// Two inputs of a separate controller move the torch, both at once do not.
#[test]
fn two_inputs_move_the_torch() {
    const UP: u16 = 1 << 2;
    const DOWN: u16 = 1 << 3;
    let mut cut = Cut::new(HeightControlSettings { source: HeightSource::UpDown { up: 2, down: 3 }, ..VOLTS }, 3000);
    let layer = cut.periods(200).layer;
    let mut after = |levels: u16| {
        cut.table.levels = levels;
        let before = cut.table.status().layer;
        let moved = cut.periods(60).layer - before;
        cut.table.levels = 0;
        cut.periods(40);
        moved
    };
    let moved = [0, UP, DOWN, UP | DOWN].map(&mut after);
    assert!(moved[0] == 0 && (90..=120).contains(&moved[1]) && (-120..=-90).contains(&moved[2]), "{moved:?}");
    assert_eq!(moved[3], 0);
    assert!((layer - cut.table.status().layer).abs() < 5);
    cut.table.assert_limits();
}

const EXTERNAL: HeightControlSettings =
    HeightControlSettings { source: HeightSource::External { output: ENABLE }, target: 0, gain: 0, slope: 0, ..VOLTS };
/// Output that lets another controller move the axis.
const ENABLE: u8 = 3;

/// Another controller may move the axis at the feed, behind the delay, and not in a corner; the card moves nothing.
#[test]
fn another_controller_is_enabled_where_the_height_may_change() {
    let mut cut =
        Cut::new(EXTERNAL, 1200).with_share(|place| if (600..640).contains(&place) { 16_384 } else { 1 << 15 });
    cut.noise = |_| 3_000;
    let layer = cut.table.status().layer;
    let seen = cut.run_to_end();
    assert!(seen.iter().all(|seen| seen.2.layer == layer));
    let is_enabled = |status: &CardStatus<2>| status.outputs[usize::from(ENABLE)] == 1;
    let enabled: Vec<u32> = seen.iter().filter(|seen| is_enabled(&seen.2)).map(|seen| seen.0).collect();
    let (first, corner) = (enabled[0], enabled.iter().filter(|&&place| (575..=640).contains(&place)).count());
    assert!((45..60).contains(&first) && corner == 0 && enabled.len() > 1_000, "{first} {corner} {}", enabled.len());
    for status in seen.iter().map(|seen| &seen.2) {
        assert_eq!(is_enabled(status), status.height_state() == HeightState::Active);
        assert!(!is_enabled(status) || status.outputs[usize::from(TORCH)] == 1);
    }
}

/// Whatever ends a cut, and a new epoch, takes the axis from another controller at once, whatever a program or an
/// operator switches.
#[test]
fn another_controller_is_disabled_with_the_cut() {
    for way in 0..7 {
        let mut cut = Cut::new(EXTERNAL, 3000);
        assert_eq!(cut.periods(300).outputs[usize::from(ENABLE)], 1);
        let hold = OutputChange { channel: channel::HEIGHT_HOLD, value: 1 };
        let torch_off = OutputChange { channel: TORCH, value: 0 };
        match way {
            0 => cut.table.send(HostCommand::rate(Rate::ZERO)),
            1 => cut.table.send(HostCommand::ManualOutput(torch_off)),
            2 => cut.table.send(HostCommand::rate(-Rate::ONE)),
            3 => cut.table.is_silent = true,
            4 => cut.table.levels = STOP,
            5 => cut.table.send(HostCommand::ManualOutput(hold)),
            _ => cut.table.send(HostCommand::ManualOutput(OutputChange { channel: ENABLE, value: 0 })),
        }
        let mut is_enabled = vec![];
        for _ in 0..200 {
            let outputs = cut.period().outputs;
            is_enabled.push(outputs[usize::from(ENABLE)] == 1);
            assert!(outputs[usize::from(TORCH)] == 1 || outputs[usize::from(ENABLE)] == 0, "{way}");
        }
        // In the last case the card has it on again in the next period.
        assert_eq!(is_enabled[199], way == 6, "{way}");
        if matches!(way, 1 | 5) {
            assert!(!is_enabled[1], "{way}");
        }
    }
    let mut cut = Cut::new(EXTERNAL, 3000);
    assert_eq!(cut.periods(300).outputs[usize::from(ENABLE)], 1);
    cut.table.send(HostCommand::rate(Rate::ZERO));
    cut.periods(100);
    let place = cut.table.status().place;
    let start = PathStart { place, rests: false, ..PathStart::at(place.boundary_ahead()) };
    cut.table.card.open(&CardSettings { epoch: 9, start, ..layer_settings(1) }).expect("it is at rest");
    assert_eq!(cut.periods(5).outputs[usize::from(ENABLE)], 0);
}

/// What ends a cut ends the control: a hold, the torch switched off, reverse, a silent host, an emergency stop. The
/// layer rests, and nothing but a new start begins it again.
#[test]
fn nothing_moves_behind_the_end_of_a_cut() {
    for way in 0..5 {
        let mut cut = Cut::new(VOLTS, 3000);
        cut.periods(300);
        cut.noise = |_| 3_000;
        cut.periods(5);
        match way {
            0 => cut.table.send(HostCommand::rate(Rate::ZERO)),
            1 => cut.table.send(HostCommand::ManualOutput(OutputChange { channel: TORCH, value: 0 })),
            2 => cut.table.send(HostCommand::rate(-Rate::ONE)),
            3 => cut.table.is_silent = true,
            _ => cut.table.levels = STOP,
        }
        cut.periods(130);
        let layer = cut.table.status().layer;
        assert_eq!(cut.table.status().outputs[usize::from(TORCH)], 0);
        if way < 3 {
            cut.table.send(HostCommand::rate(if way == 2 { -Rate::ONE } else { Rate::ONE }));
        }
        assert_eq!((cut.periods(200).layer, cut.table.status().height_state()), (layer, HeightState::Off), "{way}");
        cut.table.assert_limits();
    }
}

/// What happens before the control takes over is no void: the voltage changes on the way from the pierce to the cut.
#[test]
fn a_jump_in_the_delay_is_no_void() {
    let mut cut = Cut::new(VOLTS, 1200);
    cut.noise = |place| if place < 20 { 0 } else { 3_000 };
    let layer = cut.table.status().layer;
    assert!((74..=76).contains(&(layer - cut.periods(400).layer)));
}

/// A voltage within the dead band moves nothing.
#[test]
fn the_dead_band_is_quiet() {
    let mut cut = Cut::new(VOLTS, 1200);
    cut.noise = |place| i64::from(place * 7919 % 79) - 39;
    let layer = cut.table.status().layer;
    assert!(cut.run_to_end().iter().all(|seen| seen.2.layer == layer));
}

/// Below 99 % of the feed the control does not take over.
#[test]
fn the_control_waits_for_the_feed() {
    let mut cut = Cut::new(VOLTS, 600);
    cut.table.send(HostCommand::rate(Rate::from_units((1 << 32) * 95 / 100)));
    cut.noise = |place| i64::from(place) * 10;
    let layer = cut.table.status().layer;
    let seen = cut.run_to_end();
    assert!(seen.iter().all(|seen| seen.2.layer == layer && seen.2.height_state() == HeightState::Waiting));
}

/// Whatever the range, the layer stays between those from which the sheet was sensed and at which it is missing.
#[test]
fn the_layer_stays_within_the_bounds_of_the_sensing() {
    for (sign, bound) in [(1, -2000), (-1, -300)] {
        let any = HeightControlSettings { up: 1 << 20, down: 1 << 20, slope: 0, limit_periods: 0, ..VOLTS };
        let mut cut = Cut::new(any, 3000);
        cut.noise = if sign > 0 { |_| 65_000 } else { |_| -65_000 };
        let layer = cut.periods(1500).layer;
        assert_eq!((layer, cut.table.status().height_state()), (bound, HeightState::AtLimit));
    }
}

/// The path has its axis for itself: over records that move it the layer stays, and the bounds are those of the machine
/// behind them.
#[test]
fn the_path_has_its_axis_for_itself() {
    let any = HeightControlSettings { up: 1 << 20, down: 1 << 20, slope: 0, limit_periods: 0, ..VOLTS };
    let mut cut = Cut::new(any, 3000);
    cut.path = |place| if (80..180).contains(&place) { 1 } else { 0 };
    cut.noise = |_| 500;
    let seen: Vec<_> = (0..1500).map(|_| (cut.place(), cut.period())).collect();
    let beside: Vec<i32> = seen.iter().filter(|of| (110..180).contains(&of.0)).map(|of| of.1.layer).collect();
    assert!(beside.len() > 60 && beside.iter().all(|&layer| layer == beside[0]), "{beside:?}");
    cut.noise = |_| 65_000;
    let status = cut.periods(1000);
    assert_eq!((status.counts[Z], status.counts[Z] + i64::from(status.layer)), (100, -2000));
    // Before it takes over as well.
    let mut cut = Cut::new(any, 3000).with_path(|place| if (10..30).contains(&place) { 1 } else { 0 });
    cut.noise = |_| 65_000;
    let status = cut.periods(1500);
    assert_eq!((status.counts[Z], status.counts[Z] + i64::from(status.layer)), (20, -2000));
}

/// An instruction in the cut: the layer comes to rest, and does not go on to the end of its range.
#[test]
fn the_height_stays_in_an_instruction() {
    let mut cut = Cut::new(HeightControlSettings { slope: 0, down: 1000, hold_below: FeedShare::NONE, ..VOLTS }, 1200);
    let dwell =
        Instruction { number: 2, place: RecordIndex::new(300), periods: 400, keeps_cutter: true, ..Default::default() };
    cut.table.send(HostCommand::Instruction(dwell));
    cut.noise = |place| i64::from(place.max(280) - 280) * 3000;
    while cut.table.status().place != Place::start_of(RecordIndex::new(300)) {
        cut.period();
    }
    cut.periods(60);
    let layer = cut.table.status().layer;
    assert_eq!((cut.periods(200).layer, cut.table.status().executed), (layer, 1));
}

/// A height of the path, as for a puddle jump, is reached: the control waits for it.
#[test]
fn a_height_of_the_path_is_reached() {
    let mut cut = Cut::new(HeightControlSettings { band: u16::MAX, slope: 0, ..VOLTS }, 1200);
    let higher = OutputAction { place: RecordIndex::new(200), channel: channel::HEIGHT, before: 0, after: 145 };
    while cut.place() < 150 {
        cut.period();
    }
    cut.table.send(HostCommand::Action(higher));
    let seen = cut.run_to_end();
    assert_eq!(seen.last().map(|seen| seen.1), Some(100));
    assert!(seen.iter().any(|seen| seen.0 > 150 && seen.2.height_state() == HeightState::Active));
}

/// A flicker of the input that proves the torch: the height stays while it lasts.
#[test]
fn the_height_stays_while_the_proof_flickers() {
    let mut settings = layer_settings(1);
    settings.inputs[2] = InputSetting::default();
    let proof = ProofInput { input: 2, proven_periods: 2, lost_periods: 900, out_periods: 0 };
    settings.cutting.channels[0].proof = Some(proof);
    let slow = HeightControlSettings { slope: 0, ..VOLTS };
    let mut cut = Cut::with(slow, 2000, settings);
    cut.table.levels = 1 << 2;
    cut.periods(200);
    cut.table.levels = 0;
    cut.periods(30);
    cut.noise = |_| -3_000;
    let layer = cut.table.status().layer;
    assert_eq!((cut.periods(200).layer, cut.table.status().height_state()), (layer, HeightState::Held));
    cut.table.levels = 1 << 2;
    assert!(cut.periods(200).layer > layer);
}

/// A start without a proof, since the program ignores its input (M62 P1): the control does not begin.
#[test]
fn nothing_is_controlled_without_a_proof() {
    let mut settings = layer_settings(1);
    settings.inputs[2] = InputSetting::default();
    let proof = ProofInput { input: 2, proven_periods: 2, lost_periods: 900, out_periods: 0 };
    settings.cutting.channels[0].proof = Some(proof);
    let mut cut = Cut::with(HeightControlSettings { slope: 0, ..VOLTS }, 1200, settings);
    cut.table.send(HostCommand::ManualOutput(OutputChange { channel: channel::UNWATCHED, value: 1 }));
    cut.noise = |_| 3_000;
    let layer = cut.table.status().layer;
    let status = cut.periods(600);
    assert_eq!((status.layer, status.height_state(), status.outputs[usize::from(TORCH)]), (layer, HeightState::Off, 1));
}

/// A cutter that stays on backward: the height is not controlled there.
#[test]
fn nothing_is_controlled_backward() {
    let mut settings = layer_settings(1);
    settings.cutting.channels[0].lit_in_reverse = true;
    let quick = HeightControlSettings { slope: 0, delay_periods: 2, samples: 2, look_periods: 0, ..VOLTS };
    // The window holds them all, so that there is a way back.
    let mut cut = Cut::with(quick, 60, settings);
    assert_eq!(cut.periods(50).height_state(), HeightState::Active);
    cut.table.send(HostCommand::rate(-Rate::ONE));
    cut.periods(25);
    cut.noise = |_| -3_000;
    let layer = cut.table.status().layer;
    let status = cut.periods(10);
    assert!(status.rate < Rate::ZERO && status.outputs[usize::from(TORCH)] != 0, "{status:?}");
    assert_eq!((status.layer, status.height_state()), (layer, HeightState::Off));
}

/// Behind a cut the tool is lifted over the place where it is, and not over the one where it began.
#[test]
fn the_sheet_is_where_the_torch_has_followed_it() {
    let mut cut = Cut::new(HeightControlSettings { slope: 0, ..VOLTS }, 600);
    cut.noise = |_| 4_000;
    let lower = CUT - i64::from(cut.run_to_end().last().map_or(0, |seen| seen.2.layer));
    assert!((98..=100).contains(&lower), "{lower}");
    let mut lift = instruction(2, Some(0), LayerMove::OverSheet { height: 500, highest: 0 });
    lift.place = RecordIndex::new(600);
    cut.table.send(HostCommand::Instruction(lift));
    cut.table.until_executed(2);
    assert_eq!(cut.table.position, SHEET + 1 + 500 - lower);
}

/// Behind a cut another cutter is lit: its height is not controlled.
#[test]
fn another_cutter_is_not_controlled() {
    let mut settings = layer_settings(1);
    settings.cutting.channels[1] = CuttingChannel { channel: 5, ..settings.cutting.channels[0] };
    settings.cutting.count = 2;
    let mut cut = Cut::with(HeightControlSettings { slope: 0, ..VOLTS }, 2000, settings);
    cut.periods(200);
    let change = |channel, value| HostCommand::ManualOutput(OutputChange { channel, value });
    cut.table.send(change(TORCH, 0));
    cut.periods(30);
    let layer = cut.table.status().layer;
    cut.table.send(change(5, 1));
    cut.noise = |_| 3_000;
    let status = cut.periods(400);
    assert_eq!((status.layer, status.height_state(), status.outputs[5]), (layer, HeightState::Off, 1));
}

/// A voltage that is not read any more: the height stays.
#[test]
fn the_height_stays_where_no_voltage_is_read() {
    let mut cut = Cut::new(HeightControlSettings { slope: 0, ..VOLTS }, 2000);
    cut.periods(200);
    cut.noise = |_| 3_000;
    cut.periods(10);
    for period in 0..230 {
        cut.fill();
        cut.table.reading = None;
        let before = cut.table.status().layer;
        let status = cut.table.period();
        assert!(period < 30 || (status.layer, status.height_state()) == (before, HeightState::Held), "{status:?}");
    }
}

/// What held the height belongs to the path before: no epoch begins with it. The offset is the operator's, and stays.
#[test]
fn an_epoch_begins_with_the_height_free() {
    let mut table = Table::new(None);
    for (channel, value) in [(channel::HEIGHT_HOLD, 1), (channel::HEIGHT_OFFSET, 7)] {
        table.send(HostCommand::ManualOutput(OutputChange { channel, value }));
    }
    table.card.open(&layer_settings(2)).expect("at rest");
    let outputs = table.period().outputs;
    let values = [channel::HEIGHT_HOLD, channel::HEIGHT_OFFSET].map(|channel| outputs[usize::from(channel)]);
    assert_eq!(values, [0, 7]);
}

/// Settings that the card cannot do are refused with the instruction.
#[test]
fn control_that_the_card_cannot_do_is_refused() {
    let refused = |control: HeightControlSettings| {
        let LayerMove::Start { start, lowest, pierce, cut, sheet, .. } = START else { unreachable!() };
        let moves = LayerMove::Start { start, lowest, pierce, cut, sheet, control: [control] };
        Table::new(None).card.accept(HostCommand::Instruction(instruction(1, Some(1), moves)))
    };
    assert_eq!(refused(VOLTS), Ok(()));
    for control in [
        HeightControlSettings { source: HeightSource::Volts { input: 2 }, ..VOLTS },
        HeightControlSettings { gain: 0, ..VOLTS },
        HeightControlSettings { speed: 0, ..VOLTS },
        HeightControlSettings { samples: 0, ..VOLTS },
        HeightControlSettings { up: u32::MAX, ..VOLTS },
        HeightControlSettings { hold_below: FeedShare::FEED, ..VOLTS },
        HeightControlSettings { source: HeightSource::UpDown { up: 1, down: 1 }, ..VOLTS },
        HeightControlSettings { source: HeightSource::UpDown { up: 1, down: 6 }, ..VOLTS },
        HeightControlSettings { source: HeightSource::External { output: 64 }, ..VOLTS },
        HeightControlSettings { source: HeightSource::None, ..VOLTS },
    ] {
        assert_eq!(refused(control), Err(CommandRefusal::Unsupported), "{control:?}");
    }
    assert_eq!(InputLevels::default().analog, [None; retrace_link::ANALOG_INPUTS]);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 96, ..ProptestConfig::default() })]

    /// Whatever the readings, speeds and commands: the axis keeps its limits and the range, and the layer changes only
    /// while the torch is on or has just gone off.
    #[test]
    fn any_voltage_keeps_the_range_and_the_limits(
        steps in prop::collection::vec((any::<u16>(), 1..40u32, 0..8u8), 1..60), filter: u16, slope in 0..1u32 << 24,
        void_periods: u16,
    ) {
        let mut cut = Cut::new(HeightControlSettings { filter, slope, void_periods, limit_periods: 0, ..VOLTS }, 4000);
        let start = cut.table.status().layer;
        let mut dark = 0;
        for (reading, periods, what) in steps {
            cut.table.send(match what {
                0 => HostCommand::rate(Rate::ONE / 3),
                1 => HostCommand::ManualOutput(OutputChange { channel: channel::HEIGHT_HOLD, value: 1 }),
                2 => HostCommand::ManualOutput(OutputChange { channel: channel::HEIGHT_HOLD, value: 0 }),
                3 => {
                    let value = i32::from(reading);
                    HostCommand::ManualOutput(OutputChange { channel: channel::HEIGHT_OFFSET, value })
                }
                _ => HostCommand::rate(Rate::ONE),
            });
            for _ in 0..periods {
                cut.fill();
                cut.table.reading = (reading & 7 != 0).then_some(reading);
                let before = cut.table.status().layer;
                let status = cut.table.period();
                dark = if status.outputs[usize::from(TORCH)] == 0 { dark + 1 } else { 0 };
                prop_assert!((start - 150 - 1..=start + 200 + 1).contains(&status.layer), "{:?}", status);
                prop_assert!(status.layer == before || dark <= 25);
            }
        }
        cut.table.assert_limits();
        prop_assert_eq!(cut.table.status().counts[Z], 0);
    }
}
