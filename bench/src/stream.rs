//! An endless program on standard input: speed and memory.
//!
//! Invariant: the bytes are generated while they are read, so that the whole program is never in memory.

use super::generate;
use super::measured::Measured;
use std::path::Path;

/// Result of feeding `retrace canon -`.
pub(super) struct Streamed {
    bytes: u64,
    lines: u64,
    wall_s: f64,
    rss_mib: f64,
}

/// Bytes of a full run, and of a short one.
const FULL: u64 = 2 << 30;
const SHORT: u64 = 64 << 20;

/// Most resident memory, MiB, and least speed, lines a second.
const MAX_MIB: f64 = 48.0;
const MIN_SPEED: f64 = 1e6;

impl Streamed {
    fn speed(&self) -> f64 {
        self.lines as f64 / self.wall_s
    }

    pub(super) fn is_within(&self) -> bool {
        self.rss_mib <= MAX_MIB && self.speed() >= MIN_SPEED
    }

    pub(super) fn text(&self) -> String {
        format!(
            "`retrace canon -` fed {:.3} GiB ({} lines) on standard input: {:.2} million lines a second of wall time \
                (goal ≥ 1), \
             {:.1} MiB\nresident at most (goal ≤ {MAX_MIB}).\n",
            self.bytes as f64 / f64::from(1 << 30),
            self.lines,
            self.speed() / 1e6,
            self.rss_mib
        )
    }
}

/// Feeds the same thousands of lines again and again.
pub(super) fn measure(binary: &Path, folder: &Path, full: bool) -> Result<Streamed, String> {
    let text = generate::plain(20_000);
    let text = text.trim_end_matches("M2\n").as_bytes();
    let times = (if full { FULL } else { SHORT }).div_ceil(text.len() as u64);
    let lines = text.iter().filter(|byte| **byte == b'\n').count() as u64;
    let command = Measured {
        program: binary.to_path_buf(),
        arguments: vec!["canon".into(), "-".into()],
        folder: folder.to_path_buf(),
    };
    let taken = command.run_fed(|input| {
        // A child that ends early is reported by its exit status.
        let mut whole = (0..times).try_for_each(|_| input.write_all(text));
        whole = whole.and_then(|()| input.write_all(b"M2\n"));
        let _ = whole;
    })?;
    let bytes = times * text.len() as u64 + 3;
    Ok(Streamed { bytes, lines: times * lines + 1, wall_s: taken.wall_s, rss_mib: taken.rss_mib })
}
