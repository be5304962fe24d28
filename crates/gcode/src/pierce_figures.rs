//! The figures of a pierce in motion that M159 sets, as in QtPlasmaC (CUT-18, CUT-24).
//!
//! Invariant: they are in their ranges, in mm, s, per cent and mm per minute. They change how a contour begins, and
//! nothing else of its material.

use crate::material::Material;
use std::sync::Arc;

/// How the cutter pierces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum PierceKind {
    /// At rest.
    Standing,
    /// The feed begins with the proof; the height is that of the pierce until its delay is over.
    Moving,
    /// The same, at feed rates of its own, and the height falls before.
    Ramp,
}

/// Figures of M159; without a kind, those of the material are in force.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct PierceFigures {
    kind: Option<PierceKind>,
    /// Share of the pierce delay behind which the height falls.
    delay_percent: f64,
    end_height_mm: f64,
    /// Time from the end of the pierce delay to the fall to the cut height.
    hold_s: f64,
    gouge_mm_per_min: f64,
    gouge_mm: f64,
    creep_mm_per_min: f64,
    /// Behind the gouge.
    creep_mm: f64,
}

impl PierceFigures {
    /// Sets figure 601 to 608 from a value in program units of `unit_mm`; 609 resets all of them.
    ///
    /// # Errors
    /// The least and the greatest value; nothing has changed then.
    pub(crate) fn set(&mut self, number: u16, value: f64, unit_mm: f64) -> Result<(), [f64; 2]> {
        let (field, greatest, unit) = match number {
            601 => {
                self.kind = Some(match value {
                    0.0 => PierceKind::Standing,
                    1.0 => PierceKind::Moving,
                    2.0 => PierceKind::Ramp,
                    _ => return Err([0.0, 2.0]),
                });
                return Ok(());
            }
            602 => (&mut self.delay_percent, 100.0, 1.0),
            603 => (&mut self.end_height_mm, 200.0, unit_mm),
            604 => (&mut self.hold_s, 60.0, 1.0),
            605 => (&mut self.gouge_mm_per_min, 1_000_000.0, unit_mm),
            606 => (&mut self.gouge_mm, 100.0, unit_mm),
            607 => (&mut self.creep_mm_per_min, 1_000_000.0, unit_mm),
            608 => (&mut self.creep_mm, 900.0, unit_mm),
            _ => {
                *self = Self::default();
                return Ok(());
            }
        };
        if !(0.0..=greatest).contains(&(value * unit)) {
            return Err([0.0, greatest / unit]);
        }
        *field = value * unit;
        Ok(())
    }

    /// The material with these figures.
    pub(crate) fn applied_to(&self, material: &Arc<Material>) -> Arc<Material> {
        let Some(kind) = self.kind else { return Arc::clone(material) };
        let mut of = Material {
            pierces_in_motion: kind != PierceKind::Standing,
            ramp_height_mm: 0.0,
            ramp_delay_percent: 0.0,
            ramp_hold_s: 0.0,
            ..(**material).clone()
        };
        if kind == PierceKind::Ramp {
            of.ramp_height_mm = self.end_height_mm;
            of.ramp_delay_percent = self.delay_percent;
            of.ramp_hold_s = self.hold_s;
            if self.gouge_mm > 0.0 {
                (of.pierce_mm, of.pierce_feed_mm_per_min) = (self.gouge_mm, self.gouge_mm_per_min);
            }
            if self.creep_mm > 0.0 {
                (of.creep_mm, of.creep_feed_mm_per_min) = (self.gouge_mm + self.creep_mm, self.creep_mm_per_min);
            }
        }
        Arc::new(of)
    }
}
