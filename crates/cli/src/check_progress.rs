//! Progress bar at the terminal while a program is checked, if that takes longer than a second.
//!
//! Invariant: nothing is shown where standard error is not a terminal; the bar is removed when the check ends.

use std::io::IsTerminal;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

/// Duration after which the bar is shown.
const SHOWN_AFTER: Duration = Duration::from_secs(1);

/// Number of blocks between two reads of the clock.
const BLOCKS: u32 = 1024;

/// Progress of a check.
#[derive(Debug)]
pub struct CheckProgress {
    lines: u64,
    begun: Instant,
    blocks: u32,
    bar: Option<ProgressBar>,
}

impl CheckProgress {
    /// Progress of a program with this number of lines; `None` where no terminal would show it.
    #[must_use]
    pub fn of(lines: u64) -> Option<Self> {
        let is_seen = std::io::stderr().is_terminal();
        is_seen.then(|| Self { lines, begun: Instant::now(), blocks: 0, bar: None })
    }

    /// Counts a block; `line` returns its line and the number of blocks in loops and calls so far.
    pub fn block(&mut self, line: impl FnOnce() -> (u64, u64)) {
        self.blocks += 1;
        if self.blocks < BLOCKS || self.begun.elapsed() < SHOWN_AFTER {
            return;
        }
        self.blocks = 0;
        let (line, loop_blocks) = line();
        let bar = self.bar.get_or_insert_with(|| bar(self.lines));
        bar.set_position(line.min(self.lines));
        if loop_blocks > 0 {
            bar.set_message(format!("{loop_blocks} blocks in loops and calls"));
        }
    }
}

impl Drop for CheckProgress {
    fn drop(&mut self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

fn bar(lines: u64) -> ProgressBar {
    let bar = ProgressBar::new(lines);
    if let Ok(style) = ProgressStyle::with_template("checking {bar:24} line {pos} of {len}  {elapsed}  {msg}") {
        bar.set_style(style);
    }
    bar
}
