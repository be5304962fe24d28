//! The motion path of a job: one turn a control period, from the operator's words to the card's next report.
//!
//! Invariant: the order within a turn is always the same: look what is planned, take the operator's words, ask the mode what is
//! wanted, switch what is due, slide the window, set the rate, let the period pass, book it. Nothing here waits for the planner
//! but in virtual time, where no time passes by waiting.

mod orders;
mod switching;

use std::thread;
use std::time::Duration;

use retrace_core::mode::{Demand, Facts, Mode, Notice, Operation, Order};
use retrace_core::place::before;
use retrace_core::ring::Consumer;
use retrace_core::wheel::Wheel;
use retrace_core::{ONE, Place, Record, Travel};
use retrace_link::{CardFault, Change, MotionCard, Status, Word, channel};

use crate::event::{Event, Happening};
use crate::item::{Ending, Item, Kind};
use crate::machine::{Machine, RetraceOutputs};
use crate::operator::percent;
use crate::overrides::Asking;
use crate::script::ScriptPlayer;
use crate::supply::{News, Road, Supply};
use crate::tally::{Spent, Tally};

/// Who looks on: records, screen, judge.
pub trait Observer<const A: usize> {
    /// A control period has passed.
    fn period(&mut self, status: &Status<A>, operation: &Operation);
    /// Something happened.
    fn event(&mut self, event: &Event);
}

/// How a run ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// The program was executed to its end.
    Completed,
    /// The operator stopped it, or nobody was there to go on.
    Stopped,
    /// The program turned out to have an error while it was fed; rendered.
    Refused(String),
    /// An alarm: number, cause, remedy.
    Alarm(&'static str, String, String),
}

/// Time and company of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Manner {
    /// Does time pass while nothing happens? In virtual time the motion path waits for the planner instead.
    pub wall_time: bool,
    /// Is an operator there to press cycle start at a program stop? Without one it is passed.
    pub operator: bool,
}

/// What ends a job: a fault of the card or of the line to it.
struct Fault {
    number: &'static str,
    cause: String,
    remedy: String,
}

impl Fault {
    fn of(fault: &impl CardFault) -> Self {
        Self { number: fault.number(), cause: fault.to_string(), remedy: fault.remedy().to_string() }
    }
}

/// Records that may be on their way to the card, or that it has run since it was heard of, at a common line's latency.
pub const ON_THE_WAY: u32 = 120;

/// Standing still for so long (s), with the operator's script at its end, ends the job: nobody will go on.
const NOBODY_THERE_S: f64 = 10.0;

/// A job being executed on a card.
pub struct Session<'r, 'o, const A: usize, C: MotionCard<A>> {
    card: C,
    supply: Supply<'r, A>,
    operation: Operation,
    operator: ScriptPlayer,
    overrides: Asking,
    wheel: Box<Wheel<512>>,
    manner: Manner,
    period_s: f64,
    enough: u32,
    /// Periods to stand and wait for records in wall time.
    patience: u64,
    cutting: Vec<u8>,
    observer: &'o mut dyn Observer<A>,
    tally: Tally,
    /// The kind of the instruction that the card is executing.
    executing: Option<Kind>,
    /// Standing at a program stop until cycle start.
    program_stop: bool,
    /// Cycle start was given for the program stop in hand.
    go_on: bool,
    /// Standing at the end of a block until cycle start.
    single_stop: bool,
    single: bool,
    stopping: bool,
    /// The road ends where the mode has it end.
    road_cut: bool,
    /// An alarm was told.
    alarmed: bool,
    dry: bool,
    still_periods: u64,
    target: Option<Travel>,
}

impl<'r, 'o, const A: usize, C: MotionCard<A>> Session<'r, 'o, A, C> {
    /// A session on `card`, which stands at the place where the ring begins.
    pub fn new(
        card: C,
        machine: &Machine,
        ring: Consumer<'r, Record<A>>,
        items: std::sync::mpsc::Receiver<Item>,
        operator: ScriptPlayer,
        manner: Manner,
        observer: &'o mut dyn Observer<A>,
    ) -> Self {
        let status = card.status();
        let supply = Supply::new(ring, items, status.place.record, status.outputs);
        Self {
            tally: Tally::new(status.place.record),
            supply,
            card,
            operation: Operation::default(),
            operator,
            overrides: Asking::default(),
            wheel: Box::new(Wheel::new(machine.wheel_periods, machine.wheel_counts)),
            manner,
            period_s: machine.period_s(),
            enough: machine.stopping.foresight_records + ON_THE_WAY,
            patience: u64::from(machine.look_ahead_records),
            cutting: machine.cutting_outputs.clone(),
            observer,
            executing: None,
            program_stop: false,
            go_on: false,
            single_stop: false,
            single: false,
            stopping: false,
            road_cut: true,
            alarmed: false,
            dry: false,
            still_periods: 0,
            target: None,
        }
        .with_outputs(machine.retrace_outputs)
    }

    /// The same, which asks for overrides above 100 %.
    #[must_use]
    pub fn asking(self, overrides: Asking) -> Self {
        Self { overrides, ..self }
    }

    fn with_outputs(mut self, outputs: RetraceOutputs) -> Self {
        // Every card takes this word; it changes nothing but what retracing does.
        let _ = self.card.send(Word::Replay { on: outputs == RetraceOutputs::Replayed });
        self
    }

    /// Runs the job to its end.
    pub fn run(mut self) -> (Outcome, Tally, C) {
        self.tell(Happening::Started);
        let outcome = loop {
            match self.turn() {
                Ok(None) => {}
                Ok(Some(outcome)) => break outcome,
                Err(fault) => {
                    if !self.alarmed {
                        self.tell(Happening::Alarm(fault.number, fault.cause.clone(), fault.remedy.clone()));
                    }
                    break Outcome::Alarm(fault.number, fault.cause, fault.remedy);
                }
            }
        };
        (outcome, self.tally, self.card)
    }

    /// One control period. `Err` is a fault of the card.
    fn turn(&mut self) -> Result<Option<Outcome>, Fault> {
        self.look();
        self.take_orders();
        let demand = self.demand();
        while self.switch_what_is_due(demand)? {
            self.look();
        }
        self.slide(demand);
        if let Some(outcome) = self.ended() {
            return Ok(Some(outcome));
        }
        self.set_rate(demand);
        let status = *self.card.period().map_err(|fault| Fault::of(&fault))?;
        self.book(&status);
        Ok(self.alarm(&status))
    }

    /// A latched alarm: told at once, and the end of the job when the machine stands.
    fn alarm(&mut self, status: &Status<A>) -> Option<Outcome> {
        let alarm = status.alarm?;
        let fault = Fault::of(&alarm);
        if !self.alarmed {
            self.alarmed = true;
            self.tell(Happening::Alarm(fault.number, fault.cause.clone(), fault.remedy.clone()));
        }
        status.at_rest.then_some(Outcome::Alarm(fault.number, fault.cause, fault.remedy))
    }

    /// Looks what is planned by now. In virtual time the run must not depend on how fast the planner is: it waits until enough is.
    fn look(&mut self) {
        self.supply.look();
        let mut spins = 0u32;
        while !self.manner.wall_time && !self.supply.is_enough(self.card.status(), self.enough) {
            spins += 1;
            match spins {
                0..100 => std::hint::spin_loop(),
                100..200 => thread::yield_now(),
                _ => thread::sleep(Duration::from_micros(50)),
            }
            self.supply.look();
        }
    }

    fn facts(&self) -> Facts {
        let status = self.card.status();
        Facts {
            place: status.place,
            at_rest: status.at_rest,
            reached: status.reached,
            oldest: self.supply.oldest(),
            outputs_agree: status.outputs == *self.supply.expected(),
            wheel: self.wheel.rate(),
        }
    }

    fn demand(&mut self) -> Demand {
        let (facts, mode) = (self.facts(), self.operation.mode());
        let demand = self.operation.demand(&facts);
        match demand.notice {
            Some(Notice::Oldest) => match self.supply.barrier() {
                Some(code) => self.tell(Happening::OneWay(code)),
                None => self.tell(Happening::Oldest),
            },
            Some(Notice::OutputsDiffer) => self.tell(Happening::OutputsDiffer(self.differing())),
            Some(Notice::GoesOn) => self.tell(Happening::GoesOn),
            None => {}
        }
        if demand.restore_outputs {
            for (channel, _, value) in self.differing() {
                // The channels come from the card's own report.
                let _ = self.card.send(Word::ByHand(Change { channel, value }));
            }
            self.tell(Happening::OutputsRestored);
        }
        if self.operation.mode() != mode {
            self.tell_mode();
        }
        demand
    }

    /// Channel, value, and value that the program expects, where these differ.
    fn differing(&self) -> Vec<(u8, i32, i32)> {
        let (are, want) = (&self.card.status().outputs, self.supply.expected());
        (0..channel::COUNT).filter(|&c| are[c] != want[c]).map(|c| (c as u8, are[c], want[c])).collect()
    }

    /// Slides the window. In a mode that retraces the road is cut at `reached`, and at the oldest place, before anything moves; a card
    /// at the end of a line may have to be told more than once.
    fn slide(&mut self, demand: Demand) {
        let road = if demand.look_ahead { Road::LookAhead } else { Road::Reached };
        if road == Road::Reached {
            let Status { reached, low, high, .. } = *self.card.status();
            let oldest = self.supply.oldest();
            self.road_cut = !before(reached, high);
            if before(reached, high) {
                self.road_cut = self.card.send(Word::Trim { high: reached }).is_ok();
            }
            if before(low, oldest) && before(oldest, high) {
                self.road_cut &= self.card.send(Word::Forget { low: oldest }).is_ok();
            }
        } else {
            self.road_cut = true;
        }
        if demand.target < 0 {
            self.supply.fill_behind(&mut self.card);
        } else {
            self.supply.fill_ahead(&mut self.card, road);
        }
    }

    fn set_rate(&mut self, demand: Demand) {
        let outputs = &self.card.status().outputs;
        let cutting = self.cutting.iter().any(|&c| outputs.get(usize::from(c)).is_some_and(|&v| v != 0));
        // Rapid retrace only with the cutting outputs off.
        let target = if cutting { demand.target.clamp(-ONE, ONE) } else { demand.target };
        let target = if self.waits_for_records() || !self.road_cut { 0 } else { target };
        if self.target != Some(target) && self.card.send(Word::Rate { target }).is_ok() {
            self.target = Some(target);
        }
    }

    /// Motion begins when enough is planned, and enough of it has come to the card, to go on at full rate; or when nothing more has come
    /// for as long as the look-ahead lasts.
    fn waits_for_records(&mut self) -> bool {
        let status = self.card.status();
        let stands = status.at_rest && self.operation.mode() == Mode::Run;
        if !stands || status.place != Place::start_of(status.reached) || self.still_periods >= self.patience {
            return false;
        }
        let wanted = status.place.record.wrapping_add(self.enough);
        let wanted = if before(status.high, wanted) { status.high } else { wanted };
        before(self.card.arrived(), wanted) || self.manner.wall_time && !self.supply.is_enough(status, self.enough)
    }

    fn book(&mut self, status: &Status<A>) {
        let executing = self.executing;
        self.acknowledge();
        if let Some(planned) = self.overrides.pass(status.reached) {
            // Overrides are asked for in steps of a hundredth of a percent.
            self.tell(Happening::OverridePlanned((100.0 * percent(planned)).round() / 100.0));
            self.override_rate();
        }
        let mode = self.operation.mode();
        let held = self.operation.held() || self.program_stop || self.single_stop;
        self.tally.count(Spent {
            mode,
            held,
            instruction: executing.map(|kind| kind == Kind::Dwell),
            rate: status.rate,
            place: status.place,
        });
        let mut passed: Vec<(u32, Happening)> = Vec::new();
        self.supply.follow(status, |news| {
            passed.push(match news {
                News::Action(action, line) => (line, Happening::SwitchedInPassing(action.channel, action.after)),
                News::Message(line, text) => (line, Happening::Message(text.to_string())),
            });
        });
        for (line, happening) in passed {
            self.tally.switch_events += u64::from(matches!(happening, Happening::SwitchedInPassing(..)));
            self.tell_at(line, happening);
        }
        self.watch_supply(status, mode);
        self.observer.period(status, &self.operation);
        self.still_periods = if status.rate == 0 && self.executing.is_none() { self.still_periods + 1 } else { 0 };
    }

    /// Underruns, and the end of a single block.
    fn watch_supply(&mut self, status: &Status<A>, mode: Mode) {
        if self.single && self.supply.block_end().is_some_and(|end| before(end, self.card.status().high)) {
            // The card could not stop there any more: at the next end of a block, then.
            self.next_block();
        }
        let at_block_end = self.single && self.supply.block_end() == Some(status.high);
        // who stands does not run dry: either there was nothing to run, or it was told on the way to rest
        let dry = status.short && status.rate != 0 && mode == Mode::Run && !at_block_end;
        if dry && !self.dry {
            self.tally.underruns += 1;
            self.tell(Happening::Underrun);
        }
        self.dry = dry;
        if at_block_end
            && mode == Mode::Run
            && !self.single_stop
            && status.at_rest
            && status.place == Place::start_of(status.high)
        {
            self.single_stop = true;
            self.tell(Happening::SingleBlock);
        }
    }

    /// Has the job come to its end?
    fn ended(&mut self) -> Option<Outcome> {
        let status = *self.card.status();
        if !status.at_rest || self.executing.is_some() {
            return None;
        }
        if self.stopping {
            return Some(Outcome::Stopped);
        }
        let at_end = status.place == Place::start_of(status.reached);
        if self.operation.mode() == Mode::Run && at_end && self.supply.all_executed(&status) {
            return Some(match self.supply.summary().map(|s| &s.ending) {
                Some(Ending::Refused(text)) => Outcome::Refused(text.clone()),
                _ => Outcome::Completed,
            });
        }
        // A feed or a line may stall for as long as it likes; what waits for an operator who will not come does not.
        let waits = self.operation.mode() != Mode::Run
            || self.operation.held()
            || self.operation.override_rate() == 0
            || self.program_stop
            || self.single_stop;
        let nobody = waits && self.operator.finished() && (!self.manner.wall_time || self.manner.operator);
        (nobody && self.still_periods as f64 * self.period_s > NOBODY_THERE_S).then_some(Outcome::Stopped)
    }

    /// Sets the part of the override that the rate does.
    fn override_rate(&mut self) {
        // Never refused.
        let _ = self.operation.order(Order::Override(self.overrides.rate()));
    }

    fn tell_mode(&mut self) {
        let name = match self.operation.mode() {
            Mode::Run => "run",
            Mode::Reverse => "reverse",
            Mode::Forward => "forward",
            Mode::Wheel => "wheel",
            Mode::Return => "return",
            Mode::Settle => "settle",
        };
        self.tell(Happening::Mode(name));
    }

    fn tell(&mut self, happening: Happening) {
        self.tell_at(self.card.status().line, happening);
    }

    fn tell_at(&mut self, line: u32, happening: Happening) {
        let status = self.card.status();
        let time_s = status.period as f64 * self.period_s;
        let event = Event { period: status.period, time_s, place: status.place, line, happening };
        self.observer.event(&event);
    }
}
