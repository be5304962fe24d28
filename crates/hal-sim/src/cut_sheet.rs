//! The sheet under a source: which of its cells are cut.
//!
//! Invariant: memory is taken by the areas that were cut only, a bit for each cell of them.

use std::collections::HashMap;

/// Cells along each side of a tile.
const TILE: i32 = 64;

/// The cut cells of a sheet, each 0.05 mm wide.
#[derive(Clone, Debug, Default)]
pub(crate) struct CutSheet {
    tiles: HashMap<[i32; 2], [u64; TILE as usize]>,
}

impl CutSheet {
    /// Cuts a cell.
    pub(crate) fn cut(&mut self, cell: [i32; 2]) {
        let (tile, row, bit) = split(cell);
        self.tiles.entry(tile).or_insert([0; TILE as usize])[row] |= bit;
    }

    /// Whether a cell is cut.
    pub(crate) fn is_cut(&self, cell: [i32; 2]) -> bool {
        let (tile, row, bit) = split(cell);
        self.tiles.get(&tile).is_some_and(|rows| rows[row] & bit != 0)
    }

    /// Number of cut cells.
    #[cfg(test)]
    pub(crate) fn count(&self) -> usize {
        self.tiles.values().flatten().map(|row| row.count_ones() as usize).sum()
    }
}

/// Tile, row and bit of a cell.
fn split([x, y]: [i32; 2]) -> ([i32; 2], usize, u64) {
    ([x.div_euclid(TILE), y.div_euclid(TILE)], y.rem_euclid(TILE) as usize, 1 << x.rem_euclid(TILE))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::HashSet;

    proptest! {
        /// A sheet has exactly the cells that were cut, on both sides of every edge of a tile.
        #[test]
        fn has_the_cells_that_were_cut(cells in prop::collection::vec([-130i32..130, -130i32..130], 0..200)) {
            let mut sheet = CutSheet::default();
            cells.iter().for_each(|&cell| sheet.cut(cell));
            let all: HashSet<[i32; 2]> = cells.into_iter().collect();
            prop_assert_eq!(sheet.count(), all.len());
            for x in -130..130 {
                for y in -130..130 {
                    prop_assert_eq!(sheet.is_cut([x, y]), all.contains(&[x, y]));
                }
            }
        }
    }
}
