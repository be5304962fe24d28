//! Threads that a host has left, and that go on in a new epoch on a card that was alive (SPN-25).

use super::taps::{HeldBench, groove_bound};
use super::*;
use retrace_core::Place;

impl HeldBench {
    /// Stops the machine by the emergency stop, and waits until it rests, and the cause is gone.
    fn stop_by_alarm(&mut self) {
        self.bench.card.machine().set_input(EMERGENCY_STOP, true);
        for _ in 0..3000 {
            let _ = self.period();
        }
        self.bench.card.machine().set_input(EMERGENCY_STOP, false);
        for _ in 0..50 {
            let _ = self.period();
        }
        let status = self.bench.card.status();
        assert!(status.at_rest && status.alarm.is_some(), "{status:?}");
    }

    /// Where the cursor is, as the start of a path.
    fn here(&self) -> PathStart {
        let status = self.bench.card.status();
        let (place, reached, executed) = (status.place, status.reached, status.executed);
        PathStart { place, rests: false, reached, executed, keeps_state: true }
    }

    /// Begins an epoch, and clears the alarm.
    fn open(&mut self, start: PathStart) -> GearState {
        self.bench.card.begin_path(start).expect("it rests");
        self.bench.card.send(HostCommand::ClearAlarm).expect("its cause is gone");
        self.bench.card.status().spindle.gear
    }

    /// Lets so many periods pass in which nothing moves and the spindle is off.
    fn rest(&mut self, periods: u32) {
        let counts = self.bench.card.status().counts;
        for _ in 0..periods {
            self.bench.card.run_period().expect("no alarm");
            assert_eq!((self.bench.card.status().counts, self.outputs()[0]), (counts, 0));
        }
    }

    /// Sends so many records of the stretch ahead.
    fn send_ahead(&mut self, count: u32) {
        for _ in 0..count {
            let place = self.bench.card.status().high;
            let increments = [self.bench.increments[place.number() as usize]];
            let record = Record { increments, flags: Flags::GEARED, line: 1, ..Record::default() };
            self.bench.card.send(HostCommand::Ahead { place, record }).expect("there is room");
        }
    }

    fn length(&self) -> i64 {
        self.bench.increments.iter().map(|&n| i64::from(n)).sum()
    }
}

/// A thread that an alarm has stopped goes on in a new epoch in its groove, exact to the count, and begins to move only
/// once that is requested and the records are held. It can be stopped again, and a held one is reversed.
#[test]
fn a_thread_goes_on_in_a_new_epoch() {
    let mut random = Random::new(7);
    for (control, direction) in [(SpindleControl::None, 1), (SpindleControl::None, -1), (SpindleControl::Held, 1)] {
        let case = ThreadCase { turns: 40, ..CASE };
        let mut thread = HeldBench::with(Bench::new(case, STEADY), control);
        thread.begin(direction);
        let mut depth = 4000;
        for round in 0..3 {
            thread.run_until(|status| status.counts[0] > depth);
            depth += 8000 + i64::from(random.up_to(4000));
            if round == 2 {
                thread.bench.switch_spindle(0);
                thread.run_until(|status| status.at_rest);
            } else {
                thread.stop_by_alarm();
            }
            assert_eq!(thread.open(thread.here()), GearState::Engaged);
            thread.rest(2000);
            thread.request(Rate::ONE);
            // nothing moves with too few records
            thread.send_ahead(249);
            thread.rest(500);
            if control == SpindleControl::Held {
                thread.request(-Rate::ONE);
                thread.send_all_behind();
                let before = thread.bench.card.status().counts[0];
                thread.run_until(|status| status.counts[0] < before - 2000);
                thread.request(Rate::ONE);
            }
        }
        thread.run_until(|status| status.spindle.gear == GearState::Off);
        assert_eq!(thread.bench.card.status().counts[0], thread.length());
        assert_eq!(thread.outputs(), [direction, 1_000_000]);
        assert!(thread.worst <= groove_bound(&case), "{control:?} {direction}: {}", thread.worst);
    }
}

/// A thread that was reversed to its beginning, and awaits its spindle there, does so in the new epoch.
#[test]
fn a_thread_that_awaits_its_spindle_does_so_in_a_new_epoch() {
    let case = ThreadCase { turns: 10, ..CASE };
    let mut thread = HeldBench::with(Bench::new(case, STEADY), SpindleControl::Held);
    thread.begin(1);
    thread.run_until(|status| status.counts[0] > 6000);
    thread.request(-Rate::ONE);
    thread.run_until(|status| status.spindle.gear == GearState::Waiting);
    thread.stop_by_alarm();
    thread.bench.switch_spindle(0);
    thread.bench.card.run_period().expect_err("the alarm");
    assert_eq!(thread.open(thread.here()), GearState::Waiting);
    thread.rest(500);
    thread.bench.switch_spindle(1);
    thread.request(Rate::ONE);
    thread.run_until(|status| status.spindle.gear == GearState::Off);
    assert_eq!(thread.bench.card.status().counts[0], thread.length());
    assert!(thread.worst <= groove_bound(&case), "{}", thread.worst);
}

/// The stretch is forgotten where the host does not ask for it, the path begins elsewhere, or the encoder has failed:
/// its records are refused, and nothing moves.
#[test]
fn a_thread_is_forgotten_where_its_angle_or_place_is_not_the_same() {
    for what in 0..4 {
        let mut thread = HeldBench::with(Bench::new(ThreadCase { turns: 40, ..CASE }, STEADY), SpindleControl::None);
        thread.begin(1);
        thread.run_until(|status| status.counts[0] > 9000);
        if what == 0 {
            thread.spindle().kill_encoder();
            while thread.period().is_ok() {}
        }
        thread.stop_by_alarm();
        let here = thread.here();
        let start = match what {
            1 => PathStart { keeps_state: false, ..here },
            2 => PathStart { place: Place { fraction: here.place.fraction ^ 1, ..here.place }, ..here },
            3 => PathStart { place: Place::start_of(here.place.record), ..here },
            _ => here,
        };
        assert_eq!(thread.open(start), GearState::Off, "{what}");
        let place = thread.bench.card.status().high;
        let increments = [thread.bench.increments[place.number() as usize]];
        let record = Record { increments, flags: Flags::GEARED, line: 1, ..Record::default() };
        thread.bench.card.send(HostCommand::Ahead { place, record }).expect_err("a record of no stretch");
        thread.request(Rate::ONE);
        thread.rest(1000);
    }
}

/// A spindle that was turned by hand since does not take the tool along: it is an alarm, and the tool has not moved.
#[test]
fn a_spindle_that_was_turned_by_hand_does_not_take_the_tool_along() {
    for turns in [0.3, -1.5] {
        let mut thread = HeldBench::with(Bench::new(ThreadCase { turns: 40, ..CASE }, STEADY), SpindleControl::None);
        thread.begin(1);
        thread.run_until(|status| status.counts[0] > 9000);
        thread.stop_by_alarm();
        let stopped = thread.bench.card.status().counts[0];
        thread.spindle().turn_by_hand(turns);
        thread.is_turned_away = true;
        assert_eq!(thread.open(thread.here()), GearState::Engaged);
        thread.rest(1000);
        thread.request(Rate::ONE);
        let alarm = (0..3000).find_map(|_| {
            assert_eq!(thread.outputs()[0], 0, "it is not switched on");
            thread.period().err()
        });
        assert_eq!(alarm, Some(SimCardError::Alarm(Alarm::ThreadLost)), "{turns}");
        for _ in 0..3000 {
            let _ = thread.period();
        }
        assert_eq!((thread.bench.card.status().counts[0], thread.outputs()[0]), (stopped, 0));
    }
}
