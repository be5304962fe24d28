//! Threads that are retraced: from their end with the spindle turning backward, and by rate where the tool is free
//! (SPN-22).

use super::taps::{HeldBench, groove_bound};
use super::*;

/// A thread that was cut to its end is retraced from there, with the spindle turning backward, and cut again: the same
/// helix, exact in counts. It is entered at its angle only, and neither without its records nor without the request.
#[test]
fn a_thread_that_was_cut_to_its_end_is_retraced() {
    let mut random = Random::new(5);
    for (direction, is_off) in [(1, false), (-1, false), (1, true)] {
        let case = ThreadCase { turns: 20, ..CASE };
        let mut thread = HeldBench::with(Bench::new(case, STEADY), SpindleControl::Held);
        thread.begin(direction);
        thread.run_until(|status| status.spindle.gear == GearState::Off && status.counts[0] > 0);
        let end = thread.bench.increments.len() as u32;
        let cut = thread.bench.card.status().counts[0];
        assert_eq!(cut, thread.bench.increments.iter().map(|&n| i64::from(n)).sum::<i64>());
        for place in end..end + 300 {
            let rest = if place == end + 299 { Flags::REST } else { Flags::NONE };
            let record = Record { increments: [1], flags: rest, ..Record::default() };
            let command = HostCommand::Ahead { place: RecordIndex::new(place), record };
            thread.bench.card.send(command).expect("a record behind the thread");
        }
        let behind = |status: &retrace_link::CardStatus<1>| status.at_rest && status.place.record.number() == end + 300;
        thread.run_to(behind);
        if is_off {
            let change = OutputChange { channel: channel::SPINDLE, value: 0 };
            thread.bench.card.send(HostCommand::ManualOutput(change)).expect("a channel");
        }
        // Without the records of the thread its end is a barrier: the spindle turns as it did.
        let low = RecordIndex::new(end);
        thread.bench.card.send(HostCommand::Forget { low }).expect("behind the cursor");
        thread.request(-Rate::ONE);
        for _ in 0..3000 {
            thread.bench.card.run_period().expect("no alarm");
        }
        let on = if is_off { 0 } else { direction };
        assert_eq!((thread.bench.card.status().counts[0], thread.outputs()[0]), (cut, on));
        thread.send_all_behind();
        // The request is taken back while the spindle is being reversed: it is off, and nothing has moved.
        for _ in 0..200 {
            thread.period().expect("no alarm");
        }
        thread.request(Rate::ZERO);
        for _ in 0..2000 {
            thread.period().expect("no alarm");
            assert_eq!((thread.outputs()[0], thread.bench.card.status().counts[0]), (0, cut));
        }
        for round in 0..4 {
            thread.request(-Rate::ONE);
            thread.run_until(|status| status.spindle.gear == GearState::Engaged);
            assert_eq!(thread.outputs(), [-direction, (1_000_000 * 77) >> 8], "round {round}");
            for _ in 0..3 {
                thread.request([Rate::ZERO, -Rate::ONE][random.up_to(1) as usize]);
                for _ in 0..random.up_to(800) {
                    thread.period().expect("no alarm");
                }
            }
            if round % 2 == 0 {
                thread.request(-Rate::ONE);
                thread.run_until(|status| status.spindle.gear == GearState::Waiting);
                assert_eq!((thread.bench.card.status().counts[0], thread.outputs()[0]), (0, direction));
            }
            thread.request(Rate::ONE);
            thread.run_until(|status| status.spindle.gear == GearState::Off);
            assert_eq!((thread.bench.card.status().counts[0], thread.outputs()[0]), (cut, direction));
        }
        assert!(thread.worst <= groove_bound(&case), "{}", thread.worst);
    }
}

/// Where the tool is free and the spindle rests, a thread is passed by rate: backward from where it is held, and not
/// beyond; one that was cut, both ways. Cut again it is the same thread; a spindle that is switched on is an alarm.
#[test]
fn a_thread_whose_tool_is_free_is_passed_by_rate() {
    for direction in [1, -1] {
        let case = ThreadCase { turns: 20, ..CASE };
        let mut thread = HeldBench::with(Bench::new(case, STEADY), SpindleControl::Held);
        let cut: i64 = thread.bench.increments.iter().map(|&n| i64::from(n)).sum();
        thread.begin(direction);
        thread.run_until(|status| status.counts[0] > 9000);
        thread.bench.card.send(HostCommand::FreeTool).expect_err("the spindle turns");
        thread.request(Rate::ZERO);
        thread.run_until(|status| status.at_rest && status.outputs[usize::from(channel::SPINDLE)] == 0);
        thread.bench.card.send(HostCommand::FreeTool).expect("it rests");
        thread.is_turned_away = true;
        let held = *thread.bench.card.status();
        thread.request(Rate::ONE * 2);
        for _ in 0..1000 {
            thread.period().expect("no alarm");
        }
        let most = held.place.boundary_ahead();
        assert_eq!(thread.bench.card.status().place, retrace_core::Place::start_of(most), "what was not cut");
        thread.request(-Rate::ONE * 2);
        thread.run_until(|status| status.spindle.gear == GearState::Waiting);
        assert_eq!((thread.outputs()[0], thread.bench.card.status().counts[0]), (0, 0));
        // It waits for its spindle, its speed and its angle.
        thread.request(Rate::ONE);
        thread.is_turned_away = false;
        thread.run_until(|status| status.spindle.gear == GearState::Off);
        assert_eq!((thread.bench.card.status().counts[0], thread.outputs()[0]), (cut, direction));
        assert!(thread.worst <= groove_bound(&case), "{}", thread.worst);
        // From its end, with the spindle switched off.
        thread.request(Rate::ZERO);
        thread.bench.card.send(HostCommand::FreeTool).expect_err("the spindle is on");
        let switch = |value| HostCommand::ManualOutput(OutputChange { channel: channel::SPINDLE, value });
        thread.bench.card.send(switch(0)).expect("a channel");
        thread.bench.card.send(HostCommand::FreeTool).expect_err("it coasts");
        for _ in 0..3000 {
            thread.period().expect("no alarm");
        }
        thread.bench.card.send(HostCommand::FreeTool).expect("it rests");
        thread.send_all_behind();
        thread.is_turned_away = true;
        thread.request(-Rate::ONE);
        thread.run_until(|status| status.counts[0] < cut / 2);
        thread.request(Rate::ONE);
        thread.run_until(|status| status.spindle.gear == GearState::Off);
        assert_eq!((thread.outputs()[0], thread.bench.card.status().counts[0]), (0, cut));
        // Behind it the thread is a barrier again, and is freed again.
        thread.request(Rate::ZERO);
        thread.bench.card.send(HostCommand::FreeTool).expect("it rests");
        thread.request(-Rate::ONE);
        thread.run_until(|status| status.counts[0] < cut / 2);
        thread.bench.card.send(switch(direction)).expect("a channel");
        let alarm = (0..2000).find_map(|_| thread.period().err());
        assert_eq!(alarm, Some(SimCardError::Alarm(Alarm::ThreadLost)));
        while !thread.bench.card.status().at_rest {
            let _ = thread.period();
        }
        assert!(thread.bench.card.status().counts[0] > 0);
    }
}

/// An alarm where the spindle is being reversed at the end of a thread switches it off, and nothing moves.
#[test]
fn an_alarm_at_the_end_of_a_thread_leaves_the_spindle_off() {
    for periods in [10, 100, 1200] {
        let mut thread = HeldBench::with(Bench::new(ThreadCase { turns: 10, ..CASE }, STEADY), SpindleControl::Held);
        thread.begin(1);
        thread.run_until(|status| status.spindle.gear == GearState::Off && status.counts[0] > 0);
        thread.spindle().set_stalled(periods > 1000);
        thread.request(-Rate::ONE);
        for _ in 0..periods {
            thread.period().expect("no alarm");
        }
        let cut = thread.bench.card.status().counts[0];
        assert_ne!(thread.outputs()[0], 1, "{periods}");
        thread.bench.card.machine().set_input(EMERGENCY_STOP, true);
        for _ in 0..2000 {
            let _ = thread.period();
        }
        thread.bench.card.machine().set_input(EMERGENCY_STOP, false);
        for _ in 0..50 {
            let _ = thread.period();
        }
        thread.bench.card.send(HostCommand::ClearAlarm).expect("its cause is gone");
        thread.request(-Rate::ONE);
        for _ in 0..2000 {
            let _ = thread.period();
            assert_eq!((thread.outputs()[0], thread.bench.card.status().counts[0]), (0, cut), "{periods}");
        }
    }
}
