//! Paths along contours, cached by their parameters.
//!
//! Invariant: a cached path is that of its parameters alone; the cache is bounded.

use retrace_cycles::stock::StockRemovalParams;
use retrace_cycles::{StockMove, StockPathError};
use std::sync::{Arc, Mutex, PoisonError};

/// A path along a contour.
#[derive(Clone, Debug)]
pub(crate) struct PlannedContour {
    pub(crate) moves: Arc<[StockMove]>,
    pub(crate) warnings: Arc<[String]>,
}

/// Maximum number of moves in all cached paths.
const MAX_MOVES: usize = 500_000;
/// Maximum number of cached paths.
const MAX_PATHS: usize = 64;

/// Cached paths, by their parameters.
#[derive(Debug, Default)]
pub(crate) struct PathCache(Mutex<Vec<(StockRemovalParams, PlannedContour)>>);

impl Clone for PathCache {
    /// Returns an empty cache; the paths are calculated again.
    fn clone(&self) -> PathCache {
        PathCache::default()
    }
}

impl PathCache {
    /// Returns the path for these parameters, calculated by `plan` if it is not cached.
    pub(crate) fn get_or_plan(
        &self,
        job: StockRemovalParams,
        plan: impl FnOnce(&StockRemovalParams) -> Result<PlannedContour, StockPathError>,
    ) -> Result<PlannedContour, StockPathError> {
        // A thread that panicked while it held the list has left it intact.
        let mut paths = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, path)) = paths.iter().find(|(known, _)| *known == job) {
            return Ok(path.clone());
        }
        let path = plan(&job)?;
        let moves: usize = paths.iter().map(|(_, path)| path.moves.len()).sum();
        if paths.len() < MAX_PATHS && moves + path.moves.len() <= MAX_MOVES {
            paths.push((job, path.clone()));
        }
        Ok(path)
    }
}
