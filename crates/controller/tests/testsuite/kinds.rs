//! The machine files that `retrace machine new` writes, each with a small program of its trade, on a simulated machine
//! that is wired accordingly.
//!
//! Invariant: expected values are written here manually, from the machine files and the programs.

use retrace_config::MachineConfig;
use retrace_controller::{
    BlockDecoder, CommandSources, CutterOffReason, DecodedBlock, Event, EventKind, JobEnd, JobOptions, JobStart,
    Observer, Outcome, RunMode, ScriptPlayer, Telemetry, interpreter_setup, parse_script, run_job,
};
use retrace_core::RecordIndex;
use retrace_core::mode::Mode;
use retrace_gcode::{CanonStep, Program, Progress, Setup, Tool, ToolTable};
use retrace_hal_sim::{Clock, PlantSettings, Process, SimCard, SourceFaults, SourceSettings};
use retrace_journal::JournalConfig;
use retrace_link::{CutterOffCause, MotionCard, Outputs, PathStart, channel};

const WATERJET: &str = include_str!("../../../cli/src/machine/waterjet.toml");
const PLASMA: &str = include_str!("../../../cli/src/machine/plasma.toml");
const ROUTER: &str = include_str!("../../../cli/src/machine/router.toml");
const LATHE: &str = include_str!("../../../cli/src/machine/lathe.toml");

struct Decoder(Program<&'static [u8]>);

impl BlockDecoder for Decoder {
    fn next_block(&mut self, steps: &mut Vec<CanonStep>) -> DecodedBlock {
        match self.0.advance(steps) {
            Progress::Line => DecodedBlock::Block,
            Progress::End => DecodedBlock::End,
            Progress::BlockError => DecodedBlock::BlockError(format!("{:?}", self.0.interpreter().diagnostics())),
        }
    }
}

/// Mode and outputs of every period, and the events.
struct Seen {
    outputs: Outputs,
    periods: Vec<(Mode, Outputs)>,
    events: Vec<EventKind>,
}

impl Observer<4> for Seen {
    fn on_telemetry(&mut self, told: &Telemetry<4>) {
        match told {
            Telemetry::Period(period) => self.periods.push((period.mode, self.outputs)),
            Telemetry::Output(change) => self.outputs[usize::from(change.channel)] = change.value,
            Telemetry::Event(Event { kind, .. }) => self.events.push(kind.clone()),
            Telemetry::Active(_) => {}
        }
    }
}

/// Runs a program on a simulated machine that is wired as its file defines, with `processes` on it.
fn run(
    machine: &MachineConfig,
    program: &'static str,
    script: &str,
    processes: &[Process],
) -> (JobEnd<SimCard<4>>, Seen) {
    run_with_sources(machine, program, script, processes, &[])
}

/// As [`run`], with sources of cutters.
fn run_with_sources(
    machine: &MachineConfig,
    program: &'static str,
    script: &str,
    processes: &[Process],
    sources: &[SourceSettings],
) -> (JobEnd<SimCard<4>>, Seen) {
    let settings = machine.card_settings::<4>(PathStart::at(RecordIndex::new(0)));
    // the switches a little outside of the soft limits
    let ends = |axis: usize| machine.axes[axis].travel_mm.map(|mm| machine.counts_of(axis, mm * 1.01));
    let travel: Vec<[i64; 2]> =
        (0..machine.axes.len()).map(ends).map(|[low, high]| [low - 1000, high + 1000]).collect();
    let wired = PlantSettings {
        processes: processes.to_vec(),
        sources: sources.to_vec(),
        ..PlantSettings::wired_as(&settings.inputs, &travel, &[0; 4])
    };
    let card = SimCard::with_machine(settings, &wired, Clock::Virtual).expect("it opens");
    let mut tools = ToolTable::default();
    tools.insert(Tool { number: 1, ..Tool::default() });
    let program = Program::new(program.as_bytes(), Setup { tools, ..interpreter_setup(machine) });
    let script = parse_script(script, "script").expect("a script");
    let run_mode = RunMode { wall_time: false, operator: !script.is_empty(), real_time: false };
    let player = ScriptPlayer::new(script, machine.period_us);
    let mut seen = Seen { outputs: [0; channel::COUNT], periods: Vec::new(), events: Vec::new() };
    let operators = CommandSources::from_script(player);
    let options =
        JobOptions { start: JobStart::First, commands: operators, run_mode, journal: JournalConfig::default() };
    let end = run_job(machine, Decoder(program), options, card, &mut seen).expect("a job");
    (end, seen)
}

fn machine(text: &str) -> MachineConfig {
    MachineConfig::parse(text, "kind").expect("valid")
}

fn completed(text: &str, program: &'static str, processes: &[Process]) -> (JobEnd<SimCard<4>>, Seen) {
    let (end, seen) = run(&machine(text), program, "", processes);
    assert_eq!(end.outcome, Outcome::Completed);
    (end, seen)
}

#[test]
fn a_waterjet_pierces_cuts_and_lifts() {
    let program = "G0 Z5\nG0 X20 Y20\nM103\nM101\nG64 G1 X60 F1500\nY40\nM104\nX20\nM102\nG0 Z60\nM2\n";
    let (end, seen) = completed(WATERJET, program, &[]);
    assert_eq!(end.stats.switching, 1500 + 300 + 200);
    let jet = seen.periods.iter().filter(|(_, outputs)| outputs[3] == 1).count();
    let abrasive = seen.periods.iter().filter(|(_, outputs)| outputs[2] == 1).count();
    assert!(abrasive > 1000 && jet > 1500 && seen.periods.last().is_some_and(|(_, last)| last[3] == 0 && last[2] == 0));
    assert_eq!(end.card.status().counts, [4_000, 8_000, 48_000, 0]);
}

/// The arc takes 600 ms; the pierce begins with it.
#[test]
fn a_plasma_torch_waits_for_its_arc_and_is_started_again_where_none_comes() {
    let program = "G0 X10 Y10 Z4\nM3 S1\nG1 X30 F3000\nM5\nM2\n";
    let arc = SourceSettings {
        channel: channel::SPINDLE,
        input: 5,
        nm_per_pulse: [6250; 2],
        voltage: None,
        needs_metal: true,
        faults: SourceFaults { delay_us: [600_000; 2], ..SourceFaults::default() },
    };
    let (end, _) = run_with_sources(&machine(PLASMA), program, "", &[], std::slice::from_ref(&arc));
    assert_eq!(end.outcome, Outcome::Completed);
    // 600 ms until the arc, 10 ms until it counts, 400 ms of pierce, and some periods in which the card polls
    assert!((1010..=1025).contains(&end.stats.switching), "{}", end.stats.switching);
    let (end, seen) = run(&machine(PLASMA), program, "", &[]);
    assert_eq!(end.outcome, Outcome::Stopped, "nobody is there to try again");
    let not_started = CutterOffReason::Card(CutterOffCause::NotStarted);
    assert!(seen.events.contains(&EventKind::CutterOff { channel: channel::SPINDLE, reason: not_started }));
    let lit: Vec<bool> = seen.periods.iter().map(|(_, outputs)| outputs[64] != 0).collect();
    assert_eq!(lit.windows(2).filter(|pair| !pair[0] && pair[1]).count(), 3, "three attempts");
    assert!((14_980..=15_020).contains(&lit.iter().filter(|lit| **lit).count()), "of 5 s each");
    assert_eq!((end.card.status().counts[0], end.card.status().outputs[64]), (1_600, 0));
}

#[test]
fn a_router_spins_up_and_cools_in_passing() {
    let program = "T1 M6\nS12000 M3\nG64 G0 Z-1\nM8\nG1 X30 F1200\nY20\nM9\nX0\nM5\nG0 Z0\nM2\n";
    let (end, seen) = completed(ROUTER, program, &[]);
    // M6 and M2 stop the spindle too
    assert_eq!(end.stats.switching, 4000 + 3 * 3000);
    assert!(seen.periods.iter().any(|(_, outputs)| outputs[usize::from(channel::FLOOD)] == 1));
    assert_eq!(end.card.status().outputs[usize::from(channel::TOOL)], 1);
}

#[test]
fn a_lathe_turns_a_step() {
    let program = "G18 G7\nS800 M3\nG0 X60 Z100\nM8\nG1 X50 F400\nZ60\nX70\nM9\nG0 X200\nM5\nM2\n";
    let (end, _) = completed(LATHE, program, &[]);
    // M2 stops the spindle once more
    assert_eq!(end.stats.switching, 800 + 2500 + 2 * 3000);
    assert_eq!(end.card.status().counts, [100_000, 30_000, 0, 0]);
}

/// The behaviour of each code where reverse run passes it and outputs are replayed: "undone" is reversed with the path
/// and redone forward, "unchanged" stays, "barrier" ends reverse run.
#[test]
fn each_code_does_in_reverse_what_its_table_says() {
    let codes = "retrace_outputs = \"replayed\"\n\
        [code.M101]\noutput = 1\nin_reverse = \"undone\"\n\
        [code.M102]\noutput = 2\nin_reverse = \"unchanged\"\n\
        [code.M103]\noutput = 3\nclass = \"synchronous\"\nin_reverse = \"unchanged\"\n\
        [code.M104]\noutput = 4\nclass = \"synchronous\"\n\
        [code.M105]\noutput = 5\nin_reverse = \"barrier\"\n";
    let program = "G64 G1 X10 F3000\nM105\nX20\nM101\nX30\nM102\nX40\nM103\nX50\nM104\nX60\nX100\nM2\n";
    // all of reverse run to the barrier, and forward again
    let script = "at line 12 reverse 100%\nafter 6s leave\n";
    let (end, seen) = run(&machine(codes), program, script, &[]);
    assert_eq!(end.outcome, Outcome::Completed);
    assert!(
        seen.events.iter().any(|kind| matches!(kind, EventKind::RetraceBarrier { code: "M105", .. })),
        "{:?}",
        seen.events
    );
    let back = seen.periods.iter().rev().find(|(mode, _)| *mode == Mode::Reverse).expect("it went back").1;
    assert_eq!(back[1..=5], [0, 1, 1, 0, 1], "at the barrier");
    let forward = seen.periods.last().expect("there were some").1;
    assert_eq!(forward[1..=5], [1; 5], "at the end");
    let told =
        |code| seen.events.iter().filter(|kind| matches!(kind, EventKind::Switched(done) if *done == code)).count();
    assert_eq!((told("M101"), told("M102"), told("M105")), (1, 1, 1));
    let retraced = seen.events.iter().filter_map(|kind| match *kind {
        EventKind::RetraceSwitched(channel, value) => Some((channel, value)),
        _ => None,
    });
    assert_eq!(retraced.collect::<Vec<_>>(), [(4, 0), (1, 0), (1, 1), (4, 1)], "only where the path is retraced");
    let passing = seen.events.iter().filter(|kind| matches!(kind, EventKind::OutputChanged(..))).count();
    assert_eq!(passing, 2, "what an instruction has switched is not told again in passing");
    assert_eq!(end.stats.switch_events, 6, "with the M5 of M2");
}
