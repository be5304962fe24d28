//! The frame of a program, traced with the pointer (CUT-59).
//!
//! Invariant: the rectangle is compared with where the machine was while the torch was on in a run of the program.

use retrace_config::MachineConfig;
use retrace_controller::{
    CommandSources, CutFrame, FrameShape, JobOptions, JobStart, ManualTask, ManualTaskDone, ManualTaskError,
    ModalContext, Observer, PeriodRecord, RunMode, ScriptPlayer, Telemetry, check_program, interpreter_setup,
    parse_script, perform_manual_task, run_job,
};
use retrace_core::RecordIndex;
use retrace_hal_sim::{Clock, PlantSettings, Random, SimCard};
use retrace_journal::JournalConfig;
use retrace_link::{PathStart, channel};

use crate::wired::Decoder;

const PULSES_PER_MM: f64 = 200.0;
/// The pointer looks there, in mm from the tool.
const POINTER_MM: [f64; 2] = [80.0, -12.0];
const POINTER: u8 = 5;

fn machine(more: &str) -> MachineConfig {
    let axis = |name: &str, travel: &str| {
        format!(
            "[[axis]]\nname = \"{name}\"\npulses_per_mm = 200\nmax_velocity_mm_per_s = 100\n\
             max_acceleration_mm_per_s2 = 1000\nmax_jerk_mm_per_s3 = 20000\ntravel_mm = {travel}\n"
        )
    };
    let text = format!(
        "{more}retract_mm = -5\n{}{}{}[[cutter]]\nname = \"torch\"\nkind = \"torch\"\nfire = 64\n\
         [[cutter]]\nname = \"scribe\"\nkind = \"marker\"\nfire = 3\n\
         [manual]\npointer_mm = {{ x = 80, y = -12 }}\npointer_output = {POINTER}\n",
        axis("x", "[-50, 500]"),
        axis("y", "[-50, 400]"),
        axis("z", "[-60, 0]"),
    );
    MachineConfig::parse(&text, "m").expect("valid")
}

/// All periods, each with the outputs of torch, scribe and pointer.
#[derive(Default)]
struct Log {
    on: [bool; 3],
    periods: Vec<(PeriodRecord<4>, [bool; 3])>,
}

impl Observer<4> for Log {
    fn on_telemetry(&mut self, told: &Telemetry<4>) {
        match told {
            Telemetry::Period(period) => self.periods.push((*period, self.on)),
            Telemetry::Output(change) => {
                for (on, of) in self.on.iter_mut().zip([channel::SPINDLE, 3, POINTER]) {
                    *on = if change.channel == of { change.value != 0 } else { *on };
                }
            }
            Telemetry::Event(_) | Telemetry::Active(_) => {}
        }
    }
}

impl Log {
    /// Least and greatest counts of X and Y in the periods that `is_meant`, and in those before them.
    fn extremes(&self, is_meant: impl Fn(&[bool; 3]) -> bool) -> [[i64; 2]; 2] {
        let meant = self.periods.windows(2).filter(|pair| is_meant(&pair[1].1));
        meant.flatten().fold([[i64::MAX, i64::MIN]; 2], |ranges, (period, _)| {
            [0, 1].map(|axis| [ranges[axis][0].min(period.counts[axis]), ranges[axis][1].max(period.counts[axis])])
        })
    }
}

fn card(machine: &MachineConfig) -> SimCard<4> {
    let settings = machine.card_settings::<4>(PathStart::at(RecordIndex::new(0)));
    SimCard::with_machine(settings, &PlantSettings::default(), Clock::Virtual).expect("it opens")
}

const RUN_MODE: RunMode = RunMode { wall_time: false, operator: false, real_time: false };

fn commands(machine: &MachineConfig, script: &str) -> CommandSources {
    let script = parse_script(script, "script").expect("a script");
    CommandSources::from_script(ScriptPlayer::new(script, machine.period_us))
}

/// Runs the program.
fn cut(machine: &MachineConfig, program: &str) -> Log {
    let options = JobOptions {
        start: JobStart::First,
        commands: commands(machine, ""),
        run_mode: RUN_MODE,
        journal: JournalConfig::default(),
    };
    let mut log = Log::default();
    let decoder = Decoder::with_setup(program, interpreter_setup(machine));
    run_job(machine, decoder, options, card(machine), &mut log).expect("a job");
    log
}

fn frame(machine: &MachineConfig, program: &str) -> Result<CutFrame, String> {
    frame_of(machine, program, FrameShape::Rectangle)
}

fn frame_of(machine: &MachineConfig, program: &str, shape: FrameShape) -> Result<CutFrame, String> {
    let mut decoder = Decoder::with_setup(program, interpreter_setup(machine));
    let (.., found) = check_program::<4>(machine, &mut decoder);
    CutFrame::of_contours(machine, &found.contours, shape).map_err(|refusal| refusal.to_string())
}

/// Performs tasks, one after the other, on a card at rest. Returns what was seen, and the end of the last one.
fn perform(
    machine: &MachineConfig,
    tasks: &[ManualTask],
    script: &str,
) -> (Log, Result<ManualTaskDone, ManualTaskError>) {
    let (mut log, mut card) = (Log::default(), card(machine));
    let mut context = ModalContext::new(interpreter_setup(machine));
    let mut done = Ok(ManualTaskDone::Completed { cut_short: false });
    for task in tasks {
        let order = (commands(machine, script), RUN_MODE);
        done = perform_manual_task(task, machine, &mut context, &mut card, order, &mut log);
    }
    (log, done)
}

/// Random contours, with the work offset turned: the pointer goes round exactly what the torch cuts, high enough, and
/// nothing is lit.
#[test]
fn the_pointer_traces_the_extremes_of_what_is_cut() {
    let number = |name: &str| std::env::var(name).ok().and_then(|text| text.parse().ok());
    let (machine, mut chance) = (machine(""), Random::new(number("RETRACE_FIRST_SEED").unwrap_or(59)));
    for _ in 0..number("RETRACE_CASES").unwrap_or(20) {
        let mut mm = |most: u32| f64::from(chance.up_to(most * 10)) / 10.0;
        let (turn, x, y) = (mm(90), 165.0 + mm(60), 60.0 + mm(60));
        let (lead, radius, to) = (1.0 + mm(9), 5.0 + mm(25), mm(40));
        let program = format!(
            "G21 G90 G61 F3000\nG10 L2 P1 X{x} Y{y} R{turn}\nG0 X30 Y30\nM3\nG1 X[30 + {lead}]\nG1 Y[30 + {to}]\n\
             G3 X[30 + {lead}] Y[30 + {to} + 2 * {radius}] J{radius}\nM5\nG0 X70 Y-10\nG1 X75\nG0 X10 Y5\nM3\n\
             G1 Y[5 + {to}]\nM5\nG0 X0 Y0\nM2\n"
        );
        let cut = cut(&machine, &program).extremes(|on| on[0]);
        let frame = ManualTask::Frame(frame(&machine, &program).expect("a frame"));
        let down = ManualTask::Jog { axis: 'z', mm: -30.0 };
        let (log, done) = perform(&machine, &[down, frame], "");
        assert_eq!(done, Ok(ManualTaskDone::Completed { cut_short: false }));
        let traced = log.extremes(|on| on[2]);
        for axis in [0, 1] {
            let pointer = (POINTER_MM[axis] * PULSES_PER_MM) as i64;
            let [low, high] = traced[axis].map(|count| count + pointer);
            let off = [low - cut[axis][0], high - cut[axis][1]];
            assert!(off.iter().all(|off| off.abs() <= 1), "axis {axis}: {off:?} counts off, {program}");
        }
        for pair in log.periods.windows(2) {
            let ((before, _), (now, on)) = (&pair[0], &pair[1]);
            let moves = before.counts[..2] != now.counts[..2];
            assert!(!moves || now.counts[2] >= -1000, "it moves at {}: {program}", now.counts[2]);
            assert!(!on[0] && !on[1], "a cutter is on");
        }
        let (last, on) = log.periods.last().expect("periods");
        assert!(last.at_rest && !on[2], "the pointer is off behind it");
        // All four sides: the pointer is on at each corner.
        let corners = [[0, 0], [1, 0], [1, 1], [0, 1]].map(|turn| [0, 1].map(|axis| traced[axis][turn[axis]]));
        let visited = |corner: &[i64; 2]| log.periods.iter().any(|(period, on)| on[2] && period.counts[..2] == *corner);
        assert!(corners.iter().all(visited), "{corners:?}");
    }
}

/// A turned square and a circle: the outline is turned with them, goes round what the torch cuts, and nowhere far from
/// it.
#[test]
fn the_outline_follows_what_is_cut() {
    let machine = machine("");
    let program = "G21 G90 G61 F3000\nG10 L2 P1 X200 Y80 R30\nG0 X0 Y0\nM3\nG1 X120\nG1 Y80\nG1 X0\nG1 Y0\nM5\n\
        G0 X140 Y40\nM3\nG3 X140 Y40 I15 J0\nM5\nG0 X0 Y0\nM2\n";
    let cut = cut(&machine, program);
    let lit = cut.periods.windows(2).filter(|pair| pair[1].1[0]).flatten();
    let lit: Vec<[f64; 2]> = lit.map(|(period, _)| [0, 1].map(|axis| period.counts[axis] as f64)).collect();
    let frame = ManualTask::Frame(frame_of(&machine, program, FrameShape::Outline).expect("an outline"));
    let (log, done) = perform(&machine, &[frame], "");
    assert_eq!(done, Ok(ManualTaskDone::Completed { cut_short: false }));
    let traced = log.periods.iter().filter(|(_, on)| on[2]);
    let traced: Vec<[f64; 2]> = traced
        .map(|(period, _)| [0, 1].map(|axis| period.counts[axis] as f64 + POINTER_MM[axis] * PULSES_PER_MM))
        .collect();
    // Seen in many directions, both reach equally far: within 0.2 mm, which is 40 counts.
    for degree in 0..360 {
        let (sin, cos) = f64::from(degree).to_radians().sin_cos();
        let reach = |places: &[[f64; 2]]| places.iter().map(|[x, y]| x * cos + y * sin).fold(f64::MIN, f64::max);
        let off = reach(&traced) - reach(&lit);
        assert!((-41.0..=1.5).contains(&off), "{degree} degrees: {off} counts");
    }
}

/// What leaves the soft limits is refused with its side, before anything moves.
#[test]
fn a_frame_beyond_the_soft_limits_is_refused_with_the_side() {
    let machine = machine("");
    let program = |x: f64, y: f64| format!("G21 G90 F3000\nG0 X{x} Y{y}\nM3\nG1 X[{x} + 20]\nM5\nM2\n");
    for (at, told) in [
        ([490.0, 100.0], "cut at X 510.000 mm, 10.000 mm above the upper soft limit, 500.000 mm"),
        ([-55.0, 100.0], "cut at X -55.000 mm, 5.000 mm below the lower soft limit, -50.000 mm"),
        ([100.0, 402.5], "cut at Y 402.500 mm, 2.500 mm above the upper soft limit, 400.000 mm"),
    ] {
        let refusal = frame(&machine, &program(at[0], at[1])).expect_err(told);
        assert!(refusal.contains("E2161") && refusal.contains(told), "{refusal}");
    }
    for (at, told) in [
        ([10.0, 100.0], "the machine would move to X -70.000 mm, 20.000 mm below the lower soft limit"),
        ([100.0, 395.0], "the machine would move to Y 407.000 mm, 7.000 mm above the upper soft limit"),
    ] {
        let frame = ManualTask::Frame(frame(&machine, &program(at[0], at[1])).expect("the torch may go there"));
        let (log, done) = perform(&machine, &[frame], "");
        assert!(matches!(&done, Err(ManualTaskError::Numbered(why)) if why.cause.contains(told)), "{done:?}");
        assert!(log.periods.iter().all(|(period, on)| period.counts == [0; 4] && *on == [false; 3]));
    }
    let refusal = frame(&machine, "G21 G90 F3000\nG1 X100\nM2\n").expect_err("nothing is cut");
    assert!(refusal.contains("lights no cutter"), "{refusal}");
    let refusal = frame(&machine, "G21 G90 F3000\nM3\nG1 X[10 * #5399]\nM5\nM2\n");
    assert!(refusal.is_ok(), "a known value: {refusal:?}");
}

/// A hold ends it at rest with the pointer off; while a cutter is on it does not begin.
#[test]
fn a_frame_is_held_and_does_not_begin_with_a_cutter_on() {
    let machine = machine("");
    let program = "G21 G90 F3000\nG0 X200 Y100\nM3\nG1 X300\nG1 Y200\nM5\nM2\n";
    let frame = ManualTask::Frame(frame(&machine, program).expect("a frame"));
    let (log, done) = perform(&machine, std::slice::from_ref(&frame), "at 4s hold\n");
    assert_eq!(done, Ok(ManualTaskDone::Stopped));
    let (last, on) = log.periods.last().expect("periods");
    assert!(log.periods.iter().any(|(_, on)| on[2]) && last.at_rest && !on[2], "{last:?}");
    let (log, done) = perform(&machine, &[ManualTask::Output(3, 1), frame], "");
    assert!(matches!(&done, Err(ManualTaskError::Numbered(why)) if why.cause == "scribe is on"), "{done:?}");
    assert!(log.periods.iter().all(|(period, on)| period.counts == [0; 4] && !on[2]));
}
