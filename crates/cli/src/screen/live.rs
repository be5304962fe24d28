//! The picture of the machine, kept up with what the motion path tells; in the reporter's thread.
//!
//! Invariant: what is told is taken in the order in which it is told; the lock is held for the time of one of them at most.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use retrace_controller::event::{Event, Happening};
use retrace_controller::machine::AXIS_LETTERS;
use retrace_controller::operator::Deed;
use retrace_controller::stream::{Observer, Period, Standing, Told};
use retrace_core::ONE;
use retrace_core::mode::Mode;
use retrace_gcode::FeedMode;
use retrace_link::channel;

use super::lengths::Lengths;
use super::model::{Active, AlarmShown, Model, Pause, Stage};
use super::trail::{Knot, Trail};

/// Periods over which the speed is a mean, so that it can be read.
const FEED_PERIODS: f64 = 32.0;

/// Takes a picture's lock. Whoever panicked with it left a picture that is old at worst.
pub fn locked(model: &Mutex<Model>) -> MutexGuard<'_, Model> {
    model.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Keeps a picture up.
#[derive(Clone, Debug)]
pub struct Live {
    model: Arc<Mutex<Model>>,
    /// The pause as it was before the operator's last word, should that be refused.
    before: Option<Pause>,
}

impl Live {
    /// Of this picture.
    #[must_use]
    pub const fn new(model: Arc<Mutex<Model>>) -> Self {
        Self { model, before: None }
    }
}

impl<const A: usize> Observer<A> for Live {
    fn told(&mut self, told: &Told<A>) {
        let mut model = locked(&self.model);
        model.changes += 1;
        match told {
            Told::Period(period) => take_period(&mut model, period),
            Told::Output(change) => {
                model.outputs.insert(change.channel, change.value);
                let turns = model.output(channel::SPINDLE);
                if let Some(pause) = &mut model.pause {
                    pause.stopped |= turns == 0;
                    pause.started = pause.stopped && turns == pause.spindle;
                    pause.online &= pause.started;
                }
            }
            Told::Active(active) => take_active(&mut model, active),
            Told::Event(event) => self.before = take_event(&mut model, event, self.before),
        }
    }
}

fn take_period<const A: usize>(model: &mut Model, period: &Period<A>) {
    let step_mm = step_mm(model, &period.increments);
    model.period = period.period;
    for (slot, &count) in model.counts.iter_mut().zip(&period.counts) {
        *slot = count;
    }
    let feed = step_mm / model.facts.period_s.max(1e-9) * 60.0;
    model.feed_mm_min += (feed - model.feed_mm_min) / FEED_PERIODS;
    if period.at_rest {
        model.feed_mm_min = 0.0;
    }
    (model.at_rest, model.short, model.inputs, model.off_path) =
        (period.at_rest, period.short, period.inputs, period.off_path);
    (model.mode, model.standing) = (period.mode, period.standing);
    model.rate = period.rate as f64 / ONE as f64;
    model.override_rate = period.override_rate as f64 / ONE as f64;
    let paused = period.standing == Standing::Paused;
    if paused && model.pause.is_none() {
        let spindle = model.output(channel::SPINDLE);
        // A spindle that stood needs no step of its own.
        model.pause = Some(Pause { spindle, stopped: spindle == 0, started: spindle == 0, online: false });
    } else if !paused && !period.off_path {
        model.pause = None;
    }
    if period.off_path {
        return;
    }
    (model.place, model.reached, model.oldest) = (period.place, period.reached, period.oldest);
    (model.planned, model.window, model.line) = (period.planned, period.window, period.line);
    if model.mode == Mode::Run {
        model.differ.clear();
    }
    if model.lengths.furthest().to(period.place) > 0 {
        model.lengths.grow(period.place, step_mm, period.oldest);
        model.reached_line = period.line;
        let knot = Knot { along_mm: model.lengths.total_mm(), at: model.in_space(), rapid: false };
        model.trail.push(knot);
    }
}

/// The modal state, its feed in mm/min where that is what it is, and the work zero that follows from it.
fn take_active(model: &mut Model, active: &retrace_gcode::Active) {
    let unit_mm = active.units.millimetres();
    let per_minute = active.feed_mode == FeedMode::UnitsPerMinute && active.feed_rate > 0.0;
    model.active = Active {
        modal: active.to_string(),
        feed: per_minute.then_some(active.feed_rate * unit_mm),
        tool: i32::try_from(active.current_tool).ok(),
    };
    for (zero, axis) in model.work_zero_mm.iter_mut().zip(&model.facts.axes) {
        let Some(index) = AXIS_LETTERS.iter().position(|&letter| letter == axis.letter) else { continue };
        let offsets = [&active.origin, &active.g92_offset, &active.tool_offset];
        let sum: f64 = offsets.iter().map(|offset| offset.0[index]).sum();
        *zero = if matches!(axis.letter, 'a'..='c') { sum } else { sum * unit_mm };
    }
}

/// How far the machine moved in a period: along its linear axes, or where none of them moves, along the others.
fn step_mm<const A: usize>(model: &Model, increments: &[i32; A]) -> f64 {
    let (mut linear, mut rotary) = (0.0, 0.0);
    for (axis, &pulses) in model.facts.axes.iter().zip(increments) {
        let square = (f64::from(pulses) / axis.pulses_per_mm).powi(2);
        if matches!(axis.letter, 'a'..='c') { rotary += square } else { linear += square }
    }
    if linear > 0.0 { linear.sqrt() } else { f64::sqrt(rotary) }
}

/// Takes an event; the pause as it was before the operator's last word.
fn take_event(model: &mut Model, event: &Event, before: Option<Pause>) -> Option<Pause> {
    let mut keep = before;
    match &event.happening {
        Happening::Started => begin(model, event),
        Happening::Operator(deed) => {
            keep = model.pause;
            if *deed == Deed::Single {
                model.single = !model.single;
            }
            if let Some(pause) = &mut model.pause
                && *deed == Deed::Online
            {
                pause.online = true;
            }
        }
        Happening::OrderRefused(_) if model.pause.is_some() && before.is_some() => model.pause = before,
        Happening::OverridePlanned(percent) => model.override_planned = percent / 100.0,
        Happening::OutputsDiffer(some) => {
            // A long list comes in parts.
            let list = some.list();
            model.differ.retain(|(channel, _, _)| list.iter().all(|(new, _, _)| new != channel));
            model.differ.extend(list);
        }
        Happening::OutputsRestored | Happening::GoesOn => model.differ.clear(),
        Happening::Switching(code) => model.switching = Some(code),
        Happening::Switched(_) => model.switching = None,
        Happening::ProgramEnd => {
            model.ended.get_or_insert(event.period);
        }
        Happening::Underrun => model.underruns += 1,
        Happening::Alarm(trouble) => {
            let (number, cause, remedy) = trouble.parts();
            model.alarm = Some(AlarmShown { number: number.into(), cause, remedy, is_refusal: false });
        }
        _ => {}
    }
    model.say(event.time_s, event.line, event.text());
    keep
}

/// A job begins: what an earlier one left is forgotten, but for its messages.
fn begin(model: &mut Model, event: &Event) {
    (model.stage, model.began, model.alarm) = (Stage::Job, event.period, None);
    (model.ended, model.standing) = (None, Standing::None);
    (model.single, model.underruns, model.override_planned) = (false, 0, 1.0);
    (model.trail, model.lengths) = (Trail::default(), Lengths::from(event.place));
    let at = model.in_space();
    model.trail.push(Knot { along_mm: 0.0, at, rapid: false });
}
