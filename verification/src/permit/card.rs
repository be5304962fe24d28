//! Drawn commands on a whole card, with an observer of its reports that uses the requirements alone.
//!
//! Invariant: the observer reads reports and accepted commands, never the state of the card.

use crate::choice::Choice;
use crate::ledger::Size;
use crate::native::Draw;
use retrace_card::{Card, InputLevels};
use retrace_core::limits::{PulseLimits, RateLimits};
use retrace_core::{Distance, FeedShare, Flags, Place, Rate, Record, RecordIndex};
use retrace_link::{
    BeamPower, CardCore, CardIdentity, CardSettings, CardStatus, CutterOffCause, CuttingChannel, CuttingSettings,
    HeightControls, HostCommand, InputSetting, InputUse, Instruction, LINEAR_POWER, LayerMove, LayerSettings,
    OhmicSensing, OutputAction, OutputChange, PROTOCOL, PathStart, RepeatedInstruction, SheetSource, channel,
};

const TORCH: u8 = 3;
/// S, of which the torch's channel has the power as well.
const FULL: i32 = 1_000;
const GRACE: u16 = 4;
const HANDOVER: u16 = 6;
const WATCHDOG: u16 = 30;
/// Periods that the layer needs to come to rest: its ramp, its average, and the period of the order.
const BRAKING: u32 = 4 + 16 + 1;
const STOP: u16 = 1;
const BREAKAWAY: u16 = 2;
const FLOAT: u16 = 4;
/// Position below which the float switch is closed.
const SHEET: i64 = -25;

type TestCard = Card<1, 64, 32>;

struct Observer {
    card: TestCard,
    closed: bool,
    inhibit: bool,
    epoch: u16,
    silent: u32,
    /// Number of periods that the torch was on with the machine at rest and nothing that retains it.
    stood: u32,
    /// A place was passed in the epoch, and the torch may only be lit by a first pass, a command or an instruction.
    asked: bool,
    /// An instruction that lights the torch, which is not complete.
    pending: Option<u32>,
    /// The torch went out because the machine was at rest too long, and no restart was accepted since.
    blocked: bool,
    /// An instruction or a repeat that retains the torch was accepted in this epoch: the length of a standstill means
    /// nothing then.
    keeps: bool,
    /// Periods until a test pulse ends.
    pulse: Option<u32>,
    /// Places of actions that light the torch.
    actions: Vec<RecordIndex>,
    /// Places of heights, and periods in which the layer may move beside the path: some more after the torch is off.
    heights: Vec<RecordIndex>,
    beside: u32,
    lit: u64,
    put_out: u64,
    /// Number of periods with power in motion.
    powered: u64,
    /// Number of periods in which the layer moved, in which it did beside the path, and of sheets that were not found.
    layer_moves: u64,
    beside_moves: u64,
    not_found: u64,
}

/// Any moves of the layer, and none.
fn any_moves(draw: &mut Draw) -> Option<LayerMove> {
    let mut to = || draw.below(90) as i32 - 60;
    let (a, b, c, d) = (to(), to(), to(), to());
    match draw.below(6) {
        0 => {
            let ohmic = if b & 1 == 0 { OhmicSensing { inputs: FLOAT, tries: 1, drop: c } } else { Default::default() };
            let sheet = match a & 3 {
                0 | 2 => SheetSource::Kept(ohmic),
                1 => SheetSource::Sensed(ohmic),
                _ => SheetSource::Known(d),
            };
            Some(LayerMove::Start {
                start: a.max(b),
                lowest: a.min(b),
                pierce: c.abs(),
                cut: d.abs(),
                sheet,
                control: HeightControls::default(),
            })
        }
        1 => Some(LayerMove::OverSheet { height: a.abs(), highest: b }),
        2 => Some(LayerMove::To { layer: a }),
        _ => None,
    }
}

impl Observer {
    fn new() -> Self {
        let identity = CardIdentity {
            protocol: PROTOCOL,
            name: *b"drawn words\0\0\0\0\0",
            serial: 0,
            boot: 0,
            axes: 1,
            outputs: 8,
            inputs: 3,
            has_spindle_pwm: true,
            has_spindle_encoder: false,
            analog: retrace_link::AnalogCounts::NONE,
            window: 0,
            memory: 0,
            tick_hz: 1_000_000,
            min_period_us: 100,
            max_period_us: 10_000,
            max_pulses_hz: 250_000,
        };
        let mut observer = Self {
            card: TestCard::new(identity).expect("a memory"),
            closed: true,
            inhibit: false,
            epoch: 0,
            silent: 0,
            stood: 0,
            asked: false,
            pending: None,
            blocked: false,
            keeps: false,
            pulse: None,
            actions: Vec::new(),
            heights: Vec::new(),
            beside: 0,
            lit: 0,
            put_out: 0,
            powered: 0,
            layer_moves: 0,
            beside_moves: 0,
            not_found: 0,
        };
        observer.open();
        observer
    }

    fn status(&self) -> CardStatus<1> {
        *self.card.status()
    }

    fn open(&mut self) {
        let axis = PulseLimits { velocity: 30 << 32, acceleration: 8 << 32, jerk: 1 << 32 };
        let limits = RateLimits::new(13, 1 << 15, [axis]).expect("valid");
        let epoch = self.epoch + 1;
        let mut settings = CardSettings::new(epoch, PathStart::at(RecordIndex::new(0)), 1000, limits);
        settings.watchdog_periods = WATCHDOG;
        settings.inputs[0] = InputSetting { used_for: InputUse::EmergencyStop, active_low: false };
        settings.inputs[1] =
            InputSetting { used_for: InputUse::Collision { only_lit: epoch.is_multiple_of(2) }, active_low: false };
        settings.cutting = CuttingSettings { count: 1, handover_periods: HANDOVER, ..CuttingSettings::default() };
        settings.cutting.channels[0] =
            CuttingChannel { channel: TORCH, fires: true, standing_periods: GRACE, lit_in_reverse: false, proof: None };
        settings.cutting.inhibit = epoch.is_multiple_of(8);
        settings.cutting.beam_power =
            Some(BeamPower { channel: TORCH, least: FeedShare::NONE, exponent: LINEAR_POWER });
        let (probe_speed, latch_speed) = (3 << 16, 1 << 15);
        settings.layer = Some(LayerSettings { contacts: FLOAT, probe_speed, latch_speed, ..LayerSettings::default() });
        settings.start.keeps_state = epoch.is_multiple_of(3);
        let position = self.position();
        if self.card.open(&settings).is_ok() {
            (self.epoch, self.closed, self.inhibit, self.silent) = (epoch, false, settings.cutting.inhibit, 0);
            (self.stood, self.asked, self.pending, self.blocked, self.keeps) = (0, false, None, false, false);
            self.pulse = None;
            self.actions.clear();
            self.heights.clear();
            self.beside = 0;
            assert_eq!(self.torch(), 0, "lit behind an opening");
            assert_eq!(self.position(), position, "an opening moves nothing");
            let _ = self.card.accept(HostCommand::ManualOutput(OutputChange { channel: channel::SPEED, value: FULL }));
        }
    }

    /// Position of the axis: path and layer.
    fn position(&self) -> i64 {
        self.status().counts[0] + i64::from(self.status().layer)
    }

    fn torch(&self) -> i32 {
        self.status().outputs[usize::from(TORCH)]
    }

    fn command(&mut self, draw: &mut Draw) {
        let (status, value) = (self.status(), draw.below(2) as i32);
        let mut changes = [OutputChange::default(); 4];
        changes[0] = OutputChange { channel: TORCH, value };
        let rates = [Rate::ONE, Rate::ONE, -Rate::ONE, Rate::ZERO, Rate::ONE / 3, -Rate::ONE / 5];
        let is_over_sheet = self.torch() != 0 && status.layer != 0;
        let command = match draw.below(12) {
            _ if is_over_sheet && draw.below(3) == 0 => {
                let (place, after) = (status.place.record + draw.below(4), draw.below(400) as i32 - 100);
                HostCommand::Action(OutputAction { place, channel: channel::HEIGHT, before: 0, after })
            }
            0..=2 => HostCommand::rate(rates[draw.below(rates.len() as u32) as usize]),
            3 => {
                let (number, place) = (status.executed.wrapping_add(1), status.place.record + draw.below(8));
                let (periods, keeps_cutter) = (draw.below(9), draw.flag());
                HostCommand::Instruction(Instruction {
                    number,
                    place,
                    changes,
                    count: 1,
                    periods,
                    until: None,
                    keeps_cutter,
                    layer: any_moves(draw),
                    spindle: None,
                })
            }
            4 | 5 => {
                let (number, periods) = (status.repeated.wrapping_add(1), draw.below(9));
                let is_pulse = draw.below(3) == 0;
                let layer = any_moves(draw).filter(|_| !is_pulse);
                let until = None;
                HostCommand::Repeat(RepeatedInstruction { number, changes, count: 1, periods, until, is_pulse, layer })
            }
            6 => HostCommand::Restart { last: status.repeated.wrapping_add(draw.below(2)) },
            7 => HostCommand::ManualOutput(OutputChange { channel: TORCH, value }),
            8 => HostCommand::Replay { on: draw.below(4) != 0 },
            9 => {
                let place = status.place.record + draw.below(12);
                HostCommand::Action(OutputAction { place, channel: TORCH, before: 1 - value, after: value })
            }
            10 => HostCommand::ClearAlarm,
            _ => {
                for _ in 0..draw.below(30) {
                    let place = self.status().high;
                    let flags = if place.number() % 16 == 15 { Flags::REST } else { Flags::NONE };
                    // Where the path moves the axis of the layer, the layer rests beside it.
                    let increments = [if place.number() % 32 < 6 { 3 } else { 0 }];
                    let record = Record { increments, flags, feed_share: FeedShare::FEED, ..Record::default() };
                    let _ = self.card.accept(HostCommand::Ahead { place, record });
                }
                return;
            }
        };
        if self.card.accept(command).is_err() {
            return;
        }
        match command {
            HostCommand::Repeat(RepeatedInstruction { is_pulse: true, periods, .. }) if value != 0 => {
                self.asked = true;
                self.pulse = Some(periods).filter(|&periods| periods > 0);
            }
            HostCommand::ManualOutput(_) if value == 0 => self.pulse = None,
            HostCommand::Instruction(instruction) if value != 0 => {
                self.asked = true;
                self.pending = Some(instruction.number).filter(|&number| number != self.status().executed);
            }
            HostCommand::Repeat(_) | HostCommand::ManualOutput(_) if value != 0 => self.asked = true,
            HostCommand::Action(action) if action.channel == channel::HEIGHT => self.heights.push(action.place),
            HostCommand::Action(action) if value != 0 => self.actions.push(action.place),
            HostCommand::Restart { .. } => self.blocked = false,
            _ => {}
        }
        self.keeps |= matches!(
            command,
            HostCommand::Repeat(_) | HostCommand::Instruction(Instruction { keeps_cutter: true, .. })
        );
    }

    fn period(&mut self, levels: u16, keep_alive: bool) {
        let before = self.status();
        if keep_alive {
            self.card.keep_alive();
            self.silent = 0;
        }
        let position = self.position();
        let levels = if position < SHEET { levels | FLOAT } else { levels };
        self.card.run_period(InputLevels { levels, ..InputLevels::default() });
        self.silent += 1;
        let now = self.status();
        assert_eq!(self.position(), position + i64::from(self.card.pulses()[0]), "path and layer are what is emitted");
        let (was, is) = (before.outputs[usize::from(TORCH)] != 0, now.outputs[usize::from(TORCH)] != 0);
        let moves = now.layer != before.layer;
        assert!(!moves || now.rate == Rate::ZERO || self.beside > 0, "the layer moves with the path");
        self.layer_moves += u64::from(moves);
        self.beside_moves += u64::from(moves && now.rate != Rate::ZERO);
        if !is {
            self.beside = self.beside.saturating_sub(1);
        }
        if (was || is) && passes_first(&self.heights, &before, now.place) {
            self.beside = BRAKING;
        }
        assert!(now.rate >= Rate::ZERO || !was && !is, "lit in reverse, or in the period before it");
        assert!(!(self.blocked && before.at_rest && now.rate != Rate::ZERO), "motion with the cutter out");
        if let Some(off) = now.cutter_off {
            self.put_out += 1;
            self.blocked |=
                matches!(off.cause, CutterOffCause::Standing | CutterOffCause::NoSheet | CutterOffCause::SheetContact);
            self.not_found += u64::from(off.cause == CutterOffCause::NoSheet);
        }
        assert!(now.beam_power == 0 || is, "power without the beam");
        self.powered += u64::from(now.beam_power == FULL && now.rate != Rate::ZERO);
        if is {
            self.lit += 1;
            assert!(!self.closed && !self.inhibit && levels & STOP == 0, "lit without an epoch, dry, or in a stop");
            assert!(levels & BREAKAWAY == 0, "lit in a collision");
            assert!(now.alarm.is_none() && self.silent < u32::from(WATCHDOG), "lit under an alarm or without a host");
            assert!(
                was || self.asked || self.pending.is_some() || passes_first(&self.actions, &before, now.place),
                "lit by nothing"
            );
        }
        let stands = is && before.at_rest && now.rate == Rate::ZERO && (was || !self.asked);
        self.stood = if stands && !self.keeps { self.stood + 1 } else { 0 };
        assert!(self.stood <= u32::from(GRACE + HANDOVER), "stood for {} periods", self.stood);
        self.pulse = self.pulse.filter(|_| is).map(|left| left.saturating_sub(1));
        assert!(self.pulse != Some(0), "a test pulse is too long");
        self.asked &= !is;
        self.pending = self.pending.filter(|&number| number != now.executed && now.alarm.is_none());
    }
}

/// Whether one of these places is passed for the first time.
fn passes_first(places: &[RecordIndex], before: &CardStatus<1>, to: Place) -> bool {
    places.iter().any(|&place| {
        let at = Place::start_of(place);
        !place.is_before(before.reached)
            && before.place.distance_to(at) >= Distance::ZERO
            && at.distance_to(to) > Distance::ZERO
    })
}

/// Runs of drawn commands, openings, closings, stops and silences.
pub(super) fn drawn_words(size: Size) -> String {
    let mut draw = Draw::new(size.seed);
    let runs = if size.full { 30_000 } else { 3_000 };
    let (mut periods, mut lit, mut put_out, mut layer_moves, mut not_found, mut powered) = (0u64, 0, 0, 0, 0, 0);
    let mut beside_moves = 0;
    for _ in 0..runs {
        let mut observer = Observer::new();
        for _ in 0..60 {
            match draw.below(24) {
                0 => observer.open(),
                1 => {
                    if observer.card.close().is_ok() {
                        observer.closed = true;
                    }
                }
                _ => observer.command(&mut draw),
            }
            let levels = [STOP, BREAKAWAY].get(draw.below(160) as usize).copied().unwrap_or(0);
            let keep_alive = draw.below(40) != 0;
            for _ in 0..draw.below(24) {
                observer.period(levels, keep_alive);
                periods += 1;
            }
        }
        lit += observer.lit;
        put_out += observer.put_out;
        powered += observer.powered;
        layer_moves += observer.layer_moves;
        beside_moves += observer.beside_moves;
        not_found += observer.not_found;
    }
    assert!(
        layer_moves > periods / 50 && not_found > runs / 40,
        "the layer moved in {layer_moves}, {not_found} missed"
    );
    assert!(beside_moves > periods / 2500, "the layer moved beside the path in {beside_moves}");
    assert!(powered > periods / 100, "the beam had power in motion in {powered} periods");
    assert!(lit > periods / 50 && put_out > runs / 4, "the torch was lit in {lit} periods and put out {put_out} times");
    format!(
        "{runs} runs, {periods} periods, lit in {lit}, put out {put_out} times; the layer moved in {layer_moves}, \
         beside the path in {beside_moves}"
    )
}
