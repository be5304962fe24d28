//! Motion and instructions stay in order for any delay of the serial line: our gates on the real host endpoint, line
//! and card; and the source's literal gates on the same, which fail (GMC-4 … GMC-6; *First defect*, *Second defect*).

use crate::wired;

use retrace_config::MachineConfig;
use retrace_core::gate::Gates;
use retrace_core::place::number_is_before;
use retrace_core::{Flags, Place, Rate, Record, RecordIndex};
use retrace_hal_sim::{CardSimulator, CardSimulatorSettings, InProcess, Random, SerialChannelSettings};
use retrace_link::{
    HostCommand, Instruction, LinkError, LinkTimeouts, LinkedCard, LinkedCardError, MotionCard, OutputChange,
    PathStart, channel,
};
use wired::{AXES, Path, Period, Trial, ended_well, in_order, pick, run, watched};

fn asked(usual: u64) -> (u64, u64) {
    let number = |name: &str| std::env::var(name).ok().and_then(|text| text.parse().ok());
    (number("RETRACE_CASES").unwrap_or(usual), number("RETRACE_FIRST_SEED").unwrap_or(1))
}

/// A path with stops, some of which have instructions behind them.
struct Tape {
    records: Vec<Record<AXES>>,
    /// Place and duration in periods of each instruction.
    markers: Vec<(u32, u32)>,
}

impl Tape {
    fn draw(random: &mut Random) -> Self {
        let (mut records, mut markers) = (Vec::new(), Vec::new());
        for _ in 0..1 + random.up_to(3) {
            let length = 1 + random.up_to(30);
            for k in 0..length {
                let flags = if k + 1 == length { Flags::REST.with(Flags::MARKER) } else { Flags::NONE };
                records.push(Record { increments: [2, -1, 0, 0], flags, line: 1, ..Record::default() });
            }
            for _ in 0..random.up_to(2) {
                markers.push((records.len() as u32, random.up_to(12)));
            }
        }
        Self { records, markers }
    }

    fn instruction(&self, number: u32) -> Instruction {
        let (place, periods) = self.markers[number as usize - 1];
        let mut instruction =
            Instruction { number, place: RecordIndex::new(place), periods, count: 1, ..Instruction::default() };
        instruction.changes[0] = OutputChange { channel: channel::SPINDLE, value: number as i32 };
        instruction
    }
}

/// The host's gates: whether a record may be sent, and whether the pending instruction may be sent.
trait Policy {
    /// Updates the policy from the card's status.
    fn look(&mut self, tape: &Tape, status: &retrace_link::CardStatus<AXES>);
    fn record_may_go(&self, place: u32) -> bool;
    /// The instruction that may be sent now.
    fn due(&self, status: &retrace_link::CardStatus<AXES>) -> Option<u32>;
    fn sent(&mut self);
}

/// Ready means acknowledged.
#[derive(Default)]
struct Acknowledged {
    gates: Gates,
    next: u32,
}

impl Policy for Acknowledged {
    fn look(&mut self, tape: &Tape, status: &retrace_link::CardStatus<AXES>) {
        if self.gates.acknowledge(status.executed).is_some() || self.next == 0 {
            self.next += 1;
        }
        if let Some(&(place, _)) = tape.markers.get(self.next as usize - 1) {
            self.gates.accept(self.next, RecordIndex::new(place));
        }
    }
    fn record_may_go(&self, place: u32) -> bool {
        self.gates.b_open(RecordIndex::new(place))
    }
    fn due(&self, status: &retrace_link::CardStatus<AXES>) -> Option<u32> {
        self.gates.c_open(status.place, status.at_rest).then_some(self.next)
    }
    fn sent(&mut self) {
        self.gates.mark_sent();
    }
}

/// The source's flags, as they are sampled: B1 closes at the front marker and opens at the end marker, C1 the other way
/// round; B2 and C2 are from the card's last report: no instruction is being executed, the motion is at rest.
#[derive(Default)]
struct Sampled {
    next: u32,
    marker: Option<u32>,
    /// B1; C1 is its opposite.
    b1: bool,
    /// B2, as last sampled.
    ready: bool,
}

impl Policy for Sampled {
    fn look(&mut self, tape: &Tape, status: &retrace_link::CardStatus<AXES>) {
        if self.next == 0 {
            (self.next, self.b1) = (1, true);
        }
        // The interface is ready unless the report shows an instruction begun and not complete.
        self.ready = status.outputs[usize::from(channel::SPINDLE)] == status.executed as i32;
        self.marker = tape.markers.get(self.next as usize - 1).map(|&(place, _)| place);
    }
    fn record_may_go(&self, place: u32) -> bool {
        // A front marker that is next closes B1; B = B1 and B2.
        self.marker.is_none_or(|marker| number_is_before(place, marker)) && self.b1 && self.ready
    }
    fn due(&self, status: &retrace_link::CardStatus<AXES>) -> Option<u32> {
        let marker = self.marker?;
        // Coarse interpolation has reached the marker (C1); fine interpolation has finished (C2); ready (B2).
        let at_marker = status.high == RecordIndex::new(marker);
        (at_marker && status.at_rest && self.ready).then_some(self.next)
    }
    fn sent(&mut self) {
        // The end marker: B1 opens, the coordinator's buffer is empty, the next may be sent.
        self.next += 1;
    }
}

/// Outcome of a tape.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum End {
    /// Everything is played and executed.
    Complete,
    /// The card had to reject an instruction, which is lost with that.
    Refused,
    Hangs,
}

/// Plays a tape with these gates. Returns what the card did, and the outcome.
fn play(tape: &Tape, policy: &mut impl Policy, rig: &CardSimulatorSettings) -> (Vec<Period>, End) {
    let machine = MachineConfig::built_in().expect("valid");
    let mut rig = CardSimulator::<AXES>::new(rig).expect("a card");
    let log = watched(&mut rig);
    let mut card = Box::new(LinkedCard::connect(InProcess::new(rig), 7, LinkTimeouts::default()).expect("it answers"));
    card.open(machine.card_settings(PathStart::at(RecordIndex::new(0)))).expect("it opens");
    card.send(HostCommand::rate(Rate::ONE)).expect("a rate");
    let end = tape.records.len() as u32;
    let mut ended = End::Hangs;
    for _ in 0..6_000 {
        let status = *card.status();
        policy.look(tape, &status);
        while let Some(&record) = tape.records.get(card.status().high.number() as usize) {
            let place = card.status().high;
            if !policy.record_may_go(place.number()) || card.send(HostCommand::Ahead { place, record }).is_err() {
                break;
            }
        }
        if let Some(number) = policy.due(&status)
            && card.send(HostCommand::Instruction(tape.instruction(number))).is_ok()
        {
            policy.sent();
        }
        if let Err(fault) = card.run_period() {
            assert!(matches!(fault, LinkedCardError::Host(LinkError::Refused(_))), "{fault}");
            ended = End::Refused;
            break;
        }
        let status = card.status();
        if status.place == Place::start_of(RecordIndex::new(end)) && status.executed as usize == tape.markers.len() {
            ended = End::Complete;
            break;
        }
    }
    let log = std::mem::take(&mut *log.lock().expect("one thread"));
    (log, ended)
}

fn delayed(random: &mut Random) -> SerialChannelSettings {
    let latency_us = pick(random, &[50, 500, 2_000, 8_000, 20_000]);
    SerialChannelSettings {
        baud: 1_000_000,
        latency_us,
        jitter_us: random.up_to(10_000),
        seed: random.next(),
        ..SerialChannelSettings::default()
    }
}

#[test]
fn no_motion_stands_on_the_wrong_side_of_an_instruction() {
    let (cases, first) = asked(150);
    let (mut literal_wrong, mut literal_refused) = (0, 0);
    for seed in first..first + cases {
        let mut random = Random::new(seed);
        let tape = Tape::draw(&mut random);
        let rig = CardSimulatorSettings {
            up: delayed(&mut random),
            down: delayed(&mut random),
            ..CardSimulatorSettings::default()
        };
        let markers: Vec<u32> = tape.markers.iter().map(|&(place, _)| place).collect();
        let (log, ended) = play(&tape, &mut Acknowledged::default(), &rig);
        if let Err(what) = in_order(&markers, &log) {
            panic!("seed {seed}: {what}");
        }
        assert_eq!(ended, End::Complete, "seed {seed}");
        // An instruction that arrives while another is executed, or too late, is rejected by the card: it is lost, and
        // the run ended.
        let (log, ended) = play(&tape, &mut Sampled::default(), &rig);
        match in_order(&markers, &log) {
            Err(_) => literal_wrong += 1,
            Ok(()) => literal_refused += u64::from(ended == End::Refused),
        }
    }
    println!(
        "{cases} runs in order; with the literal gates {literal_wrong} out of order, {literal_refused} with an \
            instruction lost"
    );
    assert!(literal_wrong > cases / 50 && literal_refused > cases / 20, "the literal gates are expected to fail");
}

/// Whole jobs in order: text, planner, motion path, and instructions of any duration.
#[test]
fn whole_jobs_stay_in_order_whatever_the_line_delays() {
    let cases = asked(20).0.min(500);
    for seed in 1..=cases {
        let mut random = Random::new(seed);
        let mut file = String::new();
        for code in ["M3", "M5", "M7", "M8", "M9"] {
            file += &format!("[code.{code}]\nduration_ms = {}\n", random.up_to(60));
        }
        let machine = MachineConfig::parse(&file, "m").expect("valid");
        let program = wired::program(&mut random, 10).replace("M62", "M64").replace("M63", "M65");
        let script = wired::script(&mut random);
        let path = Path::of(&machine, &program);
        let rig = CardSimulatorSettings {
            up: delayed(&mut random),
            down: delayed(&mut random),
            ..CardSimulatorSettings::default()
        };
        let done = run(Trial {
            machine: &machine,
            program: &program,
            script: &script,
            rig,
            pulled: Vec::new(),
            tapped: false,
        })
        .expect("opened");
        let ends = ended_well(&path, &done);
        assert!(done.completed() && ends.is_ok(), "seed {seed}: {:?} {ends:?}\n{program}\n{script}", done.outcome);
    }
}
