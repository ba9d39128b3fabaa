//! Rows of a light's view in strips, so that many photons take no more memory than some: each strip has the rows of neighbours that its own
//! photons need.

use bytemuck::{Pod, Zeroable};

/// Photons that are kept together, about: on a GPU 128 MiB with their ways and places.
const PHOTONS_OF_STRIP: u32 = 1 << 20;

/// Rows of neighbours before and after those of a strip.
const NEIGHBOURS: u32 = 2;

/// Rows of a view that are kept together. As shaders have it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub(crate) struct Strip {
    /// Of the view.
    pub first_row: u32,
    /// With neighbours.
    pub rows: u32,
    /// Rows that are accounted for, counted from the first one; around them are neighbours.
    pub first_own_row: u32,
    /// How many these are.
    pub own_rows: u32,
}

impl Strip {
    /// All rows of a view.
    pub fn whole([_, rows]: [u32; 2]) -> Self {
        Self { first_row: 0, rows, first_own_row: 0, own_rows: rows }
    }

    /// Whether its own rows begin with the view's first one.
    pub fn is_first(&self) -> bool {
        self.first_row + self.first_own_row == 0
    }
}

/// The rows of a view in strips.
pub(crate) fn strips([columns, rows]: [u32; 2]) -> impl Iterator<Item = Strip> {
    let own = (PHOTONS_OF_STRIP / columns.max(1)).max(1);
    (0..rows).step_by(own as usize).map(move |first_own| {
        let first_row = first_own.saturating_sub(NEIGHBOURS);
        let own_rows = own.min(rows - first_own);
        let end = (first_own + own_rows + NEIGHBOURS).min(rows);
        Strip { first_row, rows: end - first_row, first_own_row: first_own - first_row, own_rows }
    })
}

/// The most photons of a strip of a view of so many columns.
#[cfg(feature = "gpu")]
pub(crate) fn photons_of_strip([columns, rows]: [u32; 2]) -> u64 {
    strips([columns, rows]).map(|strip| u64::from(strip.rows) * u64::from(columns)).max().unwrap_or(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_are_all_rows_once() {
        for size in [[16, 16], [1024, 1024], [2048, 2048], [8192, 8192], [8192, 5]] {
            let mut next = 0;
            for strip in strips(size) {
                assert_eq!(strip.first_row + strip.first_own_row, next, "{size:?}");
                next += strip.own_rows;
                let after = strip.first_row + strip.rows - next;
                assert!(strip.first_own_row == NEIGHBOURS || strip.first_row == 0);
                assert!(after == NEIGHBOURS || strip.first_row + strip.rows == size[1]);
            }
            assert_eq!(next, size[1]);
            let most = strips(size).map(|strip| strip.rows * size[0]).max().unwrap();
            assert!(most <= PHOTONS_OF_STRIP + 4 * size[0]);
        }
    }
}
