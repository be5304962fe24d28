//! Errors that no other test provokes: each number occurs, from the command line. `tests/error-catalogue.md` lists the
//! test of every number.

use std::fs::{self, File};
use std::process::{Command, Stdio};

use retrace_tests::command::{Bench, CommandOutput, binary};

const PROGRAM: &str = "G21 F600\nG1 X100\nX0\nM2\n";

fn assert_number(result: &CommandOutput, code: i32, number: &str) {
    assert!(
        result.code == Some(code) && result.err.contains(&format!("[{number}]")),
        "{number}: {:?}\n{}",
        result.code,
        result.err
    );
}

#[test]
fn blocks_that_are_refused() {
    let programs = [
        ("E1713", "G18 F100\nG5.1 X1 Y1 I1 J1"),
        ("E1714", "F100\nG5 X1 Y1 Z1 I1 J1 P1 Q1"),
        ("E1716", "F100\nG5.3"),
        ("E1717", "F100\nG5.2 X1 Y1 P1 L3\nG5.3"),
        ("E1720", "G10 L1 P1 Q10"),
        ("E1721", "T1 M6\nG10 L0"),
        ("E1722", "M66 P0 E0 L0"),
        ("E1723", "M66 P0 L3 Q0"),
        ("E1725", "M72"),
        ("E1727", "G17.1 F100\nG2 X1 I1"),
        ("E1807", "O1 if [1]\nO1 endif\nO1 while [0]\nO1 endwhile"),
        ("E1808", "O1 sub\nO2 sub\nO2 endsub\nO1 endsub"),
        ("E1809", "O1 sub\nO1 endsub\nO1 sub\nO1 endsub"),
        ("E1810", "O1 sub\nO1 endsub\nM98 P1"),
        ("E1814", "G0 X1 M98 P1"),
        ("E1822", "CYCLE81(1,2"),
        ("E1824", "F100 S100 M3\nCYCLE95(\"NONE\",1,,,,1,1,1,1)"),
        ("E1825", "MCALL HOLES1(0,0,0,1,1,3)"),
    ];
    let bench = Bench::new();
    for (number, program) in programs {
        bench.file("wrong.ngc", format!("{program}\nM2\n"));
        assert_number(&bench.retrace(["check", "wrong.ngc"]), 1, number);
    }
}

#[test]
fn tables_and_files_beside_the_program() {
    let bench = Bench::new();
    bench.file("part.ngc", PROGRAM);
    bench.file("bad.tbl", "T1 P1 Q\n");
    let result = bench.retrace(["check", "part.ngc", "--tools", "bad.tbl"]);
    assert_number(&result, 2, "E1702");
    assert_number(&result, 2, "E2106");
    bench.file("bad.var", "5221 zero\n");
    assert_number(&bench.retrace(["check", "part.ngc", "--params", "bad.var"]), 2, "E1703");
    bench.file("call.ngc", "O<hole> call\nM2\n");
    bench.file("hole.ngc", "G0 X1\nM2\n");
    assert_number(&bench.retrace(["check", "call.ngc"]), 1, "E1813");
    // a folder with the name of a cycle
    fs::create_dir_all(bench.path("cycles/FOLDER.SPF")).expect("a folder of the test");
    assert_number(&bench.retrace(["cycles", "check", "--cycles", "cycles"]), 1, "E1934");
    let texts: String = (0..=1 << 16).map(|n| format!("MSG(\"{n}\")\n")).collect();
    fs::create_dir(bench.path("large")).expect("a folder of the test");
    bench.file("large/TEXTS.SPF", format!("PROC TEXTS\n{texts}"));
    assert_number(&bench.retrace(["cycles", "check", "--cycles", "large"]), 1, "E1929");
}

#[test]
#[cfg(unix)]
fn a_program_whose_reading_fails() {
    let folder = File::open("/").expect("a folder");
    let mut command = Command::new(binary());
    let output = command.args(["canon", "-"]).stdin(Stdio::from(folder)).output().expect("the command runs");
    let result = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(1) && result.contains("[E1011]"), "{result}");
}

#[test]
fn arguments_and_machine_files() {
    let bench = Bench::new();
    bench.file("part.ngc", PROGRAM);
    assert_number(&bench.retrace(["size", "--axes", "0"]), 2, "E2131");
    assert_number(&bench.retrace(["run", "part.ngc", "--start-line", "9"]), 2, "E2151");
    assert_number(&bench.retrace(["run", "part.ngc", "--card", "/dev/null", "--vcd", "pins.vcd"]), 2, "E2152");
    bench.file(
        "slow.toml",
        "control_period_ms = 0.1\n[wheel]\nfilter_ms = 10\n[[axis]]\nname = \"x\"\npulses_per_mm = 100\n\
         travel_mm = [0, 100]\nmax_velocity_mm_per_s = 1000\nmax_acceleration_mm_per_s2 = 1\nmax_jerk_mm_per_s3 = 1\n",
    );
    assert_number(&bench.retrace(["check", "part.ngc", "--machine", "slow.toml"]), 2, "E2113");
    let mut command = Command::new(binary());
    command.arg("jobs").env_remove("XDG_STATE_HOME").env_remove("HOME").env_remove("USERPROFILE");
    let output = command.output().expect("the command runs");
    let result = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(2) && result.contains("[E2201]"), "{result}");
}

/// CRC-32C, as `docs/journal.md` describes it.
fn crc32c(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |register, &byte| {
        (0..8).fold(register ^ u32::from(byte), |bits, _| bits >> 1 ^ if bits & 1 == 1 { 0x82F6_3B78 } else { 0 })
    })
}

/// Sets the number behind `key` in the first line of the journal that holds the key, and mends the line's checksum.
fn edit_journal(bench: &Bench, key: &str, number: u32) {
    let jobs = fs::read_dir(bench.path("state/retrace/jobs")).expect("jobs");
    let job = jobs.filter_map(Result::ok).map(|entry| entry.path()).find(|path| path.is_dir()).expect("a job");
    let path = job.join("journal");
    let text = fs::read_to_string(&path).expect("a journal");
    let line = text.lines().find(|line| line.contains(key)).expect("a line with the key");
    let (before, rest) = line[9..].split_once(key).expect("the key");
    let content = format!("{before}{key}{number}{}", rest.trim_start_matches(|digit: char| digit.is_ascii_digit()));
    let edited = format!("{:08x} {content}", crc32c(content.as_bytes()));
    fs::write(&path, text.replacen(line, &edited, 1)).expect("the journal is written");
}

/// A job that was stopped on its first move.
fn stopped_job() -> Bench {
    let bench = Bench::new();
    bench.file("part.ngc", PROGRAM);
    bench.file("stop.op", "at 2s stop\n");
    let result = bench.retrace(["run", "part.ngc", "--operator", "stop.op"]);
    assert_eq!(result.code, Some(4), "{}", result.err);
    bench
}

#[test]
fn journals_that_do_not_match() {
    let bench = stopped_job();
    assert_number(&bench.retrace(["resume", "--yes", "--card", "/dev/null"]), 2, "E2212");
    // the first mark of the journal
    edit_journal(&bench, "\"mark\":{\"place\":64,\"block\":", 9);
    assert_number(&bench.retrace(["resume", "--yes"]), 2, "E2216");
    edit_journal(&bench, "\"planner\":", 1);
    assert_number(&bench.retrace(["resume", "--yes"]), 2, "E2211");
}

#[test]
#[cfg(target_os = "linux")]
fn a_card_that_does_not_answer() {
    let bench = Bench::new();
    let (_quiet, port) = serialport::TTYPort::pair().expect("a pseudo-terminal");
    let path = serialport::SerialPort::name(&port).expect("a name");
    assert_number(&bench.retrace(["card", "identify", &path]), 3, "E3002");
}
