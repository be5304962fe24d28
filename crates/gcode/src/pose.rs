//! A position: one coordinate for each of the nine axes.
//!
//! Invariant: the order is X Y Z A B C U V W everywhere. X Y Z U V W are lengths, A B C are degrees; the length unit is
//! documented where a [`Pose`] is used.

use std::ops::{Index, IndexMut};

/// One of the nine axes of RS274/NGC.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[repr(u8)]
pub enum Axis {
    /// Linear, first of the plane of G17.
    X,
    /// Linear, second of the plane of G17.
    Y,
    /// Linear.
    Z,
    /// Rotary about X, degrees.
    A,
    /// Rotary about Y, degrees.
    B,
    /// Rotary about Z, degrees.
    C,
    /// Linear, parallel to X.
    U,
    /// Linear, parallel to Y.
    V,
    /// Linear, parallel to Z.
    W,
}

impl Axis {
    /// All nine axes, in order.
    pub const ALL: [Axis; 9] = [Axis::X, Axis::Y, Axis::Z, Axis::A, Axis::B, Axis::C, Axis::U, Axis::V, Axis::W];

    /// Whether the axis is rotary: its coordinate is in degrees and does not change with the length unit.
    #[must_use]
    pub const fn is_rotary(self) -> bool {
        matches!(self, Axis::A | Axis::B | Axis::C)
    }

    /// Returns the word letter, upper case.
    #[must_use]
    pub const fn letter(self) -> u8 {
        b"XYZABCUVW"[self as usize]
    }

    /// Returns the axis of a word letter, of either case.
    #[must_use]
    pub const fn of_letter(letter: u8) -> Option<Axis> {
        Some(match letter {
            b'X' | b'x' => Axis::X,
            b'Y' | b'y' => Axis::Y,
            b'Z' | b'z' => Axis::Z,
            b'A' | b'a' => Axis::A,
            b'B' | b'b' => Axis::B,
            b'C' | b'c' => Axis::C,
            b'U' | b'u' => Axis::U,
            b'V' | b'v' => Axis::V,
            b'W' | b'w' => Axis::W,
            _ => return None,
        })
    }
}

/// Set of the axes of a machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AxisSet(u16);

impl AxisSet {
    /// X, Y and Z.
    pub const XYZ: AxisSet = AxisSet(0b111);
    /// X, Y, Z, A, B and C.
    pub const XYZABC: AxisSet = AxisSet(0b11_1111);
    /// All nine axes.
    pub const ALL: AxisSet = AxisSet(0b1_1111_1111);

    /// Creates the set of these axes.
    #[must_use]
    pub fn from_axes(axes: &[Axis]) -> AxisSet {
        AxisSet(axes.iter().fold(0, |bits, axis| bits | 1 << *axis as u16))
    }

    /// Whether the set contains the axis.
    #[must_use]
    pub const fn has(self, axis: Axis) -> bool {
        self.0 & 1 << axis as u16 != 0
    }
}

/// Nine coordinates. The unit of the linear ones is documented where the pose is used.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose(pub [f64; 9]);

impl Pose {
    /// Zero on every axis.
    pub const ZERO: Pose = Pose([0.0; 9]);

    /// Creates a pose from X, Y and Z; the other coordinates are zero.
    #[must_use]
    pub const fn xyz(x: f64, y: f64, z: f64) -> Pose {
        Pose([x, y, z, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    }

    /// Replaces one coordinate.
    #[must_use]
    pub fn with(mut self, axis: Axis, value: f64) -> Pose {
        self[axis] = value;
        self
    }

    /// Multiplies the linear coordinates by `factor`; the rotary ones stay.
    #[must_use]
    pub fn scaled_lengths(mut self, factor: f64) -> Pose {
        for axis in Axis::ALL {
            if !axis.is_rotary() {
                self[axis] *= factor;
            }
        }
        self
    }

    /// Adds coordinate by coordinate: `self + other`.
    #[must_use]
    pub fn plus(mut self, other: &Pose) -> Pose {
        for axis in Axis::ALL {
            self[axis] += other[axis];
        }
        self
    }

    /// Subtracts coordinate by coordinate: `self - other`.
    #[must_use]
    pub fn minus(mut self, other: &Pose) -> Pose {
        for axis in Axis::ALL {
            self[axis] -= other[axis];
        }
        self
    }
}

impl Index<Axis> for Pose {
    type Output = f64;

    fn index(&self, axis: Axis) -> &f64 {
        &self.0[axis as usize]
    }
}

impl IndexMut<Axis> for Pose {
    fn index_mut(&mut self, axis: Axis) -> &mut f64 {
        &mut self.0[axis as usize]
    }
}
