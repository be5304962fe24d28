//! Durations of profiles compared with rsruckig, on random cases with any speeds, accelerations and distances (Q1).
//!
//! Invariant: every case has a profile, it is integrated here and is within its limits, and every case that differs is
//! counted.
//!
//! The number of cases is 5 000, or the value of RETRACE_PROFILE_CASES; RETRACE_PROFILE_SHOWN prints that many that
//! differ.

mod cases;
mod outcome;
mod peer;

use cases::case;
use outcome::{Outcome, Tally, compare};
use peer::Peer;

fn number(name: &str, otherwise: u64) -> u64 {
    std::env::var(name).ok().and_then(|given| given.parse().ok()).unwrap_or(otherwise)
}

#[test]
fn durations_are_those_of_rsruckig() {
    let (count, shown) = (number("RETRACE_PROFILE_CASES", 5_000), number("RETRACE_PROFILE_SHOWN", 0));
    let (mut peer, mut tally) = (Peer::new(), Tally::default());
    let mut left = shown;
    for k in 0..count {
        let case = case(k);
        let verdict = compare(&case, &mut peer);
        if left > 0 && verdict != Outcome::Equal {
            println!("case {k} {verdict:?}: {case:?}");
            left -= 1;
        }
        assert!(verdict.is_sound(), "case {k} {verdict:?}: {case:?}");
        tally.count(verdict);
    }
    println!("{tally}");
    assert!(tally.equal as f64 >= 0.99 * count as f64, "{tally}");
}

/// The peer's solver used for the comparison of speeds is the same: without its checks it gives the same durations.
#[test]
fn the_peers_solver_alone_is_the_peer() {
    let mut peer = Peer::new();
    for k in 0..2_000 {
        let case = case(k);
        peer.set(&case);
        if let (Ok(whole), Some(bare)) = (peer.solve(), peer.solve_bare(&case)) {
            assert!((whole - bare).abs() <= 1e-12 * (1.0 + whole), "case {k}: {whole} {bare}");
        }
    }
}

#[test]
fn in_the_mirror_and_backward_in_time_it_takes_as_long() {
    use retrace_motion::profile::{KinematicState, fastest_any_way};
    let turned = |state: KinematicState, v: f64, a: f64| KinematicState { s: 0.0, v: v * state.v, a: a * state.a };
    for k in 0..number("RETRACE_PROFILE_CASES", 5_000) {
        let c = case(k);
        let Ok(plain) = fastest_any_way(c.from, c.to, c.length, c.limits) else { panic!("case {k}: {c:?}") };
        let mirror = fastest_any_way(turned(c.from, -1.0, -1.0), turned(c.to, -1.0, -1.0), -c.length, c.limits);
        let backward = fastest_any_way(turned(c.to, 1.0, -1.0), turned(c.from, 1.0, -1.0), c.length, c.limits);
        for (name, other) in [("mirror", mirror), ("backward", backward)] {
            let Ok(other) = other else { panic!("case {k} {name}: {c:?}") };
            let gap = (other.duration() - plain.duration()).abs();
            // At a border a rounding of the distance decides.
            let close = gap <= 1e-9 * (1.0 + plain.duration()) || outcome::is_at_border(&c, gap);
            assert!(close, "case {k} {name} {gap:e}: {c:?}");
        }
    }
}
