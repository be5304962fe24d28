//! A job: decoding and planning in one thread, the motion path in another, the ring between them.
//!
//! Invariant: the planning thread ends before [`run`] returns, whatever ended the job.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::thread;

use retrace_core::Record;
use retrace_core::ring::{Cell, Ring};
use retrace_core::size::ring_cells;
use retrace_gcode::Step;
use retrace_link::MotionCard;
use retrace_motion::Planner;

use crate::feed::Feeder;
use crate::item::{Ending, Summary};
use crate::machine::Machine;
use crate::overrides::overrides;
use crate::scan::Scan;
use crate::script::ScriptPlayer;
use crate::session::{Manner, Observer, Outcome, Session};
use crate::sink::Sink;
use crate::start::Skipped;
use crate::tally::Tally;
use crate::track::{Track, Untrackable};

/// A program as a source of canonical functions.
pub trait Decode {
    /// Decodes the next block and puts its steps behind those in `steps`.
    fn next_block(&mut self, steps: &mut Vec<Step>) -> Decoded;
}

/// What became of a block.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Decoded {
    /// Decoded; more may follow.
    Block,
    /// The program is at its end.
    End,
    /// The block has errors: rendered, with place, source line and remedy.
    Refused(String),
}

/// Items that may wait between the threads.
const ITEMS: usize = 1024;

/// With so many findings a program is not looked at any further.
const MOST_FINDINGS: usize = 100;

/// What is left of a job.
#[derive(Debug)]
pub struct JobEnd<C> {
    /// How it ended.
    pub outcome: Outcome,
    /// Where the time went.
    pub tally: Tally,
    /// What the program came to, where it came to its end.
    pub summary: Option<Summary>,
    /// The card, at rest.
    pub card: C,
}

/// Where in the program a job begins.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Begin {
    /// At its first block.
    #[default]
    First,
    /// At this line, with the state that the blocks before it leave.
    Line(u32),
}

/// Runs a program on a card that stands where the machine says.
///
/// # Errors
/// What keeps the job from being set up; nothing has moved then.
pub fn run<const A: usize, C: MotionCard<A>>(
    machine: &Machine,
    mut program: impl Decode + Send,
    begin: Begin,
    card: C,
    operator: ScriptPlayer,
    manner: Manner,
    observer: &mut dyn Observer<A>,
) -> Result<JobEnd<C>, String> {
    let (keep, look_ahead) = (machine.history_records, machine.look_ahead_records);
    let cells = ring_cells(keep, look_ahead).ok_or("the history is larger than any ring")?;
    let cells: Box<[Cell<Record<A>>]> = (0..cells).map(|_| Cell::default()).collect();
    let start = card.status().place.record;
    let mut ring = Ring::new(cells, keep, look_ahead, start).map_err(|e| format!("no ring: {e:?}"))?;
    let (producer, consumer) = ring.split();
    let (sender, receiver) = mpsc::sync_channel(ITEMS);
    let planner =
        Planner::new(machine.limits(), machine.start_mm()).map_err(|e| e.to_string())?.blending_by(machine.blending);
    let cancel = AtomicBool::new(false);
    let (asking, heeding) = overrides(look_ahead);
    let feeder = Feeder::new(planner, producer, sender, card.status().outputs, &cancel).heeding(heeding);
    Ok(thread::scope(|scope| {
        let planning = scope.spawn(move || plan(machine, &mut program, begin, feeder));
        let interest = Interest(&cancel);
        let session = Session::new(card, machine, consumer, receiver, operator, manner, observer).asking(asking);
        let (outcome, tally, card) = session.run();
        drop(interest);
        // A panic over there is a defect, never an input; it is passed on.
        let summary = planning.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        JobEnd { outcome, tally, summary, card }
    }))
}

/// The motion path's interest in what is planned; it ends with the session, however that ends.
struct Interest<'c>(&'c AtomicBool);

impl Drop for Interest<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// The planning thread: decodes block by block until the program, or the interest in it, ends.
fn plan<const A: usize>(
    machine: &Machine,
    program: &mut impl Decode,
    begin: Begin,
    mut feeder: Feeder<'_, A>,
) -> Option<Summary> {
    let mut track = Track::new(machine);
    let mut steps = Vec::new();
    let mut skipped = match begin {
        Begin::First => None,
        Begin::Line(line) => Some((line, Skipped::new(*feeder.outputs()))),
    };
    let (mut blocks, mut canonical) = (0, 0);
    let ending = loop {
        steps.clear();
        let decoded = program.next_block(&mut steps);
        match give(machine, &mut track, &steps, &mut skipped, &mut feeder) {
            Ok(()) => canonical += steps.len() as u64,
            Err((Untrackable::Cancelled, _)) => return None,
            Err((why, line)) => break Ending::Refused(format!("line {line}: {}", why.explain())),
        }
        match decoded {
            Decoded::Block => blocks += 1,
            Decoded::End => break Ending::Completed,
            Decoded::Refused(text) => break Ending::Refused(text),
        }
    };
    let commanded_mm = feeder.commanded_mm()[..machine.axes.len().min(A)].to_vec();
    let summary = Summary { ending, blocks, canonical, commanded_mm };
    feeder.end(summary.clone()).ok()?;
    Some(summary)
}

/// Gives steps to the feeder; those before the line to begin at are only remembered.
fn give<const A: usize>(
    machine: &Machine,
    track: &mut Track<'_>,
    steps: &[Step],
    skipped: &mut Option<(u32, Skipped)>,
    feeder: &mut Feeder<'_, A>,
) -> Result<(), (Untrackable, u32)> {
    for step in steps {
        if skipped.as_ref().is_some_and(|(line, _)| step.line >= *line)
            && let Some((line, before)) = skipped.take()
        {
            let tool_axis = machine.tool_axis();
            before.restore(feeder, track.position(), tool_axis, line).map_err(|why| (why.into(), line))?;
        }
        let result = match skipped {
            Some((_, before)) => track.run::<A>(&step.canon, step.line, before),
            None => track.run(&step.canon, step.line, feeder),
        };
        result.map_err(|why| (why, step.line))?;
    }
    Ok(())
}

/// What a scan found that cannot be run.
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    /// Program line.
    pub line: u32,
    /// The word that it is about, where there is one: its letter.
    pub word: Option<char>,
    /// Number in `docs/errors.md`.
    pub number: &'static str,
    /// What is wrong.
    pub what: String,
    /// What to do.
    pub remedy: String,
}

/// Goes through a whole program without moving anything: how many blocks it has, what of them cannot be run, and what the moves
/// came to.
///
/// The decoder's own errors are its own to tell; the scan goes on behind them.
pub fn scan<'m, const A: usize>(machine: &'m Machine, program: &mut impl Decode) -> (u64, Vec<Finding>, Scan<'m, A>) {
    let mut sink = Scan::new(machine);
    let (blocks, mut findings) = feed_all(machine, program, &mut sink);
    findings.extend(sink.beyond.iter().map(crate::scan::BeyondLimit::finding));
    findings.sort_by_key(|f| f.line);
    (blocks, findings, sink)
}

/// Gives all moves and switching of a program to `sink`: how many blocks it has, and what of them cannot be run.
pub fn feed_all<const A: usize>(
    machine: &Machine,
    program: &mut impl Decode,
    sink: &mut impl Sink<A>,
) -> (u64, Vec<Finding>) {
    feed_each(machine, program, sink, |_, _| ())
}

/// The same, with a look at the state behind each step.
pub fn feed_each<const A: usize, S: Sink<A>>(
    machine: &Machine,
    program: &mut impl Decode,
    sink: &mut S,
    mut look: impl FnMut(&Track<'_>, &mut S),
) -> (u64, Vec<Finding>) {
    let mut track = Track::new(machine);
    let (mut steps, mut findings, mut blocks) = (Vec::new(), Vec::new(), 0);
    loop {
        steps.clear();
        let decoded = program.next_block(&mut steps);
        for step in &steps {
            if let Err(why) = track.run(&step.canon, step.line, sink) {
                findings.push(why.finding(step.line));
            }
            look(&track, sink);
        }
        if decoded == Decoded::End || findings.len() >= MOST_FINDINGS {
            return (blocks, findings);
        }
        blocks += 1;
    }
}
