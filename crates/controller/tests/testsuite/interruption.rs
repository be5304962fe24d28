//! Every sequence of the operator's steps over the real session, compared with the order that is proved of
//! `core::interruption`.
//!
//! `RETRACE_WORDS` sets the length of the sequences; six are the campaign `dnc`.

use retrace_config::MachineConfig;
use retrace_controller::{
    BlockDecoder, CommandError, CommandSources, DecodedBlock, DncEvent, DncStep, Event, EventKind, JobOptions,
    JobStart, Observer, Outcome, RunMode, ScriptPlayer, Telemetry, parse_script, run_job,
};
use retrace_core::RecordIndex;
use retrace_core::interruption::{
    Breakpoint, Interruption, InterruptionAction, InterruptionError, InterruptionEvent, SpindleDirection, SpindleState,
};
use retrace_gcode::{CanonStep as Decodes, Program, Progress, Setup};
use retrace_hal_sim::{Clock, SimCard};
use retrace_journal::JournalConfig;
use retrace_link::MotionCard;

const AXES: usize = 3;
const PROGRAM: &str = "G21 G90 G64 P0.05\nS1000 M3\nG1 X60 F3000\nG1 Y5\nG1 X0\nM5\nM2\n";
const WORDS: [&str; 6] = ["pause", "spindle stop", "spindle start", "jog z 0.1", "online", "cycle start"];

struct Decoder(Program<&'static [u8]>);

impl BlockDecoder for Decoder {
    fn next_block(&mut self, steps: &mut Vec<Decodes>) -> DecodedBlock {
        match self.0.advance(steps) {
            Progress::End => DecodedBlock::End,
            Progress::BlockError => DecodedBlock::BlockError(format!("{:?}", self.0.interpreter().diagnostics())),
            Progress::Line => DecodedBlock::Block,
        }
    }
}

/// Results of the commands: done (with the latch, where it was a pause), or rejected.
#[derive(Default)]
struct Heard {
    events: Vec<Event>,
}

impl Observer<AXES> for Heard {
    fn on_telemetry(&mut self, told: &Telemetry<AXES>) {
        if let Telemetry::Event(event) = told {
            self.events.push(event.clone());
        }
    }
}

/// Counts at the end, and the events.
fn run(machine: &MachineConfig, script: &str) -> ([i64; AXES], Vec<Event>) {
    let mut heard = Heard::default();
    let card = SimCard::<AXES>::new(RecordIndex::new(0), machine.rate_limits().expect("checked"), Clock::Virtual)
        .expect("fits");
    let script = parse_script(script, "script").expect("known words");
    let operators = CommandSources::from_script(ScriptPlayer::new(script, machine.period_us));
    let run_mode = RunMode { wall_time: false, operator: true, real_time: false };
    let options =
        JobOptions { start: JobStart::First, commands: operators, run_mode, journal: JournalConfig::default() };
    let decoder = Decoder(Program::new(PROGRAM.as_bytes(), Setup::default()));
    let end = run_job(machine, decoder, options, card, &mut heard).expect("a job");
    assert!(matches!(end.outcome, Outcome::Completed | Outcome::Stopped), "{:?}", end.outcome);
    (end.card.status().counts, heard.events)
}

/// Results of the model for the same commands, each given when the machine is at rest again: accepted or rejected.
fn model(words: &[&str]) -> (Vec<Result<(), InterruptionError>>, bool) {
    let latch = Breakpoint {
        program: 0,
        counts: [0; AXES],
        spindle: Some(SpindleState { direction: SpindleDirection::Clockwise, speed: 1_000_000 }),
    };
    let mut order = Interruption::<AXES>::reading();
    let result = words.iter().map(|&word| {
        let effect = order.apply(match word {
            "pause" => InterruptionEvent::Pause(latch),
            "spindle stop" => InterruptionEvent::StopSpindle,
            "spindle start" => InterruptionEvent::StartSpindle(SpindleDirection::Clockwise),
            "online" => InterruptionEvent::Online,
            "cycle start" => InterruptionEvent::CycleStart { program: 0 },
            _ => InterruptionEvent::Jog,
        })?;
        if let InterruptionAction::Approach(to) = effect {
            order.apply(InterruptionEvent::Arrived(to))?;
        }
        Ok(())
    });
    let result = result.collect();
    (result, order.may_read())
}

/// Checks a sequence of commands, each some time after the one before. Returns whether the program was completed.
fn check(machine: &MachineConfig, words: &[&str], plain: [i64; AXES]) -> bool {
    let script =
        words.iter().fold("at 0.3s jog z 0.1\n".to_owned(), |script, word| script + &format!("after 0.25s {word}\n"));
    // Where nothing resumes the job, it ends without the wait for an operator.
    let (counts, events) = run(machine, &(script + "after 0.25s output 1 on\n"));
    let (result, reads) = model(words);
    let refused: Vec<&CommandError> = events
        .iter()
        .filter_map(|event| match &event.kind {
            EventKind::CommandRejected(why) => Some(why),
            _ => None,
        })
        .collect();
    // The jog before anything is paused, and what the model rejects. After a cycle start that is none of these steps, a
    // hold is required.
    let mut wanted = vec![CommandError::Interrupted(InterruptionError::NotPaused)];
    wanted.extend(words.iter().zip(&result).filter_map(|(word, result)| match result {
        Err(InterruptionError::NotPaused) if *word == "cycle start" => {
            Some(retrace_core::mode::ModeError::NotHeld.into())
        }
        Err(why) => Some(CommandError::Interrupted(*why)),
        Ok(()) => None,
    }));
    assert_eq!(refused, wanted.iter().collect::<Vec<_>>(), "{words:?}");
    let breakpoints: Vec<&Event> = events
        .iter()
        .filter(|e| matches!(e.kind, EventKind::Dnc(DncEvent { step: DncStep::Paused { .. }, .. })))
        .collect();
    let arrivals: Vec<&Event> =
        events.iter().filter(|e| matches!(e.kind, EventKind::Dnc(DncEvent { step: DncStep::Arrived, .. }))).collect();
    for arrival in &arrivals {
        let left = breakpoints.iter().rfind(|paused| paused.period < arrival.period).expect("paused before");
        assert_eq!(left.place, arrival.place, "{words:?}");
    }
    assert_eq!(counts == plain, reads, "{words:?}: it ends where it would have ended, if it ends");
    reads
}

/// All sequences of at most this length.
fn all(longest: usize) -> Vec<Vec<&'static str>> {
    let mut every: Vec<Vec<&str>> = vec![Vec::new()];
    let mut first = 0;
    for _ in 0..longest {
        let end = every.len();
        for at in first..end {
            for word in WORDS {
                let mut longer = every[at].clone();
                longer.push(word);
                every.push(longer);
            }
        }
        first = end;
    }
    every
}

#[test]
fn every_sequence_of_steps_is_taken_and_refused_as_the_order_says() {
    let longest = std::env::var("RETRACE_WORDS").ok().and_then(|text| text.parse().ok()).unwrap_or(3);
    let text = "history_hours = 0.001\nlook_ahead_s = 0.05\n";
    let machine = MachineConfig::parse(text, "m.toml").expect("valid");
    let (plain, _) = run(&machine, "");
    let gone_on = all(longest).iter().filter(|words| check(&machine, words, plain)).count();
    assert!(gone_on >= 6_usize.pow(longest as u32 / 2), "{gone_on}");
    let whole = ["pause", "spindle stop", "jog z 0.1", "spindle start", "online", "cycle start"];
    assert!(check(&machine, &whole, plain));
    let again = ["pause", "spindle stop", "spindle start", "online", "cycle start", "pause"];
    assert!(!check(&machine, &again, plain));
}
