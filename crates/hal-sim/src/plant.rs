//! The plant of a simulated card: axes that count pulses, switches at their ends, things that take time to switch.
//!
//! Invariant: it depends on the card's pins alone, not on what the card means by them.

use retrace_card::{InputLevels, ProbeReading};
use retrace_link::{ANALOG_INPUTS, AnalogInputs, InputSetting, InputUse, MAX_INPUTS, Outputs, channel};

use crate::arc_voltage::WarpedSheet;
use crate::cutting_source::{CuttingSource, SourceSettings};
use crate::probed_work::{ProbeContact, ProbedWork};
use crate::random::{Chance, Random};
use crate::spindle_plant::{SpindlePlant, SpindleSimulation};
use crate::step_wire::{StepMeter, StepWire};

/// A switch that an axis actuates: active from a position on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Switch {
    /// The input that it is wired to.
    pub input: u8,
    /// The axis, from 0.
    pub axis: u8,
    /// The first position where it is active, in pulses from the axis position at the start.
    pub at: i64,
    /// Whether it is active from there upward; otherwise downward.
    pub upper: bool,
}

/// A device that an output switches and that reports when it is done: its input is inactive from the change on, and
/// active when done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Process {
    /// The output channel.
    pub channel: u8,
    /// The input that reports *done*.
    pub input: u8,
    /// Shortest duration, in microseconds.
    pub min_us: u32,
    /// Longest duration, in microseconds.
    pub max_us: u32,
    /// Probability that it never reports *done*.
    pub hangs: Chance,
    /// Probability that it reports a failure.
    pub fails: Chance,
}

/// A device that reports its state: an arc, a brake, a chuck. From a change of its output on, its input denies the new
/// state, and confirms it after the delay; it reports the state of output 0 before anything was switched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reply {
    /// The output channel.
    pub channel: u8,
    /// The input that reports the state.
    pub input: u8,
    /// Whether the input is active where the channel is 0, and where it is not.
    pub active: [bool; 2],
    /// Delay, in microseconds.
    pub after_us: u32,
}

/// A change of an input at a given time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InputEvent {
    /// Time, in microseconds.
    pub at_us: u64,
    /// The input.
    pub input: u8,
    /// Whether it is active from then on.
    pub active: bool,
}

/// Settings of a plant.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlantSettings {
    /// Switches on the axes.
    pub switches: Vec<Switch>,
    /// Devices that take time to switch.
    pub processes: Vec<Process>,
    /// Devices that report their state.
    pub replies: Vec<Reply>,
    /// Sources of cutters.
    pub sources: Vec<SourceSettings>,
    /// A sheet that is not even: the switches of its contacts are higher where it is.
    pub warped: WarpedSheet,
    /// Work and a probe.
    pub work: Option<ProbedWork>,
    /// A spindle with an encoder.
    pub spindle: Option<SpindleSimulation>,
    /// A wire from a step output to an input that measures a frequency.
    pub step_wire: Option<StepWire>,
    /// Changes of inputs, in the order of time: doors, emergency stops.
    pub events: Vec<InputEvent>,
    /// Inputs whose level is low while the device on them is active, one bit each.
    pub active_low: u16,
    /// Seed of all random events.
    pub seed: u64,
}

/// The usual wiring of the simulated machine, by input.
pub mod wiring {
    /// Lower limit switches of axes 0 … 3; of axis a it is `LOWER + a`.
    pub const LOWER: u8 = 0;
    /// Upper limit switches of axes 0 … 3.
    pub const UPPER: u8 = 4;
    /// Home switches of axes 0 … 3.
    pub const HOME: u8 = 8;
    /// The door.
    pub const DOOR: u8 = 12;
    /// The emergency-stop chain, active when open.
    pub const EMERGENCY_STOP: u8 = 13;
    /// The probe.
    pub const PROBE: u8 = 14;
    /// A process reports that it is done.
    pub const DONE: u8 = 15;
    /// Number of axes that have switches.
    pub const AXES: usize = 4;
}

impl PlantSettings {
    /// A plant wired as in the card's configuration: limit switches at `travel` (lower and upper end of each axis, in
    /// pulses), home switches `home[axis]` pulses before the lower one. Doors are shut and the emergency-stop chain is
    /// closed.
    #[must_use]
    pub fn wired_as(inputs: &[InputSetting; MAX_INPUTS], travel: &[[i64; 2]], home: &[i64]) -> Self {
        let mut settings = Self::default();
        for (input, setting) in (0u8..).zip(inputs) {
            settings.active_low |= u16::from(setting.active_low) << input;
            let ends = |axis: u8| travel.get(usize::from(axis));
            match setting.used_for {
                InputUse::Limit { axis, upper } => settings.switches.extend(ends(axis).map(|&[low, high]| Switch {
                    input,
                    axis,
                    at: if upper { high } else { low },
                    upper,
                })),
                InputUse::Home { axis } => settings.switches.extend(ends(axis).map(|&[low, _]| {
                    let at = low + home.get(usize::from(axis)).copied().unwrap_or(0);
                    Switch { input, axis, at, upper: false }
                })),
                _ => {}
            }
        }
        settings
    }

    /// Limit switches at `travel` (lower and upper end of each axis, in pulses) and a home switch at the lower end,
    /// `home` pulses before the limit switch, in the usual [`wiring`].
    #[must_use]
    pub fn with_switches(travel: &[[i64; 2]], home: i64) -> Self {
        let mut switches = Vec::new();
        for (axis, &[low, high]) in (0..).zip(travel.iter().take(wiring::AXES)) {
            switches.push(Switch { input: wiring::LOWER + axis, axis, at: low, upper: false });
            switches.push(Switch { input: wiring::UPPER + axis, axis, at: high, upper: true });
            switches.push(Switch { input: wiring::HOME + axis, axis, at: low + home, upper: false });
        }
        Self { switches, ..Self::default() }
    }
}

/// The pending report of a process.
#[derive(Clone, Copy, Debug)]
enum PendingReply {
    Done,
    Failed,
}

#[derive(Clone, Debug)]
struct RunningProcess {
    process: Process,
    value: i32,
    due: Option<(u64, PendingReply)>,
}

#[derive(Clone, Debug)]
struct RunningReply {
    reply: Reply,
    value: i32,
    due_us: Option<u64>,
}

impl RunningReply {
    /// Level that the input of the device reports.
    const fn reported_level(&self) -> bool {
        self.reply.active[(self.value != 0) as usize]
    }
}

/// The handwheel in motion.
#[derive(Clone, Copy, Debug)]
struct WheelMotion {
    counts_per_s: i32,
    since_us: u64,
    until_us: u64,
    /// Counts turned so far.
    turned: i64,
}

/// A plant of `A` axes.
#[derive(Clone, Debug)]
pub struct Plant<const A: usize> {
    switches: Vec<Switch>,
    running: Vec<RunningProcess>,
    replying: Vec<RunningReply>,
    sources: Vec<CuttingSource>,
    warped: WarpedSheet,
    probe: Option<ProbeContact>,
    spindle: Option<SpindlePlant>,
    step_meter: Option<StepMeter>,
    events: std::collections::VecDeque<InputEvent>,
    random: Random,
    active: u16,
    active_low: u16,
    failed: bool,
    analog: AnalogInputs,
    encoder: u16,
    /// Motion of the handwheel, while it is turned.
    wheel_motion: Option<WheelMotion>,
    /// Number of devices that were switched, that hung, and that failed.
    switched: [u64; 3],
}

impl<const A: usize> Plant<A> {
    /// A plant at rest, at position 0, with all outputs off.
    #[must_use]
    pub fn new(settings: &PlantSettings) -> Self {
        let mut events = settings.events.clone();
        events.sort_by_key(|event| event.at_us);
        let replying = settings.replies.iter().map(|&reply| RunningReply { reply, value: 0, due_us: None });
        let replying: Vec<RunningReply> = replying.collect();
        let mut active = 0;
        for each in replying.iter().filter(|each| each.reported_level()) {
            set(&mut active, each.reply.input, true);
        }
        // What is so from the beginning is not undone by what is switched by hand before the first period.
        let later = events.partition_point(|event| event.at_us == 0);
        for event in events.drain(..later) {
            set(&mut active, event.input, event.active);
        }
        Self {
            switches: settings.switches.clone(),
            running: settings
                .processes
                .iter()
                .map(|&process| RunningProcess { process, value: 0, due: None })
                .collect(),
            replying,
            sources: settings.sources.iter().map(CuttingSource::new).collect(),
            warped: settings.warped,
            probe: settings.work.as_ref().map(ProbeContact::new),
            spindle: settings.spindle.map(SpindlePlant::new),
            step_meter: settings.step_wire.map(StepMeter::new),
            events: events.into(),
            random: Random::new(settings.seed),
            active,
            active_low: settings.active_low,
            failed: false,
            analog: [Some(0); ANALOG_INPUTS],
            encoder: 0,
            wheel_motion: None,
            switched: [0; 3],
        }
    }

    /// Levels of the card's inputs at `now_us`, with the axes at `positions`, to which they came by `pulses` in the
    /// period before.
    pub fn inputs(&mut self, now_us: u64, positions: &[i64; A], pulses: &[i32; A]) -> InputLevels {
        for switch in &self.switches {
            let Some(&position) = positions.get(usize::from(switch.axis)) else { continue };
            let is_contact = self.warped.contacts >> switch.input & 1 == 1;
            let rise = if is_contact { self.warped.rise(positions[0]).round() as i64 } else { 0 };
            let at = switch.at + rise;
            let active = if switch.upper { position >= at } else { position <= at };
            set(&mut self.active, switch.input, active);
        }
        for running in &mut self.running {
            if let Some((due, promise)) = running.due
                && due <= now_us
            {
                running.due = None;
                match promise {
                    PendingReply::Done => set(&mut self.active, running.process.input, true),
                    PendingReply::Failed => self.failed = true,
                }
            }
        }
        for each in &mut self.replying {
            if each.due_us.is_some_and(|due| due <= now_us) {
                each.due_us = None;
                set(&mut self.active, each.reply.input, each.reported_level());
            }
        }
        for source in &mut self.sources {
            let is_closed = source.advance(now_us, positions);
            set(&mut self.active, source.input(), is_closed);
            if let Some((number, reading)) = source.voltage(positions)
                && let Some(input) = self.analog.get_mut(usize::from(number))
            {
                *input = Some(reading);
            }
        }
        if let Some((number, reading)) = self.step_meter.as_mut().and_then(|meter| meter.advance(now_us, pulses)) {
            self.set_analog_input(number, Some(reading));
        }
        let mut probe_change = None;
        if let Some(probe) = &mut self.probe {
            let (touches, change) = probe.advance(now_us, positions, pulses);
            set(&mut self.active, probe.input(), touches);
            probe_change = change;
        }
        while let Some(event) = self.events.front().filter(|event| event.at_us <= now_us) {
            set(&mut self.active, event.input, event.active);
            self.events.pop_front();
        }
        self.advance_wheel(now_us);
        let failed = std::mem::take(&mut self.failed);
        let spindle = self.spindle.as_mut().map(|spindle| spindle.advance(now_us)).unwrap_or_default();
        InputLevels {
            levels: self.active ^ self.active_low,
            encoder: self.encoder,
            failed,
            probe: ProbeReading { first_change: probe_change, is_period_behind: false },
            spindle,
            analog: self.analog,
        }
    }

    /// Applies the card's outputs at `now_us`.
    pub fn outputs(&mut self, now_us: u64, outputs: &Outputs) {
        for running in &mut self.running {
            let process = running.process;
            let Some(&value) = outputs.get(usize::from(process.channel).min(channel::COUNT)) else { continue };
            if value == running.value {
                continue;
            }
            running.value = value;
            set(&mut self.active, process.input, false);
            self.switched[0] += 1;
            let us = process.min_us + self.random.up_to(process.max_us.saturating_sub(process.min_us));
            let due = now_us + u64::from(us);
            let (hangs, fails) = (process.hangs.draw(&mut self.random), process.fails.draw(&mut self.random));
            self.switched[1] += u64::from(hangs);
            self.switched[2] += u64::from(fails && !hangs);
            running.due = (!hangs).then_some((due, if fails { PendingReply::Failed } else { PendingReply::Done }));
        }
        if let Some(spindle) = &mut self.spindle {
            spindle.outputs(outputs);
        }
        for source in &mut self.sources {
            let is_on = outputs.get(usize::from(source.channel())).is_some_and(|&value| value != 0);
            source.switch(now_us, is_on);
        }
        for each in &mut self.replying {
            let Some(&value) = outputs.get(usize::from(each.reply.channel)) else { continue };
            if value != each.value {
                each.value = value;
                set(&mut self.active, each.reply.input, !each.reported_level());
                each.due_us = Some(now_us + u64::from(each.reply.after_us));
            }
        }
    }

    /// Sets an input active or inactive manually.
    pub const fn set_input(&mut self, input: u8, active: bool) {
        set(&mut self.active, input, active);
    }

    /// Sets the reading of an analog input, in units of 2⁻¹⁶ of its range, or to none, as where a module is silent.
    /// Without such an input nothing happens.
    pub fn set_analog_input(&mut self, number: u8, reading: Option<u16>) {
        if let Some(input) = self.analog.get_mut(usize::from(number)) {
            *input = reading;
        }
    }

    /// The spindle, for changes by a test; `None` without one.
    pub const fn spindle(&mut self) -> Option<&mut SpindlePlant> {
        self.spindle.as_mut()
    }

    /// Turns the handwheel by `counts` counts of its encoder.
    pub const fn turn_wheel(&mut self, counts: i16) {
        self.encoder = self.encoder.wrapping_add_signed(counts);
    }

    /// Turns the handwheel at `counts_per_s` for `for_us` microseconds from `now_us` on; ends what remains of another
    /// turn.
    pub const fn turn_wheel_for(&mut self, now_us: u64, counts_per_s: i32, for_us: u64) {
        let until_us = now_us.saturating_add(for_us);
        self.wheel_motion = Some(WheelMotion { counts_per_s, since_us: now_us, until_us, turned: 0 });
    }

    /// Adds the turn of the handwheel up to now.
    fn advance_wheel(&mut self, now_us: u64) {
        let Some(turning) = &mut self.wheel_motion else { return };
        let passed = now_us.min(turning.until_us).saturating_sub(turning.since_us);
        // less than 2⁶³: a turn of more than some days at the highest speed is cut short
        let due = i64::from(turning.counts_per_s) * passed.min(1 << 31) as i64 / 1_000_000;
        // the counter of an encoder that turns by more between two readings would overflow as well
        let counts = (due - turning.turned) as i16;
        turning.turned = due;
        if now_us >= turning.until_us {
            self.wheel_motion = None;
        }
        self.turn_wheel(counts);
    }

    /// Number of devices that were switched, that hung, and that failed.
    #[must_use]
    pub const fn switched(&self) -> [u64; 3] {
        self.switched
    }
}

const fn set(inputs: &mut u16, input: u8, active: bool) {
    if input < 16 {
        let bit = 1 << input;
        *inputs = if active { *inputs | bit } else { *inputs & !bit };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn switches_stand_at_the_ends_of_the_travel() {
        let mut machine = Plant::<2>::new(&PlantSettings::with_switches(&[[-100, 500], [0, 10]], 20));
        let mut active = |x, y| -> Vec<u32> {
            let levels = u32::from(machine.inputs(0, &[x, y], &[0; 2]).levels);
            (0..16).filter(|n| levels >> n & 1 == 1).collect()
        };
        assert_eq!(active(-80, 5), [8, 9]);
        assert_eq!(active(-79, 9), [9]);
        assert_eq!(active(-100, 10), [0, 5, 8, 9]);
        assert_eq!(active(500, 0), [1, 4, 9]);
        assert_eq!(active(499, 21), [5]);
    }

    #[test]
    fn a_machine_is_wired_as_the_card_is_told() {
        let mut inputs = [InputSetting::default(); MAX_INPUTS];
        inputs[3] = InputSetting { used_for: InputUse::Limit { axis: 1, upper: true }, active_low: true };
        inputs[5] = InputSetting { used_for: InputUse::Home { axis: 0 }, active_low: false };
        inputs[7] = InputSetting { used_for: InputUse::EmergencyStop, active_low: true };
        inputs[9] = InputSetting { used_for: InputUse::Limit { axis: 8, upper: true }, active_low: false };
        let settings = PlantSettings::wired_as(&inputs, &[[-100, 100], [-50, 50]], &[10]);
        let mut machine = Plant::<2>::new(&settings);
        let closed = 1 << 3 | 1 << 7;
        assert_eq!(machine.inputs(0, &[0, 49], &[0; 2]).levels, closed);
        assert_eq!(machine.inputs(0, &[-90, 50], &[0; 2]).levels, 1 << 5 | 1 << 7);
        machine.set_input(7, true);
        assert_eq!(machine.inputs(0, &[0, 0], &[0; 2]).levels, 1 << 3);
    }

    #[test]
    fn a_process_says_done_in_its_time_each_time() {
        let process = Process {
            channel: channel::SPINDLE,
            input: wiring::DONE,
            min_us: 500,
            max_us: 900,
            hangs: Chance::NEVER,
            fails: Chance::NEVER,
        };
        let settings = PlantSettings { processes: vec![process], seed: 3, ..PlantSettings::default() };
        let mut machine = Plant::<1>::new(&settings);
        let (mut outputs, mut times) = ([0; channel::COUNT], Vec::new());
        for round in 1..=50u64 {
            let begin = round * 10_000;
            outputs[usize::from(channel::SPINDLE)] = round as i32;
            machine.outputs(begin, &outputs);
            machine.outputs(begin + 1, &outputs);
            let took = (0..2000).find(|&us| machine.inputs(begin + us, &[0], &[0; 1]).levels >> wiring::DONE & 1 == 1);
            times.push(took.expect("done"));
        }
        assert!(times.iter().all(|&us| (500..=900).contains(&us)), "{times:?}");
        assert!(times.iter().max() > times.iter().min());
        assert_eq!(machine.switched(), [50, 0, 0]);
    }

    #[test]
    fn a_reply_denies_the_new_state_until_it_is_come_to() {
        let arc = Reply { channel: channel::SPINDLE, input: 5, active: [false, true], after_us: 500 };
        let still = Reply { input: 6, active: [true, false], ..arc };
        let changed = Reply { input: 7, active: [true, true], ..arc };
        let settings = PlantSettings { replies: vec![arc, still, changed], ..PlantSettings::default() };
        let mut machine = Plant::<1>::new(&settings);
        let mut outputs = [0; channel::COUNT];
        let levels = |machine: &mut Plant<1>, us| machine.inputs(us, &[0], &[0; 1]).levels >> 5;
        machine.outputs(0, &outputs);
        assert_eq!(levels(&mut machine, 9_999), 0b110, "nothing is switched: it stands");
        outputs[usize::from(channel::SPINDLE)] = 1;
        machine.outputs(10_000, &outputs);
        machine.outputs(10_400, &outputs);
        assert_eq!((levels(&mut machine, 10_499), levels(&mut machine, 10_500)), (0b010, 0b101));
        outputs[usize::from(channel::SPINDLE)] = 0;
        machine.outputs(20_000, &outputs);
        assert_eq!((levels(&mut machine, 20_499), levels(&mut machine, 20_500)), (0b001, 0b110));
    }

    #[test]
    fn what_hangs_stays_silent_and_what_fails_says_so_once() {
        let certain = Chance::new(1.0).expect("a probability");
        let hang = Process { channel: 0, input: 15, min_us: 1, max_us: 1, hangs: certain, fails: Chance::NEVER };
        let fail = Process { channel: 1, input: 14, hangs: Chance::NEVER, fails: certain, ..hang };
        let settings = PlantSettings { processes: vec![hang, fail], ..PlantSettings::default() };
        let mut machine = Plant::<1>::new(&settings);
        let mut outputs = [0; channel::COUNT];
        (outputs[0], outputs[1]) = (1, 1);
        machine.outputs(0, &outputs);
        let seen: Vec<InputLevels> = (0..10).map(|us| machine.inputs(us, &[0], &[0; 1])).collect();
        assert!(seen.iter().all(|inputs| inputs.levels == 0));
        assert_eq!(seen.iter().filter(|inputs| inputs.failed).count(), 1);
        assert_eq!(machine.switched(), [2, 1, 1]);
    }

    #[test]
    fn events_and_the_wheel() {
        let events = vec![
            InputEvent { at_us: 20, input: wiring::DOOR, active: false },
            InputEvent { at_us: 10, input: wiring::DOOR, active: true },
        ];
        let mut machine = Plant::<1>::new(&PlantSettings { events, ..PlantSettings::default() });
        let door = |machine: &mut Plant<1>, us| machine.inputs(us, &[0], &[0; 1]).levels >> wiring::DOOR & 1;
        assert_eq!([9, 10, 19, 20].map(|us| door(&mut machine, us)), [0, 1, 1, 0]);
        machine.turn_wheel(-5);
        assert_eq!(machine.inputs(30, &[0], &[0; 1]).encoder, u16::MAX - 4);
        machine.set_input(wiring::PROBE, true);
        assert_eq!(machine.inputs(30, &[0], &[0; 1]).levels, 1 << wiring::PROBE);
    }

    #[test]
    fn the_wheel_is_turned_evenly_and_by_as_much_as_was_said() {
        let mut machine = Plant::<1>::new(&PlantSettings::default());
        machine.turn_wheel_for(10_000, -120, 2_000_000);
        let mut last = 0;
        for now_us in (10_000..3_000_000).step_by(1000) {
            let encoder = machine.inputs(now_us, &[0], &[0; 1]).encoder as i16;
            assert!((0..=1).contains(&(last - encoder)), "evenly");
            last = encoder;
        }
        assert_eq!(last, -240);
    }
}
