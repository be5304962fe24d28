//! Streamed programs: what is executed of a stream that is cut off, and how it continues.

use retrace_tests::command::{Bench, CommandOutput};
use retrace_tests::run::Run;
use serde_json::Value;

const WHOLE: &str = "G21 G90 F3000\nM3 S1000\nG1 X5\nG0 Z10\nG1 X8\nM5\nM30\n";

fn report(result: &CommandOutput) -> Value {
    let last = result.out.lines().last().unwrap_or_default();
    serde_json::from_str(last).unwrap_or_else(|error| panic!("{error}: {}\n{}", result.out, result.err))
}

/// The only job in the journal of a bench.
fn job(bench: &Bench) -> String {
    let result = bench.retrace(["jobs", "--json"]);
    let jobs: Value = serde_json::from_str(&result.out).expect("one JSON object");
    jobs["jobs"][0]["id"].as_str().expect("a name").to_owned()
}

#[test]
fn nothing_is_executed_of_a_line_that_did_not_arrive_whole() {
    for (at, line) in [("G0 Z10", 4), ("G1 X8", 5), ("M5", 6), ("M30", 7)] {
        let begins = WHOLE.find(at).expect("a line");
        for bytes in 1..=at.len() {
            let sent = &WHOLE[..begins + bytes];
            if sent.ends_with("M30") {
                continue;
            }
            let bench = Bench::new();
            let run = Run::of_input(&bench, sent.as_bytes(), &[]);
            assert_eq!(run.output.code, Some(1), "{sent:?}: {}", run.output.err);
            assert!(
                run.output.err.contains("E1006") && run.output.err.contains(&format!(":{line}:")),
                "{}",
                run.output.err
            );
            assert_eq!(run.report["outcome"], "stopped", "{sent:?}");
            let [x, z] = [if line > 5 { 8_000 } else { 5_000 }, if line > 4 { 10_000 } else { 0 }];
            assert_eq!(run.counts(), [x, 0, z], "{sent:?}");
            let id = job(&bench);
            assert!(run.output.err.contains(&format!("retrace resume {id} --program")), "{}", run.output.err);
            let kept = bench.retrace(["jobs", "show", &id]);
            assert!(kept.out.contains("incomplete"), "{sent:?}: {}", kept.out);
        }
    }
}

/// A stream is checked as it is executed: the line that would leave the soft limits is not executed, nor anything
/// behind it.
#[test]
fn a_stream_never_leaves_the_soft_limits() {
    let bench = Bench::new();
    let moves = ["G1 X9999", "G0 X9999", "G2 I1990", "G91 G1 Y-2000.01"];
    for one in moves {
        let program = format!("G21 G90 F3000\nG64 P0.1\nG1 X30\n{one}\nG90 G1 X0\nM2\n");
        let result = bench.retrace_reading(["run", "-", "--json"], program.as_bytes());
        assert_eq!(result.code, Some(1), "{one}: {}\n{}", result.out, result.err);
        assert!(
            result.err.contains("line 4: error[E4304]") && result.err.contains("beyond its soft limit"),
            "{}",
            result.err
        );
        let report = report(&result);
        assert_eq!(
            (&report["position_counts"]["x"], &report["position_counts"]["y"]),
            (&30_000.into(), &0.into()),
            "{one}"
        );
    }
}

#[test]
fn a_last_line_that_is_exactly_the_program_end_needs_no_line_feed() {
    for end in ["M2", "M30", "%"] {
        let text = WHOLE.replace("M30\n", end);
        let text = if end == "%" { format!("%\n{text}") } else { text };
        let run = Run::of_input(&Bench::new(), text.as_bytes(), &[]);
        run.assert_exact_and_legal();
        assert_eq!(run.counts(), [8_000, 0, 10_000]);
    }
    let run = Run::of_input(&Bench::new(), WHOLE.replace("M30\n", "N7 M30").as_bytes(), &[]);
    assert_eq!(run.output.code, Some(1), "{}", run.output.err);
}

#[test]
fn a_stream_that_was_cut_off_continues_with_the_whole_program() {
    for sent in [WHOLE.find("0\nG1 X8").expect("in a line"), WHOLE.find("M5").expect("between lines")] {
        let bench = Bench::new();
        let run = Run::of_input(&bench, &WHOLE.as_bytes()[..sent], &[]);
        assert_eq!(run.output.code, Some(1), "{}", run.output.err);
        let result = bench.retrace(["resume", "--yes", "--json"]);
        assert_eq!(result.code, Some(2), "{}", result.err);
        assert!(result.err.contains("E2208") && result.err.contains("--program"), "{}", result.err);
        bench.file("other.ngc", WHOLE.replace("X5", "X6"));
        let result = bench.retrace(["resume", "--yes", "--json", "--program", "other.ngc"]);
        assert!(result.err.contains("E2208") && result.err.contains("differs in line 3"), "{}", result.err);
        // a file is whole, whether or not its last line is terminated
        bench.file("whole.ngc", WHOLE.trim_end());
        let result = bench.retrace(["resume", "--yes", "--json", "--program", "whole.ngc"]);
        assert_eq!(result.code, Some(0), "{}\n{}", result.out, result.err);
        let report = report(&result);
        assert_eq!((&report["outcome"], &report["limit_violations"]), (&"completed".into(), &0.into()));
        let counts = ["x", "y", "z"].map(|axis| report["position_counts"][axis].as_i64());
        assert_eq!(counts, [Some(8_000), Some(0), Some(10_000)]);
    }
}

/// An address of this computer that is not its loopback address; `None` where it has no network.
fn own_address() -> Option<String> {
    let socket = std::net::UdpSocket::bind("0.0.0.0:0").ok()?;
    // Nothing is sent: the system only chooses the address that it would send from.
    socket.connect("192.0.2.1:9").ok()?;
    let address = socket.local_addr().ok()?.ip();
    (!address.is_loopback() && !address.is_unspecified()).then(|| address.to_string())
}

#[test]
fn a_sender_on_the_network_is_warned_about_and_one_on_this_computer_is_not() {
    let listener = std::net::TcpListener::bind("0.0.0.0:0").expect("a port");
    let port = listener.local_addr().expect("bound").port();
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let _ = stream.map(|mut stream| std::io::Write::write_all(&mut stream, WHOLE.as_bytes()));
        }
    });
    let bench = Bench::new();
    let warning = "is on another computer: anyone who can send from there can move this machine";
    let here = bench.retrace(["run", &format!("tcp://{}:{port}", std::net::Ipv4Addr::LOCALHOST), "--json"]);
    assert!(here.code == Some(0) && !here.err.contains(warning), "{}", here.err);
    // Where there is no network no other computer can send.
    let Some(address) = own_address() else { return };
    let there = bench.retrace(["run", &format!("tcp://{address}:{port}"), "--json"]);
    assert!(there.code == Some(0) && there.err.contains(warning), "{}", there.err);
}
