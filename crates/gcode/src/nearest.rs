//! Suggestions for a misspelt name.
//!
//! Invariant: at most two letters differ, and fewer than half of the name.

/// Returns the known name that is most similar to this one, ignoring case.
pub(crate) fn nearest<'a>(name: &str, known: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let name = name.to_ascii_lowercase();
    let most = (name.len() / 3).clamp(1, 2);
    let distances = known.map(|other| (distance(&name, &other.to_ascii_lowercase()), other));
    let near = distances.filter(|(distance, _)| (1..=most).contains(distance));
    near.min_by_key(|(distance, _)| *distance).map(|(_, other)| other)
}

/// Returns the number of letters inserted, removed, replaced or swapped with their neighbour between two names.
fn distance(left: &str, right: &str) -> usize {
    let (left, right) = (left.as_bytes(), right.as_bytes());
    if left.len().abs_diff(right.len()) > 2 || left.len().max(right.len()) > 64 {
        return usize::MAX;
    }
    let mut before_last = vec![0; right.len() + 1];
    let mut last: Vec<usize> = (0..=right.len()).collect();
    for (i, l) in left.iter().enumerate() {
        let mut row = vec![i + 1; right.len() + 1];
        for (j, r) in right.iter().enumerate() {
            row[j + 1] = (last[j] + usize::from(l != r)).min(last[j + 1] + 1).min(row[j] + 1);
            if i > 0 && j > 0 && left[i - 1] == *r && *l == right[j - 1] {
                row[j + 1] = row[j + 1].min(before_last[j - 1] + 1);
            }
        }
        before_last = std::mem::replace(&mut last, row);
    }
    last[right.len()]
}

#[cfg(test)]
mod tests {
    use super::nearest;

    #[test]
    fn names_that_are_close_are_found_and_others_are_not() {
        let known = ["depth", "width", "feed_rate", "x"];
        let of = |name| nearest(name, known.into_iter());
        assert_eq!(
            [of("dpeth"), of("Widht"), of("feedrate"), of("dep")],
            [Some("depth"), Some("width"), Some("feed_rate"), None]
        );
        assert_eq!([of("depth"), of("y"), of("")], [None, Some("x"), Some("x")]);
    }
}
