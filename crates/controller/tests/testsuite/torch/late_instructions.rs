//! Instructions that reach the card late: the machine has been at rest for longer than the card leaves the torch on.
//!
//! Invariant: the card is the simulated one; only the delivery of instructions is delayed.

use retrace_controller::{JobStart, Outcome};
use retrace_hal_sim::SimCard;
use retrace_link::{CardStatus, CommandRefusal, HostCommand, Instruction, MotionCard, PathStart};

use super::{CutterState, FIRE, PROGRAM, Run, card, machine, run, run_part};

/// Control periods by which an instruction is late; the card leaves the torch on for 100.
const LATE: u32 = 150;

/// Delays the instructions of a kind.
struct LateLine {
    card: SimCard<4>,
    is_late: fn(&Instruction) -> bool,
    /// Number of instructions that are still to be delayed.
    delays: u32,
    /// The instruction on its way, and the control periods until it arrives.
    on_its_way: Option<(Instruction, u32)>,
    /// Times that each instruction finds no room on the line, and those that are left for the next one.
    full: [u32; 2],
}

impl MotionCard<4> for LateLine {
    type Fault = <SimCard<4> as MotionCard<4>>::Fault;

    fn window(&self) -> u32 {
        self.card.window()
    }
    fn send(&mut self, command: HostCommand<4>) -> Result<(), CommandRefusal> {
        match command {
            HostCommand::Instruction(instruction) if self.delays > 0 && (self.is_late)(&instruction) => {
                assert!(self.on_its_way.is_none());
                self.delays -= 1;
                self.on_its_way = Some((instruction, LATE));
                Ok(())
            }
            HostCommand::Instruction(_) if self.full[1] > 0 => {
                self.full[1] -= 1;
                Err(CommandRefusal::Full)
            }
            HostCommand::Instruction(_) => {
                self.full[1] = self.full[0];
                self.card.send(command)
            }
            command => self.card.send(command),
        }
    }
    fn run_period(&mut self) -> Result<&CardStatus<4>, Self::Fault> {
        self.on_its_way = match self.on_its_way {
            Some((instruction, 0)) => {
                self.card.send(HostCommand::Instruction(instruction)).expect("the card accepts it");
                None
            }
            other => other.map(|(instruction, periods)| (instruction, periods - 1)),
        };
        self.card.run_period()
    }
    fn begin_path(&mut self, start: PathStart) -> Result<(), Self::Fault> {
        self.on_its_way = None;
        self.card.begin_path(start)
    }
    fn status(&self) -> &CardStatus<4> {
        self.card.status()
    }
}

fn run_late(program: &str, (is_late, delays): (fn(&Instruction) -> bool, u32), script: &str) -> Run<LateLine> {
    let machine = machine();
    let card = LateLine { card: card(&machine, ""), is_late, delays, on_its_way: None, full: [0; 2] };
    run_part(&machine, program, script, JobStart::First, card)
}

fn switches_off(instruction: &Instruction) -> bool {
    instruction.changes().iter().any(|change| change.channel == FIRE && change.value == 0)
}

fn is_dwell(instruction: &Instruction) -> bool {
    instruction.changes().is_empty()
}

/// The card has switched the torch off where the cut ends: nothing is left to cut, and nothing is lit again.
#[test]
fn a_torch_that_goes_off_where_its_cut_ends_interrupts_nothing() {
    let whole = run(&machine(), PROGRAM, "", "");
    let job = run_late(PROGRAM, (switches_off, 2), "");
    job.assert_part_of(&whole);
    job.assert_safe();
    assert_eq!(job.ignitions(), whole.ignitions());
    assert_eq!((job.end.stats.cut_interruptions, job.contours()), (0, whole.contours()));
    assert!(job.states().iter().all(|&(state, _)| state != CutterState::Lost), "{:?}", job.states());
}

/// A dwell in the cut, before which the card has switched the torch off: the cut is interrupted.
#[test]
fn a_torch_that_goes_off_within_its_cut_is_lit_again_or_the_job_is_stopped() {
    let program = PROGRAM.replace("G1 X70\n", "G1 X40\nG4 P0.1\nG1 X70\n");
    let whole = run(&machine(), &program, "", "");
    let job = run_late(&program, (is_dwell, 1), "at 4s recover\n");
    job.assert_part_of(&whole);
    job.assert_safe();
    assert_eq!((job.end.stats.cut_interruptions, job.ignitions().len()), (1, 3));
    for script in ["at 4s stop\n", ""] {
        let stopped = run_late(&program, (is_dwell, 1), script);
        assert_eq!(stopped.end.outcome, Outcome::Stopped);
        stopped.assert_safe();
    }
}

/// What waits on the line because the computer was late leaves no room for an instruction: it is sent again, and is
/// executed once.
#[test]
fn an_instruction_that_finds_no_room_on_the_line_is_sent_in_a_later_period() {
    let whole = run(&machine(), PROGRAM, "", "");
    let machine = machine();
    for periods in [1, 40] {
        let card = LateLine {
            card: card(&machine, ""),
            is_late: switches_off,
            delays: 0,
            on_its_way: None,
            full: [periods; 2],
        };
        let job = run_part(&machine, PROGRAM, "", JobStart::First, card);
        assert_eq!(job.end.outcome, Outcome::Completed);
        job.assert_part_of(&whole);
        job.assert_safe();
        assert_eq!((job.ignitions(), job.contours()), (whole.ignitions(), whole.contours()));
    }
}
