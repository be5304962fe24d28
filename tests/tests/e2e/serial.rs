//! Programs over RS-232, FIFOs and devices: correct data are executed, damage stops the job before its line.

use std::fs;
use std::io::{Read, Write};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use retrace_tests::command::{Bench, CommandOutput, binary};
use retrace_tests::pause::pause;
use serde_json::Value;
use serialport::{SerialPort, TTYPort};

/// A serial line between a sender and the command: a pseudo-terminal pair.
struct PtyLine {
    sender: TTYPort,
    /// Held open, so that the other end persists.
    _receiver: TTYPort,
    path: String,
}

impl PtyLine {
    fn new() -> Self {
        let (sender, receiver) = TTYPort::pair().expect("a pseudo-terminal");
        let path = receiver.name().expect("a name");
        Self { sender, _receiver: receiver, path }
    }
}

/// Result of a sender.
#[derive(Debug, Default)]
struct Sent {
    pauses: u32,
    /// Number of bytes that were sent although the other end had requested a pause.
    overran: usize,
}

/// Sends a tape: waits for DC1, obeys DC3 only after `overrun` more bytes, and ends when all is sent.
fn send(mut line: TTYPort, tape: Vec<u8>, overrun: usize, gap: Duration) -> thread::JoinHandle<(TTYPort, Sent)> {
    thread::spawn(move || {
        let (mut at, mut may_send, mut late, mut sent) = (0, false, 0, Sent::default());
        let begun = Instant::now();
        while at < tape.len() && begun.elapsed() < Duration::from_secs(50) {
            let mut codes = [0; 16];
            line.set_timeout(if may_send { Duration::ZERO } else { Duration::from_millis(5) }).expect("a line");
            let heard = line.read(&mut codes).unwrap_or(0);
            for code in &codes[..heard] {
                match code {
                    0x11 => (may_send, late) = (true, 0),
                    0x13 => (may_send, late, sent.pauses) = (false, overrun, sent.pauses + 1),
                    other => panic!("the sender was sent {other:02X}h"),
                }
            }
            if !may_send && late == 0 {
                continue;
            }
            let most = if may_send { 128 } else { late.min(128) };
            let end = tape.len().min(at + most);
            line.set_timeout(Duration::from_secs(20)).expect("a line");
            line.write_all(&tape[at..end]).expect("a line");
            if !may_send {
                late -= end - at;
                sent.overran += end - at;
            }
            at = end;
            thread::sleep(gap);
        }
        (line, sent)
    })
}

fn with_parity(byte: u8) -> u8 {
    if byte.count_ones().is_multiple_of(2) { byte } else { byte | 0x80 }
}

/// A tape in seven bits with even parity: leader, program, trailer.
fn tape(program: &str) -> Vec<u8> {
    let text = format!("\0\0\0\0part\0%\r\n{}%\r\n\0\0", program.replace('\n', "\r\n"));
    text.bytes().map(with_parity).collect()
}

fn program(lines: u32) -> String {
    let mut text = String::from("G21 G90 F6000\n");
    (0..lines).for_each(|n| text += &format!("G1 X{}.{:03} Y{} (line {n}, 50%)\n", n % 90, n % 1000, n % 7));
    text + "M30\n"
}

fn counts(result: &CommandOutput) -> (Value, [Option<i64>; 3]) {
    let last = result.out.lines().last().unwrap_or_default();
    let report: Value =
        serde_json::from_str(last).unwrap_or_else(|error| panic!("{error}: {}\n{}", result.out, result.err));
    let counts = ["x", "y", "z"].map(|axis| report["position_counts"][axis].as_i64());
    (report, counts)
}

#[test]
fn a_sender_that_overruns_by_4_kib_loses_nothing() {
    let (line, text, bench) = (PtyLine::new(), program(2000), Bench::new());
    let normalized = bench.file("same.ngc", format!("%\n{text}%\n"));
    let whole = bench.retrace(["canon", &normalized.to_string_lossy()]);
    let sender = send(line.sender, tape(&text), 4096, Duration::from_millis(5));
    let mut command = Command::new(binary());
    command.args(["canon", &format!("serial:{}?baud=9600&format=7e2", line.path)]);
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().expect("the command runs");
    let mut out = String::new();
    let mut pipe = child.stdout.take().expect("its output");
    // nothing reads the decoded data for a while: the line has to wait
    pause(Duration::from_secs(2));
    pipe.read_to_string(&mut out).expect("text");
    let output = child.wait_with_output().expect("it ends");
    let (_line, sent) = sender.join().expect("it sends");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(out == whole.out && whole.code == Some(0), "{} and {} bytes", out.len(), whole.out.len());
    assert!(sent.pauses > 0 && sent.overran >= 4096, "{sent:?}");
}

#[test]
fn damage_stops_before_its_line_and_the_whole_program_goes_on() {
    let (line, bench) = (PtyLine::new(), Bench::new());
    let text = "G21 G90 F3000\nG1 X5\nG1 X7 Y2\nG1 X9\nM30\n";
    let mut tape = tape(text);
    // a bit of the 7 in the fourth line, counted from the percent sign
    let at = tape.iter().position(|&byte| byte & 0x7F == b'7').expect("there");
    tape[at] ^= 0x08;
    bench.file("m.toml", "[serial]\nbaud = 9600\nbits = 7\nparity = \"even\"\nstop = 2\n");
    let sender = send(line.sender, tape, 0, Duration::from_millis(20));
    let result = bench.retrace(["run", &format!("serial:{}", line.path), "--machine", "m.toml", "--json"]);
    sender.join().expect("it sends");
    assert_eq!(result.code, Some(1), "{}", result.err);
    assert!(result.err.contains("E2305") && result.err.contains(":4:"), "{}", result.err);
    assert_eq!(counts(&result).1, [Some(5000), Some(0), Some(0)]);
    bench.file("whole.ngc", format!("%\n{text}%\n"));
    let result = bench.retrace(["resume", "--yes", "--json", "--program", "whole.ngc"]);
    assert_eq!(result.code, Some(0), "{}\n{}", result.out, result.err);
    assert_eq!(counts(&result).1, [Some(9000), Some(2000), Some(0)]);
}

#[test]
fn a_sender_that_does_not_begin_or_falls_silent_is_reported() {
    let (line, bench) = (PtyLine::new(), Bench::new());
    let result = bench.retrace(["run", &format!("serial:{}?start_timeout_s=1", line.path), "--json"]);
    assert!(result.code == Some(1) && result.err.contains("E2303"), "{}", result.err);
    let sender = send(line.sender, with_silence(), 0, Duration::ZERO);
    let result = bench.retrace(["run", &format!("serial:{}?silence_timeout_s=2", line.path), "--json"]);
    sender.join().expect("it sends");
    assert!(result.code == Some(1) && result.err.contains("E2304"), "{}", result.err);
    assert_eq!(counts(&result).1, [Some(5000), Some(0), Some(0)]);
    let waiting = result.out.lines().find(|line| line.contains("stream_stalled")).expect("an event");
    let waiting: Value = serde_json::from_str(waiting).expect("JSON");
    assert!(waiting["source"].as_str().is_some_and(|source| source.contains(&line.path)), "{waiting}");
    assert!(waiting["since"].as_str().is_some_and(|since| since.contains('T')), "{waiting}");
}

/// A tape whose sender stops inside a line.
fn with_silence() -> Vec<u8> {
    tape("G21 G90 F3000\nG1 X5\nG1 X70\n").into_iter().take_while(|&byte| byte & 0x7F != b'7').collect()
}

#[test]
fn settings_that_are_not_known_are_refused_before_anything_is_opened() {
    let bench = Bench::new();
    for bad in ["serial:/dev/ttyNONE?boud=9600", "serial:", "serial:/dev/ttyNONE?format=9n1"] {
        let result = bench.retrace(["run", bad]);
        assert!(result.code == Some(2) && result.err.contains("E2301"), "{bad}: {}", result.err);
    }
    let result = bench.retrace(["run", "serial:/dev/ttyNONE"]);
    assert!(result.code == Some(2) && result.err.contains("E2141"), "{}", result.err);
    bench.file("m.toml", "[serial]\nbaud = 10\n");
    let result = bench.retrace(["run", "serial:/dev/ttyNONE", "--machine", "m.toml"]);
    assert!(result.code == Some(2) && result.err.contains("serial.baud"), "{}", result.err);
}

#[test]
fn a_fifo_is_a_stream_and_shows_that_it_waits() {
    let _ = binary();
    let bench = Bench::new();
    let fifo = bench.path("program.fifo");
    assert!(Command::new("mkfifo").arg(&fifo).status().expect("mkfifo").success());
    let written = Arc::new(AtomicBool::new(false));
    let writer = thread::spawn({
        let (fifo, written) = (fifo.clone(), Arc::clone(&written));
        move || {
            pause(Duration::from_millis(2500));
            let mut file = fs::File::options().write(true).open(fifo).expect("somebody reads");
            file.write_all(b"G21 G90 F3000\nG1 X5\nM2\n").expect("it is taken");
            written.store(true, Ordering::Relaxed);
        }
    });
    let result = bench.retrace(["run", &fifo.to_string_lossy(), "--json"]);
    writer.join().expect("it writes");
    assert!(written.load(Ordering::Relaxed));
    assert_eq!((result.code, counts(&result).1), (Some(0), [Some(5000), Some(0), Some(0)]), "{}", result.err);
    for event in ["stream_stalled", "stream_resumed"] {
        assert!(result.out.contains(event), "{event}: {}", result.out);
    }
    // a character device is a stream too: one that is empty, and one without end
    let result = bench.retrace(["run", "/dev/null"]);
    assert!(result.code == Some(1) && result.err.contains("E1007"), "{}", result.err);
    let result = bench.retrace(["run", "/dev/zero"]);
    assert!(result.code == Some(1) && result.err.contains("E2311"), "{}", result.err);
}

#[test]
fn a_tape_that_cannot_be_read_is_refused_by_its_number() {
    // a sender that begins when it likes, and never pauses
    let read = |tape: Vec<u8>, settings: &str| {
        let (line, bench) = (PtyLine::new(), Bench::new());
        let mut sender = line.sender;
        let sent = thread::spawn(move || {
            pause(Duration::from_millis(500));
            sender.set_timeout(Duration::from_secs(3)).expect("a line");
            // What is behind the error is not read any more. A small piece does not block where a line has room at all.
            let _ = tape.chunks(64).try_for_each(|piece| sender.write_all(piece));
            sender
        });
        let result = bench.retrace(["run", &format!("serial:{}?{settings}", line.path)]);
        sent.join().expect("it sends");
        assert_eq!(result.code, Some(1), "{}", result.err);
        result.err
    };
    // an end of block, and a code that EIA RS-244 does not have
    let result = read(vec![0x80, 0x80, 0x0E, 0x80], "code=eia");
    assert!(result.contains("E2307"), "{result}");
    let result = read(vec![b'x'; 70_000], "format=8n1");
    assert!(result.contains("E2308"), "{result}");
}

#[test]
fn with_rts_and_cts_no_code_is_sent_over_the_line() {
    let (line, bench) = (PtyLine::new(), Bench::new());
    let (mut sender, tape) = (line.sender, tape("G21 G90 F3000\nG1 X5\nM30\n"));
    let sent = thread::spawn(move || {
        pause(Duration::from_millis(500));
        sender.write_all(&tape).expect("a line");
        sender.set_timeout(Duration::from_millis(1500)).expect("a line");
        let mut codes = [0; 16];
        let heard = sender.read(&mut codes).unwrap_or(0);
        codes[..heard].to_vec()
    });
    let result = bench.retrace(["run", &format!("serial:{}?format=7e2&handshake=rts-cts", line.path), "--json"]);
    assert_eq!((result.code, counts(&result).1), (Some(0), [Some(5000), Some(0), Some(0)]), "{}", result.err);
    assert_eq!(sent.join().expect("it sends"), Vec::<u8>::new(), "neither DC1 nor DC3");
}

/// Memory of an old control, and the part of it that is left when it pauses the sender.
const MEMORY: usize = 4096;
const MEMORY_LEFT: usize = 1024;

/// An old control: it asks by DC1, pauses the sender by DC3 when its memory of 4 KiB is three quarters full, and reads
/// slowly. Returns everything that it has received, and the largest number of bytes that came behind its DC3, without
/// those that had waited in this computer before it. A sender that has sent nearly all by then is not paused any more.
fn old_control(mut line: TTYPort, expected: usize, parity_of_codes: u8) -> thread::JoinHandle<(Vec<u8>, usize, u32)> {
    thread::spawn(move || {
        let (mut received, mut memory, mut behind, mut worst, mut pauses) = (Vec::new(), 0_usize, 0, 0, 0);
        let (mut is_paused, mut late, begun) = (false, 0, Instant::now());
        line.set_timeout(Duration::from_millis(5)).expect("a line");
        while received.len() < expected && begun.elapsed() < Duration::from_secs(50) {
            let mut bytes = [0; 64];
            let count = line.read(&mut bytes).unwrap_or(0);
            // what it asks before the port is opened is lost
            if received.is_empty() && count == 0 {
                line.write_all(&[0x11 | parity_of_codes]).expect("a line");
            }
            received.extend_from_slice(&bytes[..count]);
            memory += count;
            assert!(memory - late.min(memory) <= MEMORY, "the memory of the control overflows");
            if is_paused {
                behind += count;
                worst = worst.max(behind.saturating_sub(late));
            }
            // it works off its blocks while it is paused, and slowly otherwise
            memory = memory.saturating_sub(if is_paused { 200 } else { count / 4 });
            let waiting = line.bytes_to_read().expect("a line") as usize;
            if !is_paused && memory > MEMORY - MEMORY_LEFT && received.len() + waiting + MEMORY_LEFT < expected {
                line.write_all(&[0x13 | parity_of_codes]).expect("a line");
                (is_paused, behind, pauses) = (true, 0, pauses + 1);
                late = waiting;
            } else if is_paused && memory < 1024 {
                line.write_all(&[0x11 | parity_of_codes]).expect("a line");
                (is_paused, late) = (false, 0);
            }
        }
        (received, worst, pauses)
    })
}

#[test]
fn an_old_control_gets_every_character_and_is_obeyed_when_it_pauses() {
    for (format, code, is_eia) in [("7e2", "iso", false), ("8n1", "eia", true)] {
        let (line, bench) = (PtyLine::new(), Bench::new());
        let blocks: String = (0..1400).map(|n| format!("G1X{}.{:03}Y{}\n", n % 90, n % 1000, n % 7)).collect();
        let text = format!("%\n{blocks}M30\n%\n");
        let program = bench.file("part.ngc", &text);
        let encoded: Vec<u8> = match is_eia {
            false => text.bytes().map(with_parity).collect(),
            true => text.bytes().map(eia).collect(),
        };
        let expected = [vec![0; 10], encoded, vec![0; 10]].concat();
        let control = old_control(line.sender, expected.len(), 0);
        let to = format!("serial:{}?baud=115200&format={format}&code={code}&leader=10", line.path);
        let sent = bench.retrace(["send", &program.to_string_lossy(), "--to", &to]);
        let (received, worst, pauses) = control.join().expect("it received");
        assert_eq!(sent.code, Some(0), "{}\n{}", sent.out, sent.err);
        assert!(received == expected, "{} of {} bytes", received.len(), expected.len());
        assert!(pauses >= 2, "{pauses} pauses");
        assert!(sent.out.contains(&format!("paused {pauses} times")), "{}", sent.out);
        // what is on its way, and what this computer is late by
        assert!(worst < 256, "{worst} bytes behind a pause");
    }
}

/// A character in EIA RS-244, by the table of the requirement.
fn eia(character: u8) -> u8 {
    match character {
        b'0' => 0x20,
        b'1' => 0x01,
        b'2' => 0x02,
        b'3' => 0x13,
        b'4' => 0x04,
        b'5' => 0x15,
        b'6' => 0x16,
        b'7' => 0x07,
        b'8' => 0x08,
        b'9' => 0x19,
        b'G' => 0x67,
        b'M' => 0x54,
        b'X' => 0x37,
        b'Y' => 0x38,
        b'.' => 0x6B,
        b'%' => 0x0B,
        b'\n' => 0x80,
        other => panic!("{other:02X}h"),
    }
}

#[test]
fn a_control_that_does_not_ask_gets_nothing_and_what_it_cannot_read_is_not_sent() {
    let (mut line, bench) = (PtyLine::new(), Bench::new());
    let program = bench.file("part.ngc", "G0 X1\n#1 = [2 + 3]\nM30\n");
    let program = program.to_string_lossy();
    let to = |more: &str| format!("serial:{}?baud=9600&format=7e2{more}", line.path);
    let mute = bench.retrace(["send", &program, "--to", &to("&start_timeout_s=0.3")]);
    assert!(mute.code == Some(2) && mute.err.contains("error[E5042]"), "{}", mute.err);
    let eia = bench.retrace(["send", &program, "--to", &to("&code=eia")]);
    assert!(eia.code == Some(2) && eia.err.contains("error[E5041]") && eia.err.contains("line 2"), "{}", eia.err);
    line.sender.set_timeout(Duration::from_millis(50)).expect("a line");
    assert_eq!(line.sender.read(&mut [0; 16]).unwrap_or(0), 0, "nothing was sent");
    let now = bench.retrace(["send", &program, "--now", "--to", &to("&leader=0")]);
    assert_eq!(now.code, Some(0), "{}", now.err);
    let mut bytes = vec![0; 40];
    let count = line.sender.read(&mut bytes).expect("it was sent");
    assert_eq!(bytes[..2], [with_parity(b'%'), with_parity(b'\n')], "{count} bytes");
}

/// A job of an old machine: its pieces are sent, and count by the operator's word alone. A control that does not ask
/// has got no piece, and without a word on the last piece no other one is sent.
#[test]
fn a_piece_that_was_sent_counts_by_the_word_of_the_operator() {
    let (line, bench) = (PtyLine::new(), Bench::new());
    bench.file("old.toml", "name = \"old\"\nroot = \"data\"\n");
    let text = "%\nG0X1\nM30\n%\n";
    bench.file("part.ngc", text);
    let shop = |arguments: &[&str]| bench.retrace([&["shop"], arguments, &["--shop-file", "old.toml"]].concat());
    let submitted = shop(&["submit", "part.ngc", "--quantity", "2"]);
    let id = submitted.out.trim().to_owned();
    assert_eq!(shop(&["agent", "--once"]).code, Some(0));
    let to = |more: &str| format!("serial:{}?baud=9600&format=7e2&leader=0{more}", line.path);
    let send = |more: &str| bench.retrace(["send", "--job", &id, "--shop-file", "old.toml", "--to", &to(more)]);
    let shown = || -> Value { serde_json::from_str(&shop(&["show", &id, "--json"]).out).expect("one object") };
    let state = || {
        let job = shown();
        (job["state"].as_str().expect("a state").to_owned(), job["good"].as_u64(), job["runs"].as_array().map(Vec::len))
    };
    let is = |state: &str, good, runs| (state.to_owned(), Some(good), Some(runs));
    let mute = send("&start_timeout_s=0.3");
    assert!(mute.code == Some(2) && mute.err.contains("error[E5042]"), "{}", mute.err);
    assert_eq!(state(), is("ready", 0, 0));
    let mut sender = line.sender;
    let mut sent = |runs: usize| {
        let control = old_control(sender.try_clone_native().expect("a line"), text.len(), 0);
        let done = send("");
        let (received, ..) = control.join().expect("it received");
        assert_eq!(received, text.bytes().map(with_parity).collect::<Vec<_>>());
        assert!(done.code == Some(0) && done.out.contains("retrace shop good"), "{}{}", done.out, done.err);
        let _ = sender.flush();
        shown()["runs"][runs - 1]["id"].as_str().expect("a name").to_owned()
    };
    let first = sent(1);
    assert_eq!(state(), is("unknown", 0, 1));
    assert!(shown()["next_step"].as_str().is_some_and(|step| step.contains(&first)), "{}", shown());
    let second = send("");
    assert!(second.code == Some(2) && second.err.contains("error[E5012]"), "{}", second.err);
    assert_eq!(shop(&["good", &id, &first]).code, Some(0));
    assert_eq!(state(), is("ready", 1, 1));
    assert!(shop(&["good", &id, &first]).err.contains("error[E5020]"), "counted once");
    pause(Duration::from_millis(1100));
    let bad = sent(2);
    assert_eq!(shop(&["scrap", &id, &bad]).code, Some(0));
    assert_eq!(state(), is("ready", 1, 2));
    assert!(shop(&["good", &id, &bad]).err.contains("error[E5020]"), "scrap stays scrap");
    pause(Duration::from_millis(1100));
    let last = sent(3);
    assert_eq!(shop(&["good", &id, &last]).code, Some(0));
    assert_eq!(state(), is("done", 2, 3));
    assert!(shop(&["audit"]).out.contains("1 jobs, 0 faults"));
    // a run of this computer has a journal, which counts
    let other = shop(&["submit", "part.ngc"]).out.trim().to_owned();
    assert_eq!(shop(&["agent", "--once"]).code, Some(0));
    assert_eq!(bench.retrace(["run", "--job", &other, "--shop-file", "old.toml"]).code, Some(0));
    let run = shop(&["show", &other, "--json"]).out;
    let run: Value = serde_json::from_str(&run).expect("one object");
    let run = run["runs"][0]["id"].as_str().expect("a name").to_owned();
    assert!(shop(&["good", &other, &run]).err.contains("error[E5020]"));
}
