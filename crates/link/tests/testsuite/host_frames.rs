//! The host's endpoint alone, frame by frame: its numbers begin anywhere and cross the wrap, and its times are exact.

use crate::works::{STARTS, WINDOW, Works, limits, record};
use retrace_core::drive::{Drive, RecordWindow};
use retrace_core::limits::{PulseLimits, RateLimits};
use retrace_core::{Distance, Place, RapidCap, Rate, RateTarget, RecordIndex};
use retrace_link::frame::{FrameDecoder, MAX_PAYLOAD, MAX_WIRE, encode_with_key};
use retrace_link::sequence::FirstNumbers;
use retrace_link::wire::{ByteReader, ByteWriter, Greeting, Opening, RecordRun, ReportEntry, kind, read_command};
use retrace_link::{
    Alarm, CardSettings, CommandRefusal, CutterOff, CutterOffCause, HomingCommand, HostCommand, HostEndpoint,
    Instruction, LinkError, OutputChange, PROTOCOL, PathStart, ProbeEdge, ProbeLatch, RepeatedInstruction, channel,
    counts_at_edge, next_epoch, session_key, state_crc,
};

const NONCE: u32 = 7;
const BOOT: u32 = 0xB007;
const START: u32 = 50;

/// A frame of the host; numbers count from the first ones.
#[derive(Clone, Debug, PartialEq)]
enum Sent {
    Hello(u32),
    Open { boot: u32, nonce: u32, epoch: u16 },
    Stream { entry: u16, number: u16, commands: Vec<HostCommand<3>> },
    Rate { entry: u16, number: u16, feed: i64 },
    Nak { entry: u16 },
    Close(u32),
}

/// What the card writes in a report.
#[derive(Clone, Copy, Default)]
struct Report<'e> {
    next_command: u16,
    rate: u16,
    flags: u8,
    /// The window, from [`START`] on.
    low: u32,
    length: u32,
    first: u16,
    entries: &'e [ReportEntry],
    /// Changed bits of the check.
    wrong: u32,
}

const GAP: u8 = 1;
const ALL: u8 = 2;
const LOST: u8 = 4;

struct HostBench {
    host: Box<HostEndpoint<3>>,
    numbers: FirstNumbers,
    last_epoch: u16,
    epoch: u16,
    key: u32,
    now: u64,
    /// Records of the card's window.
    window: u32,
    limits: RateLimits<3>,
}

fn ran(distance: Distance, count: u32) -> ReportEntry {
    ReportEntry::Ran { distance, count, starved: false, at_rest: distance == Distance::ZERO }
}

const REST: ReportEntry = ReportEntry::Ran { distance: Distance::ZERO, count: 1, starved: false, at_rest: true };

impl HostBench {
    fn unconnected((numbers, last_epoch): (FirstNumbers, u16)) -> Self {
        let epoch = next_epoch(last_epoch);
        let host = Box::new(HostEndpoint::starting_at(NONCE, numbers));
        Self {
            host,
            numbers,
            last_epoch,
            epoch,
            key: session_key(BOOT, !NONCE, epoch),
            now: 1_000_000,
            window: WINDOW,
            limits: limits(),
        }
    }

    /// A host whose epoch is open, whose first report has arrived, and which has nothing to send for now.
    fn new(start: (FirstNumbers, u16)) -> Self {
        Self::connected(Self::unconnected(start))
    }

    fn connected(mut bench: Self) -> Self {
        assert_eq!(bench.frames(), [Sent::Hello(NONCE)]);
        bench.greet(NONCE, BOOT, 0);
        bench.host.open(CardSettings::new(0, PathStart::at(RecordIndex::new(START)), 1000, bench.limits));
        assert_eq!(bench.frames(), [Sent::Open { boot: BOOT, nonce: !NONCE, epoch: bench.epoch }]);
        assert!(!bench.host.is_open());
        bench.report(Report { entries: &[REST], flags: ALL, ..Report::default() });
        assert!(bench.host.is_open() && bench.host.next_period() && !bench.host.next_period());
        assert_eq!(bench.host.fault(), None);
        bench.now += 16_000;
        assert_eq!(bench.frames(), [Sent::Rate { entry: 1, number: 0, feed: 0 }], "the sign of life");
        bench
    }

    /// The frames that are due.
    fn frames(&mut self) -> Vec<Sent> {
        let mut bytes = [0; 8192];
        let count = self.host.transmit(self.now, &mut bytes);
        assert_eq!(self.host.transmit(self.now, &mut [0; 512]), 0, "once");
        let mut decoder = FrameDecoder::<MAX_PAYLOAD>::new();
        decoder.set_key(self.key);
        let mut frames = Vec::new();
        for &byte in &bytes[..count] {
            if let Some(payload) = decoder.push(byte) {
                let payload = payload.expect("undamaged").to_vec();
                frames.push(self.parse(&mut ByteReader::new(&payload), decoder.has_key()).expect("a frame"));
            }
        }
        frames
    }

    fn parse(&self, r: &mut ByteReader<'_>, has_key: bool) -> Option<Sent> {
        let kind = r.u8()?;
        assert_eq!(has_key, !matches!(kind, kind::HELLO | kind::OPEN));
        if has_key {
            assert_eq!(r.u16()?, self.epoch);
        }
        let entry = |r: &mut ByteReader<'_>| Some(r.u16()?.wrapping_sub(self.numbers.entry));
        let sent = match kind {
            kind::HELLO => Sent::Hello(r.u32()?),
            kind::OPEN => {
                let (boot, nonce) = (r.u32()?, r.u32()?);
                Sent::Open { boot, nonce, epoch: Opening::<3>::read(r)?.0.epoch }
            }
            kind::STREAM => {
                let (entry, number) = (entry(r)?, r.u16()?.wrapping_sub(self.numbers.command));
                let (mut commands, mut run) = (Vec::new(), RecordRun::new(3));
                while !r.is_empty() {
                    commands.push(read_command(r, &mut run)?);
                }
                Sent::Stream { entry, number, commands }
            }
            kind::CLOSE => Sent::Close(r.u32()?),
            _ => {
                let (entry, number) = (entry(r)?, r.u16()?.wrapping_sub(self.numbers.rate));
                let (feed, _) = (r.signed()?, r.signed()?);
                if kind == kind::RATE { Sent::Rate { entry, number, feed } } else { Sent::Nak { entry } }
            }
        };
        assert!(r.is_empty());
        Some(sent)
    }

    fn frame(&mut self, key: u32, write: impl FnOnce(&mut ByteWriter<'_>) -> Option<()>) {
        let mut payload = [0; MAX_PAYLOAD];
        let mut writer = ByteWriter::new(&mut payload);
        write(&mut writer).expect("room");
        let length = writer.len();
        let mut wire = [0; MAX_WIRE];
        let bytes = encode_with_key(&payload[..length], &mut wire, key).expect("it fits");
        self.host.receive(bytes, self.now);
    }

    fn greet(&mut self, nonce: u32, boot: u32, epoch: u16) {
        self.greet_as(nonce, boot, epoch, true);
    }

    fn greet_as(&mut self, nonce: u32, boot: u32, epoch: u16, at_rest: bool) {
        let works = Works::new();
        let mut identity = works.identity;
        (identity.boot, identity.window) = (boot, self.window);
        let status = works.status;
        let greeting = Greeting::<3> {
            nonce,
            identity,
            epoch,
            last_epoch: self.last_epoch,
            place: status.place,
            at_rest,
            reached: status.reached,
            executed: 0,
            counts: [0; 3],
            layer: (0, 0),
            alarm: None,
        };
        self.frame(0, |w| {
            w.u8(kind::WELCOME)?;
            greeting.write(w)
        });
    }

    fn report(&mut self, report: Report<'_>) {
        let (epoch, key) = (self.epoch, self.key);
        self.report_of(epoch, key, report);
    }

    fn report_of(&mut self, epoch: u16, key: u32, report: Report<'_>) {
        // the check is that of a machine that does not move
        let crc = state_crc(Place::start_of(RecordIndex::new(START)), &[0; 3], 3) ^ report.wrong;
        let numbers = self.numbers;
        self.frame(key, |w| {
            w.u8(kind::REPORT)?;
            w.u16(epoch)?;
            w.u16(numbers.command.wrapping_add(report.next_command))?;
            w.u16(numbers.rate.wrapping_add(report.rate))?;
            w.u8(report.flags)?;
            w.u32(START + report.low)?;
            w.count(u64::from(report.length))?;
            w.u16(numbers.entry.wrapping_add(report.first))?;
            report.entries.iter().try_for_each(|entry| entry.write(w))?;
            if report.flags & ALL != 0 { w.u32(crc) } else { Some(()) }
        });
    }

    fn ahead(&mut self, offset: u32) -> HostCommand<3> {
        let place = RecordIndex::new(START + offset);
        HostCommand::Ahead { place, record: record(place.number()) }
    }

    fn send_ahead(&mut self, offset: u32) {
        let command = self.ahead(offset);
        self.host.send(command).expect("room");
    }

    fn status_window(&self) -> (u32, u32) {
        let status = self.host.status();
        (status.low.number() - START, status.high.number() - START)
    }

    /// Frames after this many microseconds.
    fn after(&mut self, us: u64) -> Vec<Sent> {
        self.now += us;
        self.frames()
    }
}

fn output(value: i32) -> HostCommand<3> {
    HostCommand::ManualOutput(OutputChange { channel: 3, value })
}

fn stream(number: u16, commands: &[HostCommand<3>]) -> Sent {
    Sent::Stream { entry: 1, number, commands: commands.to_vec() }
}

fn rate(number: u16, feed: Rate) -> Sent {
    Sent::Rate { entry: 1, number, feed: feed.units() }
}

#[test]
fn a_greeting_is_requested_until_its_own_answer_arrives() {
    let mut bench = HostBench::unconnected(STARTS[0]);
    assert_eq!(bench.frames(), [Sent::Hello(NONCE)]);
    assert_eq!(bench.after(19_999), []);
    assert_eq!(bench.after(1), [Sent::Hello(NONCE)]);
    bench.greet(NONCE + 1, BOOT, 0);
    assert!(bench.host.greeting().is_none(), "the answer to another request");
    bench.greet(NONCE, BOOT, 3);
    bench.greet(NONCE, BOOT + 1, 4);
    let greeting = bench.host.greeting().expect("answered");
    assert_eq!((greeting.identity.boot, greeting.epoch), (BOOT, 3), "the first answer counts");
    bench.host.request_greeting(0);
    assert!(bench.host.greeting().is_none());
    assert_eq!(bench.after(1), [Sent::Hello(1)], "at once, and never 0");
}

#[test]
fn a_version_is_refused_only_while_a_greeting_is_requested() {
    let other = |bench: &mut HostBench| bench.frame(0, |w| w.slice(&[kind::WELCOME, PROTOCOL + 1, 1, 2, 3]));
    let mut bench = HostBench::unconnected(STARTS[0]);
    other(&mut bench);
    assert_eq!(bench.host.fault(), Some(LinkError::Protocol(PROTOCOL + 1)));
    let mut bench = HostBench::new(STARTS[0]);
    other(&mut bench);
    assert_eq!(bench.host.fault(), None);
}

#[test]
fn an_opening_is_repeated_until_the_card_has_opened_or_refused() {
    for start in STARTS {
        let opening = || {
            let mut bench = HostBench::unconnected(start);
            bench.frames();
            bench.greet(NONCE, BOOT, 0);
            bench.host.open(CardSettings::new(0, PathStart::at(RecordIndex::new(START)), 1000, limits()));
            let open = Sent::Open { boot: BOOT, nonce: !NONCE, epoch: bench.epoch };
            assert_eq!(bench.frames(), core::slice::from_ref(&open));
            assert_eq!(bench.after(19_999), []);
            assert_eq!(bench.after(1), [open], "{start:?}");
            bench
        };
        // opened by the answer; the first report is still to come
        let mut bench = opening();
        let epoch = bench.epoch;
        bench.greet(!NONCE + 1, BOOT, epoch);
        assert_eq!(bench.after(19_999), [], "the answer to another opening");
        bench.greet(!NONCE, BOOT, epoch);
        assert!(!bench.host.is_open() && bench.host.fault().is_none());
        assert_eq!(bench.after(1), [Sent::Rate { entry: 0, number: 0, feed: 0 }], "{start:?}: it is open");
        // another start of the card
        let mut bench = opening();
        bench.greet(!NONCE, BOOT + 1, epoch);
        assert_eq!(bench.host.fault(), Some(LinkError::Restarted));
        // refused: answered three times, at rest, without that epoch
        let mut bench = opening();
        for _ in 0..5 {
            bench.greet_as(!NONCE, BOOT, 0, false);
            bench.greet(!NONCE + 1, BOOT, 0);
        }
        bench.greet(!NONCE, BOOT, 0);
        bench.greet(!NONCE, BOOT, 0);
        assert_eq!(bench.host.fault(), None);
        bench.greet(!NONCE, BOOT, 0);
        assert_eq!(bench.host.fault(), Some(LinkError::SettingsRejected), "{start:?}");
    }
}

/// The answer to an opening is a sign of life while the epoch is not open yet, and none after that.
#[test]
fn the_card_is_silent_since_its_last_answer() {
    for start in STARTS {
        let mut bench = HostBench::unconnected(start);
        bench.frames();
        bench.greet(NONCE, BOOT, 0);
        bench.host.open(CardSettings::new(0, PathStart::at(RecordIndex::new(START)), 1000, limits()));
        bench.frames();
        bench.after(7_000);
        bench.greet_as(!NONCE, BOOT, 0, false);
        assert_eq!(bench.host.silent_us(), 0, "an answer to the opening");
        bench.after(7_000);
        bench.greet_as(!NONCE + 1, BOOT, 0, false);
        assert_eq!(bench.host.silent_us(), 7_000, "an answer to another opening");
        let epoch = bench.epoch;
        bench.greet(!NONCE, BOOT, epoch);
        bench.after(5_000);
        bench.greet(!NONCE, BOOT, epoch);
        assert_eq!(bench.host.silent_us(), 5_000, "a second answer, of a card that is open");
    }
}

#[test]
fn only_reports_of_this_epoch_are_processed() {
    for start in STARTS {
        let mut bench = HostBench::new(start);
        let (epoch, key) = (bench.epoch, bench.key);
        let report = Report { first: 1, entries: &[ReportEntry::Inputs(9), REST], flags: ALL, ..Report::default() };
        bench.report_of(epoch.wrapping_add(1), key, report);
        bench.report_of(epoch.wrapping_sub(1), key, report);
        bench.report_of(epoch, session_key(BOOT, NONCE, epoch), report);
        bench.report_of(epoch, 0, report);
        assert!(!bench.host.next_period(), "{start:?}");
        bench.report(report);
        assert!(bench.host.next_period() && bench.host.status().inputs == 9);
    }
}

#[test]
fn a_rate_is_sent_until_its_number_is_acknowledged() {
    for start in STARTS {
        let mut bench = HostBench::new(start);
        bench.host.send(HostCommand::rate(Rate::ONE)).expect("a rate");
        assert!(!bench.host.is_acknowledged());
        assert_eq!(bench.after(0), [rate(1, Rate::ONE)], "{start:?}: from rest, at once");
        bench.host.send(HostCommand::rate(Rate::ONE)).expect("a rate");
        assert_eq!(bench.after(11_999), [], "{start:?}: the same one");
        assert_eq!(bench.after(1), [rate(1, Rate::ONE)]);
        // others follow after 3 ms, unless they stop or turn
        bench.host.send(HostCommand::rate(Rate::ONE / 2)).expect("a rate");
        assert_eq!(bench.after(2_999), []);
        assert_eq!(bench.after(1), [rate(2, Rate::ONE / 2)]);
        bench.host.send(HostCommand::rate(-Rate::ONE)).expect("a rate");
        assert_eq!(bench.after(0), [rate(3, -Rate::ONE)]);
        bench.host.send(HostCommand::rate(Rate::ZERO)).expect("a rate");
        assert_eq!(bench.after(0), [rate(4, Rate::ZERO)]);
        let acknowledge = |bench: &mut HostBench, rate| {
            bench.report(Report { rate, first: 1, flags: ALL, ..Report::default() });
            bench.host.is_acknowledged()
        };
        assert!(!acknowledge(&mut bench, 3) && !acknowledge(&mut bench, 0), "{start:?}: older ones");
        assert!(acknowledge(&mut bench, 4), "{start:?}");
        assert!(acknowledge(&mut bench, 3), "{start:?}: a late report takes nothing back");
        assert_eq!(bench.after(15_999), []);
        assert_eq!(bench.after(1), [rate(4, Rate::ZERO)], "{start:?}: the sign of life");
        // through the wrap, one after the other
        for number in 5..200 {
            let target = Rate::from_units(i64::from(number));
            bench.host.send(HostCommand::rate(target)).expect("a rate");
            assert_eq!(bench.after(3_000), [rate(number, target)], "{start:?}");
            assert!(!bench.host.is_acknowledged() && acknowledge(&mut bench, number), "{start:?}");
        }
    }
}

#[test]
fn a_rate_for_rapid_motion_alone_is_a_new_rate() {
    let mut bench = HostBench::new(STARTS[1]);
    let target = RateTarget { feed: Rate::ZERO, rapid: Rate::ONE };
    bench.host.send(HostCommand::Rate(target)).expect("a rate");
    assert_eq!(bench.after(0), [rate(1, Rate::ZERO)]);
    // it is in motion: another rate waits, and this one is not a stop
    bench.host.send(HostCommand::Rate(RateTarget { feed: Rate::ONE, rapid: Rate::ONE })).expect("a rate");
    assert_eq!(bench.after(0), []);
    assert_eq!(bench.after(3_000), [rate(2, Rate::ONE)]);
}

#[test]
fn records_are_gathered_and_other_commands_are_not() {
    for start in STARTS {
        let mut bench = HostBench::new(start);
        let records: Vec<_> = (0..20).map(|offset| bench.ahead(offset)).collect();
        (0..7).for_each(|offset| bench.send_ahead(offset));
        assert_eq!(bench.after(11_999), [], "{start:?}");
        assert_eq!(bench.after(1), [stream(0, &records[..7])], "{start:?}");
        (7..15).for_each(|offset| bench.send_ahead(offset));
        assert_eq!(bench.after(0), [stream(7, &records[7..15])], "{start:?}: eight at once");
        bench.send_ahead(15);
        bench.host.send(output(4)).expect("room");
        assert_eq!(bench.after(0), [stream(15, &[records[15], output(4)])], "{start:?}");
        assert_eq!(bench.status_window(), (0, 16), "{start:?}: predicted");
        assert_eq!(bench.host.acknowledged_high(), RecordIndex::new(START));
        bench.report(Report { next_command: 3, length: 3, first: 1, flags: ALL, ..Report::default() });
        assert_eq!(bench.status_window(), (0, 16), "{start:?}: still predicted");
        assert_eq!(bench.host.acknowledged_high(), RecordIndex::new(START + 3));
        // a card that has forgotten its first record and rejected the fourth
        bench.report(Report { next_command: 17, low: 1, length: 2, first: 1, flags: ALL, ..Report::default() });
        assert_eq!(bench.status_window(), (1, 3), "{start:?}: as reported");
        assert!(bench.host.is_acknowledged());
        bench.send_ahead(3);
        assert_eq!(bench.after(12_000), [stream(17, &records[3..4])], "{start:?}");
    }
}

/// A record waits for others no longer than for a time of its own, whenever they come.
#[test]
fn later_records_do_not_delay_the_first() {
    for start in STARTS {
        let mut bench = HostBench::new(start);
        let records: Vec<_> = (0..3).map(|offset| bench.ahead(offset)).collect();
        // other frames are late enough not to take part
        bench.after(40_000);
        bench.send_ahead(0);
        assert_eq!(bench.after(6_000), [], "{start:?}");
        bench.send_ahead(1);
        assert_eq!(bench.after(3_000), [], "{start:?}");
        bench.send_ahead(2);
        assert_eq!(bench.after(2_999), [], "{start:?}");
        assert_eq!(bench.after(1), [stream(0, &records)], "{start:?}");
    }
}

#[test]
fn unacknowledged_commands_are_sent_again() {
    for start in STARTS {
        let mut bench = HostBench::new(start);
        let without_rates = |frames: Vec<Sent>| -> Vec<Sent> {
            frames.into_iter().filter(|frame| !matches!(frame, Sent::Rate { .. })).collect()
        };
        let commands: Vec<_> = (0..6).map(output).collect();
        for &command in &commands[..3] {
            bench.host.send(command).expect("room");
            assert_eq!(bench.after(0).len(), 1);
        }
        assert_eq!(without_rates(bench.after(59_999)), [], "{start:?}");
        assert_eq!(without_rates(bench.after(1)), [stream(0, &commands[..3])], "{start:?}");
        assert_eq!(bench.host.line_counts().retransmitted, 1);
        // an acknowledgement begins the time again, and ends it
        bench.now += 10_000;
        bench.report(Report { next_command: 1, first: 1, flags: ALL, ..Report::default() });
        assert_eq!(without_rates(bench.after(59_999)), [], "{start:?}");
        assert_eq!(without_rates(bench.after(1)), [stream(1, &commands[1..3])], "{start:?}");
        // stale ones and such of commands that do not exist are ignored
        for next_command in [0, 4, 0xFFFF, 0x8001, 0x7FFF] {
            let lie = Report { next_command, low: 9, length: 9, first: 1, flags: ALL, ..Report::default() };
            bench.report(lie);
            assert_eq!((bench.status_window(), bench.host.is_acknowledged()), ((0, 0), false), "{start:?}");
        }
        // a gap is closed at once, but not more often than every 12 ms
        let gap = Report { next_command: 1, first: 1, flags: ALL | GAP, ..Report::default() };
        bench.report(gap);
        assert_eq!(without_rates(bench.after(0)), [stream(1, &commands[1..3])], "{start:?}");
        bench.now += 11_999;
        bench.report(gap);
        assert_eq!(without_rates(bench.after(0)), [], "{start:?}");
        bench.now += 1;
        bench.report(gap);
        assert_eq!(without_rates(bench.after(0)), [stream(1, &commands[1..3])], "{start:?}");
        bench.host.send(commands[3]).expect("room");
        assert_eq!(without_rates(bench.after(0)), [stream(3, &commands[3..4])], "{start:?}");
        bench.report(Report { next_command: 4, first: 1, flags: ALL, ..Report::default() });
        assert!(bench.host.is_acknowledged());
        assert_eq!(without_rates(bench.after(60_000)), [], "{start:?}");
        assert_eq!(bench.host.line_counts().retransmitted, 4);
    }
}

#[test]
fn commands_cross_the_wrap_one_after_the_other() {
    for start in STARTS {
        let mut bench = HostBench::new(start);
        for number in 0..300 {
            let command = output(i32::from(number));
            bench.host.send(command).expect("room");
            assert_eq!(bench.after(0)[..1], [stream(number, &[command])], "{start:?}");
            bench.report(Report { next_command: number, first: 1, flags: ALL, ..Report::default() });
            assert!(!bench.host.is_acknowledged(), "{start:?}");
            bench.report(Report { next_command: number + 1, first: 1, flags: ALL, ..Report::default() });
            assert!(bench.host.is_acknowledged(), "{start:?}");
        }
    }
}

#[test]
fn the_queue_reserves_room_for_what_is_no_record() {
    for start in STARTS {
        let mut bench = HostBench::new(start);
        for offset in 0..112 {
            bench.send_ahead(offset);
        }
        let next = bench.ahead(112);
        assert_eq!(bench.host.send(next), Err(CommandRefusal::Full), "{start:?}");
        for value in 0..16 {
            bench.host.send(output(value)).expect("room");
        }
        assert_eq!(bench.host.send(output(16)), Err(CommandRefusal::Full), "{start:?}");
        assert_eq!(bench.status_window(), (0, 112));
        bench.host.send(HostCommand::rate(Rate::ONE)).expect("a rate always has room");
        // every command is there, in its order
        let mut sent = Vec::new();
        for frame in bench.after(12_000) {
            if let Sent::Stream { number, commands, .. } = frame {
                assert_eq!(usize::from(number), sent.len());
                sent.extend(commands);
            }
        }
        let expected: Vec<_> = (0..112).map(|offset| bench.ahead(offset)).chain((0..16).map(output)).collect();
        assert_eq!(sent, expected, "{start:?}");
    }
}

#[test]
fn channels_that_do_not_exist_are_refused() {
    let mut bench = HostBench::new(STARTS[0]);
    let change = |channel: usize| OutputChange { channel: channel as u8, value: 1 };
    let action = |channel: usize| retrace_link::OutputAction {
        place: RecordIndex::new(START),
        channel: channel as u8,
        before: 0,
        after: 1,
    };
    let mut repeated = RepeatedInstruction { number: 1, count: 2, ..RepeatedInstruction::default() };
    repeated.changes[1] = change(channel::COUNT);
    for command in [
        HostCommand::Action(action(usize::from(channel::HEIGHT) + 1)),
        HostCommand::Action(action(channel::COUNT + 1)),
        HostCommand::Action(action(255)),
        HostCommand::ManualOutput(change(usize::from(channel::HEIGHT))),
        HostCommand::ManualOutput(change(channel::COUNT)),
        HostCommand::Repeat(repeated),
    ] {
        assert_eq!(bench.host.send(command), Err(CommandRefusal::NoSuchChannel));
    }
    repeated.changes[1] = change(channel::COUNT - 1);
    for command in [
        HostCommand::Action(action(channel::COUNT - 1)),
        HostCommand::Action(action(usize::from(channel::HEIGHT))),
        HostCommand::ManualOutput(change(channel::COUNT - 1)),
        HostCommand::Repeat(repeated),
    ] {
        assert_eq!(bench.host.send(command), Ok(()));
    }
}

#[test]
fn entries_are_published_once_and_in_their_order() {
    for start in STARTS {
        let mut bench = HostBench::new(start);
        let entries: Vec<_> = (0..300).flat_map(|inputs| [ReportEntry::Inputs(inputs), REST]).collect();
        let mut published = Vec::new();
        let mut at = 0;
        while at < entries.len() {
            // again from before, and further
            let (from, to) = (at.saturating_sub(7), (at + 9).min(entries.len()));
            let flags = if to == entries.len() { ALL } else { 0 };
            let report = Report { first: 1 + from as u16, entries: &entries[from..to], flags, ..Report::default() };
            bench.report(report);
            bench.report(report);
            while bench.host.next_period() {
                published.push(bench.host.status().inputs);
            }
            at = to;
            let entry = 1 + at as u16;
            assert_eq!(bench.after(16_000), [Sent::Rate { entry, number: 0, feed: 0 }], "{start:?}");
        }
        assert_eq!(published, (0..300).collect::<Vec<u16>>(), "{start:?}");
        assert_eq!(bench.host.status().period, 301);
        assert_eq!(bench.host.fault(), None);
    }
}

#[test]
fn a_report_that_is_missing_is_requested() {
    for start in STARTS {
        let mut bench = HostBench::new(start);
        let late = Report { first: 2, entries: &[ReportEntry::Inputs(2), REST], flags: ALL, ..Report::default() };
        bench.report(late);
        assert!(!bench.host.next_period(), "{start:?}: it follows a lost one");
        assert_eq!(bench.after(0), [Sent::Nak { entry: 1 }], "{start:?}");
        bench.report(late);
        assert_eq!(bench.after(7_999), [], "{start:?}");
        assert_eq!(bench.after(1), [Sent::Nak { entry: 1 }], "{start:?}");
        assert_eq!(bench.after(15_999), []);
        let entries = [ReportEntry::Inputs(1), ReportEntry::Inputs(2), REST];
        bench.report(Report { first: 1, entries: &entries, flags: ALL, ..Report::default() });
        assert!(bench.host.next_period() && bench.host.status().inputs == 2);
        assert_eq!(bench.after(1), [Sent::Rate { entry: 4, number: 0, feed: 0 }], "{start:?}");
    }
}

#[test]
fn entries_without_room_are_not_acknowledged() {
    for start in STARTS {
        let mut bench = HostBench::new(start);
        let entries = vec![ReportEntry::Inputs(3); 64];
        for k in 0..20 {
            bench.report(Report { first: 1 + 64 * k, entries: &entries, ..Report::default() });
        }
        assert_eq!(bench.after(16_000), [Sent::Nak { entry: 1025 }], "{start:?}");
        assert!(!bench.host.next_period(), "no period among them");
        // everything is published: there is room again
        bench.report(Report { first: 1025, entries: &[REST], flags: ALL, ..Report::default() });
        assert!(bench.host.next_period(), "{start:?}");
        assert_eq!(bench.host.fault(), None);
    }
}

#[test]
fn the_check_is_compared_after_the_last_entry() {
    for start in STARTS {
        let mut bench = HostBench::new(start);
        let wrong = Report { first: 1, entries: &[REST], flags: ALL, wrong: 1, ..Report::default() };
        bench.report(wrong);
        assert!(bench.host.next_period());
        assert_eq!(bench.host.fault(), Some(LinkError::StateMismatch), "{start:?}");
        // not that of a report after which more entries came
        let mut bench = HostBench::new(start);
        bench.report(wrong);
        bench.report(Report { first: 2, entries: &[REST], ..Report::default() });
        assert!(bench.host.next_period() && bench.host.next_period());
        assert_eq!(bench.host.fault(), None, "{start:?}");
        // nor that of a repeated report that ends before them
        bench.report(Report { first: 3, entries: &[REST], ..Report::default() });
        bench.report(wrong);
        assert!(bench.host.next_period());
        assert_eq!(bench.host.fault(), None, "{start:?}");
    }
}

#[test]
fn lost_entries_and_rejected_instructions_end_the_run() {
    for start in STARTS {
        let mut bench = HostBench::new(start);
        bench.report(Report { first: 1, flags: ALL | LOST, ..Report::default() });
        assert_eq!(bench.host.fault(), Some(LinkError::ReportLost), "{start:?}");
        for entry in [ReportEntry::Refused(4), ReportEntry::RepeatRefused(4)] {
            let mut bench = HostBench::new(start);
            bench.report(Report { first: 1, entries: &[entry, REST], flags: ALL, ..Report::default() });
            bench.host.next_period();
            assert_eq!(bench.host.fault(), Some(LinkError::Refused(4)), "{start:?}");
            // under an alarm, that is what is reported
            let mut bench = HostBench::new(start);
            let alarm = ReportEntry::Alarm(Some(Alarm::DoorOpen));
            bench.report(Report { first: 1, entries: &[alarm, entry, REST], flags: ALL, ..Report::default() });
            assert_eq!(bench.host.fault(), None, "before it is published");
            assert!(bench.host.next_period());
            assert_eq!(bench.host.fault(), Some(LinkError::Alarm(Alarm::DoorOpen)), "{start:?}");
        }
    }
}

#[test]
fn every_entry_is_applied_to_the_status() {
    let mut bench = HostBench::new(STARTS[1]);
    let off = CutterOff {
        channels: 3,
        cause: CutterOffCause::Reverse,
        place: Place { record: RecordIndex::new(8), fraction: 9 },
    };
    let entries = [
        ReportEntry::Output(OutputChange { channel: 3, value: 5 }),
        ReportEntry::Output(OutputChange { channel: 200, value: 5 }),
        ReportEntry::Executed(6),
        ReportEntry::Inputs(7),
        ReportEntry::Wheel(8),
        ReportEntry::Wheel(9),
        ReportEntry::CutterOff(off),
        ReportEntry::Repeated(10),
        ReportEntry::Blocked(true),
        ReportEntry::Ran { distance: Distance::ZERO, count: 2, starved: true, at_rest: false },
    ];
    bench.report(Report { first: 1, entries: &entries, ..Report::default() });
    assert!(bench.host.next_period());
    let status = *bench.host.status();
    assert_eq!((status.outputs[3], status.executed, status.inputs, status.wheel), (5, 6, 7, 17));
    assert_eq!((status.cutter_off, status.repeated, status.blocked), (Some(off), 10, true));
    assert_eq!((status.starved, status.at_rest, status.alarm), (true, false, None));
    // what belongs to one period only is not repeated
    assert!(bench.host.next_period());
    let status = *bench.host.status();
    assert_eq!((status.wheel, status.cutter_off, status.repeated, status.starved), (0, None, 10, true));
    assert!(!bench.host.next_period());
}

/// A card whose pins are a period behind reports an edge of the period before the last one: the host counts the pulses
/// of that period, as the card does.
#[test]
fn an_edge_of_the_period_before_is_counted_in_that_period() {
    let mut bench = HostBench::new(STARTS[1]);
    let of = |offset: u32| record(START + offset).increments.map(i32::from);
    // the last one is not like the one before it
    let last = (1..WINDOW).find(|&last| of(last) != of(last - 1)).expect("records differ");
    (0..=last + 1).for_each(|offset| bench.send_ahead(offset));
    let _ = bench.frames();
    let edge = ProbeEdge { is_period_earlier: true, part: 1 << 15 };
    let entries = [ran(Distance::RECORD, last + 1), ReportEntry::ProbeEdge(edge), REST];
    bench.report(Report { first: 1, entries: &entries, length: last + 2, ..Report::default() });
    assert!((0..last).all(|_| bench.host.next_period()));
    let end = bench.host.status().counts;
    assert!(bench.host.next_period() && bench.host.next_period());
    let touch = counts_at_edge(&end, &of(last - 1), edge.part);
    assert_eq!(bench.host.status().probe, ProbeLatch::Edge(touch));
}

#[test]
fn a_silent_card_is_asked_whether_it_was_restarted() {
    for start in STARTS {
        let silent = || {
            let mut bench = HostBench::new(start);
            let probe = NONCE.rotate_left(16) + 1;
            assert_eq!(bench.host.silent_us(), 16_000);
            assert_eq!(bench.after(83_999).len(), 1);
            assert_eq!(bench.after(1), [Sent::Hello(probe)], "{start:?}");
            assert_eq!(bench.host.silent_us(), 100_000);
            assert!(!bench.after(19_999).contains(&Sent::Hello(probe)));
            assert_eq!(bench.after(1), [Sent::Hello(probe)], "{start:?}: with the same nonce");
            (bench, probe)
        };
        let (mut bench, probe) = silent();
        let epoch = bench.epoch;
        bench.greet(probe + 1, BOOT + 1, epoch);
        assert_eq!((bench.host.fault(), bench.host.silent_us()), (None, 120_000), "{start:?}: another answer");
        bench.greet(probe, BOOT, epoch);
        assert_eq!((bench.host.fault(), bench.host.silent_us()), (None, 0), "{start:?}");
        bench.greet(probe, BOOT + 1, epoch);
        assert_eq!(bench.host.fault(), None, "{start:?}: it counts once");
        bench.now += 100_000;
        assert!(bench.frames().contains(&Sent::Hello(probe + 1)), "{start:?}: a new nonce");
        for (boot, epoch) in [(BOOT + 1, epoch), (BOOT, epoch.wrapping_add(1)), (BOOT, 0)] {
            let (mut bench, probe) = silent();
            bench.greet(probe, boot, epoch);
            assert_eq!(bench.host.fault(), Some(LinkError::Restarted), "{start:?}");
        }
        // a report is an answer, too
        let (mut bench, probe) = silent();
        bench.report(Report { first: 1, flags: ALL, ..Report::default() });
        bench.greet(probe, BOOT + 1, epoch);
        assert_eq!((bench.host.fault(), bench.host.silent_us()), (None, 0), "{start:?}");
    }
}

#[test]
fn an_epoch_is_closed_when_the_card_says_so() {
    for start in STARTS {
        let mut bench = HostBench::new(start);
        let epoch = bench.epoch;
        bench.host.close();
        assert_eq!(bench.after(0), [Sent::Close(!NONCE)], "{start:?}");
        assert_eq!(bench.after(19_999), []);
        assert_eq!(bench.after(1), [Sent::Close(!NONCE)], "{start:?}");
        bench.greet(!NONCE, BOOT, epoch);
        bench.greet(NONCE, BOOT, 0);
        assert!(!bench.host.is_closed(), "{start:?}");
        bench.greet(!NONCE, BOOT, 0);
        assert!(bench.host.is_closed() && bench.host.fault().is_none(), "{start:?}");
        assert_eq!(bench.after(50_000), [], "{start:?}");
        bench.host.close();
        assert!(bench.host.is_closed());
        bench.host.request_greeting(99);
        assert_eq!(bench.after(0), [Sent::Hello(99)], "{start:?}");
    }
}

#[test]
fn an_alarm_that_is_being_cleared_is_no_error_until_its_outcome_is_reported() {
    for start in STARTS {
        let alarm = |bench: &mut HostBench| {
            let entries = [ReportEntry::Alarm(Some(Alarm::HostSilent)), REST];
            bench.report(Report { first: 1, entries: &entries, flags: ALL, ..Report::default() });
            assert_eq!(bench.host.fault(), None, "{start:?}: before it is published");
            assert!(bench.host.next_period());
            assert_eq!(bench.host.fault(), Some(LinkError::Alarm(Alarm::HostSilent)), "{start:?}");
            bench.host.send(output(1)).expect("room");
            bench.host.send(HostCommand::ClearAlarm).expect("room");
            assert_eq!(bench.host.fault(), None, "{start:?}: being cleared");
        };
        // it remains: the card has the command, and a period later the alarm is still there
        let mut bench = HostBench::new(start);
        alarm(&mut bench);
        bench.report(Report { next_command: 1, first: 3, entries: &[REST], flags: ALL, ..Report::default() });
        assert!(bench.host.next_period() && bench.host.fault().is_none(), "{start:?}: not received yet");
        bench.report(Report { next_command: 2, first: 4, entries: &[REST], ..Report::default() });
        assert!(bench.host.next_period() && bench.host.fault().is_none(), "{start:?}: entries are missing");
        bench.report(Report { next_command: 2, first: 5, entries: &[REST], flags: ALL, ..Report::default() });
        assert!(bench.host.next_period() && bench.host.fault().is_none(), "{start:?}: from before, maybe");
        bench.report(Report { next_command: 2, first: 6, flags: ALL, ..Report::default() });
        assert_eq!(bench.host.fault(), None, "{start:?}");
        bench.report(Report { next_command: 2, first: 6, entries: &[REST], flags: ALL, ..Report::default() });
        assert!(bench.host.next_period());
        assert_eq!(bench.host.fault(), Some(LinkError::Alarm(Alarm::HostSilent)), "{start:?}");
        // it is gone
        let mut bench = HostBench::new(start);
        alarm(&mut bench);
        bench.report(Report { next_command: 2, first: 3, flags: ALL, ..Report::default() });
        let entries = [ReportEntry::Alarm(None), REST];
        bench.report(Report { next_command: 2, first: 3, entries: &entries, flags: ALL, ..Report::default() });
        assert!(bench.host.next_period() && bench.host.fault().is_none(), "{start:?}");
        assert_eq!(bench.host.status().alarm, None);
    }
}

/// A rate of zero stops a homing axis, which no rate has started: it is sent each time it is requested.
#[test]
fn a_stop_is_sent_again_while_the_card_homes() {
    let mut bench = HostBench::new(STARTS[2]);
    bench.host.send(HostCommand::rate(Rate::ZERO)).expect("a rate");
    assert!(bench.host.is_acknowledged(), "nothing moves");
    bench.host.send(HostCommand::Home(HomingCommand::default())).expect("room");
    bench.host.send(HostCommand::rate(Rate::ZERO)).expect("a rate");
    let frames = bench.after(0);
    assert!(frames.contains(&rate(1, Rate::ZERO)), "{frames:?}");
    bench.host.send(HostCommand::rate(Rate::ZERO)).expect("a rate");
    assert_eq!(bench.after(0), [], "one is on its way");
    bench.report(Report { next_command: 1, rate: 1, first: 1, flags: ALL, wrong: 1, ..Report::default() });
    bench.host.send(HostCommand::rate(Rate::ZERO)).expect("a rate");
    assert_eq!(bench.after(0), [rate(2, Rate::ZERO)]);
    // and the counts are not those of the path
    bench.report(Report { next_command: 1, first: 1, entries: &[REST], flags: ALL, wrong: 1, ..Report::default() });
    assert!(bench.host.next_period() && bench.host.fault().is_none());
    assert!(bench.host.is_where_reported());
}

#[test]
fn counts_and_place_follow_the_records() {
    for start in STARTS {
        let mut bench = HostBench::new(start);
        (0..12).for_each(|offset| bench.send_ahead(offset));
        let step = |to: i64| [ran(Distance::from_units(to), 1)];
        let half = 1 << 31;
        for (k, distance) in [(0, half), (1, half), (2, 3 * half), (3, -half)] {
            let report = Report { next_command: 9, length: 9, first: 1 + k, ..Report::default() };
            bench.report(Report { entries: &step(distance), ..report });
            assert!(bench.host.next_period());
        }
        let status = *bench.host.status();
        let place = Place::start_of(RecordIndex::new(START + 2));
        assert_eq!((status.place, status.rate), (place, Rate::from_units(-half)), "{start:?}");
        assert_eq!((status.reached, status.line), (RecordIndex::new(START + 3), record(START + 2).line));
        let mut counts = [0i64; 3];
        for offset in 0..2 {
            for (count, increment) in counts.iter_mut().zip(record(START + offset).increments) {
                *count += i64::from(increment);
            }
        }
        assert_eq!(status.counts, counts, "{start:?}");
        // several periods in one entry
        bench.report(Report {
            next_command: 9,
            length: 9,
            first: 5,
            entries: &[ran(Distance::RECORD, 8)],
            ..Report::default()
        });
        while bench.host.next_period() {}
        assert_eq!(bench.host.status().place, Place::start_of(RecordIndex::new(START + 10)));
        // at rest the line is that of the record that ends there
        bench.report(Report { next_command: 9, length: 9, first: 6, entries: &[REST], ..Report::default() });
        assert!(bench.host.next_period());
        assert_eq!(bench.host.status().line, record(START + 9).line, "{start:?}");
        assert_ne!(record(START + 10).line, record(START + 9).line);
    }
}

#[test]
fn instructions_are_sent_at_once() {
    let mut bench = HostBench::new(STARTS[1]);
    let instruction = HostCommand::Instruction(Instruction { number: 1, ..Instruction::default() });
    bench.host.send(instruction).expect("room");
    assert_eq!(bench.after(0), [stream(0, &[instruction])]);
}

#[test]
fn clearing_is_accepted_with_the_first_number_too() {
    for start in STARTS {
        let mut bench = HostBench::new(start);
        let entries = [ReportEntry::Alarm(Some(Alarm::HostSilent)), ran(Distance::RECORD, 1)];
        bench.send_ahead(0);
        bench.report(Report { next_command: 1, length: 1, first: 1, entries: &entries, ..Report::default() });
        assert!(bench.host.next_period() && bench.host.fault().is_none(), "{start:?}: it brakes");
        let mut bench = HostBench::new(start);
        let entries = [ReportEntry::Alarm(Some(Alarm::HostSilent)), REST, REST];
        bench.report(Report { first: 1, entries: &entries, flags: ALL, ..Report::default() });
        assert!(bench.host.next_period() && bench.host.fault().is_none(), "{start:?}: a period follows");
        assert!(bench.host.next_period() && bench.host.fault().is_some(), "{start:?}");
        bench.host.send(HostCommand::ClearAlarm).expect("room");
        bench.report(Report { next_command: 1, first: 4, flags: ALL, ..Report::default() });
        bench.report(Report { next_command: 1, first: 4, entries: &[REST], flags: ALL, ..Report::default() });
        assert!(bench.host.next_period());
        assert_eq!(bench.host.fault(), Some(LinkError::Alarm(Alarm::HostSilent)), "{start:?}");
    }
}

/// Whether the cursor may be elsewhere than it was reported.
#[test]
fn records_near_the_cursor_are_dropped_only_if_nothing_moves() {
    for start in STARTS {
        let mut bench = HostBench::new(start);
        (0..9).for_each(|offset| bench.send_ahead(offset));
        bench.report(Report { next_command: 9, length: 9, first: 1, flags: ALL, ..Report::default() });
        let trim =
            |bench: &mut HostBench, high| bench.host.send(HostCommand::Trim { high: RecordIndex::new(START + high) });
        assert_eq!(trim(&mut bench, 8), Ok(()), "{start:?}: at rest");
        // a rate is requested
        bench.host.send(HostCommand::rate(Rate::ONE)).expect("a rate");
        assert_eq!(trim(&mut bench, 7), Err(CommandRefusal::InMotion), "{start:?}");
        let acknowledged = Report { next_command: 10, length: 8, first: 1, ..Report::default() };
        bench.report(Report { rate: 1, flags: ALL, ..acknowledged });
        assert_eq!(trim(&mut bench, 7), Err(CommandRefusal::InMotion), "{start:?}: and is in force");
        // zero is requested, and not acknowledged
        bench.host.send(HostCommand::rate(Rate::ZERO)).expect("a rate");
        assert_eq!(trim(&mut bench, 7), Err(CommandRefusal::InMotion), "{start:?}");
        // it is acknowledged, and a period is not published
        bench.report(Report { rate: 2, entries: &[ran(Distance::RECORD, 3)], ..acknowledged });
        assert_eq!(trim(&mut bench, 7), Err(CommandRefusal::InMotion), "{start:?}");
        // it is published, in motion
        (0..3).for_each(|_| assert!(bench.host.next_period()));
        assert_eq!(trim(&mut bench, 7), Err(CommandRefusal::InMotion), "{start:?}");
        bench.report(Report { rate: 2, first: 2, entries: &[REST], ..acknowledged });
        assert!(bench.host.next_period());
        assert_eq!(trim(&mut bench, 7), Ok(()), "{start:?}: at rest again");
        assert_eq!(bench.status_window(), (0, 7));
        assert_eq!(bench.host.send(HostCommand::Forget { low: RecordIndex::new(START + 3) }), Ok(()));
        assert_eq!(bench.status_window(), (3, 7), "each of the periods counts");
    }
}

#[test]
fn another_epoch_begins_anew() {
    for start in STARTS {
        let mut bench = HostBench::new(start);
        bench.send_ahead(0);
        bench.host.send(output(3)).expect("room");
        bench.host.send(HostCommand::rate(Rate::ONE)).expect("a rate");
        bench.host.send(HostCommand::Home(HomingCommand::default())).expect("room");
        bench.host.send(HostCommand::ClearAlarm).expect("room");
        bench.after(12_000);
        let alarm = ReportEntry::Alarm(Some(Alarm::DoorOpen));
        bench.report(Report { first: 1, entries: &[alarm, REST, REST], flags: ALL | LOST, ..Report::default() });
        assert_eq!(bench.host.fault(), Some(LinkError::ReportLost));
        let period = bench.host.status().period;
        bench.host.request_greeting(99);
        bench.now += 70_000;
        bench.frames();
        (bench.last_epoch, bench.epoch) = (bench.epoch, next_epoch(bench.epoch));
        let last_epoch = bench.last_epoch;
        bench.greet(99, BOOT, last_epoch);
        assert!(!bench.host.is_where_reported() || bench.host.fault().is_some());
        // the last frames of the old epoch
        bench.now += 70_000;
        while bench.host.transmit(bench.now, &mut [0; 512]) > 0 {}
        bench.host.open(CardSettings::new(0, PathStart::at(RecordIndex::new(START)), 1000, limits()));
        bench.key = session_key(BOOT, !99, bench.epoch);
        assert_eq!(bench.host.silent_us(), 0, "{start:?}: the silence begins again");
        assert_eq!((bench.host.fault(), bench.host.status().period), (None, period), "{start:?}");
        assert!(bench.host.is_acknowledged() && !bench.host.is_open() && !bench.host.next_period());
        let opening = Sent::Open { boot: BOOT, nonce: !99, epoch: bench.epoch };
        assert_eq!(bench.after(0), [opening], "{start:?}");
        let wrong = Report { entries: &[REST], flags: ALL, wrong: 1, ..Report::default() };
        bench.report(wrong);
        assert!(bench.host.is_open() && bench.host.next_period(), "{start:?}");
        assert_eq!(bench.host.fault(), Some(LinkError::StateMismatch), "{start:?}: on the path again");
        assert_eq!(bench.status_window(), (0, 0), "{start:?}");
        assert_eq!(bench.host.acknowledged_high(), RecordIndex::new(START));
    }
}

/// The hash by which a model knows states: what decides about the future is in it, and the past is not.
#[test]
fn states_are_equal_if_they_behave_alike() {
    use std::collections::hash_map::DefaultHasher;
    use std::hash::Hasher;
    let hash = |bench: &HostBench, after: u64| {
        let mut state = DefaultHasher::new();
        bench.host.hash_state(bench.now + after, &mut state);
        state.finish()
    };
    let bench = HostBench::new(STARTS[1]);
    let mut later = HostBench::new(STARTS[1]);
    assert_eq!(hash(&bench, 0), hash(&later, 0));
    assert_ne!(hash(&bench, 0), hash(&bench, 1), "times count from now");
    assert_eq!(hash(&bench, 200_000), hash(&bench, 200_001), "every interval is over");
    later.host.receive(&[9], later.now);
    assert_ne!(hash(&bench, 0), hash(&later, 0), "half a frame");
    // records that were sent differ, though nothing is outstanding
    let acknowledged = |increment| {
        let mut bench = HostBench::new(STARTS[1]);
        let record = retrace_core::Record { increments: [increment; 3], ..record(1) };
        bench.host.send(HostCommand::Ahead { place: RecordIndex::new(START), record }).expect("room");
        assert_eq!(bench.host.unacknowledged_commands(), 1);
        bench.after(12_000);
        bench.report(Report { next_command: 1, length: 1, first: 1, flags: ALL, ..Report::default() });
        assert_eq!(bench.host.unacknowledged_commands(), 0);
        bench
    };
    assert_eq!(hash(&acknowledged(1), 200_000), hash(&acknowledged(1), 200_000));
    assert_ne!(hash(&acknowledged(1), 200_000), hash(&acknowledged(2), 200_000));
    assert_ne!(hash(&acknowledged(1), 0), hash(&bench, 0));
    // and so do commands that wait, wherever their numbers are
    for start in STARTS {
        let waiting = |value| {
            let mut bench = HostBench::new(start);
            for command in [output(0), output(value)] {
                bench.host.send(command).expect("room");
            }
            bench
        };
        assert_eq!(hash(&waiting(1), 0), hash(&waiting(1), 0), "{start:?}");
        assert_ne!(hash(&waiting(1), 0), hash(&waiting(2), 0), "{start:?}");
    }
}

#[test]
fn an_acknowledgement_leaves_what_is_not_sent_yet() {
    for start in STARTS {
        let mut bench = HostBench::new(start);
        let commands: Vec<_> = (0..5).map(output).collect();
        commands[..3].iter().for_each(|&command| bench.host.send(command).expect("room"));
        assert_eq!(bench.after(0), [stream(0, &commands[..3])]);
        commands[3..].iter().for_each(|&command| bench.host.send(command).expect("room"));
        bench.report(Report { next_command: 1, first: 1, flags: ALL, ..Report::default() });
        assert_eq!(bench.after(0), [stream(3, &commands[3..])], "{start:?}");
    }
}

/// A stop cuts a long frame short; what was in it is sent again, also if older commands were acknowledged meanwhile.
#[test]
fn a_frame_that_is_cut_short_is_sent_again_completely() {
    for start in STARTS {
        let mut bench = HostBench::new(start);
        bench.host.send(HostCommand::rate(Rate::ONE)).expect("a rate");
        assert_eq!(bench.after(0), [rate(1, Rate::ONE)]);
        let commands: Vec<_> = (0..30).map(|value| output(value * 1_000_000)).collect();
        commands[..2].iter().for_each(|&command| bench.host.send(command).expect("room"));
        assert_eq!(bench.after(0), [stream(0, &commands[..2])]);
        commands[2..].iter().for_each(|&command| bench.host.send(command).expect("room"));
        assert_eq!(bench.host.transmit(bench.now, &mut [0; 30]), 30, "the beginning of a long frame");
        bench.report(Report { next_command: 2, rate: 1, first: 1, flags: ALL, ..Report::default() });
        bench.host.send(HostCommand::rate(Rate::ZERO)).expect("a rate");
        // the zero byte, and the rate before everything else
        assert_eq!(bench.after(0), [rate(2, Rate::ZERO), stream(2, &commands[2..])], "{start:?}");
    }
}

/// What is left of a frame is sent before a stop, if that is about as short as the stop itself.
#[test]
fn the_end_of_a_frame_is_not_cut_short() {
    let long_frame = || {
        let mut bench = HostBench::new(STARTS[0]);
        bench.host.send(HostCommand::rate(Rate::ONE)).expect("a rate");
        assert_eq!(bench.after(0), [rate(1, Rate::ONE)]);
        (0..30).for_each(|value| bench.host.send(output(value * 1_000_000)).expect("room"));
        bench
    };
    let mut bench = long_frame();
    let length = bench.host.transmit(bench.now, &mut [0; 8192]);
    for (left, is_cut) in [(1, false), (20, false), (40, false), (60, true), (length - 1, true)] {
        let (mut bench, mut bytes) = (long_frame(), [0; 8192]);
        let begun = bench.host.transmit(bench.now, &mut bytes[..length - left]);
        bench.host.send(HostCommand::rate(Rate::ZERO)).expect("a rate");
        let end = begun + bench.host.transmit(bench.now, &mut bytes[begun..]);
        let mut decoder = FrameDecoder::<MAX_PAYLOAD>::new();
        decoder.set_key(bench.key);
        let kinds: Vec<u8> = bytes[..end].iter().filter_map(|&byte| Some(decoder.push(byte)?.ok()?[0])).collect();
        let expected = if is_cut { [kind::RATE, kind::STREAM] } else { [kind::STREAM, kind::RATE] };
        assert_eq!(kinds, expected, "{left} of {length} bytes are left");
    }
}

/// The host retains twice the window that it predicts, however large the card's window is.
#[test]
fn the_predicted_window_is_half_of_what_the_host_retains() {
    for (window, predicted) in [(256, 256), (4096, 4096), (1 << 20, 4096)] {
        let mut bench = HostBench::connected(HostBench { window, ..HostBench::unconnected(STARTS[0]) });
        let mut sent = 0;
        loop {
            let command = bench.ahead(sent);
            match bench.host.send(command) {
                Ok(()) => sent += 1,
                Err(reason) => {
                    assert_eq!((reason, sent), (CommandRefusal::Full, predicted));
                    break;
                }
            }
            if sent % 64 == 0 {
                bench.after(12_000);
                let next_command = sent as u16;
                bench.report(Report { next_command, length: sent, first: 1, flags: ALL, ..Report::default() });
            }
        }
    }
}

/// A straight path that rests at its beginning.
struct Straight;

impl RecordWindow<3> for Straight {
    fn low(&self) -> RecordIndex {
        RecordIndex::new(0)
    }
    fn high(&self) -> RecordIndex {
        RecordIndex::new(1000)
    }
    fn rests_at(&self, place: RecordIndex) -> bool {
        place.number() == 0
    }
    fn cap(&self, _: RecordIndex) -> RapidCap {
        RapidCap::PLANNED
    }
    fn increments(&self, _: RecordIndex) -> [i16; 3] {
        [1; 3]
    }
    fn is_rapid(&self, _: RecordIndex) -> bool {
        false
    }
}

/// While a rate is requested, the host keeps as many records ahead as a card at rate one needs to stop, and 40 to 48
/// more: on machines that stop in few records, and in hundreds.
#[test]
fn a_trim_leaves_the_records_of_a_stop() {
    for acceleration in [12, 1] {
        let axis = PulseLimits { velocity: 200 << 32, acceleration: acceleration << 32, jerk: 1 << 32 };
        let limits = RateLimits::new(13, 1 << 15, [axis; 3]).expect("valid");
        let mut drive = Drive::<3, 16>::new(limits).expect("fits");
        let start_place = Place::start_of(RecordIndex::new(0));
        drive.step(start_place, Rate::ONE, &Straight);
        let needed = start_place.moved(drive.stopping_distance()).boundary_ahead().number();
        for start in STARTS {
            let unconnected = HostBench::unconnected(start);
            let mut bench = HostBench::connected(HostBench { window: 1024, limits, ..unconnected });
            for n in 0..needed + 64 {
                bench.send_ahead(n);
                if n % 32 == 31 {
                    bench.after(12_000);
                    let next_command = n as u16 + 1;
                    bench.report(Report { next_command, length: n + 1, first: 1, flags: ALL, ..Report::default() });
                }
            }
            bench.host.send(HostCommand::rate(Rate::ONE)).expect("a rate");
            let mut trim = |high| bench.host.send(HostCommand::Trim { high: RecordIndex::new(START + high) });
            assert_eq!(trim(needed + 39), Err(CommandRefusal::InMotion), "{start:?}: a stop takes {needed} records");
            assert_eq!(trim(needed + 48), Ok(()), "{start:?}: a stop takes {needed} records");
        }
    }
}
