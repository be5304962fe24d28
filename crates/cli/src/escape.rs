//! Escapes text from other sources for a terminal: file names, messages of programs, names of cards.
//!
//! Invariant: no control character is printed except the line feed and the tab of a multi-line text. Any other is
//! printed as `\\u001b`, which JSON reads as the same character.

use std::borrow::Cow;
use std::fmt::Write as _;

/// Escapes a multi-line text: line feeds and tabs stay, and a carriage return before a line feed.
pub fn lines(text: &str) -> Cow<'_, str> {
    let is_odd = |c: char| c.is_control() && !matches!(c, '\n' | '\t');
    if !text.contains(is_odd) {
        return Cow::Borrowed(text);
    }
    let mut shown = String::with_capacity(text.len() + 16);
    let mut rest = text.chars().peekable();
    while let Some(c) = rest.next() {
        let ends_line = c == '\r' && rest.peek() == Some(&'\n');
        push(&mut shown, c, is_odd(c) && !ends_line);
    }
    Cow::Owned(shown)
}

/// Escapes a name: one line, without a tab.
pub fn name(text: &str) -> Cow<'_, str> {
    if !text.contains(char::is_control) {
        return Cow::Borrowed(text);
    }
    let mut shown = String::with_capacity(text.len() + 16);
    text.chars().for_each(|c| push(&mut shown, c, c.is_control()));
    Cow::Owned(shown)
}

fn push(shown: &mut String, c: char, is_escaped: bool) {
    if is_escaped {
        // Writing to a string cannot fail.
        let _ = write!(shown, "\\u{:04x}", u32::from(c));
    } else {
        shown.push(c);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_would_steer_a_terminal_is_shown() {
        assert_eq!(lines("a\tb\r\nc\n"), "a\tb\r\nc\n");
        assert_eq!(lines("\u{1b}]0;x\u{7}\r\u{9b}2J\u{7f}"), "\\u001b]0;x\\u0007\\u000d\\u009b2J\\u007f");
        assert_eq!((name("ä b"), name("a\nb\t")), ("ä b".into(), "a\\u000ab\\u0009".into()));
        let json = lines("\"\u{9b}\"").into_owned();
        assert_eq!(serde_json::from_str::<String>(&json).expect("JSON"), "\u{9b}");
    }
}
