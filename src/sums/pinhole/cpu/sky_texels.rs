//! How much of the environment parts of rows of a visibility map see, counted in whole words. Knows bits, but no samples.

/// A part of the rows of a map, from one place to another, each from 0 to 32 texels.
pub(super) struct Columns {
    /// The texels in which it begins and ends, and how far from their left edges.
    first: u32,
    last: u32,
    before_first: f32,
    in_last: f32,
    /// Bits of the texels from the first to the last, which is not included.
    mask: u64,
}

/// How many texels of some rows see the environment: between the ends of a part of them, and at its ends.
#[derive(Default)]
pub(super) struct SkyTexels {
    between: u32,
    at_first: u32,
    at_last: u32,
}

impl Columns {
    #[inline(always)]
    pub fn new(left: f32, right: f32) -> Self {
        let (first, last) = (left as u32, right as u32);
        let mask = (1u64 << last).wrapping_sub(1 << first);
        Self { first, last, before_first: left - first as f32, in_last: right - last as f32, mask }
    }

    /// Counts the texels of a row.
    #[inline(always)]
    pub fn count(&self, sky_mask: u32, texels: &mut SkyTexels) {
        let row = u64::from(sky_mask);
        texels.between += (row & self.mask).count_ones();
        texels.at_first += (row >> self.first & 1) as u32;
        texels.at_last += (row >> self.last & 1) as u32;
    }

    /// The length that sees the environment, texels; partly covered ones count in proportion.
    #[inline(always)]
    pub fn length(&self, texels: &SkyTexels) -> f32 {
        texels.between as f32 + self.in_last * texels.at_last as f32 - self.before_first * texels.at_first as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_of_rows_count_their_texels() {
        let length = |mask: u32, left: f32, right: f32| {
            let (columns, mut texels) = (Columns::new(left, right), SkyTexels::default());
            columns.count(mask, &mut texels);
            columns.length(&texels)
        };
        for place in [0.0, 0.25, 7.5, 31.5, 32.0] {
            assert_eq!(length(u32::MAX, 0.0, place), place);
            assert_eq!(length(u32::MAX, place, 32.0), 32.0 - place);
            assert_eq!(length(0, 0.0, place), 0.0);
        }
        assert_eq!(length(0b1010, 0.0, 1.5), 0.5);
        assert_eq!(length(0b1010, 0.0, 3.0), 1.0);
        assert_eq!(length(0b1010, 1.25, 1.75), 0.5);
        assert_eq!(length(0b1010, 1.25, 3.5), 1.25);
    }
}
