//! Messages to the operator.
//!
//! Invariant: a message that comes again is counted and not added, so that it hides no other.

use std::collections::VecDeque;

/// Maximum number of retained messages.
pub(crate) const MESSAGES: usize = 200;

/// A diagnostic that repeats one of so many last messages is counted.
const REPEATED_WITHIN: usize = 8;

/// Message line.
#[derive(Clone, Debug, PartialEq)]
pub struct Message {
    /// Machine time, s.
    pub time_s: f64,
    /// Program line; 0 for none.
    pub line: u32,
    /// Text.
    pub text: String,
    /// Number of times it was reported recently.
    pub times: u32,
}

/// Adds a message. Where it repeats the last one, it is counted instead; a diagnostic also where it repeats a recent
/// one: several faults that take turns are one message each.
pub(crate) fn add(messages: &mut VecDeque<Message>, time_s: f64, line: u32, text: String) {
    let mut letters = text.chars();
    let is_diagnostic = matches!(letters.next(), Some('E' | 'W')) && letters.next().is_some_and(|c| c.is_ascii_digit());
    let recent = messages.len().saturating_sub(if is_diagnostic { REPEATED_WITHIN } else { 1 });
    let same = (recent..messages.len()).find(|&at| messages[at].text == text && messages[at].line == line);
    let times = same.and_then(|at| messages.remove(at)).map_or(1, |before| before.times.saturating_add(1));
    if messages.len() >= MESSAGES {
        messages.pop_front();
    }
    messages.push_back(Message { time_s, line, text, times });
}

#[cfg(test)]
mod tests {
    use super::*;

    fn counted<'a>(texts: &[&'a str]) -> Vec<(&'a str, u32)> {
        let mut messages = VecDeque::new();
        texts.iter().for_each(|&text| add(&mut messages, 1.0, 0, text.into()));
        let times = |message: &Message| {
            (texts.iter().copied().find(|text| message.text == *text).expect("one of them"), message.times)
        };
        messages.iter().map(times).collect()
    }

    #[test]
    fn a_fault_that_comes_again_and_again_is_one_message() {
        assert_eq!(counted(&["one", "E1", "E2", "E1", "E2", "E1"]), [("one", 1), ("E2", 2), ("E1", 3)]);
    }

    #[test]
    fn moves_that_are_the_same_are_counted_while_nothing_else_is_between_them() {
        let [x, y] = ["X moved by 10.000 mm", "Y moved by 10.000 mm"];
        assert_eq!(counted(&[x, x, y, x, x, x]), [(x, 2), (y, 1), (x, 3)]);
    }
}
