//! Counting the handwheel's encoder from samples of its two signals.
//!
//! Invariant: a bounce of one signal counts back what it counted forth; a change of both signals at once, whose
//! direction is unknown, counts nothing.

/// State of the counter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Quadrature {
    levels: u8,
    count: u16,
}

impl Quadrature {
    /// Creates a counter at 0 that begins with these levels: A in bit 0, B in bit 1.
    #[must_use]
    pub const fn new(levels: u8) -> Self {
        Self { levels: levels & 0b11, count: 0 }
    }

    /// Takes a sample of the signals and returns the count, four per period of the signals; it wraps around.
    pub const fn sample(&mut self, levels: u8) -> u16 {
        let levels = levels & 0b11;
        // A leads B: 00, 01, 11, 10 counts up
        let step: i16 = match (self.levels, levels) {
            (0b00, 0b01) | (0b01, 0b11) | (0b11, 0b10) | (0b10, 0b00) => 1,
            (0b01, 0b00) | (0b11, 0b01) | (0b10, 0b11) | (0b00, 0b10) => -1,
            _ => 0,
        };
        self.levels = levels;
        self.count = self.count.wrapping_add_signed(step);
        self.count
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_counts_four_a_period_in_both_directions() {
        let mut counter = Quadrature::new(0);
        let forward = [0b01, 0b11, 0b10, 0b00];
        let counts: Vec<u16> = forward.iter().map(|&levels| counter.sample(levels)).collect();
        assert_eq!(counts, [1, 2, 3, 4]);
        for levels in [0b10, 0b11, 0b01, 0b00, 0b10] {
            counter.sample(levels);
        }
        assert_eq!(counter.sample(0b10), u16::MAX);
        assert_eq!(counter.sample(0b01), u16::MAX, "both signals changed");
    }
}
