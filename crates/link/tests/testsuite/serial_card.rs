//! A card on a serial line, as the controller uses it, over a port in virtual time.

use crate::works::{WINDOW, Works, limits, record};
use retrace_core::{Place, Rate, RecordIndex};
use retrace_link::{
    Alarm, BytePort, CardEndpoint, CardFailure, CardSettings, HostCommand, Instruction, LinkError, LinkTimeouts,
    LinkedCard, LinkedCardError, MotionCard, OutputChange, PathStart,
};

/// The cable is not plugged in.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Unplugged;

impl core::fmt::Display for Unplugged {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("unplugged")
    }
}

impl CardFailure for Unplugged {
    fn number(&self) -> &'static str {
        "E3001"
    }
    fn remedy(&self) -> &'static str {
        "plug it in"
    }
}

/// A port with the card at its other end; each microsecond that is waited for passes.
#[derive(Debug)]
struct LoopPort {
    end: CardEndpoint<3, 256>,
    works: Works,
    now: u64,
    /// Whether the card answers.
    answers: bool,
    /// Whether reading and writing fail.
    gone: bool,
    /// Whether a port that is gone comes back.
    revives: bool,
    /// Bytes that one write accepts at most.
    accepts: usize,
    writable: usize,
    written: usize,
    /// Frames that the card still sends, and when the last one arrived.
    frames: usize,
    last: u64,
}

impl LoopPort {
    fn new() -> Self {
        Self {
            end: CardEndpoint::new(),
            works: Works::new(),
            now: 5_000_000,
            answers: true,
            gone: false,
            revives: false,
            accepts: 7,
            writable: 40,
            written: 0,
            frames: usize::MAX,
            last: 0,
        }
    }
}

impl BytePort for LoopPort {
    type Fault = Unplugged;

    fn now_us(&self) -> u64 {
        self.now
    }

    fn writable_bytes(&mut self) -> usize {
        self.writable
    }

    fn write(&mut self, bytes: &[u8]) -> Result<usize, Unplugged> {
        if self.gone {
            return Err(Unplugged);
        }
        assert!(!bytes.is_empty() && bytes.len() <= self.writable);
        let count = bytes.len().min(self.accepts);
        self.written += count;
        if self.answers {
            bytes[..count].iter().for_each(|&byte| self.end.receive(byte, &mut self.works));
        }
        Ok(count)
    }

    fn read(&mut self, bytes: &mut [u8], wait_us: u32) -> Result<usize, Unplugged> {
        // a period of the card in each millisecond that is waited for
        let wait = u64::from(wait_us);
        self.now += wait;
        if wait > 0 {
            self.works.period();
            self.end.push_period(&self.works.status);
        }
        if self.gone {
            return Err(Unplugged);
        }
        if !self.answers {
            return Ok(0);
        }
        for (count, byte) in bytes.iter_mut().enumerate() {
            let byte = core::slice::from_mut(byte);
            if self.frames == 0 || self.end.transmit(&self.works, byte) == 0 {
                return Ok(count);
            }
            if byte[0] == 0 {
                (self.frames, self.last) = (self.frames - 1, self.now);
            }
        }
        Ok(bytes.len())
    }

    fn revive(&mut self) -> bool {
        self.gone &= !self.revives;
        !self.gone
    }
}

type Linked = LinkedCard<3, LoopPort>;

fn settings() -> CardSettings<3> {
    CardSettings { report_periods: 2, ..CardSettings::new(0, PathStart::at(RecordIndex::new(50)), 1000, limits()) }
}

fn connected() -> Linked {
    Linked::connect(LoopPort::new(), 9, LinkTimeouts::default()).expect("it answers")
}

fn opened() -> Linked {
    let mut card = connected();
    card.open(settings()).expect("it opens");
    card
}

fn run(card: &mut Linked, periods: usize) {
    for _ in 0..periods {
        card.run_period().expect("no error");
    }
}

#[test]
fn a_card_is_connected_opened_run_and_closed() {
    let mut card = connected();
    assert_eq!(card.greeting().map(|greeting| greeting.identity.serial), Some(77));
    card.open(settings()).expect("it opens");
    assert!(card.host().is_open() && card.port().works.open);
    assert_eq!(card.window(), WINDOW);
    for place in 50..60 {
        let place = RecordIndex::new(place);
        card.send(HostCommand::Ahead { place, record: record(place.number()) }).expect("room");
    }
    assert_eq!((card.status().high, card.acknowledged_high()), (RecordIndex::new(60), RecordIndex::new(50)));
    card.send(HostCommand::rate(Rate::ONE)).expect("a rate");
    let period = card.status().period;
    run(&mut card, 1);
    assert_eq!(card.status().period, period + 1);
    run(&mut card, 60);
    assert_eq!(card.acknowledged_high(), RecordIndex::new(60));
    assert_eq!(card.run_period().map(|status| status.place), Ok(Place::start_of(RecordIndex::new(60))));
    card.send(HostCommand::ManualOutput(OutputChange { channel: 3, value: 1 })).expect("room");
    run(&mut card, 30);
    assert_eq!((card.status().outputs[3], card.status().counts), (1, card.port().works.status.counts));
    // through a reference, as the controller holds it
    let mut reference = &mut card;
    let place = RecordIndex::new(60);
    assert_eq!(MotionCard::window(&reference), WINDOW);
    assert_eq!(
        (MotionCard::acknowledged_high(&reference), MotionCard::status(&reference).low),
        (place, settings().start.place.record)
    );
    MotionCard::send(&mut reference, HostCommand::ManualOutput(OutputChange { channel: 3, value: 2 })).expect("room");
    for _ in 0..30 {
        MotionCard::run_period(&mut reference).expect("no error");
    }
    assert_eq!(card.port().works.by_hand, [1, 2]);
    let at = PathStart::at(place);
    let mut reference = &mut card;
    MotionCard::begin_path(&mut reference, at).expect("a new path");
    assert_eq!(card.port().end.epoch(), 2);
    card.close().expect("it closes");
    assert!(!card.port().works.open && card.into_port().end.epoch() == 0);
}

#[test]
fn a_card_that_does_not_answer_is_silent() {
    let patience = LinkTimeouts { answer_us: 30_000, silence_us: 50_000, rest_us: 90_000 };
    let mut port = LoopPort::new();
    port.answers = false;
    let error = Linked::connect(port, 9, patience).err();
    assert_eq!(error, Some(LinkedCardError::Host(LinkError::Silent)));
    let mut port = LoopPort::new();
    port.gone = true;
    assert_eq!(Linked::connect(port, 9, patience).err(), Some(LinkedCardError::Port(Unplugged)));
    // until then, each is waited for as long as it says, to the millisecond
    let mut card = Linked::connect(LoopPort::new(), 9, patience).expect("it answers");
    card.open(settings()).expect("it opens");
    run(&mut card, 20);
    let begun = card.port().now;
    card.port_mut().answers = false;
    assert_eq!(card.request_greeting(10), Err(LinkedCardError::Host(LinkError::Silent)));
    assert_eq!(card.port().now - begun, 31_000);
    let mut card = Linked::connect(LoopPort::new(), 9, patience).expect("it answers");
    card.open(settings()).expect("it opens");
    run(&mut card, 20);
    card.port_mut().answers = false;
    let begun = card.port().now - card.host().silent_us();
    let error = loop {
        if let Err(error) = card.run_period() {
            break error;
        }
    };
    assert_eq!((error, card.port().now - begun), (LinkedCardError::Host(LinkError::Silent), 51_000));
}

#[test]
fn an_epoch_without_a_period_times_out() {
    let patience = LinkTimeouts { answer_us: 30_000, silence_us: 50_000, rest_us: 90_000 };
    let mut card = Linked::connect(LoopPort::new(), 9, patience).expect("it answers");
    card.port_mut().answers = false;
    let begun = card.port().now;
    assert_eq!(card.open(settings()), Err(LinkedCardError::Host(LinkError::Silent)));
    assert_eq!(card.port().now - begun, 31_000);
}

/// The first report has more outputs than fit, and the card is silent after it.
#[test]
fn an_epoch_whose_first_period_is_late_times_out() {
    let patience = LinkTimeouts { answer_us: 30_000, silence_us: 50_000, rest_us: 90_000 };
    let mut card = Linked::connect(LoopPort::new(), 9, patience).expect("it answers");
    let port = card.port_mut();
    port.works.status.outputs = [i32::MAX; retrace_link::channel::COUNT];
    // the answer to the opening, and a report
    port.frames = 2;
    assert_eq!(card.open(settings()), Err(LinkedCardError::Host(LinkError::Silent)));
    assert!(card.host().is_open());
    assert_eq!(card.port().now - card.port().last, 31_000);
}

#[test]
fn a_cable_that_is_plugged_in_again_changes_nothing() {
    let mut card = opened();
    run(&mut card, 20);
    card.port_mut().gone = true;
    card.port_mut().revives = true;
    run(&mut card, 200);
    assert!(!card.port().gone);
    // one that stays away is the error in the end
    card.port_mut().revives = false;
    card.port_mut().gone = true;
    let error = loop {
        if let Err(error) = card.run_period() {
            break error;
        }
    };
    assert_eq!(error, LinkedCardError::Port(Unplugged));
}

#[test]
fn a_port_without_room_accepts_later() {
    let mut card = opened();
    card.port_mut().accepts = 0;
    card.send(HostCommand::ManualOutput(OutputChange { channel: 3, value: 1 })).expect("room");
    run(&mut card, 100);
    assert_eq!(card.port().works.by_hand, []);
    card.port_mut().accepts = 1;
    run(&mut card, 200);
    assert_eq!(card.port().works.by_hand, [1]);
    card.port_mut().writable = 0;
    let written = card.port().written;
    run(&mut card, 10);
    assert_eq!(card.port().written, written);
}

#[test]
fn a_host_that_gives_up_stops_the_card() {
    let mut card = opened();
    for place in 50..150 {
        let place = RecordIndex::new(place);
        let _ = card.send(HostCommand::Ahead { place, record: record(place.number()) });
    }
    card.send(HostCommand::rate(Rate::ONE / 4)).expect("a rate");
    run(&mut card, 60);
    assert_eq!(card.port().works.target, Rate::ONE / 4);
    card.port_mut().works.status.counts[0] += 1;
    let error = loop {
        if let Err(error) = card.run_period() {
            break error;
        }
    };
    assert_eq!(error, LinkedCardError::Host(LinkError::StateMismatch));
    assert_eq!(card.port().works.target, Rate::ZERO, "it was told to stop");
    let begun = card.port().now;
    assert_eq!(card.run_period().err(), Some(error));
    assert_eq!(card.port().now - begun, 40_000);
    assert_eq!(card.begin_path(settings().start), Err(error), "a new path does not help");
}

#[test]
fn a_new_path_begins_where_the_card_is() {
    let start = PathStart { executed: 4, ..PathStart::at(RecordIndex::new(80)) };
    assert_eq!(connected().begin_path(start), Err(LinkedCardError::Host(LinkError::SettingsRejected)));
    // an instruction that is executed meanwhile counts
    let mut card = opened();
    run(&mut card, 20);
    card.send(HostCommand::Instruction(Instruction { number: 1, ..Instruction::default() })).expect("room");
    card.begin_path(start).expect("a new path");
    assert_eq!((card.status().executed, card.status().place), (5, start.place));
    assert_eq!((card.port().works.status.executed, card.port().end.epoch()), (5, 2));
    assert_eq!(card.host().status().low, RecordIndex::new(80));
    // a machine that has moved since is not where the path begins
    let mut card = opened();
    for place in 50..60 {
        let place = RecordIndex::new(place);
        card.send(HostCommand::Ahead { place, record: record(place.number()) }).expect("room");
    }
    run(&mut card, 60);
    card.send(HostCommand::rate(Rate::ONE)).expect("a rate");
    assert_eq!(card.begin_path(start), Err(LinkedCardError::Host(LinkError::Moved)));
    assert_eq!(card.port().end.epoch(), 1);
    // an alarm is not in the way
    let mut card = opened();
    card.port_mut().works.status.alarm = Some(Alarm::DoorOpen);
    let error = loop {
        if let Err(error) = card.run_period() {
            break error;
        }
    };
    assert_eq!(error, LinkedCardError::Host(LinkError::Alarm(Alarm::DoorOpen)));
    card.begin_path(start).expect("a new path");
}

#[test]
fn a_host_that_resumes_waits_until_no_other_can_move_the_card() {
    // at rest, and nobody is there
    let mut card = connected();
    card.wait_at_rest(20).expect("at rest");
    // another host's epoch is open
    let mut card = opened();
    card.request_greeting(19).expect("it answers");
    let begun = card.port().now;
    assert_eq!(card.wait_at_rest(20), Err(LinkedCardError::Host(LinkError::NotAtRest)));
    assert!(card.port().now - begun > LinkTimeouts::default().rest_us);
    // its watchdog has latched the alarm
    let mut card = opened();
    card.port_mut().works.status.alarm = Some(Alarm::HostSilent);
    card.request_greeting(19).expect("it answers");
    card.wait_at_rest(20).expect("at rest");
    assert_eq!(card.greeting().and_then(|greeting| greeting.alarm), Some(Alarm::HostSilent));
    // it brakes first
    let mut card = connected();
    let works = &mut card.port_mut().works;
    works.status.high = RecordIndex::new(100);
    works.records = vec![record(7); WINDOW as usize];
    works.target = Rate::ONE;
    card.request_greeting(19).expect("it answers");
    assert!(!card.greeting().is_some_and(|greeting| greeting.at_rest));
    card.wait_at_rest(20).expect("at rest");
    assert!(card.greeting().is_some_and(|greeting| greeting.at_rest));
}

/// A line that nothing can reopen, as a port is that says nothing about it.
struct FixedPort(LoopPort);

impl BytePort for FixedPort {
    type Fault = Unplugged;

    fn now_us(&self) -> u64 {
        self.0.now_us()
    }

    fn writable_bytes(&mut self) -> usize {
        self.0.writable_bytes()
    }

    fn write(&mut self, bytes: &[u8]) -> Result<usize, Unplugged> {
        self.0.write(bytes)
    }

    fn read(&mut self, bytes: &mut [u8], wait_us: u32) -> Result<usize, Unplugged> {
        self.0.read(bytes, wait_us)
    }
}

#[test]
fn a_port_that_cannot_be_reopened_stays_gone() {
    let mut port = FixedPort(LoopPort { gone: true, ..LoopPort::new() });
    assert!(!port.revive() && port.read(&mut [0], 0) == Err(Unplugged));
}
