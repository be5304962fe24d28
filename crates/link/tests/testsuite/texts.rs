//! What errors and alarms say, their numbers on the wire and in the table of errors, and fixed values of the protocol.

use retrace_core::{Place, RecordIndex};
use retrace_link::sequence::{FirstNumbers, acknowledged_items, is_after};
use retrace_link::session::{is_next_opening, is_open_epoch};
use retrace_link::{
    Alarm, CardFailure, CardStatus, CommandRefusal, LinkError, LinkedCardError, PathStart, next_epoch, session_key,
};
use std::collections::BTreeSet;

const ALARMS: [(Alarm, u8, u32, &str); 18] = [
    (Alarm::HostSilent, 1, 0, "E3011"),
    (Alarm::EmergencyStop, 2, 0, "E3012"),
    (Alarm::DoorOpen, 3, 0, "E3013"),
    (Alarm::LimitSwitch { axis: 5, upper: false }, 4, 5, "E3014"),
    (Alarm::LimitSwitch { axis: 6, upper: true }, 4, 0x106, "E3014"),
    (Alarm::TimedOut { instruction: 70_000 }, 5, 70_000, "E3015"),
    (Alarm::Failed { instruction: 70_001 }, 6, 70_001, "E3016"),
    (Alarm::TooManyPulses { axis: 2 }, 7, 2, "E3017"),
    (Alarm::HomingFailed { axis: 3 }, 8, 3, "E3018"),
    (Alarm::Defect, 9, 0, "E3019"),
    (Alarm::ProvenBeforeStart { input: 5 }, 10, 5, "E3022"),
    (Alarm::CutterStaysOn { input: 15 }, 11, 15, "E3023"),
    (Alarm::Collision { input: 7 }, 12, 7, "E3027"),
    (Alarm::ProbeTripped { input: 9 }, 13, 9, "E3028"),
    (Alarm::NotAtSpeed, 14, 0, "E3032"),
    (Alarm::EncoderFailed, 15, 0, "E3033"),
    (Alarm::SpindleStalled, 16, 0, "E3034"),
    (Alarm::ThreadLost, 17, 0, "E3035"),
];

fn is_described(failure: &impl CardFailure, number: &str) {
    assert_eq!(failure.number(), number);
    assert!(failure.remedy().len() > 10 && failure.to_string().len() > 10, "{number}");
}

#[test]
fn every_alarm_has_its_code_its_number_and_its_words() {
    for (alarm, code, detail, number) in ALARMS {
        assert_eq!(alarm.to_wire(), (code, detail));
        assert_eq!(Alarm::from_wire(code, detail), Some(alarm));
        is_described(&alarm, number);
        let error = LinkError::Alarm(alarm);
        assert_eq!((error.number(), error.remedy()), (number, alarm.remedy()));
        assert_eq!(error.to_string(), alarm.to_string());
    }
    assert_eq!(Alarm::from_wire(4, 0x2FE), Some(Alarm::LimitSwitch { axis: 0xFE, upper: false }));
    assert_eq!((Alarm::from_wire(0, 0), Alarm::from_wire(18, 0)), (None, None));
}

#[test]
fn every_error_of_the_line_has_its_number_and_its_words() {
    let errors = [
        (LinkError::Silent, "E3002"),
        (LinkError::Restarted, "E3003"),
        (LinkError::StateMismatch, "E3004"),
        (LinkError::ReportLost, "E3005"),
        (LinkError::Refused(4), "E3006"),
        (LinkError::Protocol(9), "E3007"),
        (LinkError::SettingsRejected, "E3008"),
        (LinkError::NotAtRest, "E3037"),
    ];
    let mut words = BTreeSet::new();
    for (error, number) in errors {
        is_described(&error, number);
        assert!(words.insert(error.to_string()));
        let port: LinkedCardError<Alarm> = error.into();
        assert_eq!(port, LinkedCardError::Host(error));
        assert_eq!((port.number(), port.remedy(), port.to_string()), (number, error.remedy(), error.to_string()));
    }
    let port = LinkedCardError::Port(Alarm::DoorOpen);
    assert_eq!((port.number(), port.remedy()), ("E3013", Alarm::DoorOpen.remedy()));
    assert_eq!(port.to_string(), Alarm::DoorOpen.to_string());
    assert!(LinkError::Moved.number().starts_with("E30") && LinkError::Moved.to_string().len() > 10);
}

#[test]
fn every_refusal_has_words() {
    use CommandRefusal::{Alarm, Busy, Full, InMotion, NoSuchChannel, OutOfOrder, Unsupported};
    let all = [Full, OutOfOrder, InMotion, Busy, NoSuchChannel, Alarm, Unsupported];
    let words: BTreeSet<String> = all.iter().map(ToString::to_string).collect();
    assert!(words.len() == all.len() && words.iter().all(|words| words.len() > 10));
}

/// Host and card of different builds have to calculate the same key.
#[test]
fn the_keys_of_a_protocol_version_never_change() {
    let keys = [session_key(0, 0, 1), session_key(1, 0xFEED, 7), session_key(u32::MAX, 1 << 31, u16::MAX)];
    assert_eq!(keys, KEYS);
}

/// Calculated once, by the finalizer of MurmurHash3 in another language.
const KEYS: [u32; 3] = [0x514E_28B7, 0x5C44_EF33, 0x88F1_77B3];

#[test]
fn numbers_are_compared_over_the_wrap() {
    assert_eq!(FirstNumbers::protocol(), FirstNumbers { command: 0, entry: 0, rate: 0 });
    for other in [0u16, 1, 0x7FFF, 0x8000, 0xFFFE, 0xFFFF] {
        for distance in 0..=u16::MAX {
            let number = other.wrapping_add(distance);
            assert_eq!(is_after(number, other), (1..=0x7FFF).contains(&distance));
            for count in [0, 1, 96, 0x4000] {
                assert_eq!(acknowledged_items(number, other, count), (distance <= count).then_some(distance));
            }
        }
    }
}

#[test]
fn only_the_next_epoch_of_this_start_is_opened() {
    for last in [0, 1, 0x7FFF, 0xFFFE, 0xFFFF] {
        for epoch in 0..=u16::MAX {
            let is_next = epoch == if last == 0xFFFF { 1 } else { last + 1 };
            assert_eq!((is_next_opening(4, epoch, 4, last), next_epoch(last) == epoch), (is_next, is_next));
            assert!(!is_next_opening(5, epoch, 4, last) && !is_open_epoch(epoch, 0));
            assert_eq!(is_open_epoch(epoch, last), epoch == last && last != 0);
        }
    }
}

#[test]
fn a_start_is_valid_if_it_is_consistent() {
    let start = PathStart::at(RecordIndex::new(9));
    assert_eq!((start.reached, start.executed, start.rests), (RecordIndex::new(9), 0, true));
    assert_eq!(CardStatus::<2>::at_rest(start).low, RecordIndex::new(9));
    let inside = Place { record: RecordIndex::new(9), fraction: 1 };
    let reached = RecordIndex::new(10);
    for (place, rests, reached, valid) in [
        (start.place, true, start.reached, true),
        (start.place, false, start.reached, true),
        (start.place, true, reached, true),
        (start.place, true, RecordIndex::new(8), false),
        (inside, false, reached, true),
        (inside, true, reached, false),
        (inside, false, start.reached, false),
    ] {
        assert_eq!(PathStart { place, rests, reached, ..start }.is_valid(), valid);
    }
}
