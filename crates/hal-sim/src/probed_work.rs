//! Work that the simulated probe touches: half-spaces, boxes, bosses and bores in machine coordinates.
//!
//! Invariant: whether the probe touches depends on the counted pulses alone, and the part of the control period in
//! which that changes is the one of the pulse that changes it.

use retrace_core::fine::pulse_slots;

/// Parts of a control period in which an edge is captured.
const PARTS: u32 = 1 << 16;
/// Interval at which a bouncing contact changes, in microseconds.
const BOUNCE_US: u64 = 300;
/// Width of the wall around a bore, in picometres.
const WALL_PM: i64 = 10_000_000_000;

/// A body, in pulses of the axes X, Y and Z.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProbedBody {
    /// A box, its faces included: lowest and highest corner.
    Box([i64; 3], [i64; 3]),
    /// An upright cylinder.
    Boss(Cylinder),
    /// The wall around an upright cylindrical hole.
    Bore(Cylinder),
}

/// An upright cylinder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cylinder {
    /// Centre, in pulses of X and Y.
    pub centre: [i64; 2],
    /// Radius, in picometres.
    pub radius_pm: i64,
    /// Lower and upper end, in pulses of Z.
    pub ends: [i64; 2],
}

/// The work and the probe.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ProbedWork {
    /// The probe's input.
    pub input: u8,
    /// The machine's axes X, Y and Z, from 0, where it has them.
    pub axes: [Option<u8>; 3],
    /// Length of a pulse of X and Y, in picometres.
    pub pm_per_pulse: [i64; 2],
    /// The bodies.
    pub bodies: Vec<ProbedBody>,
    /// Time for which the contact bounces after each change, in microseconds.
    pub bounce_us: u32,
}

impl ProbedWork {
    /// Whether the tip of the probe touches a body at this position of the axes, in pulses.
    fn touches(&self, positions: &[i64]) -> bool {
        let of = |axis: Option<u8>| axis.and_then(|axis| positions.get(usize::from(axis)).copied()).unwrap_or(0);
        let at = self.axes.map(of);
        self.bodies.iter().any(|body| match body {
            ProbedBody::Box(low, high) => (0..3).all(|axis| (low[axis]..=high[axis]).contains(&at[axis])),
            ProbedBody::Boss(cylinder) => self.is_within(cylinder, &at, 0),
            ProbedBody::Bore(cylinder) => self.is_within(cylinder, &at, WALL_PM) && !self.is_within(cylinder, &at, -1),
        })
    }

    /// Whether a position is in a cylinder whose radius is larger by `more_pm`.
    fn is_within(&self, cylinder: &Cylinder, at: &[i64; 3], more_pm: i64) -> bool {
        let [x, y] =
            [0, 1].map(|axis| i128::from(at[axis] - cylinder.centre[axis]) * i128::from(self.pm_per_pulse[axis]));
        let radius = i128::from(cylinder.radius_pm + more_pm);
        let [low, high] = cylinder.ends;
        (low..=high).contains(&at[2]) && x * x + y * y <= radius * radius
    }

    /// Returns the part of the period in which the contact changes first, if it does, where the axes came to
    /// `positions` by these pulses from a position with contact `before`; and the contact there.
    fn change_within(&self, positions: &[i64], pulses: &[i32], before: bool) -> (bool, Option<u16>) {
        let mut at: Vec<i64> = positions.iter().zip(pulses).map(|(&to, &pulses)| to - i64::from(pulses)).collect();
        let mut emitted: Vec<(u32, usize)> = Vec::new();
        for (axis, &count) in pulses.iter().enumerate() {
            let most = u16::try_from(count.unsigned_abs()).unwrap_or(u16::MAX);
            emitted.extend(pulse_slots(most, PARTS).map(|part| (part, axis)));
        }
        emitted.sort_unstable();
        let mut first = None;
        for (number, &(part, axis)) in emitted.iter().enumerate() {
            at[axis] += i64::from(pulses[axis].signum());
            // Pulses of the same part are emitted together.
            let is_last = emitted.get(number + 1).is_none_or(|&(next, _)| next != part);
            if is_last && first.is_none() && self.touches(&at) != before {
                first = Some(part as u16);
            }
        }
        (self.touches(positions), first)
    }
}

/// The contact of the probe as time passes.
#[derive(Clone, Debug)]
pub(crate) struct ProbeContact {
    work: ProbedWork,
    touches: bool,
    changed_us: Option<u64>,
}

impl ProbeContact {
    pub(crate) fn new(work: &ProbedWork) -> Self {
        Self { work: work.clone(), touches: false, changed_us: None }
    }

    /// The probe's input.
    pub(crate) const fn input(&self) -> u8 {
        self.work.input
    }

    /// Advances to `now_us`, the axes having come to `positions` by these pulses in the period before. Returns the
    /// level, and the part of the period in which it changed first.
    pub(crate) fn advance(&mut self, now_us: u64, positions: &[i64], pulses: &[i32]) -> (bool, Option<u16>) {
        let (touches, change) = self.work.change_within(positions, pulses, self.touches);
        if touches != self.touches {
            (self.touches, self.changed_us) = (touches, Some(now_us));
        }
        let since = self.changed_us.map(|then| now_us - then).filter(|&us| us < u64::from(self.work.bounce_us));
        let is_bounced = since.is_some_and(|us| us / BOUNCE_US % 2 == 1);
        (self.touches != is_bounced, change)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn work(bodies: Vec<ProbedBody>) -> ProbedWork {
        let axes = [Some(0), Some(1), Some(2)];
        ProbedWork { input: 3, axes, pm_per_pulse: [1000; 2], bodies, bounce_us: 0 }
    }

    #[test]
    fn the_contact_changes_with_the_pulse_that_changes_it() {
        let plane = work(vec![ProbedBody::Box([i64::MIN; 3], [i64::MAX, i64::MAX, -95])]);
        // Ten pulses down, from −90 to −100: the fifth one touches.
        let fifth = pulse_slots(10, PARTS).nth(4).map(|part| part as u16);
        assert_eq!(plane.change_within(&[0, 0, -100], &[0, 0, -10], false), (true, fifth));
        assert!(!plane.change_within(&[0, 0, -90], &[0, 0, 10], true).0);
        assert_eq!(plane.change_within(&[0, 0, -100], &[0, 0, 0], true), (true, None));
    }

    #[test]
    fn a_boss_is_touched_from_outside_and_a_bore_from_inside() {
        let cylinder = Cylinder { centre: [1000, 0], radius_pm: 500_000, ends: [-10, 0] };
        let (boss, bore) = (work(vec![ProbedBody::Boss(cylinder)]), work(vec![ProbedBody::Bore(cylinder)]));
        assert_eq!([499, 500, 1000, 1500, 1501].map(|x| boss.touches(&[x, 0, -5])), [false, true, true, true, false]);
        assert_eq!(
            [499, 500, 501, 1000, 1499, 1500].map(|x| bore.touches(&[x, 0, -5])),
            [true, true, false, false, false, true]
        );
        assert!(!boss.touches(&[1000, 0, 1]) && !bore.touches(&[499, 0, -11]));
    }

    #[test]
    fn a_contact_bounces_and_then_stays() {
        let plane =
            ProbedWork { bounce_us: 2000, ..work(vec![ProbedBody::Box([i64::MIN; 3], [i64::MAX, i64::MAX, 0])]) };
        let mut contact = ProbeContact::new(&plane);
        let mut advance = |us: u64, z: i64| contact.advance(us, &[0, 0, z], &[0, 0, -1]);
        assert_eq!(advance(0, 1), (false, None));
        assert!(advance(1000, 0).0 && advance(1000, 0).1.is_none());
        assert!(!advance(1400, -1).0 && advance(1700, -2).0 && !advance(2000, -3).0);
        assert!((3000..9000).all(|us| advance(us, -4).0));
    }
}
