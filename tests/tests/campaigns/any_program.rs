//! Generated programs: for any sequence of valid blocks, the end is exact and no limit is exceeded.

use proptest::prelude::*;
use retrace_tests::command::Bench;
use retrace_tests::run::Run;
use std::fmt::Write;

/// One block, before its start is known.
#[derive(Clone, Debug)]
enum Block {
    /// A straight move in mm, by a rapid or at a feed in mm/min.
    Line { to: [f64; 3], feed: Option<u32> },
    /// An arc in XY, its radius above the smallest one by `excess`.
    Arc { to: [f64; 2], excess: f64, is_clockwise: bool, is_long: bool, feed: u32 },
    /// A circle or helix about a centre off the tool.
    Circle { centre: [f64; 2], climb: f64, is_clockwise: bool, feed: u32 },
    /// A block without motion.
    Other(&'static str),
}

fn lengths() -> impl Strategy<Value = f64> {
    // Thousandths of a mm, as programs have them.
    prop_oneof![3 => -40_000_i32..40_000, 2 => -900_i32..900, 1 => -9_i32..9].prop_map(|um| f64::from(um) / 1000.0)
}

fn blocks() -> impl Strategy<Value = Block> {
    let feeds = || prop_oneof![60_u32..6000, 1000_u32..9000];
    prop_oneof![
        5 => ([lengths(), lengths(), lengths()], prop::option::weighted(0.8, feeds()))
            .prop_map(|(to, feed)| Block::Line { to, feed }),
        3 => ([lengths(), lengths()], 1.001..5.0_f64, any::<bool>(), any::<bool>(), feeds())
            .prop_map(|(to, excess, is_clockwise, is_long, feed)| Block::Arc { to, excess, is_clockwise, is_long,
                feed }),
        1 => ([lengths(), lengths()], lengths(), any::<bool>(), feeds())
            .prop_map(|(centre, climb, is_clockwise, feed)| Block::Circle { centre, climb, is_clockwise, feed }),
        3 => prop::sample::select(vec![
            "G61", "G61.1", "G64 P0.05", "G64 P0.5", "G64", "M62 P3", "M63 P3", "M8", "M9", "G4 P0.05", "S1200 \
                M3", "M5",
        ]).prop_map(Block::Other),
    ]
}

/// Text of the program; every move is relative, so that no arc's radii can disagree.
fn written(blocks: &[Block]) -> String {
    let mut text = String::from("G21 G91 G17 G91.1\n");
    for block in blocks {
        let _ = match block {
            Block::Line { to: [x, y, z], feed: Some(feed) } => writeln!(text, "G1 X{x:.3} Y{y:.3} Z{z:.3} F{feed}"),
            Block::Line { to: [x, y, z], feed: None } => writeln!(text, "G0 X{x:.3} Y{y:.3} Z{z:.3}"),
            Block::Arc { to: [x, y], .. } if x.hypot(*y) < 0.05 => Ok(()),
            Block::Arc { to: [x, y], excess, is_clockwise, is_long, feed } => {
                let radius = x.hypot(*y) / 2.0 * excess * if *is_long { -1.0 } else { 1.0 };
                writeln!(text, "{} X{x:.3} Y{y:.3} R{radius:.4} F{feed}", if *is_clockwise { "G2" } else { "G3" })
            }
            Block::Circle { centre: [i, j], .. } if i.hypot(*j) < 0.05 => Ok(()),
            Block::Circle { centre: [i, j], climb, is_clockwise, feed } => {
                let code = if *is_clockwise { "G2" } else { "G3" };
                writeln!(text, "{code} X0 Y0 Z{climb:.3} I{i:.3} J{j:.3} F{feed}")
            }
            Block::Other(words) => writeln!(text, "{words}"),
        };
    }
    text.push_str("M2\n");
    text
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: retrace_tests::command::cases(24),
        max_shrink_iters: 60,
        // No file is written into the source tree.
        failure_persistence: None,
        ..ProptestConfig::default()
    })]
    #[test]
    fn any_program_ends_exactly_and_within_the_limits(blocks in prop::collection::vec(blocks(), 1..30)) {
        let bench = Bench::new();
        let program = bench.file("any.ngc", written(&blocks));
        let run = Run::of(&bench, &program, &[]);
        run.assert_exact_and_legal();
        prop_assert_eq!(run.number("underruns"), 0.0);
    }
}
