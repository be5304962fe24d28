//! Measures the time from a key to the first slower period, over a pseudo-terminal in wall time: `cargo run --release
//! -p retrace-hal-serial --example key_latency`.
//!
//! The simulated card and the host run in two threads; a third one presses hold at intervals.
//!
//! Invariant: the key takes effect where the motion path would read it, between two control periods, and the period is
//! timed by the card's own clock.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use retrace_core::limits::{PulseLimits, RateLimits};
use retrace_core::{Rate, Record, RecordIndex};
use retrace_hal_serial::{Address, Pty, SerialPort};
use retrace_hal_sim::{CardSimulator, CardSimulatorSettings};
use retrace_link::{CardSettings, HostCommand, LinkTimeouts, LinkedCard, MotionCard, PathStart};

const AXES: usize = 4;
const PRESSES: usize = 200;

/// Microseconds since the start, for all threads.
fn us(since: Instant) -> u64 {
    since.elapsed().as_micros() as u64
}

/// Serves a card until `ended` is set; `slower` receives the time of the first period that is slower than the one
/// before, after it was set to 0.
fn serve(mut pty: Pty, begun: Instant, slower: &Arc<AtomicU64>, ended: &AtomicBool) {
    let mut rig = CardSimulator::<AXES>::new(&CardSimulatorSettings::default()).expect("a card");
    let (mut last, slower) = (Rate::ZERO, Arc::clone(slower));
    rig.observe(Box::new(move |moment| {
        if moment.status.rate < last {
            let _ = slower.compare_exchange(0, us(begun), Ordering::Relaxed, Ordering::Relaxed);
        }
        last = moment.status.rate;
    }));
    let mut bytes = [0; 512];
    while !ended.load(Ordering::Relaxed) {
        let count = pty.read(&mut bytes, Duration::from_micros(300)).expect("the pseudo-terminal");
        rig.send(&bytes[..count]);
        while rig.now_us() < us(begun) {
            rig.advance(us(begun));
            let count = rig.receive(&mut bytes);
            pty.write(&bytes[..count]).expect("the pseudo-terminal");
        }
    }
}

fn main() {
    let begun = Instant::now();
    let (slower, pressed, ended) = (Arc::new(AtomicU64::new(1)), AtomicU64::new(0), AtomicBool::new(false));
    let pty = Pty::open().expect("a pseudo-terminal");
    let address = Address::parse(&pty.path().display().to_string()).expect("a path");
    let axis = PulseLimits { velocity: 100 << 32, acceleration: 1 << 32, jerk: (1 << 32) / 50 };
    let limits = RateLimits::new(51, 58_983, [axis; AXES]).expect("valid");
    let mut latencies = Vec::new();
    std::thread::scope(|scope| {
        scope.spawn(|| serve(pty, begun, &slower, &ended));
        let port = SerialPort::open(&address).expect("the pseudo-terminal");
        let mut card = Box::new(LinkedCard::<AXES, _>::connect(port, 7, LinkTimeouts::default()).expect("a card"));
        card.open(CardSettings::new(0, PathStart::at(RecordIndex::new(0)), 1000, limits)).expect("it opens");
        let (ended, pressed) = (&ended, &pressed);
        scope.spawn(move || {
            let mut wait_us = 170_000;
            while !ended.load(Ordering::Relaxed) {
                // at no fixed phase to the periods
                wait_us = 150_000 + (wait_us * 7919) % 60_013;
                std::thread::sleep(Duration::from_micros(wait_us));
                let _ = pressed.compare_exchange(0, us(begun), Ordering::Relaxed, Ordering::Relaxed);
            }
        });
        let mut held = 0u64;
        while latencies.len() < PRESSES {
            let high = card.status().high;
            let record = Record { increments: [50, 0, 0, 0], line: 1, ..Record::default() };
            if high.since(card.status().place.record) < 1000
                && card.send(HostCommand::Ahead { place: high, record }).is_ok()
            {
                continue;
            }
            let at = pressed.load(Ordering::Relaxed);
            if at != 0 && held == 0 && card.status().rate == Rate::ONE {
                slower.store(0, Ordering::Relaxed);
                held = at;
                card.send(HostCommand::rate(Rate::ZERO)).expect("a rate");
            } else if held == 0 {
                pressed.store(0, Ordering::Relaxed);
                card.send(HostCommand::rate(Rate::ONE)).expect("a rate");
            }
            let status = *card.run_period().expect("the card");
            let seen = slower.load(Ordering::Relaxed);
            if held != 0 && seen > 1 && status.at_rest {
                latencies.push(seen.saturating_sub(held));
                held = 0;
                pressed.store(0, Ordering::Relaxed);
            }
        }
        ended.store(true, Ordering::Relaxed);
    });
    latencies.sort_unstable();
    let ms = |k: usize| latencies[k] as f64 / 1000.0;
    println!(
        "{PRESSES} presses of hold: median {:.1} ms, nine of ten within {:.1} ms, worst {:.1} ms",
        ms(PRESSES / 2),
        ms(PRESSES * 9 / 10),
        ms(PRESSES - 1)
    );
}
