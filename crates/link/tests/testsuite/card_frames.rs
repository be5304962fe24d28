//! The card's endpoint alone, frame by frame: every number that it compares begins anywhere and crosses the wrap.

use crate::works::{STARTS, Works, limits};
use retrace_core::{Distance, Rate, RecordIndex};
use retrace_link::frame::{FrameDecoder, MAX_PAYLOAD, MAX_WIRE, encode_with_key};
use retrace_link::sequence::FirstNumbers;
use retrace_link::wire::{ByteReader, ByteWriter, Greeting, Opening, RecordRun, ReportEntry, kind, write_command};
use retrace_link::{
    CardEndpoint, CardSettings, HostCommand, Instruction, OutputChange, PathStart, RepeatedInstruction, next_epoch,
    session_key, state_crc,
};

const NONCE: u32 = 0xFEED;

/// What a report says.
#[derive(Debug, PartialEq)]
struct Report {
    epoch: u16,
    next_command: u16,
    rate: u16,
    gap: bool,
    all: bool,
    lost: bool,
    low: u32,
    length: u32,
    first: u16,
    entries: Vec<ReportEntry>,
    crc: Option<u32>,
}

/// A card with `E` entries, and a host that writes its frames by hand.
struct CardBench<const E: usize> {
    end: CardEndpoint<3, E>,
    works: Works,
    numbers: FirstNumbers,
    epoch: u16,
    key: u32,
}

fn settings(epoch: u16) -> CardSettings<3> {
    CardSettings { report_periods: 4, ..CardSettings::new(epoch, PathStart::at(RecordIndex::new(50)), 1000, limits()) }
}

impl<const E: usize> CardBench<E> {
    /// A card with its epoch open and its first reports acknowledged: none are, as no period has run.
    fn new((numbers, last_epoch): (FirstNumbers, u16)) -> Self {
        let epoch = next_epoch(last_epoch);
        let mut bench = Self {
            end: CardEndpoint::starting_at(numbers, last_epoch),
            works: Works::new(),
            numbers,
            epoch,
            key: session_key(1, NONCE, epoch),
        };
        bench.open(1, NONCE, epoch);
        assert_eq!(bench.end.epoch(), epoch);
        assert_eq!(bench.greeting().map(|greeting| (greeting.nonce, greeting.epoch)), Some((NONCE, epoch)));
        bench
    }

    fn open(&mut self, boot: u32, nonce: u32, epoch: u16) {
        self.frame(0, |w| {
            w.u8(kind::OPEN)?;
            w.u32(boot)?;
            w.u32(nonce)?;
            Opening(settings(epoch)).write(w)
        });
    }

    fn frame(&mut self, key: u32, write: impl FnOnce(&mut ByteWriter<'_>) -> Option<()>) {
        let mut payload = [0; MAX_PAYLOAD];
        let mut writer = ByteWriter::new(&mut payload);
        write(&mut writer).expect("room");
        let length = writer.len();
        let mut wire = [0; MAX_WIRE];
        for &byte in encode_with_key(&payload[..length], &mut wire, key).expect("it fits") {
            self.end.receive(byte, &mut self.works);
        }
    }

    /// Commands from a number on, with an acknowledgement of entries. Numbers count from the first ones.
    fn stream(&mut self, entry: u16, number: u16, commands: &[HostCommand<3>]) {
        let (epoch, key, numbers) = (self.epoch, self.key, self.numbers);
        self.frame(key, |w| {
            w.u8(kind::STREAM)?;
            w.u16(epoch)?;
            w.u16(numbers.entry.wrapping_add(entry))?;
            w.u16(numbers.command.wrapping_add(number))?;
            let mut run = RecordRun::new(3);
            commands.iter().try_for_each(|command| write_command(w, &mut run, command))
        });
    }

    /// A rate, in units, under a number.
    fn rate_frame(&mut self, kind: u8, epoch: u16, entry: u16, number: u16, units: i64) {
        let (key, numbers) = (self.key, self.numbers);
        self.frame(key, |w| {
            w.u8(kind)?;
            w.u16(epoch)?;
            w.u16(numbers.entry.wrapping_add(entry))?;
            w.u16(numbers.rate.wrapping_add(number))?;
            w.signed(units)?;
            w.signed(units)
        });
    }

    fn rate(&mut self, number: u16, units: i64) {
        self.rate_frame(kind::RATE, self.epoch, 0, number, units);
    }

    fn acknowledge(&mut self, entry: u16) {
        self.rate_frame(kind::RATE, self.epoch, entry, 0, 0);
    }

    fn nak(&mut self, entry: u16) {
        self.rate_frame(kind::NAK, self.epoch, entry, 0, 0);
    }

    fn close(&mut self, epoch: u16, nonce: u32) {
        let key = self.key;
        self.frame(key, |w| {
            w.u8(kind::CLOSE)?;
            w.u16(epoch)?;
            w.u32(nonce)
        });
    }

    /// A control period with an output change, which cannot be merged with another entry: two entries.
    fn period_with_change(&mut self, value: i32) {
        self.works.status.outputs[0] = value;
        self.period();
    }

    /// A control period in which nothing happens.
    fn period(&mut self) {
        self.works.status.wheel = 0;
        self.end.push_period(&self.works.status);
    }

    /// The payload of the next frame, without its kind.
    fn payload(&mut self, expected: u8) -> Option<Vec<u8>> {
        let mut decoder = FrameDecoder::<MAX_PAYLOAD>::new();
        decoder.set_key(self.key);
        let mut byte = [0];
        loop {
            if self.end.transmit(&self.works, &mut byte) == 0 {
                return None;
            }
            if let Some(payload) = decoder.push(byte[0]) {
                let payload = payload.expect("undamaged");
                assert_eq!(payload[0], expected);
                let payload = payload[1..].to_vec();
                assert!(expected != kind::REPORT || payload.len() < 200, "the longest report");
                assert_eq!(decoder.has_key(), expected == kind::REPORT, "reports have the key");
                return Some(payload);
            }
        }
    }

    fn greeting(&mut self) -> Option<Greeting<3>> {
        let payload = self.payload(kind::WELCOME)?;
        Greeting::read(&mut ByteReader::new(&payload))?.ok()
    }

    /// The next report, its numbers counted from the first ones.
    fn report(&mut self) -> Option<Report> {
        let payload = self.payload(kind::REPORT)?;
        let mut r = ByteReader::new(&payload);
        let epoch = r.u16()?;
        let next_command = r.u16()?.wrapping_sub(self.numbers.command);
        let rate = r.u16()?.wrapping_sub(self.numbers.rate);
        let flags = r.u8()?;
        let (low, length) = (r.u32()?, r.count32()?);
        let first = r.u16()?.wrapping_sub(self.numbers.entry);
        let all = flags & 2 != 0;
        let mut entries = Vec::new();
        while r.remaining() > if all { 4 } else { 0 } {
            entries.push(ReportEntry::read(&mut r).expect("an entry"));
        }
        let crc = if all { r.u32() } else { None };
        let (gap, lost) = (flags & 1 != 0, flags & 4 != 0);
        Some(Report { epoch, next_command, rate, gap, all, lost, low, length, first, entries, crc })
    }
}

fn output(value: i32) -> HostCommand<3> {
    HostCommand::ManualOutput(OutputChange { channel: 3, value })
}

/// The entries that [`CardBench::period_with_change`] makes.
fn entries_of(values: impl Iterator<Item = i32>) -> Vec<ReportEntry> {
    let ran = ReportEntry::Ran { distance: Distance::ZERO, count: 1, starved: false, at_rest: true };
    values.flat_map(|value| [ReportEntry::Output(OutputChange { channel: 0, value }), ran]).collect()
}

#[test]
fn a_rate_is_accepted_if_its_number_is_after_the_last_one() {
    for start in STARTS {
        let mut bench = CardBench::<16>::new(start);
        // number, rate, and whether it is new; 0x8000 after the last one is as far before it
        let frames = [(0, 9, false), (1, 10, true), (1, 11, false), (0, 12, false), (2, 13, true), (1, 14, false)]
            .into_iter()
            .chain([(5, 15, true), (4, 16, false), (5 + 0x7FFF, 17, true), (5, 18, false), (4, 19, false)])
            .chain([(3, 20, true), (4, 21, true), (4, 22, false), (0x8004, 23, false)]);
        let mut accepted = Vec::new();
        for (number, units, is_new) in frames {
            bench.rate(number, units);
            accepted.extend(is_new.then(|| Rate::from_units(units)));
            assert_eq!(bench.works.rates, accepted, "{start:?}: number {number}");
        }
    }
}

#[test]
fn a_command_is_accepted_once_and_in_its_order() {
    for start in STARTS {
        let mut bench = CardBench::<16>::new(start);
        bench.stream(0, 0, &[output(10), output(11)]);
        assert_eq!(bench.works.by_hand, [10, 11], "{start:?}");
        bench.stream(0, 0, &[output(10), output(11)]);
        bench.stream(0, 1, &[output(11)]);
        assert_eq!(bench.works.by_hand, [10, 11], "{start:?}: repeated");
        bench.stream(0, 1, &[output(11), output(12)]);
        assert_eq!(bench.works.by_hand, [10, 11, 12], "{start:?}: overlapping");
        assert!(!bench.report_now().gap);
        bench.stream(0, 4, &[output(14)]);
        assert_eq!(bench.works.by_hand, [10, 11, 12], "{start:?}: beyond a gap");
        // reported at once, as of the last command accepted
        let report = bench.report().expect("it is urgent");
        assert_eq!((report.next_command, report.gap), (3, true));
        assert!(bench.report_now().gap, "until it is closed");
        bench.stream(0, 3, &[output(13), output(14), output(15)]);
        assert_eq!(bench.works.by_hand, [10, 11, 12, 13, 14, 15], "{start:?}");
        let report = bench.report_now();
        assert_eq!((report.epoch, report.next_command, report.gap), (bench.epoch, 6, false));
        // far behind is a repetition, too
        for number in 6..200 {
            bench.stream(0, number, &[output(i32::from(number))]);
        }
        let count = bench.works.by_hand.len();
        bench.stream(0, 0, &[output(10), output(11)]);
        bench.stream(0, 150, &[output(10), output(11)]);
        assert_eq!(bench.works.by_hand.len(), count);
        assert!(!bench.report_now().gap, "no gap");
    }
}

impl<const E: usize> CardBench<E> {
    /// A report after as many periods as it takes.
    fn report_now(&mut self) -> Report {
        for _ in 0..4 {
            self.period();
        }
        self.report().expect("it is due")
    }
}

/// A reading that changes in every period costs one entry in an interval of the reports, one that stays none, one that
/// is lost one, and what was never known is not reported.
#[test]
fn an_analog_input_is_reported_once_in_an_interval() {
    let mut card = CardBench::<64>::new(STARTS[0]);
    let mut told = Vec::new();
    for period in 1..=40_u16 {
        card.works.status.period = u64::from(period);
        let lost = (10..20).contains(&period).then_some(3);
        card.works.status.analog_inputs = [Some(100 * period), Some(7), None, lost];
        card.period();
        let Some(report) = card.report() else { continue };
        card.acknowledge(report.first.wrapping_add(report.entries.len() as u16));
        told.extend(report.entries.iter().filter_map(|entry| match *entry {
            ReportEntry::AnalogInput { number, reading } => Some((number, reading)),
            _ => None,
        }));
    }
    let of =
        |input| told.iter().filter(|(number, _)| *number == input).map(|(_, reading)| *reading).collect::<Vec<_>>();
    assert_eq!(of(0), (1..=10).map(|at| Some(400 * at)).collect::<Vec<_>>());
    assert_eq!((of(1), of(2), of(3)), (vec![Some(7)], vec![], vec![Some(3), None]));
}

#[test]
fn entries_are_reported_until_they_are_acknowledged_and_no_longer() {
    for start in STARTS {
        let mut bench = CardBench::<16>::new(start);
        for value in 1..=3 {
            bench.period_with_change(value);
        }
        assert_eq!(bench.report(), None, "not due");
        bench.period_with_change(4);
        let report = bench.report().expect("every fourth period");
        assert_eq!((report.first, report.all, report.lost), (0, true, false), "{start:?}");
        assert_eq!(report.entries, entries_of(1..5), "{start:?}");
        assert_eq!((report.low, report.length), (50, 0));
        let status = bench.works.status;
        assert_eq!(report.crc, Some(state_crc(status.place, &status.counts, 3)));
        // those that the host has are not repeated, and those that it misses are
        bench.nak(2);
        let report = bench.report().expect("at once");
        assert_eq!((report.first, report.entries), (2, entries_of(2..5)), "{start:?}");
        bench.acknowledge(4);
        bench.acknowledge(2);
        bench.acknowledge(3);
        bench.acknowledge(0xFFFF);
        bench.acknowledge(9);
        bench.nak(0x8000);
        let report = bench.report().expect("at once");
        assert_eq!((report.first, report.entries), (4, entries_of(3..5)), "{start:?}: stale ones are ignored");
        bench.acknowledge(8);
        bench.nak(8);
        let report = bench.report().expect("at once");
        assert_eq!((report.first, report.entries.len(), report.all), (8, 0, true), "{start:?}");
        // again, around the array
        for value in 5..=8 {
            bench.period_with_change(value);
        }
        let report = bench.report().expect("due");
        assert_eq!((report.first, report.entries), (8, entries_of(5..9)), "{start:?}");
    }
}

#[test]
fn an_acknowledgement_before_all_was_sent_leaves_the_rest_to_send() {
    for start in STARTS {
        let mut bench = CardBench::<64>::new(start);
        for value in 1..=4 {
            bench.period_with_change(value);
        }
        assert_eq!(bench.report().map(|report| report.entries.len()), Some(8));
        for value in 5..=8 {
            bench.period_with_change(value);
        }
        bench.acknowledge(3);
        let report = bench.report().expect("due");
        assert_eq!((report.first, report.entries), (8, entries_of(5..9)), "{start:?}");
        // acknowledged beyond what was sent again
        bench.nak(3);
        bench.acknowledge(9);
        let report = bench.report().expect("urgent");
        assert_eq!((report.first, report.entries), (9, entries_of(5..9)[1..].to_vec()), "{start:?}");
    }
}

#[test]
fn a_full_queue_keeps_the_oldest_entries_and_reports_the_loss() {
    for start in STARTS {
        let mut bench = CardBench::<16>::new(start);
        for value in 1..=8 {
            bench.period_with_change(value);
        }
        let report = bench.report().expect("due");
        assert_eq!((report.lost, report.entries), (false, entries_of(1..9)), "{start:?}: exactly full");
        bench.period_with_change(9);
        bench.nak(0);
        let report = bench.report().expect("urgent");
        assert!(report.lost, "{start:?}");
        assert_eq!((report.first, report.entries), (0, entries_of(1..9)), "{start:?}: none is overwritten");
        // it stays known until the next epoch
        bench.acknowledge(16);
        assert!(bench.report_now().lost, "{start:?}");
        let next = next_epoch(bench.epoch);
        bench.open(1, NONCE, next);
        (bench.epoch, bench.key) = (next, session_key(1, NONCE, next));
        assert!(bench.greeting().is_some());
        assert!(!bench.report_now().lost, "{start:?}");
    }
}

#[test]
fn periods_that_are_alike_are_one_entry_until_it_is_sent() {
    for start in STARTS {
        let mut bench = CardBench::<16>::new(start);
        let ran = |count| ReportEntry::Ran { distance: Distance::ZERO, count, starved: false, at_rest: true };
        (0..4).for_each(|_| bench.period());
        assert_eq!(bench.report().map(|report| report.entries), Some(vec![ran(4)]), "{start:?}");
        (0..2).for_each(|_| bench.period());
        bench.nak(0);
        // the entry that was sent is as it was
        assert_eq!(bench.report().map(|report| report.entries), Some(vec![ran(4), ran(2)]), "{start:?}");
        bench.period();
        bench.works.status.starved = true;
        bench.period();
        bench.nak(1);
        let starved = ReportEntry::Ran { distance: Distance::ZERO, count: 1, starved: true, at_rest: true };
        let report = bench.report().expect("urgent");
        assert_eq!((report.first, report.entries), (1, vec![ran(2), ran(1), starved]), "{start:?}");
        // one that is acknowledged does not grow either
        bench.acknowledge(4);
        bench.period();
        bench.nak(4);
        let report = bench.report().expect("urgent");
        assert_eq!((report.first, report.entries), (4, vec![starved]), "{start:?}");
    }
}

#[test]
fn unacknowledged_entries_are_sent_again_after_a_while() {
    for start in STARTS {
        let mut bench = CardBench::<16>::new(start);
        assert_eq!(bench.report_now().first, 0);
        // 40 ms at 1 ms a period, from the first period after it was sent
        for period in 1..=40 {
            bench.period();
            let again = bench.report().map(|report| report.first);
            assert_eq!(again, (period % 4 == 0).then_some(period / 4), "{start:?}: period {period}");
        }
        bench.period();
        assert_eq!(bench.report().map(|report| report.first), Some(0), "{start:?}");
        // 30 periods later some are acknowledged, and the time begins again
        for _ in 0..30 {
            bench.period();
            while bench.report().is_some() {}
        }
        bench.acknowledge(2);
        for _ in 0..39 {
            bench.period();
            assert!(bench.report().is_none_or(|report| report.first > 2), "{start:?}");
        }
        bench.period();
        bench.period();
        assert_eq!(bench.report().map(|report| report.first), Some(2), "{start:?}");
    }
}

/// 40 ms are few long periods: it waits for two reports and their answers at least.
#[test]
fn long_periods_prolong_the_time_until_entries_are_sent_again() {
    let mut bench = CardBench::<16>::new(STARTS[1]);
    let next = next_epoch(bench.epoch);
    bench.frame(0, |w| {
        w.u8(kind::OPEN)?;
        w.u32(1)?;
        w.u32(NONCE)?;
        Opening(CardSettings { period_us: 20_000, ..settings(next) }).write(w)
    });
    (bench.epoch, bench.key) = (next, session_key(1, NONCE, next));
    assert!(bench.greeting().is_some());
    assert_eq!(bench.report_now().first, 0);
    for period in 1..=10 {
        bench.period();
        let again = bench.report().map(|report| report.first);
        assert_eq!(again, (period % 4 == 0).then_some(period / 4), "period {period}");
    }
    bench.period();
    assert_eq!(bench.report().map(|report| report.first), Some(0));
}

#[test]
fn a_limited_number_of_entries_is_in_flight() {
    for start in STARTS {
        let mut bench = CardBench::<256>::new(start);
        for value in 1..=60 {
            bench.period_with_change(value);
        }
        // those that do not fit a frame follow at once
        let mut next = 0;
        while let Some(report) = bench.report() {
            assert_eq!((report.first, report.all, report.crc), (next, false, None), "{start:?}");
            assert!(!report.entries.is_empty());
            next += report.entries.len() as u16;
        }
        assert_eq!(next, 96, "{start:?}");
        bench.acknowledge(10);
        let report = bench.report_now();
        assert_eq!((report.first, report.entries.len()), (96, 10), "{start:?}");
    }
}

/// 15 bytes before the entries, 30 times six, and one: 196, with the check 200.
#[test]
fn a_report_is_filled_to_its_last_byte() {
    let mut bench = CardBench::<256>::new(STARTS[1]);
    for executed in 1..=30 {
        bench.works.status.executed = executed;
        bench.period();
    }
    bench.works.status.starved = true;
    bench.period();
    let report = bench.report().expect("due");
    assert_eq!((report.entries.len(), report.all), (61, true));
    assert_eq!(bench.report(), None);
}

#[test]
fn only_frames_of_the_open_epoch_have_an_effect() {
    for start in STARTS {
        let mut bench = CardBench::<16>::new(start);
        let frames = bench.works.host_frames;
        let (epoch, key) = (bench.epoch, bench.key);
        bench.rate_frame(kind::RATE, epoch.wrapping_add(1), 0, 1, 5);
        bench.rate_frame(kind::RATE, epoch.wrapping_sub(1), 0, 1, 5);
        bench.rate_frame(kind::NAK, 0, 0, 1, 5);
        bench.key = session_key(1, NONCE + 1, epoch);
        bench.rate(1, 5);
        bench.key = 0;
        bench.rate(1, 5);
        bench.key = key;
        assert_eq!((bench.works.host_frames, bench.works.rates.len()), (frames, 0), "{start:?}");
        bench.rate(1, 5);
        assert_eq!((bench.works.host_frames, bench.works.rates.len()), (frames + 1, 1), "{start:?}");
        // a closed epoch has no frames; 0 is none
        bench.close(epoch, 4);
        assert_eq!((bench.end.epoch(), bench.greeting().map(|greeting| greeting.nonce)), (0, Some(4)));
        let frames = bench.works.host_frames;
        bench.rate(2, 6);
        bench.rate_frame(kind::RATE, 0, 0, 3, 6);
        assert_eq!((bench.works.host_frames, bench.works.rates.len()), (frames, 1), "{start:?}");
        // and is closed again for a host that has missed the answer
        bench.close(epoch, 5);
        assert_eq!(bench.greeting().map(|greeting| (greeting.nonce, greeting.epoch)), Some((5, 0)));
        (0..20).for_each(|_| bench.period());
        assert_eq!(bench.report(), None, "{start:?}: no report without an epoch");
    }
}

#[test]
fn an_epoch_is_not_closed_in_motion() {
    let mut bench = CardBench::<16>::new(STARTS[1]);
    bench.works.status.at_rest = false;
    let epoch = bench.epoch;
    bench.close(epoch, 4);
    assert_eq!(bench.end.epoch(), epoch);
    assert_eq!(bench.greeting().map(|greeting| (greeting.nonce, greeting.epoch)), Some((4, epoch)));
    bench.works.status.at_rest = true;
    bench.close(epoch.wrapping_sub(1), 6);
    assert_eq!(bench.end.epoch(), epoch, "another one");
}

#[test]
fn only_the_next_epoch_of_this_start_of_the_card_is_opened() {
    for start in STARTS {
        let mut bench = CardBench::<16>::new(start);
        bench.stream(0, 0, &[output(10)]);
        let (epoch, next) = (bench.epoch, next_epoch(bench.epoch));
        let frames = bench.works.host_frames;
        for (boot, epoch) in [(2, next), (1, next_epoch(next)), (1, epoch.wrapping_sub(1)), (1, 0)] {
            bench.open(boot, NONCE + 1, epoch);
            assert_eq!(bench.end.epoch(), bench.epoch, "{start:?}");
            // it is answered, with what is open
            let answer = bench.greeting().map(|greeting| (greeting.nonce, greeting.epoch, greeting.last_epoch));
            assert_eq!(answer, Some((NONCE + 1, bench.epoch, bench.epoch)));
        }
        bench.works.refuses = true;
        bench.open(1, NONCE, next);
        assert_eq!((bench.end.epoch(), bench.works.host_frames), (bench.epoch, frames), "{start:?}: refused");
        assert!(bench.greeting().is_some());
        bench.works.refuses = false;
        assert_eq!(bench.report_now().next_command, 1, "{start:?}: the epoch is as it was");
        // the next one begins with the first numbers, and has its own key
        bench.open(1, NONCE + 7, next);
        assert_eq!((bench.end.epoch(), bench.works.host_frames), (next, frames + 1), "{start:?}");
        bench.rate(1, 5);
        assert!(bench.works.rates.is_empty(), "{start:?}: the old key");
        (bench.epoch, bench.key) = (next, session_key(1, NONCE + 7, next));
        assert!(bench.greeting().is_some());
        bench.stream(0, 0, &[output(20)]);
        bench.rate(1, 5);
        assert_eq!((bench.works.by_hand.last(), bench.works.rates.len()), (Some(&20), 1), "{start:?}");
        let report = bench.report_now();
        assert_eq!((report.epoch, report.first, report.next_command, report.rate), (next, 0, 1, 1), "{start:?}");
    }
}

#[test]
fn an_opening_that_is_repeated_is_a_sign_of_life_until_a_frame_arrives() {
    for start in STARTS {
        let mut bench = CardBench::<16>::new(start);
        let (epoch, frames) = (bench.epoch, bench.works.host_frames);
        bench.open(1, NONCE, epoch);
        assert_eq!(bench.works.host_frames, frames + 1, "{start:?}");
        bench.open(1, NONCE + 1, epoch);
        assert_eq!(bench.works.host_frames, frames + 1, "{start:?}: another nonce");
        bench.rate(1, 5);
        bench.open(1, NONCE, epoch);
        assert_eq!(bench.works.host_frames, frames + 2, "{start:?}: a recording");
        assert_eq!(bench.works.rates.len(), 1);
        bench.close(epoch, 3);
        bench.open(1, NONCE, epoch);
        assert_eq!((bench.end.epoch(), bench.works.host_frames), (0, frames + 3), "{start:?}: closed");
    }
}

#[test]
fn rejected_instructions_and_repeats_are_reported() {
    let mut bench = CardBench::<16>::new(STARTS[1]);
    let instruction = |number| HostCommand::Instruction(Instruction { number, ..Instruction::default() });
    let repeat = HostCommand::Repeat(RepeatedInstruction { number: 8, ..RepeatedInstruction::default() });
    bench.stream(0, 0, &[instruction(7), repeat, instruction(1)]);
    let mut report = bench.report_now();
    report.entries.truncate(3);
    assert_eq!(report.entries, [ReportEntry::Refused(7), ReportEntry::RepeatRefused(8), ReportEntry::Executed(1),]);
    assert_eq!(report.next_command, 3);
}

/// The hash by which a model knows states: what decides about the future is in it, and the past is not.
#[test]
fn states_are_equal_if_they_behave_alike() {
    use std::collections::hash_map::DefaultHasher;
    use std::hash::Hasher;
    let hash = |bench: &CardBench<16>| {
        let mut state = DefaultHasher::new();
        bench.end.hash_state(&mut state);
        state.finish()
    };
    let (bench, mut other) = (CardBench::<16>::new(STARTS[1]), CardBench::<16>::new(STARTS[1]));
    assert_eq!(hash(&bench), hash(&other));
    other.end.receive(9, &mut other.works);
    let half = hash(&other);
    assert_ne!(hash(&bench), half);
    other.end.receive(8, &mut other.works);
    assert_ne!(hash(&other), half);
    other.end.receive(0, &mut other.works);
    assert_eq!(hash(&bench), hash(&other), "a damaged frame leaves nothing behind");
    // entries that are outstanding differ, and those that are acknowledged do not
    let with_entry = |value| {
        let mut bench = CardBench::<16>::new(STARTS[1]);
        bench.period_with_change(value);
        bench.period_with_change(0);
        bench
    };
    let (mut one, mut two) = (with_entry(1), with_entry(2));
    assert_ne!(hash(&one), hash(&two));
    for bench in [&mut one, &mut two] {
        bench.nak(0);
        assert_eq!(bench.report().map(|report| report.entries.len()), Some(4));
        bench.acknowledge(4);
    }
    assert_eq!(hash(&one), hash(&two));
}
