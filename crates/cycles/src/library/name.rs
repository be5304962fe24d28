//! Names that a program can call.
//!
//! Invariant: a name in a library never reads as words of a block, so an added cycle does not change the meaning of any
//! block.

/// Maximum length of a callable name in bytes.
const MAX_NAME_LENGTH: usize = 32;

/// Words that open a control line of a program, with or without a number after them.
const CONTROL_WORDS: [&str; 6] = ["IF", "THEN", "GOTO", "WHILE", "DO", "END"];

/// Returns why a program cannot call a cycle of this name, which is in capitals; `None` if it can.
pub(super) fn cannot_be_called(name: &str) -> Option<String> {
    let letters = name.bytes().filter(u8::is_ascii_alphabetic).count();
    let has_early_digit = name.as_bytes().get(1).is_some_and(u8::is_ascii_digit);
    let why = if name.len() > MAX_NAME_LENGTH {
        "is longer than 32 characters"
    } else if letters < 2 {
        "has fewer than two letters"
    } else if reads_as_words(name) {
        "reads as words of a block"
    } else if has_early_digit && name.starts_with(['N', 'O']) {
        "begins like a block number or an O word"
    } else if name.starts_with("MCALL") {
        "begins with MCALL"
    } else if CONTROL_WORDS.contains(&name.trim_end_matches(|letter: char| letter.is_ascii_digit())) {
        "is a control word"
    } else {
        return None;
    };
    Some(format!("{name} {why}, so no program can call it"))
}

/// Whether a name consists of letters each followed by a number, such as `M7` or `X1Y2`.
fn reads_as_words(name: &str) -> bool {
    let bytes = name.as_bytes();
    let followed = |at: usize| bytes.get(at + 1).is_some_and(u8::is_ascii_digit);
    (0..bytes.len()).all(|at| match bytes[at] {
        b'0'..=b'9' => true,
        b'A'..=b'Z' => followed(at),
        _ => false,
    })
}

#[cfg(test)]
mod tests {
    use super::cannot_be_called;

    #[test]
    fn names_that_read_as_something_else_are_found() {
        for name in ["NEST", "OPEN", "M7X", "PARK", "_AB", "CYCLE81", "POCKET3", "IFX", "ENDE", "XY"] {
            assert_eq!(cannot_be_called(name), None);
        }
        for name in ["M7", "X1Y2", "G81", "A", "A_", "N1AB", "O1SUB", "MCALLS", "IF", "GOTO", "END1", "DO2"] {
            assert!(cannot_be_called(name).is_some(), "{name}");
        }
        assert!(cannot_be_called(&"AB".repeat(17)).is_some());
    }
}
