//! `retrace canon -`: a program on standard input is decoded as it arrives, in memory that does not grow with it.

use retrace_tests::command::binary;
use std::io::Write;
use std::process::{Command, Stdio};

/// Largest resident memory, MiB, of the command once `bytes` have been fed to it, and the number of lines printed; the
/// kernel's account is read while the command still waits for more.
fn fed(bytes: usize) -> (Option<f64>, usize) {
    let mut command = Command::new(binary());
    command.args(["canon", "-"]).stdin(Stdio::piped()).stdout(Stdio::piped());
    let mut child = command.spawn().expect("the command");
    let (mut input, mut output) = (child.stdin.take().expect("its input"), child.stdout.take().expect("its output"));
    let counter = std::thread::spawn(move || {
        let mut lines = 0;
        let mut taken = vec![0; 1 << 16];
        loop {
            match std::io::Read::read(&mut output, &mut taken).expect("its output") {
                0 => return lines,
                length => lines += taken[..length].iter().filter(|byte| **byte == b'\n').count(),
            }
        }
    });
    let lines: String =
        (0..4000).map(|n| format!("G1 X{}.{:03} Y-{}.5 (hole {n})\n", n % 97, n % 1000, n % 31)).collect();
    input.write_all(b"F1000\n").expect("it reads");
    let mut written = 0;
    while written < bytes {
        input.write_all(lines.as_bytes()).expect("it reads");
        written += lines.len();
    }
    let status = std::fs::read_to_string(format!("/proc/{}/status", child.id())).unwrap_or_default();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let peak = peak.and_then(|kib| kib.trim().strip_suffix(" kB")?.parse::<f64>().ok()).map(|kib| kib / 1024.0);
    input.write_all(b"M2\n").expect("it reads");
    drop(input);
    assert!(child.wait().expect("its end").success());
    // A move and its comment each.
    let printed = counter.join().expect("the counter");
    assert!(printed > written / lines.len() * 8000, "{printed} lines for {written} bytes");
    (peak, printed)
}

#[test]
fn memory_does_not_grow_with_what_is_fed() {
    let ((short, few), (long, many)) = (fed(1 << 20), fed(32 << 20));
    assert!(many > 25 * few);
    if let (Some(short), Some(long)) = (short, long) {
        println!("{short:.1} MiB after 1 MiB of program, {long:.1} MiB after 32 MiB");
        assert!(long <= 48.0 && long < short + 2.0, "{short} MiB, then {long} MiB");
    }
}
