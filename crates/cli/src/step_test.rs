//! `retrace doctor PORT --step-test AXIS`: compares the steps at a pin of the card with what was ordered, over a wire
//! from the step output of the axis to the card's frequency input.
//!
//! Invariant: nothing moves before the operator has agreed; the axis ends where it began, within its soft limits, and
//! no output is switched. A signal, or an alarm, ends the test at rest.

use std::io::{IsTerminal, stdin};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use retrace_config::{MachineConfig, NumberedError};
use retrace_controller::{
    AnyCard, CommandSources, ManualTask, ManualTaskDone, ManualTaskError, ModalContext, Observer, PeriodRecord,
    RunMode, ScriptPlayer, Telemetry, interpreter_setup, perform_manual_task,
};
use retrace_core::RecordIndex;
use retrace_link::PathStart;
use serde_json::json;

use crate::command_failure::CommandFailure;
use crate::linked_card;
use crate::resume_summary::ask_yes_or_no;
use crate::stop_signals::{self, StopPolicy, StopSignals};

/// The analog input at which the card measures the frequency, and the frequency at the upper end of its range: those of
/// the Pico.
const INPUT: u8 = 0;
const FULL_SCALE_HZ: f64 = 1_000_000.0;
/// Shares of the highest speed of the axis at which it is tested.
const SHARES: [f64; 3] = [0.1, 0.3, 1.0];
/// Time for which each speed is kept, and of this the time at its beginning in which readings are of the speeding up
/// still, and at its end in which the axis may slow down already, s.
const CRUISE_S: f64 = 0.5;
const SETTLING_S: f64 = 0.1;
const ENDING_S: f64 = 0.05;
/// A count of the frequency input, which counts for a millisecond or for a control period if that is longer, and the
/// share of the frequency within which it has to be.
const COUNT_S: f64 = 0.001;
const TOLERANCE: f64 = 0.002;

/// What was found at one speed.
#[derive(Clone, Copy, Debug, PartialEq)]
struct MeasuredRate {
    ordered_hz: f64,
    /// At the pin; `None` where the speed was not kept for long enough.
    measured_hz: Option<f64>,
    tolerance_hz: f64,
}

impl MeasuredRate {
    fn passed(&self) -> bool {
        self.measured_hz.is_some_and(|hz| (hz - self.ordered_hz).abs() <= self.tolerance_hz)
    }
}

/// Collects the steps and the readings of a move.
#[derive(Debug, Default)]
struct Samples {
    axis: usize,
    /// Steps of each period, and the reading that was reported last.
    periods: Vec<(u32, Option<u16>)>,
}

impl Samples {
    fn take<const A: usize>(&mut self, period: &PeriodRecord<A>) {
        let steps = period.increments.get(self.axis).map_or(0, |steps| steps.unsigned_abs());
        self.periods.push((steps, period.analog_inputs.get(usize::from(INPUT)).copied().flatten()));
    }

    /// The rate while the axis kept this speed, in steps per period.
    fn rate(&self, steps_per_period: f64, period_s: f64) -> MeasuredRate {
        // At a constant speed the steps of two periods differ by one at most.
        let is_cruise = |&(steps, _): &(u32, _)| (f64::from(steps) - steps_per_period).abs() <= 1.0;
        let runs = self.periods.split(|period| !is_cruise(period));
        let cruise = runs.max_by_key(|run| run.len()).unwrap_or_default();
        let [from, behind] = [SETTLING_S, ENDING_S].map(|s| (s / period_s).ceil() as usize);
        let settled = cruise.get(from..cruise.len().saturating_sub(behind)).unwrap_or_default();
        let readings: Vec<f64> = settled.iter().filter_map(|(_, reading)| reading.map(f64::from)).collect();
        let counted: u32 = settled.iter().map(|(steps, _)| steps).sum();
        let ordered_hz = if settled.is_empty() {
            steps_per_period / period_s
        } else {
            f64::from(counted) / (settled.len() as f64 * period_s)
        };
        let is_enough = settled.len() as f64 * period_s >= CRUISE_S / 4.0 && readings.len() == settled.len();
        // A reading is the lower end of a step of its range.
        let mean = readings.iter().sum::<f64>() / readings.len().max(1) as f64 + 0.5;
        MeasuredRate {
            ordered_hz,
            measured_hz: is_enough.then_some(mean / 65_536.0 * FULL_SCALE_HZ),
            tolerance_hz: TOLERANCE * ordered_hz + 1.0 / COUNT_S.max(period_s),
        }
    }
}

/// Observer of a move that signals can stop.
struct Watch<'s> {
    samples: &'s mut Samples,
    signals: Option<&'s StopSignals>,
}

impl<const A: usize> Observer<A> for Watch<'_> {
    fn on_telemetry(&mut self, telemetry: &Telemetry<A>) {
        if let Telemetry::Period(period) = telemetry {
            self.samples.take(period);
        }
        if let Some(signals) = self.signals {
            signals.observe(telemetry);
        }
    }
}

/// Runs the test; whether to move without asking, and to print a JSON object.
///
/// # Errors
/// `E2161`, `E2164`, and what prevents a move.
pub fn run(port: &str, machine: &MachineConfig, letter: char, options: (bool, bool)) -> Result<(), CommandFailure> {
    if machine.axes.len() <= 4 {
        on_card::<4>(port, machine, letter, options)
    } else {
        on_card::<9>(port, machine, letter, options)
    }
}

fn on_card<const A: usize>(
    port: &str,
    machine: &MachineConfig,
    letter: char,
    (is_agreed, is_json): (bool, bool),
) -> Result<(), CommandFailure> {
    let name = letter.to_ascii_uppercase();
    let axis = machine.axis_of(letter).ok_or_else(|| {
        NumberedError::new("E2161", format!("the machine has no axis {name}"), "an axis of the machine file")
    })?;
    let mut card = linked_card::find::<A>(port)?;
    card.wait_at_rest(linked_card::nonce()).map_err(|fault| linked_card::card_error(port, &fault))?;
    let greeting = card.greeting().copied();
    let greeting =
        greeting.ok_or_else(|| NumberedError::new("E2164", "the card does not say what it is", "try again"))?;
    linked_card::check_fit(port, &greeting.identity, machine)?;
    if greeting.identity.analog.inputs() == 0 {
        let what = "the card has no frequency input, so that it cannot count its own steps";
        return Err(NumberedError::new("E2164", what, "a board that has one: docs/firmware.md").into());
    }
    let moves = planned_moves(machine, axis, greeting.counts[axis]);
    let longest_mm = moves.iter().map(|(_, mm)| mm.abs()).fold(0.0, f64::max);
    let question = format!(
        "wire the step output of {name} to the frequency input; {name} MOVES by up to {longest_mm:.1} mm and back, \
         three times, at up to {:.1} mm/s: is its motor uncoupled, or its drive unplugged? [y/N] ",
        machine.axes[axis].max_velocity_mm_per_s
    );
    let agrees = || stdin().is_terminal() && ask_yes_or_no(&question);
    if !is_agreed && !agrees() {
        let remedy = "uncouple the motor, then repeat the command with --yes";
        return Err(NumberedError::new("E2164", "nobody has agreed; nothing has moved", remedy).into());
    }
    // A signal between two moves ends the test as well.
    let is_stopped = Arc::new(AtomicBool::new(false));
    #[cfg(unix)]
    stop_signals::set_at_signal(&is_stopped);
    card.open(machine.card_settings(PathStart::at(RecordIndex::new(0))))
        .map_err(|fault| linked_card::card_error(port, &fault))?;
    let mut found = Vec::new();
    for (mm_per_s, mm) in moves.into_iter().flat_map(|(mm_per_s, mm)| [(mm_per_s, mm), (mm_per_s, -mm)]) {
        let mut card = AnyCard::new(&mut *card);
        found.push(measure(machine, (axis, letter), (mm_per_s, mm), (&mut card, &is_stopped))?);
    }
    // The card is at rest.
    let _ = card.close();
    print(name, &found, is_json);
    if found.iter().all(MeasuredRate::passed) {
        return Ok(());
    }
    let what = format!("the steps of {name} at the wire are not those that were ordered");
    let remedy = "check the wire and its pin; if they are right, see docs/firmware.md for what to report";
    Err(CommandFailure::Card(NumberedError::new("E2164", what, remedy)))
}

/// Speeds in mm/s and the signed length of the move at each, in mm, into the direction with more room.
fn planned_moves(machine: &MachineConfig, index: usize, counts: i64) -> Vec<(f64, f64)> {
    let axis = &machine.axes[index];
    let at_mm = axis.mm_of(counts);
    let room = [at_mm - axis.travel_mm[0], axis.travel_mm[1] - at_mm].map(|mm| mm.max(0.0));
    let (sign, room_mm) = if room[1] >= room[0] { (1.0, room[1]) } else { (-1.0, room[0]) };
    let limits = [axis.max_acceleration_mm_per_s2, axis.max_jerk_mm_per_s3];
    let length = |mm_per_s: f64| {
        let ramp_s = mm_per_s / limits[0] + limits[0] / limits[1];
        (mm_per_s * (CRUISE_S + ramp_s)).min(room_mm)
    };
    SHARES.map(|share| share * axis.max_velocity_mm_per_s).map(|speed| (speed, sign * length(speed))).to_vec()
}

/// Moves the axis at a speed, and compares.
fn measure<const A: usize>(
    machine: &MachineConfig,
    (axis, letter): (usize, char),
    (mm_per_s, mm): (f64, f64),
    (card, is_stopped): (&mut AnyCard<'_, A>, &AtomicBool),
) -> Result<MeasuredRate, CommandFailure> {
    let stopped = || NumberedError::new("E2164", "the test was stopped; the axis is at rest", "repeat the command");
    let mut machine = machine.clone();
    machine.axes[axis].set_jog_mm_s(mm_per_s);
    let mut samples = Samples { axis, ..Samples::default() };
    let (signals, stops) = StopSignals::watch(StopPolicy::Manual).unzip();
    let operators =
        CommandSources::from_script(ScriptPlayer::new(Vec::new(), machine.period_us)).with_stop_receiver(stops);
    if let Some(signals) = &signals {
        signals.listen();
    }
    if is_stopped.load(Ordering::Relaxed) {
        return Err(stopped().into());
    }
    let run_mode = RunMode { wall_time: true, operator: false, real_time: false };
    let mut modal_context = ModalContext::new(interpreter_setup(&machine));
    let mut watch = Watch { samples: &mut samples, signals: signals.as_ref() };
    let task = ManualTask::Jog { axis: letter, mm };
    let done = perform_manual_task(&task, &machine, &mut modal_context, card, (operators, run_mode), &mut watch);
    match done {
        Ok(ManualTaskDone::Completed { .. }) if !is_stopped.load(Ordering::Relaxed) => {}
        Ok(_) => return Err(stopped().into()),
        Err(ManualTaskError::Numbered(refusal)) => return Err(refusal.into()),
        Err(ManualTaskError::Block(_)) => return Err(CommandFailure::Program),
        Err(ManualTaskError::Card(error)) => {
            let (number, cause, remedy) = error.parts();
            return Err(CommandFailure::Card(NumberedError::new(number, cause, remedy)));
        }
    }
    let period_s = machine.period_s();
    Ok(samples.rate(mm_per_s * machine.axes[axis].pulses_per_mm * period_s, period_s))
}

fn print(name: char, found: &[MeasuredRate], is_json: bool) {
    let passed = found.iter().all(MeasuredRate::passed);
    if is_json {
        let rates: Vec<_> = found
            .iter()
            .map(|rate| {
                json!({"ordered_hz": rate.ordered_hz, "measured_hz": rate.measured_hz,
                    "tolerance_hz": rate.tolerance_hz, "passed": rate.passed()})
            })
            .collect();
        let axis = name.to_ascii_lowercase().to_string();
        crate::out::line(json!({"step_test": {"axis": axis, "passed": passed, "rates": rates}}));
        return;
    }
    say!("steps of {name} per second:     ordered   at the wire   within");
    for rate in found {
        let measured = rate.measured_hz.map_or("not measured".into(), |hz| format!("{hz:.0}"));
        let verdict = if rate.passed() { "" } else { "  WRONG" };
        say!("{:>31.0} {measured:>13} {:>8.0}{verdict}", rate.ordered_hz, rate.tolerance_hz);
    }
    say!("{}", if passed { "passed" } else { "FAILED" });
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Readings of a wire that shows this share of the steps, at 50.4 steps a period of 1 ms.
    fn samples(share: f64) -> Samples {
        let steps = |n: u32| f64::from(n) * 50.4;
        let period = |n: u32| {
            let taken = (steps(n + 1).floor() - steps(n).floor()) as u32;
            (taken, Some(((steps(n + 1) * share).floor() - (steps(n) * share).floor()) as u16 * 65))
        };
        let ramp = (0..200).map(|n| (n / 4, Some(n as u16)));
        Samples { axis: 0, periods: ramp.clone().chain((0..500).map(period)).chain(ramp.rev()).collect() }
    }

    #[test]
    fn steps_that_are_missing_at_the_wire_are_wrong() {
        for (share, passes) in [(1.0, true), (0.99, true), (0.95, false), (1.05, false), (0.0, false)] {
            let rate = samples(share).rate(50.4, 0.001);
            assert!((rate.ordered_hz - 50_400.0).abs() < 10.0, "{rate:?}");
            assert_eq!(rate.passed(), passes, "{share}: {rate:?}");
        }
        let mut short = samples(1.0);
        short.periods.truncate(300);
        assert_eq!(short.rate(50.4, 0.001).measured_hz, None, "it was too short to tell");
    }
}
