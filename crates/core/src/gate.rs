//! The gates that keep motion and exclusive instructions in order (GMC-3 … GMC-7), in their acknowledged form.
//!
//! No gate depends on a sampled flag of the card. Gate B, which lets records through to the card, is closed from the
//! front marker until the card reports the *number* of the instruction as executed. Gate C, which lets the instruction
//! through, opens when the card reports the *place* of the marker as executed and the cursor at rest there. Gate A,
//! which accepts the next instruction, is open while none is pending. The literal gates of the source sample a ready
//! flag and treat "empty" as a level; both fail (spec, GMC).
//!
//! Invariant: B and C are never open together for the same marker; at most one instruction is pending.

use crate::{Place, RecordIndex};

/// The pending instruction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct PendingInstruction {
    number: u32,
    place: RecordIndex,
    sent: bool,
}

/// State of the gates A, B and C.
///
/// # Examples
///
/// ```
/// use retrace_core::gate::Gates;
/// use retrace_core::{Place, RecordIndex};
///
/// let (marker, behind) = (RecordIndex::new(100), RecordIndex::new(101));
/// let mut gates = Gates::default();
/// gates.accept(1, marker);
/// assert!(!gates.b_open(behind), "motion waits for the instruction");
/// assert!(gates.c_open(Place::start_of(marker), true), "at rest at the marker");
/// gates.mark_sent();
/// assert_eq!(gates.acknowledge(1), Some(1));
/// assert!(gates.b_open(behind));
/// ```
#[derive(Clone, Copy, Debug, Default)]
pub struct Gates {
    pending: Option<PendingInstruction>,
}

impl Gates {
    /// Whether gate A is open: the next instruction may be accepted. (GMC-5)
    #[must_use]
    pub const fn a_open(&self) -> bool {
        self.pending.is_none()
    }

    /// Accepts instruction `number`, whose front marker is before record `place`.
    ///
    /// Returns false and changes nothing if another instruction is pending.
    pub fn accept(&mut self, number: u32, place: RecordIndex) -> bool {
        let open = self.a_open();
        if open {
            self.pending = Some(PendingInstruction { number, place, sent: false });
        }
        open
    }

    /// Whether gate B is open for record `place`: the record may be sent to the card. (GMC-4)
    #[must_use]
    pub const fn b_open(&self, place: RecordIndex) -> bool {
        match self.pending {
            Some(marker) => place.is_before(marker.place),
            None => true,
        }
    }

    /// Whether gate C is open: the pending instruction may be sent. All motion before it is executed and the cursor is
    /// at rest on its place. (GMC-6)
    #[must_use]
    pub fn c_open(&self, cursor: Place, at_rest: bool) -> bool {
        self.pending.is_some_and(|marker| !marker.sent && at_rest && cursor == Place::start_of(marker.place))
    }

    /// Records that the card has accepted the pending instruction.
    pub fn mark_sent(&mut self) {
        if let Some(marker) = &mut self.pending {
            marker.sent = true;
        }
    }

    /// Records that the card has cancelled the pending instruction: gate C may open for it again.
    pub fn mark_cancelled(&mut self) {
        if let Some(marker) = &mut self.pending {
            marker.sent = false;
        }
    }

    /// Handles the card's report that instruction `executed` is complete.
    ///
    /// If it is the pending one, the instruction and its marker are removed and its number is returned.
    pub fn acknowledge(&mut self, executed: u32) -> Option<u32> {
        let marker = self.pending.filter(|m| m.sent && m.number == executed)?;
        self.pending = None;
        Some(marker.number)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn only_the_instruction_that_was_sent_is_acknowledged() {
        let mut gates = Gates::default();
        assert!(gates.accept(7, RecordIndex::new(3)) && !gates.accept(8, RecordIndex::new(4)));
        assert_eq!(gates.acknowledge(7), None);
        gates.mark_sent();
        gates.mark_cancelled();
        assert_eq!((gates.acknowledge(7), gates.c_open(Place::start_of(RecordIndex::new(3)), true)), (None, true));
        gates.mark_sent();
        assert_eq!(gates.acknowledge(6), None);
        assert!(!gates.b_open(RecordIndex::new(3)) && gates.b_open(RecordIndex::new(2)) && !gates.a_open());
        assert_eq!(gates.acknowledge(7), Some(7));
        assert!(gates.b_open(RecordIndex::new(3)) && gates.a_open());
    }

    proptest! {
        /// Simulates a card that plays records, dwells, executes and reports late. In the card's own sequence no record
        /// is on the wrong side of an instruction, and the run completes.
        #[test]
        fn order_holds_under_every_delay(
            markers in prop::collection::btree_set(0u32..40, 0..8), start in any::<u32>(),
            lag in 0usize..7, duration in 0u32..5,
        ) {
            let end = start.wrapping_add(40);
            let markers: Vec<u32> = markers.into_iter().map(|m| start.wrapping_add(m)).collect();
            let (mut gates, mut next, mut sent) = (Gates::default(), 0usize, start);
            // the card: place played up to, running instruction, last executed instruction
            let (mut at, mut busy, mut executed) = (start, None::<(u32, u32)>, 0u32);
            let mut line: Vec<Result<u32, u32>> = Vec::new();
            let mut reports = vec![(start, true, 0u32); lag + 1];
            for _ in 0..4000 {
                // the host, with a report that is `lag` periods old
                let (place, rest, done) = reports[reports.len() - 1 - lag];
                if gates.acknowledge(done).is_some() { next += 1; }
                if next < markers.len() { gates.accept(next as u32 + 1, RecordIndex::new(markers[next])); }
                while sent != end && gates.b_open(RecordIndex::new(sent)) { sent = sent.wrapping_add(1); }
                if gates.c_open(Place::start_of(RecordIndex::new(place)), rest) {
                    gates.mark_sent();
                    prop_assert!(busy.is_none());
                    busy = Some((next as u32 + 1, duration));
                    line.push(Err(markers[next]));
                }
                // card
                match busy {
                    Some((number, 0)) => { executed = number; busy = None; }
                    Some((number, remaining)) => busy = Some((number, remaining - 1)),
                    None if at != sent => { line.push(Ok(at)); at = at.wrapping_add(1); }
                    None => {}
                }
                reports.push((at, at == sent, executed));
            }
            let mut expected = Vec::new();
            for k in 0..40 {
                let place = start.wrapping_add(k);
                if markers.contains(&place) { expected.push(Err(place)); }
                expected.push(Ok(place));
            }
            prop_assert_eq!(line, expected);
        }
    }
}
