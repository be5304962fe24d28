//! Twelve ways in which a job on a torch ends, at random moments over the simulated line: the torch is off behind every
//! end, at once where the host or the card ends it, and within the watchdog where the host or the line is gone (CUT-4,
//! CUT-7).
//!
//! Invariant: every figure comes from the trace of the pins; the test marks the end in it with an input of its own.

use std::io;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use retrace_tests::command::{Bench, binary, cases};
use retrace_tests::pins::{Sample, samples};
use retrace_tests::sender::TestRandom;
use retrace_tests::served::ServedCard;
use retrace_tests::terminal::Terminal;

/// Number of hosts and cards at a time.
const AT_A_TIME: usize = 4;
/// Factor of the card's time over wall time.
const SPEED: f64 = 5.0;
/// In ms of the card's time: it tolerates a computer under load.
const WATCHDOG_MS: u64 = 1500;
/// Control period in µs.
const PERIOD_US: u64 = 1000;
/// Inputs by which the test marks the end of the host, and the emergency stop.
const MARK: u64 = 1 << 12;
/// Time in which a host ends on a computer under load.
const ENDS_WITHIN: Duration = Duration::from_secs(60);
/// Time in which a program ends that nothing interrupts.
const PROGRAM_ENDS_WITHIN: Duration = Duration::from_secs(20);

const AXES: [&str; 2] = ["x", "y"];

/// A cut that the program ends, a cut that it forgets to end.
const PROGRAM: &str = "G21 G90 F3000\nG0 X10 Y10\nM3 S1\nG1 X70\nG3 X70 Y50 J20\nG1 X10\nG1 Y10\nM5\nG0 X20 Y60\nM3 \
    S1\nG1 X90\nG1 Y80\nM2\n";

/// Its lines that are cut. The torch goes off in line 8, or by the end of the job.
const CUT_LINES: [u64; 6] = [4, 5, 6, 7, 11, 12];

fn machine() -> String {
    let axes: String = AXES
        .iter()
        .map(|name| {
            format!(
                "[[axis]]\nname = \"{name}\"\npulses_per_mm = 200\nmax_velocity_mm_per_s = 200\n\
                 max_acceleration_mm_per_s2 = 2500\nmax_jerk_mm_per_s3 = 40000\ntravel_mm = [-100, 500]\n"
            )
        })
        .collect();
    format!(
        "[card]\nwatchdog_ms = {WATCHDOG_MS}\n{axes}[[card.input]]\nnumber = 1\nuse = \"emergency-stop\"\n\
         [[cutter]]\nname = \"torch\"\nkind = \"torch\"\nfire = 64\nok = {{ input = 5 }}\n\
         start = {{ start_s = 0.5, retry_s = 0.1, pierce_s = 0.2 }}\n"
    )
}

/// A trace without the mark of the test.
const UNMARKED: &str = "the end is not in the trace";

/// How a job ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum End {
    /// The program ends, without M5.
    Program,
    /// The operator's script.
    Stop,
    /// `q` at the screen.
    Quit,
    Interrupt,
    Terminate,
    HangUp,
    Kill,
    /// The cable is pulled out.
    Cable,
    /// The line stalls: bytes arrive late, by more than the watchdog.
    Stall,
    /// The journal cannot be written any more.
    FullDisk,
    /// The emergency stop is pressed.
    Alarm,
    /// The process aborts, as in a panic.
    Abort,
}

/// The one that takes longest first.
const ENDS: [End; 12] = [
    End::Cable,
    End::Program,
    End::Stop,
    End::Quit,
    End::Interrupt,
    End::Terminate,
    End::HangUp,
    End::Kill,
    End::Stall,
    End::FullDisk,
    End::Alarm,
    End::Abort,
];

impl End {
    /// Whether the card is on its own: the torch goes off when the watchdog trips.
    fn is_silent(self) -> bool {
        matches!(self, Self::Kill | Self::Cable | Self::Stall | Self::Abort)
    }
}

/// A host, with its files in a folder of its own.
struct Host {
    child: Child,
}

impl Host {
    fn start(bench: &Bench, card: &ServedCard, arguments: &[&str], journal_bytes: Option<u64>) -> io::Result<Self> {
        let mut command = Command::new("env");
        command.args(["--default-signal=INT,TERM,HUP", "--ignore-signal=XFSZ", "prlimit"]);
        // Output goes nowhere, so that the limit concerns the journal.
        command.arg(journal_bytes.map_or("--fsize=unlimited".to_owned(), |bytes| format!("--fsize={bytes}")));
        command.arg(binary()).args(["run", "part.ngc", "--card", &card.port, "--machine", "m.toml", "--no-tui"]);
        command.args(arguments).current_dir(bench.path("")).env("XDG_STATE_HOME", bench.path("state"));
        command.env("XDG_CONFIG_HOME", bench.path("config")).env("XDG_CACHE_HOME", bench.path("cache"));
        let child = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn()?;
        Ok(Self { child })
    }

    fn signal(&self, name: &str) {
        let told = Command::new("kill").args([name, &self.child.id().to_string()]).status();
        assert!(told.is_ok_and(|status| status.success()));
    }

    fn wait(&mut self) -> Result<(), String> {
        self.wait_for(ENDS_WITHIN)
    }

    fn wait_for(&mut self, longest: Duration) -> Result<(), String> {
        let begun = Instant::now();
        while begun.elapsed() < longest {
            if self.child.try_wait().map_err(|error| error.to_string())?.is_some() {
                return Ok(());
            }
            thread::sleep(Duration::from_millis(2));
        }
        Err("the host does not end".to_owned())
    }
}

impl Drop for Host {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// One job that ends so.
fn case(end: End, seed: u64) -> Result<Judged, String> {
    let mut chance = TestRandom::new(seed);
    let bench = Bench::new();
    let trace = bench.path("trace.vcd");
    bench.file("part.ngc", PROGRAM);
    let machine = bench.file("m.toml", machine()).display().to_string();
    let vcd = trace.display().to_string();
    let speed = SPEED.to_string();
    let mut served = vec!["--speed", &speed, "--vcd", &vcd, "--machine", &machine];
    let fault = format!("{}stall@{}+400", ["up.", "down.", ""][chance.below(3)], 3000 + chance.below(9000));
    if end == End::Stall {
        served.extend(["--faults", &fault]);
    }
    let mut card = ServedCard::with(&served);
    // From the start of the host into its second cut.
    let at = Duration::from_millis(400 + chance.below(1400) as u64);
    let script = format!("at {:.2}s stop\n", 0.5 + chance.below(700) as f64 / 100.0);
    bench.file("stop.op", script);
    if end == End::Quit {
        quit(&bench, &card, at);
        card.operate("input 12 on");
    } else {
        let limit = (end == End::FullDisk).then(|| 3_000 + chance.below(40_000) as u64);
        let arguments: &[&str] = if end == End::Stop { &["--operator", "stop.op"] } else { &[] };
        let mut host = Host::start(&bench, &card, arguments, limit).map_err(|error| error.to_string())?;
        finish(end, &mut host, &mut card, at)?;
    }
    // Longer than the watchdog, and than any stop.
    thread::sleep(Duration::from_secs_f64((WATCHDOG_MS as f64 + 1000.0) / 1000.0 / SPEED));
    let told = card.end();
    if told["counts"] != told["counted"] {
        return Err(format!("{told}"));
    }
    judge(end, &trace)
}

/// Starts a job at the screen, and quits.
fn quit(bench: &Bench, card: &ServedCard, at: Duration) {
    let [part, machine, state] = ["part.ngc", "m.toml", "state"].map(|name| bench.path(name).display().to_string());
    let run = ["run", &part, "--card", &card.port, "--machine", &machine, "--tui"];
    let mut screen = Terminal::with(&run, 100, 30, &[("XDG_STATE_HOME", &state)]);
    screen.wait_for_text("READY");
    screen.keys("c");
    thread::sleep(at);
    // Stops the job, and releases a machine whose program has ended; then ends the screen.
    // A host that is kept from running takes its keys later.
    let begun = Instant::now();
    for key in ["q", "y"].into_iter().cycle() {
        if !screen.is_full_screen() || begun.elapsed() > ENDS_WITHIN {
            break;
        }
        screen.keys(key);
        thread::sleep(Duration::from_millis(200));
    }
    screen.wait_for_end();
}

/// Ends the host or the line in this way, and marks that in the trace.
fn finish(end: End, host: &mut Host, card: &mut ServedCard, at: Duration) -> Result<(), String> {
    match end {
        // On a computer under load the line may run dry: the torch goes out, and the host waits for the operator.
        End::Program | End::Stop | End::Stall => {
            if host.wait_for(PROGRAM_ENDS_WITHIN).is_err() {
                host.signal("-INT");
                host.wait()?;
            }
        }
        // The host waits for the operator once the journal is late.
        End::FullDisk => {
            thread::sleep(Duration::from_secs(3));
            card.operate("input 12 on");
            host.signal("-INT");
            return host.wait();
        }
        _ => {
            thread::sleep(at);
            match end {
                End::Interrupt => host.signal("-INT"),
                End::Terminate => host.signal("-TERM"),
                End::HangUp => host.signal("-HUP"),
                End::Kill => host.signal("-KILL"),
                End::Abort => host.signal("-ABRT"),
                End::Cable => {
                    card.operate("input 12 on");
                    card.operate("unplug");
                }
                _ => {
                    card.operate("input 12 on");
                    card.operate("press emergency-stop");
                }
            }
            host.wait()?;
        }
    }
    if !matches!(end, End::Cable | End::Alarm) {
        card.operate("input 12 on");
    }
    Ok(())
}

/// What the trace of a job shows.
struct Judged {
    /// Whether the end of the job put out a torch that was cutting.
    was_cutting: bool,
    /// Time from the end to the torch off, in ms; 0 where it was off before.
    off_after_ms: f64,
}

/// Judges a trace; an error is a torch that is on too long.
fn judge(end: End, trace: &Path) -> Result<Judged, String> {
    let all = samples(trace);
    let is_on = |sample: &Sample| sample.is_on("spindle");
    if all.last().is_some_and(is_on) {
        return Err("on at the end of the trace".to_owned());
    }
    let latched = all.windows(2).find(|pair| pair[0].alarm == 0 && pair[1].alarm != 0);
    if let Some(on) = latched.and_then(|pair| {
        let latched_us = pair[1].at_us;
        all.iter().find(|sample| sample.at_us > latched_us + PERIOD_US && is_on(sample))
    }) {
        return Err(format!("on behind an alarm, at {} ms", on.at_us / 1000));
    }
    let marked = all.iter().position(|sample| sample.inputs & MARK != 0).ok_or(UNMARKED)?;
    let mark_us = all[marked].at_us;
    let last_off = all.windows(2).rfind(|pair| is_on(&pair[0]) && !is_on(&pair[1]));
    let Some(off_us) = last_off.map(|pair| pair[1].at_us) else {
        return Ok(Judged { was_cutting: false, off_after_ms: 0.0 });
    };
    let limit_us = match end {
        // The card samples the input in the same period, or in the next.
        End::Alarm => mark_us + 2 * PERIOD_US,
        _ if end.is_silent() => mark_us + WATCHDOG_MS * 1000 + 2 * PERIOD_US,
        _ => mark_us,
    };
    if off_us > limit_us {
        return Err(format!("off {:.3} ms late", (off_us - limit_us) as f64 / 1000.0));
    }
    let burning = all.iter().take_while(|sample| sample.at_us < off_us).last();
    Ok(Judged {
        was_cutting: burning.is_some_and(|sample| CUT_LINES.contains(&sample.line)),
        off_after_ms: off_us.saturating_sub(mark_us) as f64 / 1000.0,
    })
}

/// What the jobs of one end have shown.
#[derive(Default)]
struct Tally {
    jobs: u32,
    cutting: u32,
    longest_ms: f64,
    wrong: Vec<String>,
}

#[test]
fn the_torch_is_off_behind_every_end_of_a_job() {
    let first: u64 = std::env::var("RETRACE_FIRST_SEED").ok().and_then(|text| text.parse().ok()).unwrap_or(1);
    let count = cases(1);
    let (next, begun) = (AtomicU32::new(0), Instant::now());
    let tallies = ENDS.map(|_| Mutex::new(Tally::default()));
    let work = || {
        while let number = next.fetch_add(1, Ordering::Relaxed)
            && number < count * ENDS.len() as u32
        {
            let (at, seed) = (number as usize % ENDS.len(), first + u64::from(number / ENDS.len() as u32));
            // A card that was kept from running has not read the mark.
            let mut judged = case(ENDS[at], seed);
            for _ in 0..2 {
                if judged.as_ref().err().is_some_and(|why| why == UNMARKED) {
                    judged = case(ENDS[at], seed);
                }
            }
            let mut tally = tallies[at].lock().expect("no panic");
            tally.jobs += 1;
            match judged {
                Ok(Judged { was_cutting, off_after_ms }) => {
                    tally.cutting += u32::from(was_cutting);
                    tally.longest_ms = tally.longest_ms.max(off_after_ms);
                }
                Err(why) => {
                    println!("WRONG {:?}, seed {seed}: {why}", ENDS[at]);
                    tally.wrong.push(format!("{:?}, seed {seed}: {why}", ENDS[at]));
                }
            }
        }
    };
    thread::scope(|scope| (0..AT_A_TIME).for_each(|_| drop(scope.spawn(work))));
    let mut wrong = Vec::new();
    for (end, tally) in ENDS.iter().zip(tallies) {
        let Tally { jobs, cutting, longest_ms, wrong: of } = tally.into_inner().expect("no panic");
        println!("{end:?}: {jobs} jobs, {cutting} ended in a cut, off at most {longest_ms:.3} ms behind the end");
        wrong.extend(of);
    }
    println!("{:.0} s", begun.elapsed().as_secs_f64());
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
