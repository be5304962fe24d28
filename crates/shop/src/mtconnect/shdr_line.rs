//! Lines of the SHDR protocol.
//!
//! Invariant: a line is one line, whatever its values are, and each value is one field.

use retrace_journal::Timestamp;

/// Line of one or more values: `time|key|value|key|value…`.
pub(super) fn values(time: Timestamp, values: &[(String, String)]) -> String {
    let fields = values.iter().map(|(key, value)| format!("|{key}|{}", field(value)));
    format!("{time}{}\n", fields.collect::<String>())
}

/// Line of a condition: `time|key|level|native code|native severity|qualifier|text`.
pub(super) fn condition(time: Timestamp, key: &str, level: &str, code: &str, text: &str) -> String {
    format!("{time}|{key}|{level}|{}|||{}\n", field(code), field(text))
}

/// A value as a field: control characters are blanks, and a value with a vertical bar is quoted. Quotes in it are
/// single ones then, and where it begins with them: nothing else tells where a quoted value ends.
fn field(value: &str) -> String {
    let plain: String = value.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    match plain.trim() {
        plain if plain.contains('|') => format!("\"{}\"", plain.replace('"', "'").replace('|', "\\|")),
        plain if plain.starts_with('"') => plain.replace('"', "'"),
        plain => plain.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quotes_do_not_begin_a_field_that_is_not_quoted() {
        for (value, is) in [("\"a\"", "'a'"), ("say \"a\"", "say \"a\""), ("\"|\"", "\"'\\|'\"")] {
            assert_eq!(field(value), is);
        }
    }

    #[test]
    fn a_value_is_one_field_of_one_line() {
        let time = Timestamp::from_ms(0);
        let line = values(time, &[("block".into(), "(a|b)\r\n|line|3".into()), ("line".into(), "2".into())]);
        assert_eq!(line, "1970-01-01T00:00:00.000Z|block|\"(a\\|b)  \\|line\\|3\"|line|2\n");
        let line = condition(time, "system", "FAULT", "E3012", "open | pressed\n");
        assert_eq!(line, "1970-01-01T00:00:00.000Z|system|FAULT|E3012|||\"open \\| pressed\"\n");
    }
}
