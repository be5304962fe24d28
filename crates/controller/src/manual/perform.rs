//! Carries a task out while no program runs, with the machinery of a job: an epoch, the card's window, one stream that tells it.
//!
//! Invariant: it begins and ends at rest; whoever says *stop* or *hold* brings it to rest where it is, and what is left of it is discarded.

use std::sync::PoisonError;
use std::thread;

use retrace_core::mode::Mode;
use retrace_link::{Alarm, CardStatus, HostCommand, MotionCard, OutputChange, PathStart};

use super::Task;
use super::hand::{self, Hand, Request};
use super::trip::{Ended, OLD_NEWS, Trip};
use crate::by_hand::Desk;
use crate::dnc::{AxisCounts, Dnc, Flags, Step};
use crate::event::{CardError, Event, EventKind};
use crate::index::Keeping;
use crate::job::{self, Begin, Conduct};
use crate::machine::Machine;
use crate::operator::{CommandError, OperatorCommand};
use crate::orders::Operators;
use crate::refusal::Refusal;
use crate::session::{Manner, ON_THE_WAY, Outcome};
use crate::stream::{self, Observer, Period, Teller, Told};

/// Periods within which a card has taken a word and said so.
const HEARD: u32 = 3 * OLD_NEWS;

/// What a task came to.
#[derive(Clone, Debug, PartialEq)]
pub enum Done {
    /// It was carried out; of a jog, whether the soft limit cut it short.
    Whole {
        /// It was to go farther.
        cut_short: bool,
    },
    /// It was stopped.
    Stopped,
}

/// Why a task was not carried out, or not to its end. The machine stands.
#[derive(Clone, Debug, PartialEq)]
pub enum NotDone {
    /// It is not begun: what is wrong.
    Refused(Refusal),
    /// A block by hand has errors: rendered.
    Block(Vec<String>),
    /// An alarm, or a fault of the card.
    Trouble(CardError),
}

impl From<Refusal> for NotDone {
    fn from(refusal: Refusal) -> Self {
        Self::Refused(refusal)
    }
}

/// Carries a task out on a card that stands. What `desk` has in force is what blocks by hand go by, and go on from.
///
/// # Errors
/// What keeps it from being done.
pub fn perform<const A: usize, C: MotionCard<A>>(
    task: &Task,
    machine: &Machine,
    desk: &mut Desk,
    card: &mut C,
    (operators, manner): (Operators, Manner),
    observer: &mut dyn Observer<A>,
) -> Result<Done, NotDone> {
    if let Some(text) = block_of(task, machine)? {
        return block(&text, machine, desk, card, (operators, manner), observer);
    }
    let mut ring =
        hand::ring(machine, 0).map_err(|_| Refusal::new("E2112", "no ring for a move", "a shorter look_ahead_s"))?;
    let mail = hand::Mail::default();
    let (hand, requests) = hand::hand(ring.split(), &mail);
    let (teller, hearing) = stream::stream(manner.wall_time, machine.period_s());
    thread::scope(|scope| {
        scope.spawn(move || hearing.report(observer));
        let planner = scope.spawn(move || requests.serve(machine, Box::new(|| 0)));
        let hand = hand.waking(planner.thread().clone());
        let enough = machine.stopping.foresight_records + ON_THE_WAY;
        Bench { machine, card, operators, manner, teller, hand, enough, stopped: false }.perform(task)
    })
}

/// The block that a task comes to, if it is one.
fn block_of(task: &Task, machine: &Machine) -> Result<Option<String>, NotDone> {
    Ok(match task {
        Task::Mdi(text) => Some(text.clone()),
        Task::WorkZero(None) => {
            let words: Vec<String> =
                machine.axes.iter().map(|axis| format!(" {}0", axis.name.to_ascii_uppercase())).collect();
            Some(format!("G10 L20 P0{}", words.concat()))
        }
        Task::WorkZero(Some(letter)) => {
            axis(machine, *letter)?;
            Some(format!("G10 L20 P0 {}0", letter.to_ascii_uppercase()))
        }
        _ => None,
    })
}

fn axis(machine: &Machine, letter: char) -> Result<usize, Refusal> {
    machine.axis_of(letter).ok_or_else(|| {
        let names: Vec<String> = machine.axes.iter().map(|axis| axis.name.to_string()).collect();
        let what = format!("the machine has no axis {}", letter.to_ascii_uppercase());
        Refusal::new("E2161", what, format!("one of {}", names.join(", ")))
    })
}

/// A block by hand is a small job.
fn block<const A: usize, C: MotionCard<A>>(
    text: &str,
    machine: &Machine,
    desk: &mut Desk,
    card: &mut C,
    (operators, manner): (Operators, Manner),
    observer: &mut dyn Observer<A>,
) -> Result<Done, NotDone> {
    let trouble = |fault: &C::Fault| NotDone::Trouble(CardError::of(fault));
    anew(card).map_err(|fault| trouble(&fault))?;
    let machine = Machine { history_records: 0, ..machine.clone() }.standing_at(&card.status().counts);
    let block = desk.block(&machine, text).map_err(NotDone::Block)?;
    let (block, left) = block.leaving();
    let conduct = Conduct { begin: Begin::First, operators, manner, keeping: Keeping::default() };
    let end = job::run(&machine, block, conduct, &mut *card, observer)
        .map_err(|why| Refusal::new("E2112", why.to_string(), "a shorter look_ahead_s in the machine file"))?;
    match end.outcome {
        Outcome::Completed => {
            if let Some(carried) = left.lock().unwrap_or_else(PoisonError::into_inner).take() {
                desk.take_over(carried);
            }
            Ok(Done::Whole { cut_short: false })
        }
        Outcome::Stopped => {
            anew(card).map_err(|fault| trouble(&fault))?;
            Ok(Done::Stopped)
        }
        Outcome::Refused(text) => Err(NotDone::Block(vec![text])),
        Outcome::Alarm(number, cause, remedy) => Err(NotDone::Trouble(CardError::Fault { number, cause, remedy })),
    }
}

/// Begins a path anew where the machine stands.
fn anew<const A: usize, C: MotionCard<A>>(card: &mut C) -> Result<(), C::Fault> {
    let CardStatus { place, executed, .. } = *card.status();
    card.begin(PathStart { executed, ..PathStart::at(place.boundary_ahead()) })
}

/// A card in hand.
struct Bench<'a, 'r, const A: usize, C: MotionCard<A>> {
    machine: &'a Machine,
    card: &'a mut C,
    operators: Operators,
    manner: Manner,
    teller: Teller<A>,
    hand: Hand<'r, A>,
    enough: u32,
    stopped: bool,
}

impl<const A: usize, C: MotionCard<A>> Bench<'_, '_, A, C> {
    fn perform(mut self, task: &Task) -> Result<Done, NotDone> {
        match task {
            Task::Home(None) => {
                let order: Vec<char> = self.machine.homing_order().to_vec();
                if order.is_empty() {
                    return Err(no_home("no axis of the machine has a home switch".into()).into());
                }
                order.into_iter().try_fold(Done::Whole { cut_short: false }, |done, letter| {
                    if done == Done::Stopped { Ok(done) } else { self.home(letter) }
                })
            }
            Task::Home(Some(letter)) => self.home(*letter),
            Task::Jog { axis, mm } => self.jog(*axis, |from, counts| from.saturating_add(counts(*mm))),
            Task::JogOn { axis, up: true } => self.jog(*axis, |_, _| i64::MAX),
            Task::JogOn { axis, up: false } => self.jog(*axis, |_, _| i64::MIN),
            Task::ClearAlarm => self.clear(),
            Task::Output(channel, value) => {
                let change = OutputChange { channel: *channel, value: *value };
                let refused =
                    |_| Refusal::new("E2161", format!("the card has no output {channel}"), "an output that it has");
                self.card.send(HostCommand::ManualOutput(change)).map_err(refused)?;
                self.pass(if self.manner.wall_time { OLD_NEWS } else { 2 })
            }
            // Blocks: not here.
            Task::Mdi(_) | Task::WorkZero(_) => Ok(Done::Whole { cut_short: false }),
        }
    }

    /// One axis to its home switch, over the card.
    fn home(&mut self, letter: char) -> Result<Done, NotDone> {
        let index = axis(self.machine, letter)?;
        let name = letter.to_ascii_uppercase();
        let homing = self.machine.homing(index).ok_or_else(|| no_home(format!("axis {name} has no home switch")))?;
        self.begin()?;
        self.card
            .send(HostCommand::Home(homing))
            .map_err(|why| no_home(format!("the card does not home axis {name}: {why:?}")))?;
        let settled = if self.manner.wall_time { OLD_NEWS } else { 2 };
        let mut stood = 0;
        while stood < settled {
            self.period()?;
            if self.stopped {
                let _ = self.card.send(HostCommand::rate(0));
            }
            stood = if self.card.status().at_rest { stood + 1 } else { 0 };
        }
        // The count was set: a path begins anew there.
        self.begin()?;
        Ok(if self.stopped { Done::Stopped } else { Done::Whole { cut_short: false } })
    }

    /// An axis by hand, within its soft limits; `wanted`: from the count where it stands, and what makes counts of mm.
    fn jog(&mut self, letter: char, wanted: impl Fn(i64, &dyn Fn(f64) -> i64) -> i64) -> Result<Done, NotDone> {
        let index = axis(self.machine, letter)?;
        let counts = self.card.status().counts;
        let from = counts[index];
        let of = |mm| self.machine.counts_of(index, mm);
        let [low, high] = self.machine.axes[index].travel_mm.map(of);
        let wanted = wanted(from, &of);
        let to = wanted.clamp(low.min(from), high.max(from));
        if to == from && wanted != from {
            let what = CommandError::BeyondLimit(letter).to_string();
            return Err(Refusal::new(
                "E2161",
                what,
                "the other way; home the axis where its position cannot be trusted",
            )
            .into());
        }
        let mut end = counts;
        end[index] = to;
        let executed = self.card.status().executed;
        let mut trip = Trip::begin(
            &mut self.hand,
            Request::Straight { from: counts, to: end },
            executed,
            self.enough,
            self.manner.wall_time,
        );
        let ended = loop {
            let ended =
                trip.turn(&mut self.hand, self.card).map_err(|fault| NotDone::Trouble(CardError::of(&fault)))?;
            if let Some(ended) = ended {
                break ended;
            }
            self.period()?;
            if self.stopped {
                trip.stop();
                self.stopped = false;
            }
        };
        let cut_short = to != wanted;
        self.tell_jogged(index, from, cut_short || ended == Ended::Stopped);
        // What is left of it is forgotten.
        self.begin()?;
        match ended {
            Ended::There => Ok(Done::Whole { cut_short }),
            Ended::Stopped => Ok(Done::Stopped),
            Ended::NotPlanned => Err(Refusal::new("E2161", "the move cannot be planned", "a shorter move").into()),
        }
    }

    fn clear(&mut self) -> Result<Done, NotDone> {
        let Some(alarm) = self.card.status().alarm else { return Ok(Done::Whole { cut_short: false }) };
        // What the card refuses shows below.
        let _ = self.card.send(HostCommand::ClearAlarm);
        for _ in 0..HEARD {
            if self.card.period().is_ok_and(|status| status.alarm.is_none()) {
                return Ok(Done::Whole { cut_short: false });
            }
        }
        Err(NotDone::Trouble(CardError::Latched(alarm)))
    }

    fn begin(&mut self) -> Result<(), NotDone> {
        anew(self.card).map_err(|fault| NotDone::Trouble(CardError::of(&fault)))
    }

    fn pass(&mut self, periods: u32) -> Result<Done, NotDone> {
        for _ in 0..periods {
            self.period()?;
        }
        Ok(Done::Whole { cut_short: false })
    }

    /// One control period: the operator's words, the card, and what is told.
    fn period(&mut self) -> Result<(), NotDone> {
        let period = self.card.status().period;
        while let Some(deed) = self.operators.next_word(period, 0) {
            self.tell(EventKind::Operator(deed));
            match deed {
                OperatorCommand::Stop | OperatorCommand::Hold | OperatorCommand::Pause => self.stopped = true,
                _ => self
                    .tell(EventKind::CommandRejected(CommandError::NotNow("an axis is moved by hand: stop it first"))),
            }
        }
        let status = *self.card.period().map_err(|fault| NotDone::Trouble(CardError::of(&fault)))?;
        self.teller.outputs(&status.outputs);
        self.teller.tell(Told::Period(Period { off_path: true, mode: Mode::Run, ..Period::of(&status) }));
        match status.alarm {
            Some(alarm) if status.at_rest => Err(self.alarm(alarm)),
            _ => Ok(()),
        }
    }

    fn alarm(&mut self, alarm: Alarm) -> NotDone {
        self.tell(EventKind::Alarm(CardError::Latched(alarm)));
        NotDone::Trouble(CardError::Latched(alarm))
    }

    fn tell_jogged(&mut self, index: usize, from: i64, cut_short: bool) {
        let axis = &self.machine.axes[index];
        let mm = (self.card.status().counts[index] - from) as f64 / axis.pulses_per_mm;
        let step = Step::Jogged { axis: axis.name, mm, cut_short, off: AxisCounts::default() };
        self.tell(EventKind::Dnc(Dnc { step, flags: Flags::default() }));
    }

    fn tell(&mut self, happening: EventKind) {
        let CardStatus { period, place, .. } = *self.card.status();
        let time_s = period as f64 * self.machine.period_s();
        self.teller.tell(Told::Event(Event { period, time_s, place, line: 0, kind: happening }));
    }
}

fn no_home(what: String) -> Refusal {
    Refusal::new("E2161", what, "name its switch in the machine file: `home` of the axis, and the input it is wired to")
}
