//! Levels of detail of the planned path, and their chunks as pages receive them.
//!
//! Invariant: the coarsest level is good to half a pixel on a large screen; each level has its vertices in the order of
//! the path, and a vertex has the same record number in all of them.

use std::sync::Arc;

use retrace_controller::{PathVertex, PlannedPath};
use serde::Serialize;

/// Number of vertices in a chunk.
const CHUNK: usize = 8_192;

/// Number of tolerances of the coarsest level that fit in the extent of the path.
const COARSEST: f64 = 2_000.0;

/// Ratio of the tolerances of a level and the next one.
const RATIO: f64 = 4.0;

/// A path with its levels.
#[derive(Debug)]
pub(crate) struct PathLevels {
    /// Number of the path.
    pub(crate) number: u32,
    /// The planned path.
    pub(crate) path: Arc<PlannedPath>,
    levels: Vec<Level>,
    origin_um: [i32; 3],
}

#[derive(Debug)]
struct Level {
    tolerance_um: f64,
    /// Indices of its vertices; `None` for all of them.
    kept: Option<Vec<u32>>,
    boxes: Vec<[f64; 6]>,
}

#[derive(Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct PathView {
    t: &'static str,
    path: u32,
    origin_mm: [f64; 3],
    bounds_mm: [[f64; 3]; 2],
    vertices: usize,
    records: u32,
    levels: Vec<LevelView>,
}

#[derive(Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
struct LevelView {
    level: usize,
    tolerance_mm: f64,
    vertices: usize,
    chunks: Vec<ChunkView>,
}

#[derive(Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
struct ChunkView {
    first: usize,
    count: usize,
    #[serde(rename = "box")]
    bounds: [f64; 6],
}

impl PathLevels {
    /// Levels of a path; `number` tells it from the paths before it.
    pub(crate) fn new(number: u32, path: Arc<PlannedPath>) -> Self {
        let [low, high] = path.bounds_um();
        let extent = (0..3).map(|i| f64::from(high[i]) - f64::from(low[i])).fold(1.0, f64::max);
        let origin_um = std::array::from_fn(|i| ((i64::from(low[i]) + i64::from(high[i])) / 2) as i32);
        let mut levels = Vec::new();
        let mut tolerance_um = extent / COARSEST;
        let all = path.vertices().len();
        while tolerance_um > 4.0 && all > CHUNK {
            let kept = path.thinned(tolerance_um);
            if kept.len() * 2 > all {
                break;
            }
            levels.push(Level { tolerance_um, kept: Some(kept), boxes: Vec::new() });
            tolerance_um /= RATIO;
        }
        levels.push(Level { tolerance_um: 2.0, kept: None, boxes: Vec::new() });
        let mut levels = Self { number, path, levels, origin_um };
        for level in 0..levels.levels.len() {
            let boxes = (0..levels.vertices(level)).step_by(CHUNK).map(|first| levels.bounds(level, first)).collect();
            levels.levels[level].boxes = boxes;
        }
        levels
    }

    fn vertices(&self, level: usize) -> usize {
        let all = self.path.vertices().len();
        self.levels.get(level).map_or(0, |level| level.kept.as_ref().map_or(all, Vec::len))
    }

    fn vertex(&self, level: usize, index: usize) -> Option<PathVertex> {
        let index = match &self.levels.get(level)?.kept {
            Some(kept) => *kept.get(index)? as usize,
            None => index,
        };
        self.path.vertices().get(index).copied()
    }

    /// Box of a chunk with the segment that leads into it, mm relative to the origin.
    fn bounds(&self, level: usize, first: usize) -> [f64; 6] {
        let vertices = (first.saturating_sub(1)..first + CHUNK).map_while(|index| self.vertex(level, index));
        vertices.fold([f64::MAX, f64::MAX, f64::MAX, f64::MIN, f64::MIN, f64::MIN], |mut bounds, vertex| {
            for axis in 0..3 {
                let mm = (f64::from(vertex.at_um[axis]) - f64::from(self.origin_um[axis])) / 1000.0;
                bounds[axis] = bounds[axis].min(mm);
                bounds[axis + 3] = bounds[axis + 3].max(mm);
            }
            bounds
        })
    }

    /// Description of the path, as JSON.
    pub(crate) fn description(&self) -> String {
        let in_mm = |um: [i32; 3]| um.map(|um| f64::from(um) / 1000.0);
        let levels = self.levels.iter().enumerate().map(|(level, it)| LevelView {
            level,
            tolerance_mm: it.tolerance_um / 1000.0,
            vertices: self.vertices(level),
            chunks: it.boxes.iter().enumerate().map(|(n, &bounds)| self.chunk_view(level, n * CHUNK, bounds)).collect(),
        });
        let view = PathView {
            t: "path",
            path: self.number,
            origin_mm: in_mm(self.origin_um),
            bounds_mm: self.path.bounds_um().map(in_mm),
            vertices: self.path.vertices().len(),
            records: self.path.records(),
            levels: levels.collect(),
        };
        // A structure of numbers always serializes.
        serde_json::to_string(&view).unwrap_or_default()
    }

    fn chunk_view(&self, level: usize, first: usize, bounds: [f64; 6]) -> ChunkView {
        ChunkView { first, count: CHUNK.min(self.vertices(level) - first), bounds }
    }

    /// One chunk as a binary message; `None` where the level has no such chunk.
    pub(crate) fn chunk(&self, level: usize, first: usize) -> Option<Vec<u8>> {
        if !first.is_multiple_of(CHUNK) || first >= self.vertices(level) {
            return None;
        }
        let count = CHUNK.min(self.vertices(level) - first);
        let mut out = Vec::with_capacity(28 + count * 6);
        out.extend([1, 1, level as u8, 1]);
        for number in [self.number, first as u32, count as u32] {
            out.extend(number.to_le_bytes());
        }
        self.origin_um.iter().for_each(|um| out.extend(um.to_le_bytes()));
        let (mut record, mut at) = (0, self.origin_um);
        for vertex in (first..first + count).map_while(|index| self.vertex(level, index)) {
            push_varint(&mut out, u64::from(vertex.record.wrapping_sub(record)) << 2 | vertex.kind as u64);
            for (new, old) in vertex.at_um.into_iter().zip(at) {
                let by = i64::from(new) - i64::from(old);
                push_varint(&mut out, (by << 1 ^ by >> 63) as u64);
            }
            (record, at) = (vertex.record, vertex.at_um);
        }
        Some(out)
    }
}

fn push_varint(out: &mut Vec<u8>, mut value: u64) {
    while value > 127 {
        out.push(value as u8 | 128);
        value >>= 7;
    }
    out.push(value as u8);
}
