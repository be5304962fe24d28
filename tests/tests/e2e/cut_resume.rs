//! A cut whose host is killed: the resumed job continues it where it certainly ended, and the part is whole (CUT-46).

use std::process::Stdio;
use std::thread;
use std::time::Duration;

use retrace_tests::command::Bench;
use retrace_tests::cut_judge::{JudgedMachine, Verdict, judge_served};
use retrace_tests::cut_part::{self, MachineKind};
use retrace_tests::run::Run;
use retrace_tests::served::{ServedCard, resume_to_end};

/// Two cuts of 60 mm, 3 s each.
const PROGRAM: &str = "G21 G90 F1200\nG0 X10\nM3 S1\nG1 X70\nM5\nG0 X100\nM3\nG1 X160\nM5\nG0 X0\nM2\n";
const MACHINE: &str = "[[cutter]]\nname = \"torch\"\nkind = \"torch\"\nfire = 64\nok = { input = 5 }\n\
                       start = { start_s = 1.0, retry_s = 0.5, pierce_s = 0.4 }\n[card]\nwatchdog_ms = 2000\n";
const JUDGED: JudgedMachine = JudgedMachine {
    pulses_per_mm: 1000.0,
    fire: "spindle",
    input: 5,
    pierce_ms: 400.0,
    pilot_ms: 298.0,
    has_lead_ins: false,
};
/// Card time over wall time.
const SPEED: f64 = 4.0;

/// Kills the host at this card time, more or less, and resumes the job; returns what is wrong with the part.
fn killed_and_resumed(faults: &str, script: &str, at_s: f64) -> Result<(), String> {
    let bench = Bench::new();
    for (name, text) in [("part.ngc", PROGRAM), ("m.toml", MACHINE), ("s.op", script)] {
        bench.file(name, text);
    }
    let whole = bench.path("whole.vcd");
    let arguments = ["--machine", "m.toml", "--no-journal", "--vcd", "whole.vcd"];
    let _ = Run::of(&bench, std::path::Path::new("part.ngc"), &arguments);
    let vcd = bench.path("pins.vcd").display().to_string();
    let machine = bench.path("m.toml").display().to_string();
    let speed = SPEED.to_string();
    let card = ServedCard::with(&["--machine", &machine, "--source-faults", faults, "--vcd", &vcd, "--speed", &speed]);
    let run = ["run", "part.ngc", "--card", &card.port, "--machine", "m.toml", "--json", "--operator", "s.op"];
    let mut host = bench.start(&run, Stdio::null(), "killed.txt");
    thread::sleep(Duration::from_secs_f64(0.3 + at_s / SPEED));
    host.kill().expect("it is killed");
    host.wait().expect("it ends");
    let mut told = std::fs::read_to_string(bench.path("killed.txt")).unwrap_or_default();
    told += &resume_to_end(&bench).map_err(|why| format!("after {at_s} s\n{told}{why}"))?;
    let _ = card.end();
    let judged = JudgedMachine { has_lead_ins: script.contains("shift"), ..JUDGED };
    let verdict = judge_served(&whole, bench.path("pins.vcd"), &judged);
    if verdict.is_good() { Ok(()) } else { Err(format!("{verdict:?} after {at_s} s\n{told}")) }
}

#[test]
fn a_cut_goes_on_where_a_killed_host_left_it() {
    for at_s in [2.4, 3.1] {
        killed_and_resumed("", "", at_s).unwrap_or_else(|why| panic!("{why}"));
    }
}

/// Stopped in the cut by the operator; the summary says how the cut goes on, and so it does.
#[test]
fn a_job_that_was_stopped_in_a_cut_is_resumed_in_its_kerf() {
    let bench = Bench::new();
    for (name, text) in [("part.ngc", PROGRAM), ("m.toml", MACHINE), ("s.op", "at 2.5s stop\n")] {
        bench.file(name, text);
    }
    let stopped = bench.retrace(["run", "part.ngc", "--machine", "m.toml", "--operator", "s.op"]);
    assert_eq!(stopped.code, Some(4), "{}", stopped.err);
    let refused = bench.retrace(["resume"]);
    let told = format!("{}{}", refused.out, refused.err);
    assert!(told.contains("5 mm before the end of the kerf, where the torch starts in motion"), "{told}");
    let resumed = bench.retrace(["resume", "--yes", "--json"]);
    assert_eq!(resumed.code, Some(0), "{}", resumed.err);
    let events: Vec<&str> = resumed.out.lines().filter(|line| line.contains("cut_from_here")).collect();
    assert!(events.len() == 1 && events[0].contains("\"moving\""), "{}", resumed.out);
}

/// On the way to the shifted start, in its pierce and on the lead-in; the job is resumed on the path.
#[test]
fn a_lead_in_ends_with_a_killed_host_and_the_cut_is_resumed() {
    for at_s in [4.1, 4.5] {
        let shifted = "at 3s shift 1 4\nafter 0s recover\n";
        killed_and_resumed("lose@20", shifted, at_s).unwrap_or_else(|why| panic!("{why}"));
    }
}

/// On the way back, in the pilot arc, and beyond the end of the cut.
#[test]
fn a_recovery_goes_on_where_a_killed_host_left_it() {
    for at_s in [3.6, 4.0] {
        killed_and_resumed("lose@20", "at 3s recover\n", at_s).unwrap_or_else(|why| panic!("{why}"));
    }
}

/// The arc does not strike at the end of the contour, and the program switches the torch off: the cut is interrupted
/// all the same when the job is resumed.
#[test]
fn a_cut_is_resumed_whose_end_was_passed_without_an_arc() {
    // the second ignition of this seed strikes no arc
    killed_and_resumed("lose@59,no-start=0.4,seed=11", "at 5.5s recover\n", 8.5).unwrap_or_else(|why| panic!("{why}"));
}

/// The tool touches something in the cut, or the operator presses the emergency stop: the torch is off at once, the
/// axes brake on the path, nothing else moves, and the job goes on from there.
#[test]
fn a_cut_is_resumed_after_a_collision_and_after_an_emergency_stop() {
    let inputs = "[[card.input]]\nnumber = 13\nuse = \"emergency-stop\"\n";
    let machine = MACHINE.replace("fire = 64\n", "fire = 64\ncollision = [7]\n") + inputs;
    for (what, number) in [("breakaway", "E3027"), ("emergency-stop", "E3012")] {
        let bench = Bench::new();
        bench.file("part.ngc", PROGRAM);
        let file = bench.file("m.toml", &machine).display().to_string();
        let vcd = bench.path("pins.vcd").display().to_string();
        let _ = Run::of(
            &bench,
            std::path::Path::new("part.ngc"),
            &["--machine", "m.toml", "--no-journal", "--vcd", "whole.vcd"],
        );
        let speed = SPEED.to_string();
        let mut card = ServedCard::with(&["--machine", &file, "--vcd", &vcd, "--speed", &speed]);
        let run = ["run", "part.ngc", "--card", &card.port, "--machine", "m.toml", "--json"];
        let mut host = bench.start(&run, Stdio::null(), "stopped.txt");
        thread::sleep(Duration::from_secs_f64(0.3 + 2.5 / SPEED));
        card.operate(&format!("press {what}"));
        assert_eq!(host.wait().expect("it ends").code(), Some(3), "{what}");
        let told = std::fs::read_to_string(bench.path("stopped.txt")).unwrap_or_default();
        assert!(told.contains(number), "{told}");
        let blocked = bench.retrace(["resume", "--yes", "--json"]);
        let told_again = format!("{}{}", blocked.out, blocked.err);
        assert!(blocked.code != Some(0) && told_again.contains(number), "{what} is still active: {told_again}");
        card.operate(&format!("release {what}"));
        thread::sleep(Duration::from_millis(100));
        // A host that was kept from running for longer than the watchdog allows is resumed as well.
        let mut resumed = bench.retrace(["resume", "--yes", "--json"]);
        while resumed.code == Some(3) && resumed.out.contains("E3011") {
            resumed = bench.retrace(["resume", "--yes", "--json"]);
        }
        assert_eq!(resumed.code, Some(0), "{what}: {told}\n{}{}", resumed.out, resumed.err);
        let _ = card.end();
        let verdict = judge_served(bench.path("whole.vcd"), bench.path("pins.vcd"), &JUDGED);
        assert!(verdict.is_good(), "{what}: {verdict:?}");
    }
}

/// The power of the card and the host fails once the host has reported `told`; the journal ends where `durable` says,
/// from its text. The axes are homed again, and the job is resumed, which ends with each of the exit codes, with that
/// script. Returns what the last one printed, and the verdict on the part.
fn power_failed(
    (faults, first, resumes): (&str, &str, &[(i32, &str)]),
    (told, delay_ms): (&str, u64),
    durable: impl Fn(&str) -> usize,
) -> (String, Verdict) {
    let bench = Bench::new();
    let machine = cut_part::machine(MachineKind { senses: false, homes: true });
    for (name, text) in [("part.ngc", PROGRAM), ("m.toml", &machine), ("first.op", first)] {
        bench.file(name, text);
    }
    let whole = ["--machine", "m.toml", "--no-journal", "--vcd", "whole.vcd"];
    let _ = Run::of(&bench, std::path::Path::new("part.ngc"), &whole);
    let vcd = bench.path("pins.vcd").display().to_string();
    // A host that is late by 25 ms of the card's time behind M3 loses the cut: half as fast, that is seldom.
    let (file, speed) = (bench.path("m.toml").display().to_string(), (SPEED / 2.0).to_string());
    let card = ["--machine", &file, "--vcd", &vcd, "--speed", &speed, "--source-faults", faults];
    let mut card = ServedCard::with(&card);
    card.home(&bench).expect("it is homed");
    let run = ["run", "part.ngc", "--card", &card.port, "--machine", "m.toml", "--json", "--operator", "first.op"];
    let mut host = bench.start(&run, Stdio::null(), "killed.txt");
    while !std::fs::read_to_string(bench.path("killed.txt")).is_ok_and(|text| text.contains(told)) {
        let ended = host.try_wait().expect("a child");
        let so_far = || std::fs::read_to_string(bench.path("killed.txt")).unwrap_or_default();
        assert!(ended.is_none(), "it ends before {told}: {}", so_far());
        thread::sleep(Duration::from_millis(1));
    }
    thread::sleep(Duration::from_millis(2 * delay_ms));
    card.operate("power off");
    host.kill().expect("it is killed");
    host.wait().expect("it ends");
    let mut jobs = std::fs::read_dir(bench.path("state/retrace/jobs")).expect("a folder of jobs");
    let journal = jobs.next().expect("a job").expect("a job").path().join("journal");
    let text = std::fs::read_to_string(&journal).expect("a journal");
    std::fs::write(&journal, &text[..durable(&text)]).expect("a cut journal");
    card.operate("power on");
    thread::sleep(Duration::from_millis(100));
    card.home(&bench).expect("it is homed again");
    let mut out = String::new();
    for &(code, script) in resumes {
        bench.file("s.op", script);
        let resumed = bench.retrace(["resume", "--yes", "--json", "--operator", "s.op"]);
        assert_eq!(resumed.code, Some(code), "{script}: {}{}", resumed.out, resumed.err);
        out = resumed.out;
    }
    let _ = card.end();
    (out, judge_served(bench.path("whole.vcd"), bench.path("pins.vcd"), &cut_part::JUDGED))
}

/// The power fails soon after the pierce, and the end of the pierce is not in the journal: nobody knows whether the
/// sheet is pierced, or cut. The torch pierces again; over the kerf no arc strikes, and then it starts in motion.
#[test]
fn a_cut_is_resumed_whose_pierce_was_not_recorded_when_the_power_failed() {
    let before_end_of_pierce = |text: &str| {
        let is_end = |line: &&str| line.contains("\"M3\"") && line.contains("\"switched\"");
        text.lines().find(is_end).and_then(|line| text.find(line)).expect("the pierce is complete")
    };
    let resumes: &[_] = &[(0, "after 6s recover\nafter 6s recover\n")];
    let (out, verdict) = power_failed(("", "", resumes), ("\"cutting\"", 60), before_end_of_pierce);
    let (pierces, moves) = (out.find("not_started"), out.find("cut_continued"));
    assert!(pierces.is_some() && pierces < moves, "{out}");
    assert!(verdict.is_good(), "{verdict:?}\n{out}");
}

/// The arc is lost close to the end of its contour, the cut is continued to the end, and the journal lacks that: where
/// the torch passes to the end once more and no arc strikes, the job is held; the next pass takes the kerf to end
/// there, and the job goes on, also where it was resumed once more in between.
#[test]
fn a_cut_whose_last_bit_is_not_in_the_journal_does_not_hold_the_job_for_ever() {
    let behind_loss = |text: &str| {
        let lost = text.lines().find(|line| line.contains("\"cut_end\"")).expect("the loss is recorded");
        text.find(lost).expect("it is a part of it") + lost.len() + 1
    };
    let [held, goes_on] = [(4, "after 15s stop\n"), (0, "")];
    for resumes in [&[(0, "after 4s recover\nafter 4s recover\n")][..], &[held, goes_on]] {
        let what = ("lose@59.5", "at 8s recover\n", resumes);
        let (out, verdict) = power_failed(what, ("\"event\":\"contour\"", 0), behind_loss);
        let (lost, continued) = (out.find("\"reason\":\"lost\""), out.find("cut_continued"));
        assert!(continued.is_some() && (lost.is_none() || lost < continued), "{out}");
        assert_eq!(lost.is_some(), resumes.len() == 1, "{out}");
        assert_eq!(verdict.not_cut, 0, "{verdict:?}\n{out}");
    }
}
