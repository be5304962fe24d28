//! Short form of diagnostics: one message line instead of the form with source line and mark.
//!
//! Invariant: number, cause, location and remedy are kept; frames and marks are dropped.

/// Converts each diagnostic of a rendered text to one line; any other text is kept, line by line. Not empty unless the
/// text is.
#[must_use]
pub fn diagnostic_lines(rendered: &str) -> Vec<String> {
    let mut result: Vec<String> = Vec::new();
    for line in rendered.lines().map(str::trim_end).filter(|line| !line.trim().is_empty()) {
        let bare = line.trim_start();
        if let Some((number, what)) = heading(line) {
            result.push(format!("{number}: {what}"));
        } else if let Some(at) = bare.strip_prefix("--> ") {
            if let (Some(last), Some(place)) = (result.last_mut(), place_of(at)) {
                *last = format!("{last} ({place})");
            }
        } else if let Some(help) = bare.strip_prefix("= help: ").or_else(|| bare.strip_prefix("help: ")) {
            match result.last_mut() {
                Some(last) => *last = format!("{last} · {help}"),
                None => result.push(help.to_owned()),
            }
        } else if !is_frame(bare) {
            result.push(bare.to_owned());
        }
    }
    result
}

/// Number and text of a heading such as `error[E1101]: what is wrong`.
fn heading(line: &str) -> Option<(&str, &str)> {
    let (head, what) = line.split_once(": ")?;
    let number = ["error[", "warning["].iter().find_map(|level| head.strip_prefix(level)?.strip_suffix(']'));
    Some((number?, what))
}

/// File and line of a location such as `folder/part.ngc:12:4`. An MDI block has none.
fn place_of(at: &str) -> Option<String> {
    let mut parts = at.rsplitn(3, ':');
    let (_column, line, file) = (parts.next()?, parts.next()?, parts.next()?);
    let name = file.rsplit(['/', '\\']).next().unwrap_or(file);
    let is_line = line.bytes().all(|digit| digit.is_ascii_digit());
    (is_line && name != "MDI").then(|| format!("{name} line {line}"))
}

/// Whether the line is the source line, the mark below it, or the frame around them.
fn is_frame(bare: &str) -> bool {
    bare.trim_start_matches(|c: char| c.is_ascii_digit()).trim_start().starts_with('|')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_diagnostic_is_a_line_without_frame_and_mark() {
        let rendered = "error[E4304]: axis X would go too far\n --> a:/b.ngc:3:4\n  |\n3 | G1 X9999\n  |    ^\n  |\n  \
            = help: move it\n\
            error[E1508]: no feed\n  --> MDI:12:1\n   |\n12 | G1 X1\n   | ^^\n   |\n   = help: F before it";
        let result = diagnostic_lines(rendered);
        assert_eq!(result, ["E4304: axis X would go too far (b.ngc line 3) · move it", "E1508: no feed · F before it"]);
    }

    #[test]
    fn other_texts_stay_as_they_are() {
        assert_eq!(
            diagnostic_lines("E2101: there is no program a\n  help: check the name"),
            ["E2101: there is no program a · check the name"]
        );
        assert_eq!(diagnostic_lines("\n\n"), Vec::<String>::new());
        for text in ["|", "-->", "error[", "--> 1:2", "= help: x", "3 | x"] {
            assert!(diagnostic_lines(text).len() <= 1);
        }
    }
}
