//! Initial programs, and mutations of them.
//!
//! Invariant: a seed number identifies one case, on every machine.

use crate::outline::{Outline, TOOLS};
use crate::writer::{Random, Writer};

/// Entry point of a case.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Way {
    Program,
    Tables,
    Cycle,
}

const EXAMPLES: &[&str] = &[
    include_str!("../../../../../examples/03-arcs.ngc"),
    include_str!("../../../../../examples/04-path-control.ngc"),
    include_str!("../../../../../examples/05-switching.ngc"),
    include_str!("../../../../../examples/06-coordinates.ngc"),
    include_str!("../../../../../examples/07-feed-modes.ngc"),
    DRILLING,
    TURNING,
    LABELS,
    FLOW,
    MACROS,
    SPLINES,
];

const DRILLING: &str = "G21 G17 T1 M6 G43\nS500 M3 F100\nCYCLE81(10,0,2,-20)\nCYCLE82(10,0,2,,20,1.5)\n\
    MCALL CYCLE83(10,0,2,-57,,,20,5,1,1,0.5,1)\nX1 Y2\nHOLES1(0,0,30,5,10,4)\nHOLES2(0,0,20,0,0,6)\nMCALL\n\
    CYCLE84(10,0,2,-12,,0,3,6,,90,300,200)\nCYCLE85(10,0,2,-20,,1,50,80)\nCYCLE86(10,0,2,-20,,1,3,1,-1,1,45)\n\
    CYCLE87(10,0,2,-20,,3)\nCYCLE88(10,0,2,-20,,1,4)\nCYCLE89(10,0,2,-20,,1)\nG20 G18 G91 G95 \
    F.1\nCYCLE83(1,0,.1,-2,,,.5,-.8,-2,-1,1,0,1,.05)\nM2\n";

const TURNING: &str = "G18 G21 G90 T2 M6 G43\nS500 M3 F.2 G95\nG0 X60 Z10\n\
    CYCLE95(\"PART\",2.8,0.1,0.2,,0.3,0.15,0.1,9)\nG7\nCYCLE95(\"PART\",1,0,0,0.1,0.3,0.15,0.1,2,1,5,0.5)\nG8\n\
    CYCLE95(\"PART\",2,0.1,0.2,,0.3,0.15,0.1,12)\nG71 Q7 X30 Z2 D.1 I2 R.5\nG70 Q7 X30 Z2\nM2\n\
    O<PART> sub\nG1 X10 Z0\nZ-12\nX16 Z-18\nZ-24\nX13 Z-30\nZ-38\nX22\nG3 X25 Z-41 I0 K-3\nG1 Z-50\nO<PART> endsub\n\
    O7 sub\nG1 X10 Z0\nG1 X15 Z-10\nG3 X20 Z-15 I0 K-5\nG1 X25\nO7 endsub\n";

const LABELS: &str = "G18 G21 G90 T9 M6\nF100\nG0 X60 Z10\nCYCLE95(\"START:END\",3,0.1,0.2,0,90,50,20,1,0,8)\n\
    CYCLE95(\"START:END\",3,,,,90,50,20,207)\nCYCLE95(\"F1\",3,,,,90,50,20,4)\nCYCLE95(\"PART\",3,,,,90,50,20,4)\nM2\n\
    START:\nG1 X20 Z0\nZ-10\nG2 X24 Z-14 I4 K0\nG1 X30\nX28 Z-20\nZ-30\nX40 Z-40\nEND:\n";

const FLOW: &str = "#1=0\nO1 while [#1 LT 5]\n#1=[#1+1]\nO2 if [#1 MOD 2]\nG0 X#1\nO2 elseif [#1 GT 3]\nO1 \
    continue\nO2 else\nG0 Y#1\nO2 endif\n\
    O3 repeat [3]\nG91 G0 X1\nO3 endrepeat\nO1 endwhile\nO4 do\n#1=[#1-1]\nO4 while [#1 GT 0]\nO<part> call [1] \
    [2]\nO<f1> call\nM98 P20 L3\nM2\n\
    O<part> sub\nG90 G0 X#1 Y#2 Z#<_x>\n(DEBUG, #1 #<_value>)\nO5 if [#1 GT 0]\nO<part> call [#1-1] [3]\nO5 \
    endif\nO<part> endsub [#1]\n\
    O20\nG0 X1\nM99\n";

const MACROS: &str = "#1=0\nN10 #1=[#1+1]\nIF [#1 GT 20] GOTO 90\nWHILE [#2 LT 3] DO1\n#2=[#2+1]\nG0 X[#1+#2]\nIF [#2 \
    EQ 2] GOTO 30\n\
    IF [#1 LT 5] THEN #3=#2\nEND1\nN30 G1 Y#3 F100\nM98 P20\nGOTO [5*2]\nN90 M2\nO20\nIF [#1 MOD 2] GOTO 10\nG0 \
    Z1\nN10 G0 Z0\nM99\n";

const SPLINES: &str = "F100\nG5 X10 Y0 I1 J2 P-3 Q-4\nG5 X10 Y5 P1 Q1\nG5.1 X2 Y0 I1 J3\nG5.2 P1 L4\nX2 Y1 P2\nX3 Y0 \
    P.5\nX4 Y0 P1\nG5.3\n\
    G33 Z-4 K2\nM3 S100\nG33.1 Z-4 K2\nG76 P2 Z-9 I-2 J.5 K1 H1\nG38.2 Z-5\nG83 X1 Z-3 R1 Q.01\nG73 X2 L3\nG81 X1 Y1 \
    Z-1 R1 L5\n\
    G68\nG10 L2 P1 R30 X1\nG52 X1\nG92 Y1\nG28.1\nG30 X1\nG96 S100 D500\n@5 ^30\nG2 X1 Y1 R5 P3\nG20\nM70\nM72\nG64 \
    P.1 Q.1\nM2\n";

const TABLES: &[&str] = &[
    TOOLS,
    "T1 P1 Z0.511 D0.125 ;1/8 end mill\nT2 P2 X1 Y2 Z3 A4 I10 J20 Q3\n",
    "5161\t0.000000\n5220\t1.000000\n5221\t1.5\n5222\t-2\n5230\t30\n5399\t0\n",
    "[EMC]\n#comment\n[RS274NGC]\nSUBROUTINE_PATH = a:b\nFEATURES = 12\n[SETUP]\nDEPTH = -3.5\n",
];

const CYCLES: &[&str] = &[
    "PROC FUZZ(REAL A, REAL B, INT C) SAVE\nDEF INT K\nDEF REAL R[10]\nIF A>0\nG0 G90 AX[3]=A\nELSE\nG1 X=B \
        F100\nENDIF\n\
     FOR K=0 TO 5\nR[K]=SIN(K*B)+SQRT(ABS(C))\nG1 AX[1]=R[K]\nENDFOR\nWHILE C<20\nC=C+1\nENDWHILE\n\
     LOOP\nGOTOF OUT\nENDLOOP\nOUT:\nCYCLE81(10,0,2,,5)\nMSG(\"A=\" << A)\nM17\n",
    include_str!("../../../../cycles/cycles/CYCLE81.SPF"),
    include_str!("../../../../cycles/cycles/CYCLE83.SPF"),
    include_str!("../../../../cycles/cycles/CYCLE84.SPF"),
    include_str!("../../../../cycles/cycles/CYCLE86.SPF"),
    include_str!("../../../../cycles/cycles/CYCLE95.SPF"),
    include_str!("../../../../cycles/cycles/HOLES1.SPF"),
    include_str!("../../../../cycles/cycles/HOLES2.SPF"),
];

/// Numbers that have crashed controllers.
const NUMBERS: &[&str] = &[
    "0",
    "-0",
    "1",
    "-1",
    "17987547480000",
    "4294967296",
    "4000000000",
    "2147483648",
    "-2147483649",
    "1000000",
    "99999999999999999999999999999999999999999",
    "0.0000000000000000001",
    "-0.00000001",
    "1e300",
    "1e-300",
    "65536",
    "1.5",
    "[1/0]",
    "[10**300]",
    "[-10**300]",
    "[10**-300]",
    "[0/-1]",
    "#1",
    "#5600",
    "#<_line>",
    "[1+[1+[1+1]]]",
    "12.5",
];

/// Words and lines with a meaning.
const LINES: &[&str] = &[
    "G41 D2",
    "G42",
    "G40",
    "G41.1 D1",
    "G7",
    "G8",
    "G17",
    "G18",
    "G19",
    "G20",
    "G21",
    "G90",
    "G91",
    "G93",
    "G94",
    "G95",
    "G90.1",
    "G91.1",
    "M2",
    "M30",
    "M99",
    "M98 P20 L4000000000",
    "MCALL",
    "MCALL CYCLE81(10,0,2,-20)",
    "HOLES1(0,0,0,1,1,100000)",
    "HOLES2(0,0,20,0,0,1000000000)",
    "O1 while [1]",
    "O1 endwhile",
    "O9 repeat [10**300]",
    "O9 endrepeat",
    "O1 break",
    "GOTO 10",
    "N10 GOTO 10",
    "GOTO #1",
    "GOTO [10**300]",
    "IF [#1 LT 5] GOTO 10",
    "IF [1] THEN #1=[1/0]",
    "WHILE [#1 LT 5] DO1",
    "END1",
    "O2 if [0]",
    "O2 endif",
    "O<f2> call",
    "O<g2> call",
    "O8 sub",
    "O8 endsub",
    "O8 call",
    "O[#1] call",
    "START:",
    "END:",
    "T2 M6 G43",
    "T0",
    "M61 Q1",
    "G10 L1 P1 R5 Q2",
    "G92 X1e5",
    "G52 Z3",
    "G10 L2 P1 R45",
    "M70",
    "M71",
    "M72",
    "M73",
    "%",
    "/G0 X1",
    "N1",
    "(MSG, #1)",
    "(print, %f #1)",
    "G64 P1 Q1",
    "G61.1",
    "CYCLE95(\"START:END\",1e-300,,,,90,50,20,1)",
    "CYCLE95(\"PART\",0.01,0,0,0,90,50,20,9,0,0.001)",
    "G71 Q7 X30 Z2 D.1 I.001",
    "CYCLE83(10,0,2,-57,,,20,-0.01,0,0,1,0,0,0.0001)",
    "G83 Z-1000 R0 Q.0000001",
    "M66 P1 L3 Q5",
    "M68 E1 Q2",
    "S0",
    "F0",
    "X1 Y1 Z1",
    "G3 X1 Y1 I1 J1",
    "G2 X0 I5 P1000000",
    "PROC FUZZ(REAL A)",
    "DEF REAL Q[9999]",
    "WHILE TRUE",
    "ENDWHILE",
    "GOTOB OUT",
    "A=1/0",
    "FUZZ(1)",
    "SETAL(61000,\"x\")",
    "G4 F=1",
];

/// Returns a case.
pub(crate) fn case(seed: u64) -> (Way, Vec<u8>) {
    let mut random = Random::new(seed ^ 0x6a09_e667);
    let way = match random.below(10) {
        0 => Way::Tables,
        1 | 2 => Way::Cycle,
        _ => Way::Program,
    };
    let mut text = origin(&mut random, way).into_bytes();
    if random.one_in(4) {
        let other = origin(&mut random, way);
        splice(&mut text, other.as_bytes(), &mut random);
    }
    for _ in 0..random.below(12) {
        change(&mut text, &mut random);
        if text.len() > 20_000 {
            text.truncate(20_000);
        }
    }
    (way, text)
}

fn origin(random: &mut Random, way: Way) -> String {
    match way {
        Way::Tables => random.pick(TABLES).to_owned(),
        Way::Cycle => random.pick(CYCLES).to_owned(),
        Way::Program => match random.below(6) {
            0 => Writer::case(random.below(1 << 40)).program,
            1 => Outline::program(random.below(1 << 40)),
            _ => random.pick(EXAMPLES).to_owned(),
        },
    }
}

/// Copies a range of one text into another.
fn splice(text: &mut Vec<u8>, other: &[u8], random: &mut Random) {
    let from = random.below(other.len() as u64 + 1) as usize;
    let to = from + random.below((other.len() - from) as u64 + 1) as usize;
    let at = random.below(text.len() as u64 + 1) as usize;
    text.splice(at..at, other[from..to].iter().copied());
}

fn change(text: &mut Vec<u8>, random: &mut Random) {
    let at = random.below(text.len() as u64 + 1) as usize;
    match random.below(10) {
        0 => text.insert(at, random.below(256) as u8),
        1 if at < text.len() => text[at] = (0x20 + random.below(0x5f)) as u8,
        2 if at < text.len() => {
            let behind = (at + random.below(20) as usize).min(text.len());
            text.drain(at..behind);
        }
        3..=5 => number(text, at, random),
        6 | 7 => {
            let at = line_start(text, at);
            let line = [random.pick(LINES), "\n"].concat();
            text.splice(at..at, line.bytes());
        }
        8 => {
            let (from, to) = (line_start(text, at), line_end(text, at));
            let line: Vec<u8> = text[from..to].to_vec();
            let copies = if random.one_in(8) { 300 } else { 1 };
            let to = random.below(text.len() as u64 + 1) as usize;
            let to = line_start(text, to);
            text.splice(to..to, line.repeat(copies));
        }
        _ => {
            let (from, to) = (line_start(text, at), line_end(text, at));
            text.drain(from..to);
        }
    }
}

/// Replaces the next number by another.
fn number(text: &mut Vec<u8>, at: usize, random: &mut Random) {
    let is_digit = |byte: &u8| byte.is_ascii_digit() || *byte == b'.';
    let Some(from) = text[at..].iter().position(is_digit).map(|index| at + index) else { return };
    let to = text[from..].iter().position(|byte| !is_digit(byte)).map_or(text.len(), |index| from + index);
    let new = match random.below(8) {
        0 => "9".repeat(random.below(300) as usize),
        1..=4 => random.pick(NUMBERS).to_owned(),
        _ => format!("{}", random.below(2000) as f64 / 100.0 - 5.0),
    };
    text.splice(from..to, new.bytes());
}

fn line_start(text: &[u8], at: usize) -> usize {
    text[..at].iter().rposition(|byte| *byte == b'\n').map_or(0, |index| index + 1)
}

fn line_end(text: &[u8], at: usize) -> usize {
    text[at..].iter().position(|byte| *byte == b'\n').map_or(text.len(), |index| at + index + 1)
}
