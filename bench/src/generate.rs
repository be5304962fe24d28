//! Programs for measurements, generated from fixed seeds.
//!
//! Invariant: the same call gives the same text, on any machine.

use std::fmt::Write as _;

/// Numbers that follow from a seed (SplitMix64).
pub(crate) struct Numbers(u64);

impl Numbers {
    pub(crate) fn new(seed: u64) -> Numbers {
        Numbers(seed)
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = self.0;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }

    /// A number below `end`.
    pub(crate) fn below(&mut self, end: u64) -> u64 {
        self.next() % end.max(1)
    }

    /// A coordinate from −100 to 100 with three decimals, as programs for milling have them.
    fn coordinate(&mut self) -> f64 {
        (self.below(200_001) as f64 - 100_000.0) / 1000.0
    }

    /// `true` with a probability of `per_mille` in 1 000.
    pub(crate) fn chance(&mut self, per_mille: u64) -> bool {
        self.below(1000) < per_mille
    }
}

/// A line, whose writing into memory cannot fail.
macro_rules! line {
    ($text:expr, $($argument:tt)*) => {{
        let _ = writeln!($text, $($argument)*);
    }};
}

const OPENING: &str = "G21 G90 G17\nF1000\nG0 X0 Y0 Z5\n";

/// Feed moves with two or three axes, most of them with their G1.
pub(crate) fn plain(lines: u64) -> String {
    let mut numbers = Numbers::new(1);
    let mut text = String::from(OPENING);
    for _ in 0..lines {
        feed(&mut text, &mut numbers);
    }
    text + "M2\n"
}

/// Half of the lines with named parameters and functions, feed moves between them.
pub(crate) fn expressions(lines: u64) -> String {
    let mut numbers = Numbers::new(4);
    let mut text = String::from(OPENING);
    text += "#<depth>=-2.5\n#<step>=0.125\n#<angle>=15\n#<radius>=42.5\n#100=1\n";
    for _ in 0..lines / 2 {
        feed(&mut text, &mut numbers);
        let number = numbers.below(360);
        match numbers.below(6) {
            0 => line!(text, "#<angle>=[[#<angle> + {number}] MOD 360]"),
            1 => line!(text, "G1 X[#<radius>*COS[#<angle>]] Y[#<radius>*SIN[#<angle>]]"),
            2 => line!(text, "G1 Z[#<depth> - #<step>*{}]", number % 8),
            3 => line!(text, "#100=[ABS[#<depth>]/2 + SQRT[#<radius>]]"),
            4 => line!(text, "G1 X[#100 + FIX[#<radius>/4]] Y#<step>"),
            _ => line!(text, "#<radius>=[40 + ROUND[#<angle>*10]/1000]"),
        }
    }
    text + "M2\n"
}

/// A feed move.
pub(crate) fn feed(text: &mut String, numbers: &mut Numbers) {
    let (x, y) = (numbers.coordinate(), numbers.coordinate());
    if numbers.chance(500) {
        line!(text, "G1 X{x:.3} Y{y:.3}");
    } else {
        let z = numbers.coordinate() / 10.0;
        line!(text, "G1 X{x:.3} Y{y:.3} Z{z:.3}");
    }
}

/// Every second line a drilling cycle, the others feed moves.
pub(crate) fn canned(lines: u64) -> String {
    let mut numbers = Numbers::new(2);
    let mut text = String::from(OPENING);
    for _ in 0..lines / 2 {
        feed(&mut text, &mut numbers);
        let (x, y, depth) = (numbers.coordinate(), numbers.coordinate(), numbers.below(100));
        match numbers.below(4) {
            0 | 1 => line!(text, "G81 X{x:.3} Y{y:.3} Z-{depth} R20"),
            2 => line!(text, "G82 X{x:.3} Y{y:.3} Z-{depth} R20 P0.5"),
            _ => line!(text, "G83 X{x:.3} Y{y:.3} Z-20 R20 Q10"),
        }
    }
    text + "M2\n"
}

/// Location of subprograms.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Subs {
    First,
    BehindTheEnd,
}

/// Every second line a call of one of `count` subprograms, the others feed moves.
pub(crate) fn calls(lines: u64, count: u64, place: Subs) -> String {
    let mut numbers = Numbers::new(3);
    let mut main = String::from(OPENING);
    for _ in 0..lines / 2 {
        feed(&mut main, &mut numbers);
        line!(main, "O{} call [{:.3}]", 100 + numbers.below(count), numbers.coordinate());
    }
    main.push_str("M2\n");
    let mut subs = String::new();
    for number in 100..100 + count {
        line!(subs, "O{number} sub\nG1 X[#1+{number}] Y{:.3}\nG0 Z5\nO{number} endsub", numbers.coordinate());
    }
    match place {
        Subs::First => subs + &main,
        Subs::BehindTheEnd => main + &subs,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_has_its_share_and_its_subprograms_where_they_belong() {
        let text = canned(1000);
        assert_eq!(text.lines().filter(|line| line.starts_with("G8")).count(), 500);
        assert_eq!(text, canned(1000));
        let (first, behind) = (calls(1000, 10, Subs::First), calls(1000, 10, Subs::BehindTheEnd));
        assert!(first.starts_with("O100 sub") && first.ends_with("M2\n"));
        assert!(behind.find("M2").is_some_and(|end| behind[end..].contains("O109 endsub")));
        assert_eq!(first.lines().filter(|line| line.contains(" call ")).count(), 500);
        assert_eq!(plain(1000).lines().count(), 1004);
    }
}
