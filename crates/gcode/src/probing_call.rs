//! Probing cycles in short words, as an operator enters them: `surface z- 20 g54`.
//!
//! Invariant: a length is in mm whatever unit is in force, and every argument is within the range of its kind.

use crate::active::system_name;

/// Kinds of arguments.
#[derive(Clone, Copy, Debug)]
enum Argument {
    /// `x+` … `z-`.
    Direction,
    /// `x+` … `y-`.
    Side,
    /// `x+` or `x-`, as 1 or −1.
    InX,
    /// `y+` or `y-`, as 1 or −1.
    InY,
    /// `x` or `y`.
    Axis,
    /// A length above 0.
    Length,
    /// A length of 0 or more.
    Depth,
    /// A signed length.
    Signed,
}

use Argument::{Axis, Depth, Direction, InX, InY, Length, Side, Signed};

/// A probing cycle as an operator calls it. The name of its subprogram is `probe_` and its word.
#[derive(Clone, Copy, Debug)]
pub struct ProbingForm {
    /// Word of the cycle.
    word: &'static str,
    arguments: &'static [Argument],
    /// Whether a work offset may follow.
    sets_offset: bool,
    /// The call with names for its lengths.
    pub form: &'static str,
    /// What it measures.
    pub purpose: &'static str,
}

const fn form(
    form: &'static str,
    arguments: &'static [Argument],
    sets_offset: bool,
    purpose: &'static str,
) -> ProbingForm {
    // The word ends at the first blank.
    let (word, _) = form.as_bytes().split_at(blank_in(form));
    let word = match core::str::from_utf8(word) {
        Ok(word) => word,
        Err(_) => "",
    };
    ProbingForm { word, arguments, sets_offset, form, purpose }
}

const fn blank_in(text: &str) -> usize {
    let (bytes, mut index) = (text.as_bytes(), 0);
    while index < bytes.len() && bytes[index] != b' ' {
        index += 1;
    }
    index
}

/// The probing cycles, for an operator.
#[rustfmt::skip]
pub const PROBING_FORMS: &[ProbingForm] = &[
    form("surface z- TRAVEL", &[Direction, Length], true, "surface along one axis"),
    form("edge x+ OUT DEPTH", &[Side, Length, Length], true, "edge, from above"),
    form("outside-corner x+ y+ OUT DEPTH", &[InX, InY, Length, Length], true, "outside corner, from above"),
    form("inside-corner x- y- TRAVEL DEPTH", &[InX, InY, Length, Depth], true, "inside corner"),
    form("bore DIAMETER DEPTH", &[Length, Depth], true, "centre and diameter of a bore"),
    form("boss DIAMETER OUT DEPTH", &[Length, Length, Length], true, "centre and diameter of a boss, from above"),
    form("slot x WIDTH DEPTH", &[Axis, Length, Depth], true, "middle and width of a slot"),
    form("web x WIDTH OUT DEPTH", &[Axis, Length, Length, Length], true, "middle and width of a web, from above"),
    form("angle y+ ALONG OUT DEPTH", &[Side, Signed, Length, Length], true, "angle of an edge, from above"),
    form("tool-setter TRAVEL", &[Length], false, "length of the tool, at the tool setter"),
    form("tool-at-work TRAVEL HEIGHT", &[Length, Signed], false, "length of the tool, at a known surface"),
    form("calibrate DIAMETER DEPTH", &[Length, Depth], false, "diameter of the probe's ball, in a ring"),
];

/// Returns the MDI block of a probing cycle.
///
/// # Errors
/// What the text should be.
pub fn probing_block(text: &str) -> Result<String, String> {
    let text = text.to_ascii_lowercase();
    let mut words = text.split_whitespace();
    let word = words.next().unwrap_or_default();
    let Some(call) = PROBING_FORMS.iter().find(|call| call.word == word) else {
        return Err("enter a cycle and its lengths, such as surface z- 20 g54".into());
    };
    let should =
        || format!("enter {}{}", call.form, if call.sets_offset { ", and g54 … g59.3 or nothing" } else { "" });
    let mut block = format!("o<probe_{}> call", word.replace('-', "_"));
    for argument in call.arguments {
        let value = words.next().and_then(|word| argument.value(word)).ok_or_else(should)?;
        block += &format!(" [{value}]");
    }
    if let Some(word) = words.next() {
        let offset = (1..=9_u8).find(|&system| system_name(system).eq_ignore_ascii_case(word));
        block += &format!(" [{}]", offset.filter(|_| call.sets_offset).ok_or_else(should)?);
    }
    if words.next().is_some() { Err(should()) } else { Ok(block) }
}

impl Argument {
    /// Returns the expression of an argument; `None` where the word is none.
    fn value(self, word: &str) -> Option<String> {
        let (axis, sign) = match word.as_bytes() {
            &[axis @ b'x'..=b'z', sign @ (b'+' | b'-')] => (axis - b'x' + 1, if sign == b'+' { 1 } else { -1 }),
            _ => (0, 0),
        };
        let towards = |found: bool, value: i32| found.then(|| value.to_string());
        let length = |lowest: f64| {
            let mm = word.parse::<f64>().ok().filter(|mm| (lowest..=100_000.0).contains(mm))?;
            // 1 or 25.4
            Some(format!("{mm} / [1 + 24.4 * #<_imperial>]"))
        };
        match self {
            Direction => towards(sign != 0, i32::from(axis) * sign),
            Side => towards(matches!(axis, 1 | 2), i32::from(axis) * sign),
            InX => towards(axis == 1, sign),
            InY => towards(axis == 2, sign),
            Axis => ["x", "y"].iter().position(|axis| *axis == word).map(|index| (index + 1).to_string()),
            Length => length(0.001),
            Depth => length(0.0),
            Signed => length(-100_000.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::probing_cycles::probing_cycles;

    #[test]
    fn each_form_is_a_call_of_a_cycle_and_others_say_what_they_should_be() {
        for ProbingForm { form, word, .. } in PROBING_FORMS {
            let text: Vec<&str> = form
                .split(' ')
                .map(|word| if word.bytes().all(|byte| byte.is_ascii_uppercase()) { "5" } else { word })
                .collect();
            let block = probing_block(&text.join(" ")).expect(form);
            let name = format!("probe_{}", word.replace('-', "_"));
            assert!(form.starts_with(word) && block.starts_with(&format!("o<{name}> call [")), "{block}");
            assert!(probing_cycles().iter().any(|(known, _)| *known == name), "{name}");
        }
        let mm = |mm: f64| format!("[{mm} / [1 + 24.4 * #<_imperial>]]");
        assert_eq!(probing_block("Surface Z- 20 G59.1"), Ok(format!("o<probe_surface> call [-3] {} [7]", mm(20.0))));
        assert_eq!(
            probing_block("angle y- -40 10 5"),
            Ok(format!("o<probe_angle> call [-2] {} {} {}", mm(-40.0), mm(10.0), mm(5.0)))
        );
        for wrong in [
            "",
            "drill 5",
            "surface",
            "surface q 5",
            "surface z- -5",
            "surface z- 5 g53",
            "edge z- 5 5",
            "outside-corner y+ x+ 5 5",
            "slot z 5 5",
            "bore nan 5",
            "tool-setter 5 g54",
            "surface z- 5 g54 6",
        ] {
            assert!(probing_block(wrong).is_err_and(|why| why.starts_with("enter ")), "{wrong}");
        }
    }
}
