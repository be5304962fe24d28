//! A page that dies while it holds a jog: `cargo xtask campaign page-dead`.
//!
//! The axis is judged by the wires of the card, in the card's own time. That time is compared with the clock of the
//! computer by what the page was shown: a position cannot be shown before the card has reached it, so that the card's
//! time is at least as late as the earliest of all of these says. Delays of what is shown make the result worse, never
//! better.

use std::time::{Duration, Instant};

use retrace_tests::command::{Bench, cases};
use retrace_tests::page_client::{Page, PageServer};
use retrace_tests::pins::{Sample, samples};
use retrace_tests::served::ServedCard;
use serde_json::json;

/// Deaths, unless the campaign sets another number, and those on one server.
const DEATHS: u32 = 4;
const BATCH: u32 = 20;

/// Pulses of a millimetre, and the speed of the jog.
const PULSES_PER_MM: f64 = 200.0;
const JOG_MM_PER_S: f64 = 50.0;

/// Time from full speed to rest, with the acceleration and jerk of the machine file below.
const BRAKING_MS: f64 = 100.0;

/// Time from the last beat to the beginning of braking: in a campaign, and in the suite, which runs beside other work.
const LIMIT_MS: f64 = 200.0;
const LIMIT_OF_THE_SUITE_MS: f64 = 1_000.0;

/// Largest step by which a position that is shown may improve what is known of the clocks, µs.
const CLOCK_STEP_US: f64 = 100_000.0;

/// Interval of the beats of a page.
const BEAT: Duration = Duration::from_millis(50);

fn machine_file() -> String {
    let axis = |name: &str| {
        format!(
            "[[axis]]\nname = \"{name}\"\npulses_per_mm = {PULSES_PER_MM:?}\nmax_velocity_mm_per_s = 100.0\n\
             max_acceleration_mm_per_s2 = 1000.0\nmax_jerk_mm_per_s3 = 20000.0\ntravel_mm = [-2000.0, 2000.0]\n\
             jog_mm_per_s = {JOG_MM_PER_S:?}\n"
        )
    };
    format!("{}{}{}[card]\nwatchdog_ms = 2000\n", axis("x"), axis("y"), axis("z"))
}

/// How a page dies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Death {
    /// Its thread hangs: it neither sends nor reads, and then goes on as before.
    Hangs,
    /// Its link is cut.
    LinkIsCut,
    /// It reads and shows all, and sends nothing.
    IsSilent,
    /// It does not die: it holds, which is measured in the same way.
    Holds,
}

/// A jog whose page has died: axis, and times of the computer's clock since the server began, s.
#[derive(Clone, Copy, Debug)]
struct DeadJog {
    death: Death,
    axis: usize,
    last_beat_s: f64,
    at_rest_s: f64,
}

/// A page with the clock of the computer, and the positions that it was shown.
struct Watched {
    begun: Instant,
    page: Page,
    shown: Vec<(f64, [i64; 2])>,
    beats: u32,
}

impl Watched {
    fn now_s(&self) -> f64 {
        self.begun.elapsed().as_secs_f64()
    }

    fn listen(&mut self, time: Duration) {
        let begun = Instant::now();
        while begun.elapsed() < time {
            if let Ok(Some(kind)) = self.page.receive()
                && kind == "live"
            {
                let counts = [0, 1].map(|axis| (self.page.machine_mm(axis) * PULSES_PER_MM).round() as i64);
                self.shown.push((self.now_s(), counts));
            }
        }
    }

    /// Begins a jog, as soon as the machine is done with what was before. Returns the number of its beats.
    fn begin_jog(&mut self, axis: &str, up: bool) -> u32 {
        let begun = Instant::now();
        loop {
            self.beats += 1;
            let (beat, id) = (self.beats, 1000 + self.beats);
            let (turn, seen) = (self.page.last("control")["turn"].clone(), self.page.last("state")["n"].clone());
            let jog = json!({"t": "jog", "id": id, "turn": turn, "seen": seen, "axis": axis, "up": up, "beat": beat});
            self.page.send(&jog);
            let answer = self.page.answer(id);
            if answer["t"] == "done" {
                return beat;
            }
            assert!(answer["number"] == "E2421" && begun.elapsed() < Duration::from_secs(20), "{answer:#}");
            self.listen(BEAT);
        }
    }

    /// Holds a jog for about this long, and dies.
    fn die(&mut self, server: &PageServer, death: Death, axis: usize, up: bool, held: Duration) -> DeadJog {
        self.page
            .wait_until("rest", |page| page.last("state")["stage"] == "setup" && page.last("live")["at_rest"] == true);
        let beat = self.begin_jog(["x", "y"][axis], up);
        let begun = Instant::now();
        let mut last_beat_s = self.now_s();
        while begun.elapsed() < held {
            self.listen(BEAT);
            self.page.send(&json!({"t": "beat", "beat": beat}));
            last_beat_s = self.now_s();
        }
        match death {
            Death::IsSilent => self.listen(Duration::from_millis(700)),
            Death::Holds => {
                self.page.send(&json!({"t": "hold"}));
                last_beat_s = self.now_s();
                self.listen(Duration::from_millis(700));
            }
            Death::Hangs => {
                std::thread::sleep(Duration::from_millis(700));
                // It comes back and beats on, as if nothing had happened.
                for _ in 0..4 {
                    self.page.send(&json!({"t": "beat", "beat": beat}));
                    self.listen(BEAT);
                }
            }
            Death::LinkIsCut => {
                let page = server.page(&server.token);
                drop(std::mem::replace(&mut self.page, page));
                last_beat_s = self.now_s();
                self.listen(Duration::from_millis(700));
                self.page.take_control();
            }
        }
        self.listen(Duration::from_millis(100));
        DeadJog { death, axis, last_beat_s, at_rest_s: self.now_s() }
    }
}

/// Deaths on one server, and what they show. Returns the time to the beginning of braking and to rest of each, ms.
fn batch(count: u32, seed: &mut u64) -> Vec<(Death, f64, f64)> {
    let bench = Bench::new();
    let trace = bench.path("card.vcd");
    let machine = bench.file("m.toml", machine_file()).display().to_string();
    let card = ServedCard::with(&["--vcd", &trace.display().to_string()]);
    let server = PageServer::start(&["--card", &card.port, "--machine", &machine]);
    let mut page = server.page(&server.token);
    page.take_control();
    let mut watched = Watched { begun: Instant::now(), page, shown: Vec::new(), beats: 0 };
    let mut random = move || {
        *seed ^= *seed << 13;
        *seed ^= *seed >> 7;
        *seed ^= *seed << 17;
        *seed
    };
    let deaths = [Death::Hangs, Death::LinkIsCut, Death::IsSilent, Death::Holds];
    let jogs: Vec<DeadJog> = (0..count)
        .map(|number| {
            let held = Duration::from_millis(300 + random() % 400);
            let axis = (random() % 2) as usize;
            watched.die(&server, deaths[(random() % 4) as usize], axis, number % 4 < 2, held)
        })
        .collect();
    let shown = std::mem::take(&mut watched.shown);
    drop((watched, server));
    let _ = card.end();
    let samples = samples(&trace);
    let offset_s = card_clock(&samples, &shown);
    jogs.iter().map(|jog| judge(jog, &samples, offset_s)).collect()
}

/// The least that the card's time is ahead of the clock of the computer, s.
fn card_clock(samples: &[Sample], shown: &[(f64, [i64; 2])]) -> f64 {
    let mut offset_s = f64::NEG_INFINITY;
    let mut before = None;
    let mut from = 0;
    for &(at_s, counts) in shown {
        if before == Some(counts) {
            continue;
        }
        before = Some(counts);
        // Positions come again in later jogs: it is looked for where it can have been, as far as the clocks are known.
        let latest_us = if offset_s.is_finite() { (at_s + offset_s) * 1e6 + CLOCK_STEP_US } else { f64::INFINITY };
        let near = samples[from..].iter().take_while(|sample| sample.at_us as f64 <= latest_us);
        let is_it = |sample: &Sample| [sample.counts[0], sample.counts[1]] == counts;
        if let Some(place) = near.into_iter().position(is_it) {
            from += place;
            offset_s = offset_s.max(samples[from].at_us as f64 / 1e6 - at_s);
        }
    }
    assert!(offset_s.is_finite(), "the page was shown no position of the wires");
    offset_s
}

/// Time from the last beat of a page to the beginning of braking and to rest, ms.
fn judge(jog: &DeadJog, samples: &[Sample], offset_s: f64) -> (Death, f64, f64) {
    let (from_us, to_us) = ((jog.last_beat_s + offset_s - 0.25) * 1e6, (jog.at_rest_s + offset_s) * 1e6);
    let of_jog: Vec<&Sample> =
        samples.iter().filter(|sample| (from_us..to_us).contains(&(sample.at_us as f64))).collect();
    let count = |sample: &Sample| sample.counts[jog.axis] as f64;
    let since_beat_ms = |sample: &Sample| sample.at_us as f64 / 1e3 - (jog.last_beat_s + offset_s) * 1e3;
    // Full speed over 4 ms, less a pulse.
    let full = JOG_MM_PER_S * PULSES_PER_MM * 0.004 - 1.0;
    let (mut braking_ms, mut rest_ms) = (f64::NAN, f64::NAN);
    for (place, sample) in of_jog.iter().enumerate() {
        let later = of_jog[place..].iter().find(|later| later.at_us >= sample.at_us + 4_000);
        if later.is_some_and(|later| (count(later) - count(sample)).abs() >= full) {
            braking_ms = since_beat_ms(later.expect("there is one"));
        }
        if place > 0 && count(sample) != count(of_jog[place - 1]) {
            rest_ms = since_beat_ms(sample);
        }
    }
    (jog.death, braking_ms, rest_ms)
}

/// However a page dies, its jog begins to brake within the limit and is at rest after braking.
#[test]
fn a_dead_page_stops_its_jog() {
    let count = cases(DEATHS);
    let is_campaign = std::env::var_os("RETRACE_CASES").is_some();
    let limit_ms = if is_campaign { LIMIT_MS } else { LIMIT_OF_THE_SUITE_MS };
    let first = std::env::var("RETRACE_FIRST_SEED").ok().and_then(|text| text.parse().ok()).unwrap_or(1_u64);
    let mut seed = first.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    let mut judged = Vec::new();
    while judged.len() < count as usize {
        let left = count - judged.len() as u32;
        judged.extend(batch(left.min(BATCH), &mut seed));
    }
    // A page that is delayed itself has lost its jog before its last beat: then nothing moves behind it.
    let count_of_early = judged.iter().filter(|(_, _, rest_ms)| rest_ms.is_nan()).count();
    println!("{count_of_early} had ended before the last beat");
    let late: Vec<_> = judged
        .iter()
        .filter(|(_, _, rest_ms)| !rest_ms.is_nan())
        .filter(|(_, braking_ms, rest_ms)| !(*braking_ms <= limit_ms && *rest_ms <= limit_ms + BRAKING_MS))
        .collect();
    for death in [Death::Hangs, Death::LinkIsCut, Death::IsSilent, Death::Holds] {
        let of = |which: fn(&(Death, f64, f64)) -> f64| {
            let mut times: Vec<f64> = judged.iter().filter(|it| it.0 == death).map(which).collect();
            times.sort_by(f64::total_cmp);
            times
        };
        let (braking, rest) = (of(|it| it.1), of(|it| it.2));
        if let (Some(most), Some(rest_most)) = (braking.last(), rest.last()) {
            println!(
                "{death:?}: {} times, braking begins {:.0} ms (median) to {most:.0} ms after the last beat, at rest \
                 after {:.0} ms to {rest_most:.0} ms",
                braking.len(),
                braking[braking.len() / 2],
                rest[rest.len() / 2],
            );
        }
    }
    println!("{} of {count} within {limit_ms} ms and braking", judged.len() - late.len());
    assert!(late.is_empty() && count_of_early * 2 <= judged.len(), "{late:?}");
}
