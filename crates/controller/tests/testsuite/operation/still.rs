//! The motion path allocates nothing and frees nothing, whatever happens on it.
//!
//! Invariant: the count is of the motion path's own thread.

use allocation_counter::{AllocationInfo, measure};
use retrace_config::MachineConfig;
use retrace_controller::{JobStart, Observer, Outcome, Telemetry, run_job};
use retrace_core::RecordIndex;
use retrace_hal_sim::{Clock, PlantSettings, SimCard, SpindleSimulation};
use retrace_journal::JournalConfig;
use retrace_link::PathStart;

use super::jobs::{AXES, Decoder, card, machine, options};

struct Counted(u64);

impl Observer<AXES> for Counted {
    fn on_telemetry(&mut self, told: &Telemetry<AXES>) {
        self.0 += u64::from(matches!(told, Telemetry::Event(_)));
    }
}

/// Allocations of the caller's thread, which is the motion path's, in a whole job; and the number of events.
fn allocated(program: &str, script: &str) -> (AllocationInfo, u64) {
    let machine = machine(60.0);
    allocated_by(&machine, card(&machine), program, script)
}

fn allocated_by(machine: &MachineConfig, card: SimCard<AXES>, program: &str, script: &str) -> (AllocationInfo, u64) {
    let decoder = Decoder::new(program);
    let options = options(machine, script, JobStart::First, JournalConfig::default());
    let mut counted = Counted(0);
    let mut end = None;
    let info = measure(|| end = Some(run_job(machine, decoder, options, card, &mut counted).expect("a job")));
    assert_eq!(end.map(|end| end.outcome), Some(Outcome::Completed));
    (info, counted.0)
}

/// A program and a script with everything that can happen on the path, repeated.
fn eventful(times: usize) -> (String, String) {
    let mut program = String::from("G21 G64 P0.05 F3000\n");
    for k in 0..times {
        program += &format!(
            "M3 S{}\n(MSG, lap {k})\nG1 X{}\nM62 P2\nG1 Y5\nM63 P2\nM64 P1\nG1 X0\nM65 P1\nG4 P0.01\nM8\nG1 \
                Y0\nM9\nM5\n(MSG, done)\nM0\n",
            1000 + k,
            20 + k
        );
    }
    program += "M2\n";
    let once = "after 0.3s hold\nafter 0.3s resume\nafter 0.1s override 40%\nafter 0.2s override 150%\nafter 0.2s \
        override 100%\n\
        after 0.2s reverse 100%\nafter 0.2s output 5 on\nafter 0.1s back 1 mm\nafter 0.5s wheel -90 for 0.2s\nafter \
        0.2s wheel 80 for 2s\n\
        after 0.1s leave ask\nafter 1s agree\nafter 0.1s single\nafter 1s cycle start\nafter 0.2s single\nafter 0.5s \
        pause\n\
        after 0.5s spindle stop\nafter 0.1s jog x 1\nafter 0.5s spindle start\nafter 0.2s online\nafter 0.2s cycle \
        start\n\
        after 1s back to pierce\nafter 0.5s back to block\nafter 0.3s leave\nafter 0.3s cycle start\nafter 0.3s \
        resume\n";
    (program, once.repeat(times) + &"after 0.5s cycle start\n".repeat(60))
}

#[test]
fn what_a_job_allocates_does_not_depend_on_what_happens_in_it() {
    let (plain, few) = allocated("G21 F3000\nG1 X20\nM2\n", "at 0s override 100%\n");
    let (program, script) = eventful(12);
    let (eventful, many) = allocated(&program, &script);
    assert!(many > 500 && few < 10, "{few} {many}");
    let counts = |info: &AllocationInfo| (info.count_total, info.bytes_total, info.count_current);
    assert_eq!(counts(&eventful), counts(&plain), "allocations, bytes, and what was not freed");
}

/// Nor on how many threads there are, nor on how many of them are passed backward.
#[test]
fn threads_allocate_nothing() {
    let text = "[spindle]\ncounts_per_turn = 400\nmax_rpm = 3000\nthread_hold = \"spindle\"\n";
    let machine = MachineConfig::parse(text, "test").expect("valid");
    let allocated = |program: &str, script: &str| {
        let settings = machine.card_settings(PathStart::at(RecordIndex::new(0)));
        let spindle = SpindleSimulation { counts_per_turn: 400, ..SpindleSimulation::default() };
        let plant = PlantSettings { spindle: Some(spindle), ..PlantSettings::default() };
        let card = SimCard::with_machine(settings, &plant, Clock::Virtual).expect("it opens");
        allocated_by(&machine, card, program, script)
    };
    let thread = "G0 X1 Z5\nG33 Z-5 K1\n";
    let (plain, few) = allocated(&format!("G21 G90 S1000 M3\n{thread}G0 X5\nM5\nM2\n"), "at 0s override 100%\n");
    let program = format!("G21 G90 S1000 M3\n{}G4 P2\nG0 X5\nM5\nM2\n", thread.repeat(40));
    let script = "at 30s reverse 100%\n".to_owned() + &"after 5s reverse 100%\n".repeat(6) + "after 5s leave\n";
    let (many_threads, many) = allocated(&program, &script);
    assert!(many > few + 100, "{few} {many}");
    let counts = |info: &AllocationInfo| (info.count_total, info.bytes_total, info.count_current);
    assert_eq!(counts(&many_threads), counts(&plain), "allocations, bytes, and what was not freed");
}
