//! Measures how many control periods per second the simulated card runs in virtual time, with its window filled.
//!
//! `cargo run --release -p retrace-hal-sim --example periods_a_second`

use std::time::Instant;

use retrace_core::limits::{PulseLimits, RateLimits};
use retrace_core::{Rate, Record, RecordIndex};
use retrace_hal_sim::{Clock, SimCard};
use retrace_link::{HostCommand, MotionCard};

const PERIODS: u32 = 1_000_000;

fn main() {
    let axis = PulseLimits { velocity: 100 << 32, acceleration: 1 << 32, jerk: 1 << 28 };
    let limits = RateLimits::new(51, 1 << 15, [axis; 4]).expect("valid");
    for rate in [Rate::ONE, Rate::ONE / 3 * 2] {
        for pulses in [5, 50] {
            let mut best = f64::INFINITY;
            for _ in 0..5 {
                let mut card = SimCard::<4>::new(RecordIndex::new(0), limits, Clock::Virtual).expect("fits");
                card.send(HostCommand::rate(rate)).expect("a rate");
                let began = Instant::now();
                for _ in 0..PERIODS {
                    let place = card.status().high;
                    if place.since(card.status().place.record) < 2000 {
                        let increments = [pulses, -pulses, pulses / 2, 0];
                        card.send(HostCommand::Ahead { place, record: Record { increments, ..Record::default() } })
                            .expect("room");
                    }
                    card.run_period().expect("no fault");
                }
                best = best.min(began.elapsed().as_secs_f64());
            }
            let share = f64::from(rate);
            println!(
                "rate {share:.2}, {pulses} pulses: {:.2} million periods a second",
                f64::from(PERIODS) / best / 1e6
            );
        }
    }
}
