//! The simulated serial channel: faults, delays, and complete counters.

use proptest::prelude::*;
use retrace_hal_sim::{Chance, FaultRates, InFlightPolicy, LineFault, SerialChannel, SerialChannelSettings};

/// All bytes that have arrived by `now_ns`.
fn drain(line: &mut SerialChannel, now_ns: u64) -> Vec<u8> {
    std::iter::from_fn(|| line.receive(now_ns)).collect()
}

/// Bytes 0, 1, 2 … sent together at time 0, with this script.
fn scripted(count: u8, script: &[(u64, LineFault)]) -> (Vec<u8>, SerialChannel) {
    let settings =
        SerialChannelSettings { baud: 1_000_000, script: script.to_vec(), ..SerialChannelSettings::default() };
    let mut line = SerialChannel::new(&settings);
    line.send(0, &(0..count).collect::<Vec<_>>());
    (drain(&mut line, u64::MAX), line)
}

#[test]
fn scripted_faults_strike_the_byte_that_they_name() {
    assert_eq!(scripted(4, &[]).0, [0, 1, 2, 3]);
    assert_eq!(scripted(4, &[(2, LineFault::Flip { bit: 7 })]).0, [0, 1, 130, 3]);
    assert_eq!(scripted(4, &[(3, LineFault::Drop), (0, LineFault::Drop)]).0, [1, 2]);
    assert_eq!(scripted(4, &[(1, LineFault::Duplicate)]).0, [0, 1, 1, 2, 3]);
    assert_eq!(scripted(6, &[(1, LineFault::Cut { bytes: 3 })]).0, [0, 4, 5]);
    assert_eq!(scripted(6, &[(4, LineFault::Cut { bytes: 0 })]).0, [0, 1, 2, 3]);
    // 25 µs of a channel where a byte takes 10: three bytes from the one on
    assert_eq!(scripted(6, &[(1, LineFault::Stall { us: 25, lost: true })]).0, [0, 4, 5]);
    let (bytes, line) = scripted(6, &[(1, LineFault::Stall { us: 25, lost: false })]);
    assert_eq!((bytes, line.counters().stalls, line.counters().faults()), (vec![0, 1, 2, 3, 4, 5], 1, 1));
}

#[test]
fn a_cut_to_the_end_of_a_burst_ends_with_it() {
    let mut line = SerialChannel::new(&SerialChannelSettings {
        baud: 1_000_000,
        script: vec![(1, LineFault::Cut { bytes: 0 })],
        ..SerialChannelSettings::default()
    });
    line.send(0, &[1, 2]);
    line.send(15_000, &[3]); // the sender is still busy with 2
    line.send(100_000, &[4]);
    assert_eq!((drain(&mut line, u64::MAX), line.counters().cut), (vec![1, 4], 2));
}

#[test]
fn a_stall_holds_everything_back_and_lets_it_come_at_once() {
    let script = vec![(1, LineFault::Stall { us: 100, lost: false })];
    let mut line = SerialChannel::new(&SerialChannelSettings {
        baud: 1_000_000,
        latency_us: 5,
        script,
        ..SerialChannelSettings::default()
    });
    line.send(0, &[1, 2, 3]);
    assert_eq!(drain(&mut line, 14_999), []);
    assert_eq!(drain(&mut line, 124_999), [1]);
    assert_eq!(drain(&mut line, 125_000), [2, 3]);
}

#[test]
fn bytes_of_an_old_connection_come_between_those_of_the_new_one() {
    let settings = SerialChannelSettings { baud: 1_000_000, ..SerialChannelSettings::default() };
    let mut line = SerialChannel::new(&settings);
    line.send(0, &[1, 2, 3]);
    assert_eq!(drain(&mut line, 10_000), [1]);
    line.reconnect(10_000, InFlightPolicy::Late { us: 15 });
    line.send(10_000, &[11, 12]);
    assert_eq!(drain(&mut line, 1_000_000), [11, 2, 3, 12]);
    line.send(1_000_000, &[1, 2]);
    line.reconnect(1_000_000, InFlightPolicy::Lost);
    line.send(1_000_000, &[13]);
    assert_eq!(drain(&mut line, u64::MAX), [13]);
    assert_eq!((line.counters().late, line.counters().lost_at_reconnect), (2, 2));
}

fn settings() -> impl Strategy<Value = SerialChannelSettings> {
    let probability = prop::sample::select(vec![0.0, 0.001, 0.02, 0.2]);
    let baud = prop::sample::select(vec![0u32, 115_200, 230_400, 1_000_000]);
    (baud, 0u32..2000, 0u32..3000, probability, any::<u64>()).prop_map(|(baud, latency_us, jitter_us, p, seed)| {
        let rates = FaultRates { stall_us: 4000, ..FaultRates::all(Chance::new(p).expect("a probability")) };
        SerialChannelSettings { baud, latency_us, jitter_us, rates, seed, script: Vec::new() }
    })
}

proptest! {
    /// Whatever happens, every byte is accounted for; and receiving often or seldom changes nothing.
    #[test]
    fn every_byte_is_accounted_for_however_it_is_read(
        settings in settings(),
        bursts in prop::collection::vec((0u64..3_000_000, prop::collection::vec(any::<u8>(), 0..60), any::<bool>()),
            1..30),
    ) {
        let (mut often, mut seldom) = (SerialChannel::new(&settings), SerialChannel::new(&settings));
        let (mut now, mut read, mut all) = (0, Vec::new(), 0);
        for (pause, bytes, ask) in &bursts {
            now += pause;
            if *ask {
                read.extend(drain(&mut often, now));
            }
            often.send(now, bytes);
            seldom.send(now, bytes);
            all += bytes.len() as u64;
        }
        let whole = drain(&mut seldom, u64::MAX);
        let so_far = *often.counters();
        prop_assert_eq!(so_far.delivered, read.len() as u64);
        read.extend(drain(&mut often, u64::MAX));
        prop_assert_eq!(&read, &whole);
        let t = often.counters();
        prop_assert_eq!(t, seldom.counters());
        prop_assert_eq!(t.sent, all);
        prop_assert_eq!(t.sent + t.duplicated, t.delivered + t.dropped + t.cut + t.stalled + t.lost_at_reconnect);
        prop_assert!(often.next_arrival().is_none());
    }

    /// A good line is a slow one: every byte arrives, in order, and exactly when its bits have passed.
    #[test]
    fn a_good_line_paces_bytes(
        baud in prop::sample::select(vec![115_200u32, 230_400, 1_000_000]),
        latency_us in 0u32..500,
        bursts in prop::collection::vec((0u64..3_000_000, 1usize..60), 1..30),
    ) {
        let mut line = SerialChannel::new(&SerialChannelSettings { baud, latency_us,
            ..SerialChannelSettings::default() });
        let (mut now, mut free, mut due) = (0u64, 0u64, Vec::new());
        for (pause, count) in bursts {
            now += pause;
            line.send(now, &vec![7; count]);
            for _ in 0..count {
                free = free.max(now) + 10_000_000_000 / u64::from(baud);
                due.push(free + u64::from(latency_us) * 1000);
            }
            prop_assert_eq!(line.free_at(), free);
            prop_assert!(line.unsent(now) as u64 * line.byte_ns() >= free - now);
        }
        for at in due {
            prop_assert_eq!(line.next_arrival(), Some(at));
            prop_assert_eq!(line.receive(at - 1), None);
            prop_assert_eq!(line.receive(at), Some(7));
        }
    }

    /// Delays alone lose nothing and change no order.
    #[test]
    fn delays_keep_bytes_and_order(jitter_us in 0u32..5000, seed: u64,
        pauses in prop::collection::vec(0u64..2_000_000, 1..100)) {
        let mut line = SerialChannel::new(&SerialChannelSettings { baud: 1_000_000, jitter_us, seed,
            ..SerialChannelSettings::default() });
        let mut now = 0;
        for (number, pause) in pauses.iter().enumerate() {
            now += pause;
            line.send(now, &[number as u8]);
        }
        let (mut bytes, mut last) = (Vec::new(), 0);
        while let Some(due) = line.next_arrival() {
            prop_assert!(due >= last, "arrivals go on in time");
            last = due;
            bytes.extend(line.receive(due));
        }
        prop_assert_eq!(bytes, (0..pauses.len() as u8).collect::<Vec<_>>());
    }
}
