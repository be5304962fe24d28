//! Executing a block allocates nothing once the buffers have grown: neither reading its line, nor its expressions, nor
//! its moves.

use allocation_counter::measure;
use retrace_gcode::{CanonStep, Prescan, Program, Progress, Setup};
use std::io::BufRead;
use std::sync::Arc;

/// Number of blocks executed before counting, and while counting.
const BLOCKS: usize = 3_000;

/// Returns the allocations of the second part of a program.
fn allocated<R: BufRead>(mut program: Program<R>, name: &str) -> u64 {
    let mut steps: Vec<CanonStep> = Vec::with_capacity(4096);
    let mut blocks = |program: &mut Program<R>| {
        for _ in 0..BLOCKS {
            steps.clear();
            let progress = program.advance(&mut steps);
            let found = program.interpreter().diagnostics();
            assert!(progress == Progress::Line && found.is_empty(), "{name}: {found:?}");
        }
    };
    blocks(&mut program);
    measure(|| blocks(&mut program)).count_total
}

fn lines(of: &[&str]) -> String {
    let mut text = "G21 G90 G17 F1000 S1000\n#1=1\n#<way>=2\n".to_owned();
    for line in of.iter().cycle().take(3 * BLOCKS) {
        text += line;
        text.push('\n');
    }
    text + "M2\n"
}

#[test]
fn no_block_allocates() {
    let programs = [
        ("moves", lines(&["G1 X1.5 Y2", "X3 Y-1.25 Z0.5", "G0 X0 Y0", "N100 G1 X7", "/G1 X8", ""])),
        ("arcs", lines(&["G0 X0 Y0", "G2 X2 Y0 I1 J0", "G3 X0 Y0 R1", "G2 X0 Y0 I1 P2"])),
        (
            "expressions",
            lines(&[
                "#1=[#1*1.01+SIN[30]]",
                "G1 X[#1 MOD 7] Y#<way>",
                "#<way>=[ABS[#<way>]/2+1]",
                "#2=[#1 \
            GT 3]",
            ]),
        ),
        (
            "modes",
            lines(&[
                "G91",
                "G1 X1",
                "G90 G64 P0.01",
                "M3 S1200",
                "G4 \
            P0.1",
                "M5",
                "G54",
                "G92.1",
                "T1",
                "M8",
                "M9",
            ]),
        ),
        ("canned cycles", lines(&["G81 X1 Y1 Z-1 R1", "X2 Y2", "G80", "G83 X3 Z-3 R1 Q1", "G80", "G0 Z5"])),
        ("then", lines(&["IF [#1 GT 0] THEN #2=[#1+1]", "G1 X#2", "IF [#1 LT 0] THEN #2=0"])),
        (
            "a loop",
            "F1000\nO1 while [1]\n#1=[#1+1]\nG1 X[#1 MOD 100]\nO2 if [#1 MOD 2]\nY1\nO2 else\nY2\nO2 endif\nO1 \
            endwhile\nM2\n"
                .into(),
        ),
        (
            "macros",
            "F1000\nWHILE [1] DO1\n#1=[#1+1]\nG1 X[#1 MOD 100]\nIF [#1 MOD 3] GOTO 10\nY1\nN10 \
            Y2\nEND1\nM2\n"
                .into(),
        ),
        (
            "calls",
            "F1000\nO9 sub\nG1 X#1 Y#2\nO9 endsub\nO1 while [1]\nO9 call [1] [2]\nO9 call [#1]\nO1 \
            endwhile\nM2\n"
                .into(),
        ),
        ("M98", "F1000\nO1 while [1]\nM98 P9 L2\nO1 endwhile\nM2\nO9\nG1 X1\nX0\nM99\n".into()),
    ];
    for (name, text) in programs {
        let prescan = Arc::new(Prescan::scan(name, text.as_str().into(), &Setup::default()));
        assert!(prescan.diagnostics().is_empty(), "{name}: {:?}", prescan.diagnostics());
        let from_file = Program::<&[u8]>::prescanned(prescan, Setup::default());
        assert_eq!(allocated(from_file, name), 0, "{name}");
        // code with jumps is compiled as it arrives, which allocates
        if text.starts_with("G21") && name != "then" {
            assert_eq!(allocated(Program::new(text.as_bytes(), Setup::default()), name), 0, "{name}, arriving");
        }
    }
}
