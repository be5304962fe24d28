//! Taps, and holds, reverse run and a spindle turned by hand inside of stretches (SPN-19, SPN-21 … SPN-23).

use super::*;
use retrace_link::CommandRefusal;

/// A stretch in which a rate acts on the spindle. Counts are those of the place in every period, and in the straight
/// part they lie on the one helix through the start at the index.
pub(super) struct HeldBench {
    pub(super) bench: Bench,
    start: GearStart,
    pub(super) worst: f64,
    deepest: i64,
    /// Records to the depth of a tap.
    depth: u32,
    /// Whether the cursor does not follow the spindle: it is turned by hand, or the tool is free.
    pub(super) is_turned_away: bool,
}

/// Turns behind the turn of a tap.
const SPARE_TURNS: u32 = 10;

impl HeldBench {
    /// A tap of so many turns, without its ramp.
    fn tap(case: ThreadCase, spindle: SpindleSimulation) -> Self {
        Self::tap_reversed_early(case, spindle, 0.0)
    }

    /// A tap whose spindle is reversed by so many turns before the depth.
    fn tap_reversed_early(case: ThreadCase, spindle: SpindleSimulation, early: f64) -> Self {
        let bench = Bench::new(ThreadCase { turns: case.turns + SPARE_TURNS, ..case }, spindle);
        let of = |turns: f64| bench.ramp as u32 + (turns * f64::from(bench.records_per_turn)) as u32;
        let (depth, turn) = (of(f64::from(case.turns)), of(f64::from(case.turns) - early));
        Self { depth, ..Self::with(bench, SpindleControl::Tap(turn)) }
    }

    pub(super) fn with(bench: Bench, control: SpindleControl) -> Self {
        let reverse_share = if control == SpindleControl::Held { 77 } else { 1 << 8 };
        let start = GearStart { reverse_share, control, ..bench.start() };
        Self { bench, start, worst: 0.0, deepest: 0, depth: 0, is_turned_away: false }
    }

    pub(super) fn begin(&mut self, direction: i32) {
        self.bench.begin_with(direction, self.start);
    }

    pub(super) fn request(&mut self, rate: Rate) {
        self.bench.card.send(HostCommand::rate(rate)).expect("a rate");
    }

    /// Sends the records behind of a cursor that goes back.
    fn send_behind(&mut self) {
        while self.bench.card.status().rate < Rate::ZERO
            && self.bench.card.status().low.number() > 0
            && self.send_one_behind()
        {}
    }

    /// Sends a record behind; returns false where there is no room.
    fn send_one_behind(&mut self) -> bool {
        let place = self.bench.card.status().low - 1;
        let increments = [self.bench.increments[place.number() as usize]];
        let record = Record { increments, flags: Flags::GEARED, line: 1, ..Record::default() };
        self.bench.card.send(HostCommand::Behind { place, record, rests: place.number() == 0 }).is_ok()
    }

    /// Runs a period, and checks it.
    pub(super) fn period(&mut self) -> Result<(), SimCardError> {
        self.send_behind();
        let place = self.bench.card.status().place.record.number() as usize;
        let (z, angle) = self.bench.period()?;
        let status = self.bench.card.status();
        assert!((status.counts[0] as f64 - self.bench.position_of_place()).abs() <= 0.51, "{status:?}");
        self.deepest = self.deepest.max(status.counts[0]);
        let end = self.bench.increments.len() - self.bench.ramp - 2;
        if (self.bench.ramp + 2..end).contains(&place) && !self.is_turned_away {
            let turns = z as f64 / self.bench.case.pitch - angle * f64::from(self.direction());
            self.worst = self.worst.max((turns - turns.round()).abs() * self.bench.case.pitch);
        }
        Ok(())
    }

    /// Sends records of the stretch behind of a cursor at its end.
    pub(super) fn send_all_behind(&mut self) {
        while self.bench.card.status().low.number() > 0 && self.send_one_behind() {}
    }

    /// Runs behind the stretch, where no helix is checked.
    pub(super) fn run_to(&mut self, is_so: impl Fn(&retrace_link::CardStatus<1>) -> bool) {
        for _ in 0..20_000 {
            self.bench.card.run_period().expect("no alarm");
            if is_so(self.bench.card.status()) {
                return;
            }
        }
        panic!("it does not come: {:?}", self.bench.card.status());
    }

    /// Direction in which the stretch is passed forward.
    fn direction(&self) -> i32 {
        if self.bench.is_left { -1 } else { 1 }
    }

    pub(super) fn run_until(&mut self, is_so: impl Fn(&retrace_link::CardStatus<1>) -> bool) {
        for _ in 0..120_000 {
            self.period().expect("no alarm");
            if is_so(self.bench.card.status()) {
                return;
            }
        }
        panic!("it does not come: {:?}", self.bench.card.status());
    }

    pub(super) fn spindle(&mut self) -> &mut retrace_hal_sim::SpindlePlant {
        self.bench.card.machine().spindle().expect("a spindle")
    }

    /// Turns the spindle by hand where nothing follows it.
    fn turn_away(&mut self, turns: f64) {
        self.spindle().turn_by_hand(turns);
        self.is_turned_away = true;
        for _ in 0..500 {
            self.period().expect("no alarm");
        }
        self.is_turned_away = false;
    }

    pub(super) fn outputs(&self) -> [i32; 2] {
        [channel::SPINDLE, channel::SPEED].map(|number| self.bench.card.status().outputs[usize::from(number)])
    }

    /// Runs a tap to its end: at rest where it began, exactly, with the spindle as before.
    fn complete(&mut self) {
        self.run_until(|status| status.executed == 1 && status.spindle.gear == GearState::Off);
        let status = *self.bench.card.status();
        assert_eq!((status.counts[0], status.place.record.number(), status.place.fraction), (0, 0, 0));
        assert_eq!(self.outputs(), [self.direction(), (self.bench.case.rpm * 1000.0) as i32]);
        // Its records are not passed at the requested rate.
        for _ in 0..200 {
            self.period().expect("no alarm");
        }
        assert_eq!((self.bench.card.status().counts[0], self.bench.card.status().at_rest), (0, true));
    }

    /// Depth in pulses.
    fn depth(&self) -> i64 {
        self.bench.increments[..self.depth as usize].iter().map(|&n| i64::from(n)).sum()
    }
}

/// Bound of the distance from the groove, in pulses of 1 µm: near standstill edges are rare, and the angle between them
/// is known to some counts only.
pub(super) fn groove_bound(case: &ThreadCase) -> f64 {
    1.0 + 2.25 * case.pitch / f64::from(case.counts)
}

/// The acceptance row: a thousand taps with random speed, load and depth.
#[test]
fn a_thousand_taps_return_to_where_they_began() {
    let number = |name: &str, usual: u64| std::env::var(name).ok().and_then(|n| n.parse().ok()).unwrap_or(usual);
    let (cases, first) = (number("RETRACE_CASES", 1000), number("RETRACE_FIRST_SEED", 1));
    let (mut worst, mut least, mut most) = (0.0f64, i64::MAX, 0);
    for case in 0..cases {
        let mut random = Random::new(first + case);
        let rpm = 200.0 + f64::from(random.up_to(800));
        let turns = 3 + random.up_to(12);
        let [swing, dips] = [random.up_to(20), random.up_to(20)].map(|part| f64::from(part) / 100.0);
        let spindle = SpindleSimulation { swing: [swing, 1.0], dips: [dips, 0.15, 0.7], ..LATHE };
        let mut tap = HeldBench::tap(ThreadCase { pitch: 1000.0, rpm, turns, ..CASE }, spindle);
        tap.begin(if case % 2 == 0 { 1 } else { -1 });
        tap.complete();
        let overrun = tap.deepest - tap.depth();
        (worst, least, most) = (worst.max(tap.worst), least.min(overrun), most.max(overrun));
        assert!(overrun >= 0, "seed {}: turned {overrun} pulses before the depth", first + case);
        assert!(tap.worst <= groove_bound(&tap.bench.case), "seed {}: {} µm", first + case, tap.worst);
    }
    println!("{cases} taps: groove within {worst:.2} µm both ways, turned {least} to {most} µm behind the depth");
}

/// A random tap, a turn in which is 1 mm, whose spindle is reversed by the turns that it needs at 1000 rpm, in
/// proportion to the square of the speed. Returns by how much it turned deeper than programmed, pulses.
fn overrun_of_early_tap(seed: u64, rpm: Option<u32>, reversal_turns: f64) -> i64 {
    let mut random = Random::new(seed);
    let rpm = f64::from(rpm.unwrap_or(200 + random.up_to(800)));
    let turns = 5 + random.up_to(12);
    let [swing, dips] = [random.up_to(5), random.up_to(10)].map(|part| f64::from(part) / 100.0);
    let spindle = SpindleSimulation { swing: [swing, 1.0], dips: [dips, 0.15, 0.7], ..LATHE };
    let early = reversal_turns * (rpm / 1000.0).powi(2);
    let case = ThreadCase { pitch: 1000.0, rpm, turns, ..CASE };
    let mut tap = HeldBench::tap_reversed_early(case, spindle, early);
    tap.begin(if seed.is_multiple_of(2) { 1 } else { -1 });
    tap.complete();
    tap.deepest - tap.depth()
}

/// The acceptance row: reversed early by what the spindle was seen to need, taps turn at their depth or before it.
#[test]
fn taps_that_are_reversed_early_turn_at_their_depth() {
    let number = |name: &str, usual: u64| std::env::var(name).ok().and_then(|n| n.parse().ok()).unwrap_or(usual);
    let (cases, first) = (number("RETRACE_CASES", 1000), number("RETRACE_FIRST_SEED", 1));
    // The longest of a hundred taps, as the report of each tells, and a twentieth more.
    let measured = (0..100).map(|n| overrun_of_early_tap(1_000_000 + n, Some(1000), 0.0)).max().expect("some");
    let reversal_turns = 1.05 * measured as f64 / 1000.0;
    let overruns: Vec<_> = (0..cases).map(|n| overrun_of_early_tap(first + n, None, reversal_turns)).collect();
    let (least, most) = (overruns.iter().min().expect("some"), overruns.iter().max().expect("some"));
    println!("{cases} taps, reversed early by up to {reversal_turns:.3} turns: {least} to {most} µm behind the depth");
    assert!(*most <= 0, "{most} µm too deep");
    assert!(*least >= -600, "{least} µm");
}

/// Held and let go on at random places, a tap and its way out stay in the groove, and end where they began.
#[test]
fn a_tap_that_is_held_fifty_times_rests_in_the_groove() {
    let mut random = Random::new(7);
    let mut tap = HeldBench::tap(ThreadCase { pitch: 1000.0, rpm: 300.0, turns: 40, ..CASE }, STEADY);
    tap.begin(1);
    for _ in 0..50 {
        tap.run_until(|status| status.spindle.gear == GearState::Engaged);
        for _ in 0..random.up_to(200) {
            tap.period().expect("no alarm");
        }
        if tap.bench.card.status().spindle.gear != GearState::Engaged {
            break;
        }
        tap.request(Rate::ZERO);
        tap.run_until(|status| status.at_rest);
        assert_eq!(tap.outputs()[0], 0, "the spindle is off");
        let at = tap.bench.card.status().counts[0];
        assert!(at > 0);
        // Nothing moves while it is held, whoever turns the spindle a little.
        tap.turn_away(0.01);
        tap.turn_away(-0.01);
        assert_eq!(tap.bench.card.status().counts[0], at);
        tap.request(Rate::ONE);
    }
    tap.complete();
    assert!(tap.worst <= groove_bound(&tap.bench.case), "{}", tap.worst);
}

/// Hold, reverse, forward and reverse again, fifty times in a thread: the same helix in every period.
#[test]
fn a_thread_is_run_backward_and_forward_again() {
    for counts in [400, 4096] {
        let case = ThreadCase { turns: 60, counts, ..CASE };
        let worst = turned_round_fifty_times(case);
        println!("50 changes of direction in a thread, {counts} counts: within {worst:.2} µm");
        assert!(worst <= groove_bound(&case), "{counts}: {worst}");
    }
}

/// Returns the largest distance from the groove, in pulses.
fn turned_round_fifty_times(case: ThreadCase) -> f64 {
    let mut random = Random::new(11);
    let mut thread = HeldBench::with(Bench::new(case, STEADY), SpindleControl::Held);
    thread.begin(1);
    for _ in 0..50 {
        thread.run_until(|status| status.spindle.gear == GearState::Engaged);
        let is_far = thread.bench.card.status().place.record.number() as usize > thread.bench.increments.len() / 2;
        let rate = [Rate::ZERO, -Rate::ONE, if is_far { -Rate::ONE } else { Rate::ONE }][random.up_to(2) as usize];
        thread.request(rate);
        for _ in 0..random.up_to(1200) {
            thread.period().expect("no alarm");
        }
        if thread.bench.card.status().spindle.gear == GearState::Waiting {
            // Back at the beginning: it is cut again.
            assert_eq!(thread.bench.card.status().counts[0], 0);
            assert_eq!(thread.outputs(), [1, 1_000_000], "the spindle turns as where it begins");
            thread.request(Rate::ONE);
        }
    }
    thread.request(Rate::ONE);
    thread.run_until(|status| status.spindle.gear == GearState::Off);
    assert_eq!(
        thread.bench.card.status().counts[0],
        thread.bench.increments.iter().map(|&n| i64::from(n)).sum::<i64>()
    );
    thread.worst
}

/// The way out of a tap that an alarm has stopped: by hand, on the helix, exactly to its beginning.
#[test]
fn the_spindle_turned_by_hand_backs_a_tap_out() {
    for is_alarm in [false, true] {
        let mut tap = HeldBench::tap(ThreadCase { pitch: 1000.0, rpm: 300.0, turns: 8, ..CASE }, STEADY);
        tap.bench.card.send(HostCommand::FollowSpindle { on: true }).expect_err("no stretch");
        tap.begin(1);
        tap.run_until(|status| status.counts[0] > 5000);
        tap.bench.card.send(HostCommand::FollowSpindle { on: true }).expect_err("the spindle turns");
        if is_alarm {
            tap.bench.card.machine().set_input(EMERGENCY_STOP, true);
            let alarm = (0..5000).find_map(|_| tap.period().err());
            assert_eq!(alarm, Some(SimCardError::Alarm(Alarm::EmergencyStop)));
            assert_eq!(tap.outputs()[0], 0);
            while !tap.bench.card.status().at_rest {
                let _ = tap.period();
            }
            let refused = tap.bench.card.send(HostCommand::FollowSpindle { on: true });
            assert_eq!(refused, Err(CommandRefusal::Alarm));
            tap.bench.card.machine().set_input(EMERGENCY_STOP, false);
            for _ in 0..50 {
                let _ = tap.period();
            }
            tap.bench.card.send(HostCommand::ClearAlarm).expect("its cause is gone");
        } else {
            tap.request(Rate::ZERO);
            tap.run_until(|status| status.at_rest);
        }
        let stopped = tap.bench.card.status().counts[0];
        // Turned away by more than 5°, it is refused until it is turned back.
        for (turns, is_taken) in [(0.05, false), (-0.05, true)] {
            tap.turn_away(turns);
            assert_eq!(tap.bench.card.status().counts[0], stopped);
            let result = tap.bench.card.send(HostCommand::FollowSpindle { on: true });
            assert_eq!(result.is_ok(), is_taken, "{turns}: {result:?}");
        }
        tap.spindle().turn_by_hand(1.0);
        for _ in 0..3000 {
            tap.period().expect("no alarm");
        }
        assert!((tap.bench.card.status().counts[0] - stopped - 1000).abs() <= 4, "a turn deeper by hand");
        tap.spindle().turn_by_hand(-20.0);
        tap.run_until(|status| status.counts[0] == 0);
        for _ in 0..500 {
            tap.period().expect("no alarm");
        }
        assert_eq!((tap.bench.card.status().counts[0], tap.bench.card.status().at_rest), (0, true));
        assert!(tap.worst <= groove_bound(&tap.bench.case), "{}", tap.worst);
        if !is_alarm {
            // Let go on, it taps again: what was turned meanwhile is none of the way.
            tap.request(Rate::ONE);
            tap.complete();
        }
    }
}

/// An alarm ends following by hand: the axes follow the turn that is in progress, and none after it.
#[test]
fn an_alarm_ends_following_by_hand() {
    let mut tap = HeldBench::tap(ThreadCase { pitch: 1000.0, rpm: 300.0, turns: 8, ..CASE }, STEADY);
    tap.begin(1);
    tap.run_until(|status| status.counts[0] > 5000);
    tap.request(Rate::ZERO);
    tap.run_until(|status| status.at_rest);
    tap.bench.card.send(HostCommand::FollowSpindle { on: true }).expect("it rests");
    tap.spindle().turn_by_hand(-1.0);
    for _ in 0..500 {
        tap.period().expect("no alarm");
    }
    tap.bench.card.machine().set_input(EMERGENCY_STOP, true);
    for _ in 0..5000 {
        let _ = tap.period();
    }
    let rests = tap.bench.card.status().counts[0];
    assert!(tap.bench.card.status().at_rest);
    tap.bench.card.machine().set_input(EMERGENCY_STOP, false);
    for is_cleared in [false, true] {
        if is_cleared {
            tap.bench.card.send(HostCommand::ClearAlarm).expect("its cause is gone");
        }
        tap.spindle().turn_by_hand(-0.5);
        for _ in 0..3000 {
            let _ = tap.bench.card.run_period();
            assert_eq!(tap.bench.card.status().counts[0], rests, "cleared: {is_cleared}");
        }
    }
}

/// Following by hand ends where the spindle is switched on again: held once more, a turn by hand moves nothing.
#[test]
fn a_spindle_that_is_switched_on_ends_following_by_hand() {
    let mut tap = HeldBench::tap(ThreadCase { pitch: 1000.0, rpm: 300.0, turns: 20, ..CASE }, STEADY);
    tap.begin(1);
    tap.run_until(|status| status.counts[0] > 5000);
    tap.request(Rate::ZERO);
    tap.run_until(|status| status.at_rest);
    tap.bench.card.send(HostCommand::FollowSpindle { on: true }).expect("it rests");
    tap.spindle().turn_by_hand(-0.5);
    for _ in 0..3000 {
        tap.period().expect("no alarm");
    }
    let backed = tap.bench.card.status().counts[0];
    tap.request(Rate::ONE);
    tap.run_until(|status| status.counts[0] > backed + 2000);
    tap.request(Rate::ZERO);
    tap.run_until(|status| status.at_rest);
    let rests = tap.bench.card.status().counts[0];
    tap.turn_away(0.05);
    assert_eq!(tap.bench.card.status().counts[0], rests);
    tap.turn_away(-0.05);
    tap.request(Rate::ONE);
    tap.complete();
}

/// What ends a tap early is an alarm with the spindle off: a drive that does not reverse it in time, an encoder that
/// dies at the turn, a spindle that does not start again.
#[test]
fn a_tap_that_does_not_turn_is_an_alarm() {
    let case = ThreadCase { pitch: 1000.0, rpm: 600.0, turns: 4, ..CASE };
    let alarm_of = |tap: &mut HeldBench| {
        let alarm = (0..40_000).find_map(|_| tap.period().err());
        assert_eq!(tap.outputs()[0], 0);
        alarm
    };
    // Ten turns are gone before a drive of 100 rpm/s stands.
    let mut slow = HeldBench::tap(case, SpindleSimulation { acceleration: 100.0, ..STEADY });
    slow.begin(1);
    assert_eq!(alarm_of(&mut slow), Some(SimCardError::Alarm(Alarm::ThreadLost)));
    let mut dead = HeldBench::tap(case, STEADY);
    dead.begin(1);
    let depth = dead.depth();
    dead.run_until(|status| status.counts[0] > depth);
    dead.spindle().kill_encoder();
    let alarm = alarm_of(&mut dead);
    let is_one = |of| alarm == Some(SimCardError::Alarm(of));
    assert!(is_one(Alarm::EncoderFailed) || is_one(Alarm::ThreadLost), "{alarm:?}");
    let mut stuck = HeldBench::tap(case, STEADY);
    stuck.begin(1);
    stuck.run_until(|status| status.counts[0] > 2000);
    stuck.request(Rate::ZERO);
    stuck.run_until(|status| status.at_rest);
    stuck.spindle().set_stalled(true);
    stuck.request(Rate::ONE);
    assert_eq!(alarm_of(&mut stuck), Some(SimCardError::Alarm(Alarm::NotAtSpeed)));
}

/// A thread that is held so close to its end that the spindle coasts out of it: the spindle stays off while it is held.
/// Let go on, it turns again, and nothing moves before it is at speed.
#[test]
fn a_spindle_that_coasts_out_of_a_thread_turns_again_before_anything_moves() {
    let mut thread = HeldBench::with(Bench::new(ThreadCase { turns: 20, ..CASE }, STEADY), SpindleControl::Held);
    thread.begin(1);
    let end = thread.bench.increments.len();
    thread.run_until(|status| status.place.record.number() as usize > end - 60);
    thread.request(Rate::ZERO);
    thread.run_until(|status| status.spindle.gear == GearState::Off);
    for record in 0..500 {
        let (place, record) =
            (thread.bench.card.status().high, Record { increments: [record % 5], ..Record::default() });
        thread.bench.card.send(HostCommand::Ahead { place, record }).expect("a record behind the thread");
    }
    let left = thread.bench.card.status().counts[0];
    let still = |thread: &mut HeldBench, periods| {
        for _ in 0..periods {
            thread.bench.card.run_period().expect("no alarm");
            assert_eq!((thread.outputs()[0], thread.bench.card.status().counts[0]), (0, left));
        }
    };
    still(&mut thread, 3000);
    thread.request(Rate::ONE);
    let mut turning = 0;
    while thread.bench.card.status().counts[0] == left {
        thread.bench.card.run_period().expect("no alarm");
        turning += i32::from(thread.outputs()[0] == 1);
        assert!(turning < 3000, "it does not go on");
    }
    let rpm = thread.spindle().speed_rpm();
    assert!(rpm > 700.0 && turning > 100, "it moves at {rpm} after {turning} periods");
}

/// The emergency stop anywhere in a tap or a thread: the spindle stays off, also where it coasts over the depth or out
/// of the thread, and after the alarm is cleared: it is the operator's then.
#[test]
fn an_emergency_stop_in_a_tap_leaves_the_spindle_off() {
    let case = ThreadCase { pitch: 1000.0, rpm: 600.0, turns: 4, ..CASE };
    let depth = HeldBench::tap(case, STEADY).depth();
    let presses = [100, 2000, depth - 900, depth - 300, depth - 10, depth, depth + 10, depth + 200];
    for (pressed, is_tap) in presses.map(|pressed| (pressed, true)).into_iter().chain([(4000, false), (4300, false)]) {
        let mut tap = if is_tap {
            HeldBench::tap(case, STEADY)
        } else {
            HeldBench::with(Bench::new(case, STEADY), SpindleControl::Held)
        };
        tap.begin(1);
        tap.run_until(|status| status.counts[0] >= pressed);
        tap.bench.card.machine().set_input(EMERGENCY_STOP, true);
        let alarm = (0..500).find_map(|_| tap.period().err());
        assert_eq!(alarm, Some(SimCardError::Alarm(Alarm::EmergencyStop)));
        let stays_off = |tap: &mut HeldBench| {
            for _ in 0..4000 {
                let _ = tap.period();
                assert_eq!(tap.outputs()[0], 0, "pressed at {pressed}");
            }
            assert!(tap.bench.card.status().at_rest, "pressed at {pressed}");
            tap.bench.card.status().counts[0]
        };
        let stopped = stays_off(&mut tap);
        tap.bench.card.machine().set_input(EMERGENCY_STOP, false);
        stays_off(&mut tap);
        tap.bench.card.send(HostCommand::ClearAlarm).expect("its cause is gone");
        for rate in [Rate::ONE, -Rate::ONE] {
            tap.request(rate);
            assert_eq!(stays_off(&mut tap), stopped, "pressed at {pressed}");
        }
    }
}
