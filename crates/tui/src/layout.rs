//! Layout of the panes on a screen of a given size.
//!
//! Invariant: panes lie within the screen and never overlap; from 80 × 24 every pane has space.

use ratatui::layout::Rect;

/// Minimum size.
pub(crate) const MIN_SIZE: (u16, u16) = (80, 24);

/// Rows of the motion pane, with its border.
const MOTION_ROWS: u16 = 7;
/// Minimum number of rows of the state pane, with its border.
const STATE_ROWS: u16 = 5;

/// Areas of the panes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Panes {
    /// Status, program, time.
    pub head: Rect,
    /// Reason, and the keys that apply.
    pub why: Rect,
    /// The program.
    pub program: Rect,
    /// The tool path.
    pub path: Rect,
    /// Positions.
    pub position: Rect,
    /// Feed, rate, override, history.
    pub motion: Rect,
    /// Modal state, spindle, outputs.
    pub state: Rect,
    /// Latest messages.
    pub messages: Rect,
    /// Keys that apply now.
    pub keys: Rect,
}

/// Lays out the panes; `None` below the minimum size.
#[must_use]
pub(crate) fn panes(width: u16, height: u16, axes: usize) -> Option<Panes> {
    if width < MIN_SIZE.0 || height < MIN_SIZE.1 {
        return None;
    }
    let message_rows = match height {
        ..30 => 2,
        30..40 => 4,
        _ => 8,
    };
    let line = |y, rows| Rect::new(0, y, width, rows);
    let body_rows = height - 3 - message_rows;
    let body = Rect::new(0, 2, width, body_rows);
    let position_rows = axes as u16 + 3;
    let [program, path, position, motion, state] = match width {
        ..120 => narrow(body, position_rows),
        _ => wide(body, position_rows),
    };
    Some(Panes {
        head: line(0, 1),
        why: line(1, 1),
        program,
        path,
        position,
        motion,
        state,
        messages: line(2 + body_rows, message_rows),
        keys: line(height - 1, 1),
    })
}

/// Two columns: program above path, and the readouts.
fn narrow(body: Rect, position_rows: u16) -> [Rect; 5] {
    let (left, right) = columns(body, body.width / 2);
    let (program_path, figures) = if position_rows + MOTION_ROWS + STATE_ROWS <= body.height {
        let (program, path) = rows(left, body.height * 9 / 20);
        let (position, rest) = rows(right, position_rows);
        let (motion, state) = rows(rest, MOTION_ROWS);
        ([program, path], [position, motion, state])
    } else {
        // With many axes their table and the path exchange places.
        let (program, position) = rows(left, body.height.saturating_sub(position_rows));
        let (motion, rest) = rows(right, MOTION_ROWS);
        let (state, path) = rows(rest, STATE_ROWS);
        ([program, path], [position, motion, state])
    };
    let ([program, path], [position, motion, state]) = (program_path, figures);
    [program, path, position, motion, state]
}

/// Three columns: program, path, readouts.
fn wide(body: Rect, position_rows: u16) -> [Rect; 5] {
    let (rest, right) = columns(body, body.width - 44);
    let (program, path) = columns(rest, rest.width * 2 / 5);
    let (position, rest) = rows(right, position_rows);
    let (motion, state) = rows(rest, MOTION_ROWS);
    if state.height >= STATE_ROWS {
        return [program, path, position, motion, state];
    }
    // With many axes the state is below the program.
    let (program, state) = rows(program, body.height - STATE_ROWS);
    [program, path, position, rest, state]
}

fn columns(area: Rect, left: u16) -> (Rect, Rect) {
    let left = left.min(area.width);
    (Rect { width: left, ..area }, Rect { x: area.x + left, width: area.width - left, ..area })
}

fn rows(area: Rect, top: u16) -> (Rect, Rect) {
    let top = top.min(area.height);
    (Rect { height: top, ..area }, Rect { y: area.y + top, height: area.height - top, ..area })
}

#[cfg(test)]
mod tests {
    use super::*;

    impl Panes {
        fn all(&self) -> [Rect; 9] {
            let Self { head, why, program, path, position, motion, state, messages, keys } = *self;
            [head, why, program, path, position, motion, state, messages, keys]
        }
    }

    #[test]
    fn the_panes_fill_every_screen_and_nothing_overlaps() {
        for axes in 1..=9 {
            for (width, height) in (70..=300).step_by(7).flat_map(|w| (20..=100).map(move |h| (w, h))) {
                let Some(panes) = panes(width, height, axes) else {
                    assert!(width < 80 || height < 24);
                    continue;
                };
                let all = panes.all();
                let area: u32 = all.iter().map(|r| u32::from(r.width) * u32::from(r.height)).sum();
                assert_eq!(area, u32::from(width) * u32::from(height), "{width} {height} {axes}");
                for (n, a) in all.iter().enumerate() {
                    assert!(
                        a.right() <= width && a.bottom() <= height && a.height > 0,
                        "{width} {height} {axes}: {a:?}"
                    );
                    assert!(all[n + 1..].iter().all(|b| !a.intersects(*b)), "{width} {height} {axes}");
                }
                let least = if axes <= 4 || width >= 120 { 6 } else { 3 };
                assert!(panes.program.height >= 4 && panes.path.height >= least && panes.state.height >= 3);
                assert!(panes.position.height as usize >= axes + 3, "{width} {height} {axes}: {panes:?}");
            }
        }
    }
}
