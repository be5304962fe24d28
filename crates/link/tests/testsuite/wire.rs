//! Messages as bytes: what is written is read back, and any bytes are read as something or refused.

use proptest::prelude::*;
use retrace_core::gear::GearLimits;
use retrace_core::limits::{PulseLimits, RateLimits};
use retrace_core::{Distance, FeedShare, Flags, Place, RapidCap, Rate, Record, RecordIndex};
use retrace_link::frame::MAX_PAYLOAD;
use retrace_link::wire::{
    ByteReader, ByteWriter, Greeting, Opening, RecordRun, ReportEntry, read_command, write_command,
};
use retrace_link::{
    ANALOG_INPUTS, Alarm, ArmedStretch, BeamPower, CardIdentity, CardSettings, CutterOff, CutterOffCause,
    CuttingChannel, CuttingSettings, GearStart, GearState, HeightControlSettings, HeightSource, HeightState,
    HomingCommand, HostCommand, Ignition, InputSetting, InputUse, InputWait, Instruction, LayerMove, LayerSettings,
    MAX_CHANGES, MAX_CURVE_POINTS, MAX_CUTTING_CHANNELS, MAX_PROOFS, MAX_SAFE, OhmicSensing, OutputAction,
    OutputChange, PROTOCOL, PathStart, ProbeArming, ProbeEdge, ProofInput, RepeatedInstruction, SheetSource,
    SpeedCurve, SpeedPoint, SpindleControl, SpindlePwm, SpindleSettings, SpindleTask,
};

/// Every value at its largest.
const HEIGHT_CONTROL: HeightControlSettings = HeightControlSettings {
    source: HeightSource::Volts { input: 3 },
    target: u16::MAX,
    speed: u32::MAX,
    gain: i32::MIN,
    filter: u16::MAX,
    band: u16::MAX,
    slope: u32::MAX,
    void_periods: 1,
    up: u32::MAX,
    down: u32::MAX,
    delay_periods: u16::MAX,
    samples: u16::MAX,
    hold_below: FeedShare::from_units(u16::MAX),
    look_periods: u16::MAX,
    limit_periods: u16::MAX,
};

fn record() -> impl Strategy<Value = Record<4>> {
    let increment = prop_oneof![-3i16..3, -100i16..100, any::<i16>()];
    let share = prop_oneof![Just(0), Just(1 << 15), any::<u16>()];
    let all = (prop::array::uniform4(increment), any::<u32>(), 0u8..64, 0u8..=255, share);
    all.prop_map(|(increments, line, flags, cap, share)| Record {
        increments,
        line: line >> (line & 31),
        flags: Flags::from_bits(flags),
        cap: RapidCap::sixteenths(cap),
        feed_share: FeedShare::from_units(share),
    })
}

fn change() -> impl Strategy<Value = OutputChange> {
    (0u8..69, any::<i32>()).prop_map(|(channel, value)| OutputChange { channel, value })
}

fn instruction() -> impl Strategy<Value = Instruction> {
    let ignition = (any::<[u16; 2]>(), any::<u8>(), any::<u32>()).prop_map(|(periods, attempts, delay_periods)| {
        Ignition { stable_periods: periods[0], attempts, retry_periods: periods[1], delay_periods }
    });
    let until = prop::option::of((0u8..16, any::<bool>(), any::<u32>(), prop::option::of(ignition)));
    let changes = prop::collection::vec(change(), 0..=MAX_CHANGES);
    let rest = (any::<bool>(), layer(), spindle_task());
    (any::<[u32; 3]>(), changes, until, rest).prop_map(|(n, list, until, (keeps_cutter, layer, spindle))| {
        let mut changes = [OutputChange::default(); MAX_CHANGES];
        changes[..list.len()].copy_from_slice(&list);
        let until = until
            .map(|(input, active, at_most, ignition)| InputWait { ignition, ..InputWait::new(input, active, at_most) });
        Instruction {
            number: n[0],
            place: RecordIndex::new(n[1]),
            changes,
            count: list.len() as u8,
            periods: n[2],
            until,
            keeps_cutter,
            layer,
            spindle,
        }
    })
}

fn spindle_task() -> impl Strategy<Value = Option<SpindleTask>> {
    prop::option::of(prop_oneof![Just(SpindleTask::AtSpeed), gear_start().prop_map(SpindleTask::Gear)])
}

fn armed_stretch() -> impl Strategy<Value = ArmedStretch> {
    let places = (any::<u32>(), prop::option::of(any::<u32>()));
    (places, gear_start(), any::<i32>(), any::<bool>()).prop_map(|((first, barrier), start, speed, is_passed)| {
        ArmedStretch { first: RecordIndex::new(first), start, speed, is_passed, barrier: barrier.map(RecordIndex::new) }
    })
}

fn gear_start() -> impl Strategy<Value = GearStart> {
    let control =
        prop_oneof![Just(SpindleControl::None), Just(SpindleControl::Held), any::<u32>().prop_map(SpindleControl::Tap)];
    let numbers = (any::<[u32; 2]>(), any::<[u16; 4]>(), any::<[i64; 3]>(), control);
    numbers.prop_map(|([length, start_angle], shorts, units, control)| {
        let [records_per_turn, ahead, ramp_share, reverse_share] = shorts;
        let [near_end, tolerance] = [units[1], units[2]].map(Distance::from_units);
        let limits = GearLimits { rate: Rate::from_units(units[0]), near_end, tolerance };
        GearStart { length, records_per_turn, start_angle, ahead, limits, ramp_share, reverse_share, control }
    })
}

fn layer() -> impl Strategy<Value = Option<LayerMove>> {
    let control = prop_oneof![
        Just(HeightControlSettings::default()),
        Just(HEIGHT_CONTROL),
        any::<u16>().prop_map(|target| {
            let source = HeightSource::UpDown { up: 15, down: 0 };
            HeightControlSettings { source, target, gain: i32::MAX, filter: 0, up: 7, ..HEIGHT_CONTROL }
        }),
        any::<u8>()
            .prop_map(|output| HeightControlSettings { source: HeightSource::External { output }, ..HEIGHT_CONTROL }),
    ];
    let ohmic = prop_oneof![
        Just(OhmicSensing::default()),
        (1..u16::MAX, any::<u8>(), any::<i32>()).prop_map(|(inputs, tries, drop)| OhmicSensing { inputs, tries, drop }),
    ];
    let sheet = prop_oneof![
        ohmic.clone().prop_map(SheetSource::Sensed),
        ohmic.prop_map(SheetSource::Kept),
        any::<i32>().prop_map(SheetSource::Known),
    ];
    let start = (any::<[i32; 4]>(), sheet, control).prop_map(|([start, lowest, pierce, cut], sheet, control)| {
        LayerMove::Start { start, lowest, pierce, cut, sheet, control: [control] }
    });
    let over = any::<[i32; 2]>().prop_map(|[height, highest]| LayerMove::OverSheet { height, highest });
    prop::option::of(prop_oneof![start, over, any::<i32>().prop_map(|layer| LayerMove::To { layer })])
}

fn speed_curve() -> impl Strategy<Value = SpeedCurve> {
    prop::collection::vec(any::<(u32, u32)>(), 0..=MAX_CURVE_POINTS).prop_map(|points| {
        let mut curve = SpeedCurve { count: points.len() as u8, ..SpeedCurve::default() };
        for (slot, (speed, duty)) in curve.points.iter_mut().zip(points) {
            *slot = SpeedPoint { speed, duty };
        }
        curve
    })
}

fn command() -> impl Strategy<Value = HostCommand<4>> {
    prop_oneof![
        (any::<u32>(), record())
            .prop_map(|(place, record)| HostCommand::Ahead { place: RecordIndex::new(place), record }),
        (any::<u32>(), record(), any::<bool>()).prop_map(|(place, record, rests)| HostCommand::Behind {
            place: RecordIndex::new(place),
            record,
            rests
        }),
        any::<u32>().prop_map(|high| HostCommand::Trim { high: RecordIndex::new(high) }),
        any::<u32>().prop_map(|low| HostCommand::Forget { low: RecordIndex::new(low) }),
        (any::<u32>(), 0u8..69, any::<i32>(), any::<i32>()).prop_map(|(place, channel, before, after)| {
            HostCommand::Action(OutputAction { place: RecordIndex::new(place), channel, before, after })
        }),
        any::<bool>().prop_map(|on| HostCommand::Replay { on }),
        instruction().prop_map(HostCommand::Instruction),
        change().prop_map(HostCommand::ManualOutput),
        Just(HostCommand::ClearAlarm),
        any::<u32>().prop_map(|last| HostCommand::Restart { last }),
        any::<bool>().prop_map(|on| HostCommand::FollowSpindle { on }),
        Just(HostCommand::FreeTool),
        speed_curve().prop_map(HostCommand::SpeedCurve),
        armed_stretch().prop_map(HostCommand::ArmStretch),
        (0u8..128, any::<bool>(), any::<u16>()).prop_map(|(input, active, filter_periods)| HostCommand::ArmProbe(
            ProbeArming { input, active, filter_periods }
        )),
        instruction().prop_map(
            |Instruction { number, changes, count, periods, until, keeps_cutter, layer, .. }| {
                HostCommand::Repeat(RepeatedInstruction {
                    number,
                    changes,
                    count,
                    periods,
                    until,
                    is_pulse: keeps_cutter,
                    layer,
                })
            }
        ),
        (0u8..9, any::<bool>(), any::<[i64; 4]>(), any::<u32>()).prop_map(|(axis, upper, n, farthest)| {
            HostCommand::Home(HomingCommand {
                axis,
                upper,
                search_speed: n[0],
                latch_speed: n[1],
                acceleration: n[2],
                max_travel: farthest,
                count: n[3],
            })
        }),
    ]
}

fn entry() -> impl Strategy<Value = ReportEntry> {
    let travel = prop_oneof![Just(0i64), Just(1 << 32), Just(-(1i64 << 32)), -(8i64 << 32)..=8 << 32]
        .prop_map(Distance::from_units);
    let alarm = (0u8..18, any::<u32>()).prop_map(|(code, detail)| Alarm::from_wire(code, detail & 0x1FF));
    prop_oneof![
        (travel, 1u32..u32::MAX, any::<bool>(), any::<bool>())
            .prop_map(|(distance, count, starved, at_rest)| ReportEntry::Ran { distance, count, starved, at_rest }),
        change().prop_map(ReportEntry::Output),
        any::<u32>().prop_map(ReportEntry::Executed),
        alarm.prop_map(ReportEntry::Alarm),
        any::<u16>().prop_map(ReportEntry::Inputs),
        any::<i16>().prop_map(ReportEntry::Wheel),
        any::<u32>().prop_map(ReportEntry::Refused),
        any::<i32>().prop_map(ReportEntry::SpindleSpeed),
        (0..ANALOG_INPUTS as u8, any::<Option<u16>>())
            .prop_map(|(number, reading)| ReportEntry::AnalogInput { number, reading }),
        (0usize..3, any::<u32>()).prop_map(|(state, lag)| {
            let state = [GearState::Off, GearState::Waiting, GearState::Engaged][state];
            ReportEntry::Gear { state, largest_lag: lag, armed_again: lag as u8 }
        }),
        (any::<u8>(), 0u8..9, any::<[u32; 2]>()).prop_map(|(channels, cause, [record, fraction])| {
            let cause = CutterOffCause::from_wire(cause).expect("a cause");
            let place = Place { record: RecordIndex::new(record), fraction };
            ReportEntry::CutterOff(CutterOff { channels, cause, place })
        }),
        any::<u32>().prop_map(ReportEntry::Repeated),
        any::<bool>().prop_map(ReportEntry::Blocked),
        any::<u32>().prop_map(ReportEntry::RepeatRefused),
        any::<i32>().prop_map(ReportEntry::Layer),
        (0u8..5).prop_map(|code| ReportEntry::Height(HeightState::from_wire(code).expect("a state"))),
        Just(ReportEntry::ProbeArmed),
        (any::<bool>(), any::<u16>())
            .prop_map(|(is_period_earlier, part)| ReportEntry::ProbeEdge(ProbeEdge { is_period_earlier, part })),
        Just(ReportEntry::ProbeTouched),
    ]
}

proptest! {
    #[test]
    fn words_are_read_back(commands in prop::collection::vec(command(), 1..12), follow in any::<bool>(),
        start in any::<u32>()) {
        let mut commands = commands;
        if follow {
            // runs, as they usually come
            for (place, command) in (start..).zip(&mut commands) {
                match command {
                    HostCommand::Ahead { place: p, .. } => *p = RecordIndex::new(place),
                    HostCommand::Behind { place: p, .. } => *p = RecordIndex::new(0u32.wrapping_sub(place)),
                    _ => {}
                }
            }
        }
        let mut bytes = [0; 1000];
        let (mut writer, mut run) = (ByteWriter::new(&mut bytes), RecordRun::new(4));
        for command in &commands {
            prop_assert_eq!(write_command(&mut writer, &mut run, command), Some(()));
        }
        let length = writer.len();
        let (mut reader, mut run) = (ByteReader::new(&bytes[..length]), RecordRun::new(4));
        for command in &commands {
            prop_assert_eq!(read_command(&mut reader, &mut run), Some(*command));
        }
        prop_assert!(reader.is_empty());
    }

    #[test]
    fn entries_are_read_back(entries in prop::collection::vec(entry(), 1..12)) {
        let mut bytes = [0; 300];
        let mut writer = ByteWriter::new(&mut bytes);
        for entry in &entries {
            prop_assert_eq!(entry.write(&mut writer), Some(()));
        }
        let length = writer.len();
        let mut reader = ByteReader::new(&bytes[..length]);
        for entry in &entries {
            prop_assert_eq!(ReportEntry::read(&mut reader), Some(*entry));
        }
        prop_assert!(reader.is_empty());
    }

    /// A word that does not fit leaves no trace: what comes before it is read as it was, and the next one too.
    #[test]
    fn a_word_without_room_leaves_no_trace(commands in prop::collection::vec(command(), 1..12), room in 0usize..120) {
        let mut bytes = [0; 120];
        let (mut writer, mut run) = (ByteWriter::new(&mut bytes[..room]), RecordRun::new(4));
        let written: Vec<&HostCommand<4>> = commands.iter().filter(|command| write_command(&mut writer, &mut run,
            command).is_some()).collect();
        let length = writer.len();
        let (mut reader, mut run) = (ByteReader::new(&bytes[..length]), RecordRun::new(4));
        for command in written {
            prop_assert_eq!(read_command(&mut reader, &mut run), Some(*command));
        }
        prop_assert!(reader.is_empty());
    }

    #[test]
    fn any_bytes_are_messages_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        let (mut reader, mut run) = (ByteReader::new(&bytes), RecordRun::<4>::new(4));
        while read_command(&mut reader, &mut run).is_some() {}
        let mut reader = ByteReader::new(&bytes);
        while ReportEntry::read(&mut reader).is_some() {}
        let _ = Greeting::<4>::read(&mut ByteReader::new(&bytes));
        let _ = Opening::<4>::read(&mut ByteReader::new(&bytes));
    }
}

#[test]
fn handshakes_are_read_back() {
    let identity = CardIdentity {
        protocol: PROTOCOL,
        name: *b"a simulated card",
        serial: 0xDEAD_BEEF,
        boot: 7,
        axes: 3,
        outputs: 64,
        inputs: 16,
        has_spindle_pwm: true,
        has_spindle_encoder: true,
        analog: retrace_link::AnalogCounts::new(5, 3),
        window: 4096,
        memory: 64,
        tick_hz: 168_000_000,
        min_period_us: 250,
        max_period_us: 20_000,
        max_pulses_hz: 100_000,
    };
    let greeting = Greeting::<4> {
        nonce: 99,
        identity,
        epoch: 3,
        last_epoch: 3,
        place: Place { record: RecordIndex::new(u32::MAX), fraction: 5 },
        at_rest: true,
        reached: RecordIndex::new(1),
        executed: u32::MAX - 6,
        counts: [1, -2, i64::MAX, 0],
        layer: (2, -77_000),
        alarm: Some(Alarm::LimitSwitch { axis: 2, upper: true }),
    };
    let mut bytes = [0; 200];
    let mut writer = ByteWriter::new(&mut bytes);
    greeting.write(&mut writer).expect("room");
    let length = writer.len();
    assert_eq!(Greeting::read(&mut ByteReader::new(&bytes[..length])), Some(Ok(greeting)));
    bytes[0] = PROTOCOL + 1;
    assert_eq!(Greeting::<4>::read(&mut ByteReader::new(&bytes[..length])), Some(Err(PROTOCOL + 1)));

    let mut settings = CardSettings::<4>::new(9, PathStart::at(RecordIndex::new(77)), 1000, limits());
    settings.start = PathStart {
        place: Place { record: RecordIndex::new(70), fraction: 1 << 31 },
        rests: false,
        reached: RecordIndex::new(77),
        executed: 12,
        keeps_state: true,
    };
    settings.layer = Some(LayerSettings { axis: 2, contacts: 1 << 9 | 1, probe_speed: 1 << 17, latch_speed: u32::MAX });
    settings.spindle_pwm = Some(SpindlePwm { full_scale: i32::MAX as u32, hz: 50_000 });
    settings.spindle = Some(SpindleSettings {
        counts_per_turn: 1 << 17,
        is_inverted: true,
        has_index: true,
        at_speed_permille: 500,
        at_speed_periods: u16::MAX,
        timeout_periods: u32::MAX,
        highest_speed: i32::MAX as u32,
    });
    settings.backlash_pulses = [0, 300, u16::MAX, 7];
    settings.inputs[3] = InputSetting { used_for: InputUse::Limit { axis: 2, upper: true }, active_low: true };
    settings.inputs[15] = InputSetting { used_for: InputUse::EmergencyStop, active_low: false };
    settings.safe[0] = OutputChange { channel: 64, value: 0 };
    settings.safe[1] = OutputChange { channel: 5, value: -1 };
    settings.safe_count = 2;
    settings.cutting.channels[0] = CuttingChannel {
        channel: 64,
        fires: true,
        standing_periods: u16::MAX,
        lit_in_reverse: true,
        proof: Some(PROOF),
    };
    settings.cutting.channels[1] =
        CuttingChannel { channel: 3, fires: false, standing_periods: 0, lit_in_reverse: false, proof: None };
    (settings.cutting.count, settings.cutting.handover_periods, settings.cutting.inhibit) = (2, 100, true);
    settings.cutting.beam_power = Some(BeamPower { channel: 64, least: FeedShare::from_units(3_277), exponent: 6 });
    let mut writer = ByteWriter::new(&mut bytes);
    Opening(settings).write(&mut writer).expect("room");
    let length = writer.len();
    assert_eq!(Opening::read(&mut ByteReader::new(&bytes[..length])), Some(Opening(settings)));
}

const PROOF: ProofInput = ProofInput { input: 15, proven_periods: 100, lost_periods: 10_000, out_periods: u16::MAX };

/// The longest opening that a card of four axes can get fits a frame.
#[test]
fn the_longest_opening_of_four_axes_fits_a_frame() {
    let axis = PulseLimits { velocity: 2000 << 32, acceleration: 2000 << 32, jerk: 2000 << 32 };
    let limits = RateLimits::new(255, 1 << 15, [axis; 4]).expect("valid");
    let mut settings = CardSettings::<4>::new(9, PathStart::at(RecordIndex::new(77)), 10_000, limits);
    settings.backlash_pulses = [u16::MAX; 4];
    settings.inputs = [InputSetting { used_for: InputUse::Door, active_low: true }; 16];
    settings.safe_count = 16;
    let channel =
        CuttingChannel { channel: 64, fires: true, standing_periods: 20_000, lit_in_reverse: true, proof: Some(PROOF) };
    settings.cutting = CuttingSettings {
        channels: [channel; MAX_CUTTING_CHANNELS],
        count: 8,
        handover_periods: 400,
        inhibit: true,
        beam_power: Some(BeamPower { channel: 64, least: FeedShare::FEED, exponent: u8::MAX }),
    };
    for without_input in &mut settings.cutting.channels[MAX_PROOFS..] {
        without_input.proof = None;
    }
    let [probe_speed, latch_speed] = [2000 << 16; 2];
    settings.layer = Some(LayerSettings { axis: 3, contacts: u16::MAX, probe_speed, latch_speed });
    settings.spindle_pwm = Some(SpindlePwm { full_scale: i32::MAX as u32, hz: u16::MAX });
    // kind and epoch binding besides
    let mut bytes = [0; MAX_PAYLOAD - 1];
    let mut writer = ByteWriter::new(&mut bytes);
    Opening(settings).write(&mut writer).expect("room");
}

/// Limits of a machine that stops within some tens of periods.
fn limits<const A: usize>() -> RateLimits<A> {
    let axis = PulseLimits { velocity: 200 << 32, acceleration: 12 << 32, jerk: 1 << 32 };
    RateLimits::new(13, 1 << 15, [axis; A]).expect("valid")
}

/// Every input keeps its use over the line, whichever that is.
#[test]
fn every_use_of_an_input_is_read_back() {
    let uses = [
        InputUse::Plain,
        InputUse::Limit { axis: 0, upper: false },
        InputUse::Limit { axis: 3, upper: true },
        InputUse::Home { axis: 2 },
        InputUse::Door,
        InputUse::EmergencyStop,
        InputUse::Probe,
        InputUse::Collision { only_lit: false },
        InputUse::Collision { only_lit: true },
    ];
    for used_for in uses {
        let mut settings = CardSettings::<4>::new(9, PathStart::at(RecordIndex::new(77)), 1000, limits());
        settings.inputs[5] = InputSetting { used_for, active_low: true };
        settings.inputs[15] = InputSetting { used_for, active_low: false };
        let mut bytes = [0; MAX_PAYLOAD];
        let mut writer = ByteWriter::new(&mut bytes);
        Opening(settings).write(&mut writer).expect("room");
        let length = writer.len();
        assert_eq!(Opening::read(&mut ByteReader::new(&bytes[..length])), Some(Opening(settings)), "{used_for:?}");
    }
}

/// Differences of −1 on every axis are not those of zero, nor is one −1 among zeros: after any record, every other is
/// read back as it was.
#[test]
fn small_differences_are_read_back() {
    const SMALL: [i16; 7] = [-9, -8, -1, 0, 1, 7, 8];
    let records = SMALL.iter().flat_map(|&first| SMALL.map(|second| [first, second]));
    for increments in records {
        let record = |increments| Record { increments, ..Record::<2>::default() };
        let commands = [[0, 0], increments, [0, 0]].map(record);
        let mut bytes = [0; 100];
        let (mut writer, mut run) = (ByteWriter::new(&mut bytes), RecordRun::new(2));
        let command = |n: usize| HostCommand::Ahead { place: RecordIndex::new(n as u32), record: commands[n] };
        (0..3).for_each(|n| write_command(&mut writer, &mut run, &command(n)).expect("room"));
        let length = writer.len();
        let (mut reader, mut run) = (ByteReader::new(&bytes[..length]), RecordRun::new(2));
        (0..3).for_each(|n| assert_eq!(read_command(&mut reader, &mut run), Some(command(n)), "{increments:?}"));
    }
}

/// As many cutting channels as the settings have room for are read back.
#[test]
fn all_cutting_channels_are_read_back() {
    let mut settings = CardSettings::<4>::new(9, PathStart::at(RecordIndex::new(77)), 1000, limits());
    for count in 0..=MAX_CUTTING_CHANNELS {
        settings.cutting.count = count as u8;
        let mut bytes = [0; MAX_PAYLOAD];
        let mut writer = ByteWriter::new(&mut bytes);
        Opening(settings).write(&mut writer).expect("room");
        let length = writer.len();
        assert_eq!(Opening::read(&mut ByteReader::new(&bytes[..length])), Some(Opening(settings)), "{count}");
    }
}

/// As many safe outputs as the settings have room for are read back.
#[test]
fn all_safe_outputs_are_read_back() {
    let mut settings = CardSettings::<4>::new(9, PathStart::at(RecordIndex::new(77)), 1000, limits());
    for count in 0..=MAX_SAFE {
        if let Some(last) = count.checked_sub(1) {
            settings.safe[last] = OutputChange { channel: count as u8, value: -1 - count as i32 };
        }
        settings.safe_count = count as u8;
        let mut bytes = [0; MAX_PAYLOAD];
        let mut writer = ByteWriter::new(&mut bytes);
        Opening(settings).write(&mut writer).expect("room");
        let length = writer.len();
        assert_eq!(Opening::read(&mut ByteReader::new(&bytes[..length])), Some(Opening(settings)), "{count}");
    }
}
