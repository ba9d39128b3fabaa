//! The account of a picture's flux: what an estimate says that the picture holds, against an independent count.

use std::fmt;

use super::count::{BLOCKS, Counted, Flux, block};
use crate::estimate::Estimate;

/// So many standard errors are no disagreement.
const SIGMAS: f64 = 4.0;
/// Nor is this part of the light: meshes' normals are interpolated, and light that is followed backwards takes them otherwise than light that
/// is followed forwards;
const NEGLIGIBLE: f64 = 0.02;
/// nor this part of a picture's mean in one of its blocks;
const NEGLIGIBLE_IN_BLOCK: f64 = 0.05;
/// nor, of light at pixels' centres, what these may miss between each other, but no more than this part of the light.
const MOST_BETWEEN_CENTRES: f64 = 0.1;
const MOST_BETWEEN_CENTRES_IN_BLOCK: f64 = 0.3;

/// The flux of light that is followed forwards, ray by ray, and that of an estimate. All numbers are means of the three channels.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Ledger {
    /// What falls on mirrors and interfaces, W.
    pub cast_w: f64,
    /// What of that arrives in the picture, W.
    pub arriving_w: f64,
    /// The mean irradiance of the picture by the count, W/m²,
    pub counted: f64,
    /// and its standard error.
    pub counted_error: f64,
    /// That of the estimate,
    pub estimated: f64,
    /// and its standard error.
    pub estimated_error: f64,
    /// The largest difference in any of the sixteen blocks of the picture, in parts of what can be explained; beyond 1 the ledger is open.
    pub largest_difference: f64,
    /// The same of the whole picture.
    pub difference: f64,
}

impl Ledger {
    /// Whether count and estimate agree within their errors.
    pub fn closes(&self) -> bool {
        self.largest_difference <= 1.0 && self.difference <= 1.0
    }

    /// `points`: points in each pixel, where the estimate is of these, or `None` where it has means over pixels.
    pub(crate) fn new(flux: &Flux, estimate: &Estimate, points: Option<u32>) -> Self {
        let of_blocks = blocks(estimate, points);
        let total = of_blocks.iter().fold(Block::default(), |sum, block| sum.with(block));
        let mean = flux.picture.mean.max(total.mean);
        let in_block = |(counted, estimated): (&Counted, &Block)| {
            let between = estimated.between.min(MOST_BETWEEN_CENTRES_IN_BLOCK * counted.mean.max(estimated.mean));
            let share = mean / (BLOCKS * BLOCKS) as f64;
            disagreement(counted, estimated, between + NEGLIGIBLE_IN_BLOCK * share.max(counted.mean))
        };
        let between = total.between.min(MOST_BETWEEN_CENTRES * mean);
        Self {
            cast_w: flux.met.mean,
            arriving_w: flux.seen.mean,
            counted: flux.picture.mean,
            counted_error: flux.picture.error,
            estimated: total.mean,
            estimated_error: total.variance.sqrt(),
            largest_difference: flux.blocks.iter().zip(&of_blocks).map(in_block).fold(0.0, f64::max),
            difference: disagreement(&flux.picture, &total, between + NEGLIGIBLE * mean),
        }
    }
}

impl fmt::Display for Ledger {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { counted, counted_error, estimated, estimated_error, .. } = self;
        write!(
            f,
            "a forward count finds a mean of {counted:.4e} ± {counted_error:.1e} W/m², the estimate {estimated:.4e} ± {estimated_error:.1e}"
        )
    }
}

/// What a block of pixels brings to the picture's mean, by an estimate.
#[derive(Clone, Copy, Default)]
struct Block {
    mean: f64,
    variance: f64,
    /// What points may miss of light that varies between them.
    between: f64,
}

impl Block {
    fn with(mut self, other: &Self) -> Self {
        self.mean += other.mean;
        self.variance += other.variance;
        self.between += other.between;
        self
    }
}

/// A difference in parts of what errors explain.
fn disagreement(counted: &Counted, estimated: &Block, allowed: f64) -> f64 {
    let difference = (counted.mean - estimated.mean).abs();
    if difference == 0.0 {
        return 0.0;
    }
    difference / (SIGMAS * counted.error.hypot(estimated.variance.sqrt()) + allowed)
}

fn blocks(estimate: &Estimate, points: Option<u32>) -> [Block; BLOCKS * BLOCKS] {
    let image = &estimate.irradiance;
    let (width, count) = (image.width as usize, image.pixels.len());
    let light = |pixel: usize| f64::from(image.pixels[pixel].element_sum()) / 3.0;
    let mut blocks = [Block::default(); BLOCKS * BLOCKS];
    for pixel in 0..count {
        let error = f64::from(estimate.standard_error.pixels[pixel].element_sum()) / 3.0;
        let right = if (pixel + 1) % width == 0 { pixel } else { pixel + 1 };
        let below = if pixel + width < count { pixel + width } else { pixel };
        let change = (light(pixel) - light(right)).abs().max((light(pixel) - light(below)).abs());
        // Of an edge anywhere in the pixel; edges along rows of pixels add up.
        let between = points.map_or(0.0, |points| change / 12f64.sqrt() / f64::from(points));
        let block = &mut blocks[block(pixel, [image.width, image.height])];
        let part = 1.0 / count as f64;
        *block = block.with(&Block { mean: part * light(pixel), variance: (part * error).powi(2), between: part * between });
    }
    blocks
}
