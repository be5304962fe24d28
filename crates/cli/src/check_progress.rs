//! A bar at the terminal while a program is looked through, once that takes longer than a second.
//!
//! Invariant: nothing is shown where standard error is not a terminal; the bar is gone when the looking is over.

use std::io::IsTerminal;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

/// Nothing is shown of what takes less.
const SHOWN_AFTER: Duration = Duration::from_secs(1);

/// Blocks between two looks at the clock.
const BLOCKS: u32 = 1024;

/// How far a program has been looked through.
#[derive(Debug)]
pub struct CheckProgress {
    lines: u64,
    begun: Instant,
    blocks: u32,
    bar: Option<ProgressBar>,
}

impl CheckProgress {
    /// Of a program with so many lines; none where nobody would see it.
    #[must_use]
    pub fn of(lines: u64) -> Option<Self> {
        let is_seen = std::io::stderr().is_terminal();
        is_seen.then(|| Self { lines, begun: Instant::now(), blocks: 0, bar: None })
    }

    /// A block has been looked at; `line` tells the line that it stands in, and the blocks in loops and calls so far.
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
