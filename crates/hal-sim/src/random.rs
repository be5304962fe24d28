//! Repeatable random numbers.
//!
//! Invariant: the same seed gives the same numbers, on every machine and in every version.

/// Pseudo-random number generator: SplitMix64 (Steele, Lea and Flood, *Fast splittable pseudorandom number generators*,
/// OOPSLA 2014).
#[derive(Clone, Debug)]
pub struct Random {
    state: u64,
}

impl Random {
    /// Generator whose numbers depend on the seed alone.
    #[must_use]
    pub const fn new(seed: u64) -> Self {
        Self { state: seed }
    }

    /// The next number, with all 64 bits random.
    pub const fn next(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.state;
        z = (z ^ z >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ z >> 31
    }

    /// A number in 0 … `most`, each with equal probability to one part in 2³².
    pub const fn up_to(&mut self, most: u32) -> u32 {
        (((self.next() >> 32) * (most as u64 + 1)) >> 32) as u32
    }

    /// A separate generator for a part of the simulation, so that the numbers of one part do not affect the others.
    #[must_use]
    pub const fn branch(&mut self) -> Self {
        Self::new(self.next())
    }
}

/// Probability, in units of 2⁻³².
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Chance(u32);

impl Chance {
    /// Probability 0.
    pub const NEVER: Self = Self(0);

    /// Creates a probability from a number in 0 … 1; `None` outside. Certainty is short of 1 by 2⁻³².
    #[must_use]
    pub fn new(probability: f64) -> Option<Self> {
        (0.0..=1.0).contains(&probability).then(|| Self((probability * 4_294_967_296.0).round() as u32))
    }

    /// Draws whether the event occurs.
    pub const fn draw(self, random: &mut Random) -> bool {
        self.0 > 0 && (random.next() as u32) < self.0
    }

    pub(crate) const fn parts(self) -> u32 {
        self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_published_sequence() {
        // the reference implementation's first numbers for the seed 1234567
        let mut random = Random::new(1_234_567);
        let first = [random.next(), random.next(), random.next()];
        assert_eq!(first, [6_457_827_717_110_365_317, 3_203_168_211_198_807_973, 9_817_491_932_198_370_423]);
    }

    #[test]
    fn a_chance_comes_as_often_as_it_says() {
        let mut random = Random::new(5);
        for probability in [0.0, 0.001, 0.25, 1.0] {
            let chance = Chance::new(probability).expect("a probability");
            let count = (0..100_000).filter(|_| chance.draw(&mut random)).count() as f64;
            assert!((count - probability * 1e5).abs() <= 4.0 * (probability * 1e5).sqrt(), "{count} at {probability}");
        }
        assert_eq!([Chance::new(-0.1), Chance::new(1.1), Chance::new(f64::NAN)], [None; 3]);
        let draws: Vec<u32> = (0..1000).map(|_| random.up_to(2)).collect();
        assert!((0..=2).all(|n| draws.iter().filter(|&&d| d == n).count() > 250) && draws.iter().all(|&d| d <= 2));
    }
}
