//! The account of a picture's flux: what an estimate says that the picture holds, against an independent count.

use std::fmt;

use super::count::{BLOCKS, Counted, Flux, block};
use crate::estimate::Estimate;

/// Fewer rays tell nothing, not even their error.
const LEAST_RAYS: u64 = 200;
/// A count with a larger relative error is made of few rays that carry most of the light, and its error is itself uncertain; so is that of a block.
const MOST_RELATIVE_ERROR: f64 = 0.05;
/// So many standard errors are no disagreement.
const SIGMAS: f64 = 4.0;
/// Nor is this part of the light: meshes' normals are interpolated, and light that is followed backwards takes them otherwise than light that
/// is followed forwards;
const NEGLIGIBLE: f64 = 0.02;
/// nor this part of a picture's mean in one of its blocks;
const NEGLIGIBLE_IN_BLOCK: f64 = 0.1;
/// nor, of light at points, what changes about them, but no more than this part of the light.
const MOST_BETWEEN: f64 = 0.1;
const MOST_BETWEEN_IN_BLOCK: f64 = 0.5;

/// The flux of light that is followed forwards, ray by ray, and that of an estimate. All numbers are means of the three channels.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Ledger {
    /// What falls on mirrors and interfaces, W.
    pub cast_w: f64,
    /// What of that arrives in the picture, W,
    pub arriving_w: f64,
    /// and in how many rays of the count.
    pub rays: u64,
    /// The mean irradiance of the picture by the count, W/m²,
    pub counted: f64,
    /// and its standard error.
    pub counted_error: f64,
    /// That of the estimate,
    pub estimated: f64,
    /// and its standard error.
    pub estimated_error: f64,
    /// The largest difference in any of the sixteen blocks of the picture, in parts of what errors explain; beyond 1 the ledger is open.
    pub largest_difference: f64,
    /// The same of the whole picture.
    pub difference: f64,
}

impl Ledger {
    /// Whether enough rays arrive in the picture to tell what it holds: of a picture that is a thousandth of all that is lit, few do.
    pub fn is_known(&self) -> bool {
        let is_certain = self.rays >= LEAST_RAYS && self.counted_error <= MOST_RELATIVE_ERROR * self.counted;
        is_certain || self.rays == 0 && self.estimated == 0.0
    }

    /// Whether count and estimate agree within their errors, as far as is known.
    pub fn closes(&self) -> bool {
        !self.is_known() || self.largest_difference <= 1.0 && self.difference <= 1.0
    }

    /// `between`: the part of a change from pixel to pixel that the estimate and the count may differ by.
    pub(crate) fn new(flux: &Flux, estimate: &Estimate, between: f64) -> Self {
        let of_blocks = blocks(estimate, between);
        let total = of_blocks.iter().fold(Block::default(), Block::with);
        let mean = flux.picture.mean.max(total.mean);
        // What is finer than pixels may be seen in one block, and missed in another.
        let finer_than_pixels = 2.0 * (total.between + total.alone) / (BLOCKS * BLOCKS) as f64;
        let in_block = |((counted, estimated), in_pixels): ((&Counted, &Block), &f64)| {
            if counted.error > MOST_RELATIVE_ERROR * counted.mean {
                return 0.0;
            }
            // Blocks of few pixels may have a single edge, and no others that make up for it.
            let between = (4.0 * estimated.between).min(MOST_BETWEEN_IN_BLOCK * counted.mean.max(estimated.mean));
            let share = mean / (BLOCKS * BLOCKS) as f64;
            let explained = between + estimated.alone + finer_than_pixels + 2.0 * (counted.mean - in_pixels).abs();
            disagreement(counted, estimated, explained + NEGLIGIBLE_IN_BLOCK * share.max(counted.mean))
        };
        // Where light around points is other than in their pixels, it is other at the points themselves, too.
        let uneven = 2.0 * (flux.picture.mean - flux.in_pixels.iter().sum::<f64>()).abs();
        let between = total.between.min(MOST_BETWEEN * mean) + uneven;
        Self {
            cast_w: flux.met.mean,
            arriving_w: flux.seen.mean,
            rays: flux.rays,
            counted: flux.picture.mean,
            counted_error: flux.picture.error,
            estimated: total.mean,
            estimated_error: total.variance.sqrt(),
            largest_difference: flux
                .blocks
                .iter()
                .zip(&of_blocks)
                .zip(&flux.in_pixels)
                .map(in_block)
                .fold(0.0, f64::max),
            difference: disagreement(&flux.picture, &total, between + total.alone + NEGLIGIBLE * mean),
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
    /// What may be missed of light that changes from pixel to pixel.
    between: f64,
    /// What stands in single pixels, of which nothing is known around their points.
    alone: f64,
}

impl Block {
    fn with(mut self, other: &Self) -> Self {
        self.mean += other.mean;
        self.variance += other.variance;
        self.between += other.between;
        self.alone += other.alone;
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

fn blocks(estimate: &Estimate, part_between: f64) -> [Block; BLOCKS * BLOCKS] {
    let image = &estimate.irradiance;
    let (width, height) = (image.width as usize, image.height as usize);
    let light = |x: usize, y: usize| f64::from(image.pixels[y * width + x].element_sum()) / 3.0;
    let mut blocks = [Block::default(); BLOCKS * BLOCKS];
    for (pixel, error) in estimate.standard_error.pixels.iter().enumerate() {
        let (x, y) = (pixel % width, pixel / width);
        let own = light(x, y);
        let beside = [(x.saturating_sub(1), y), (x + 1, y), (x, y.saturating_sub(1)), (x, y + 1)];
        let beside = beside.into_iter().filter(|(i, j)| *i < width && *j < height && (*i, *j) != (x, y));
        let changes: Vec<f64> = beside.map(|(i, j)| (own - light(i, j)).abs()).collect();
        let [least, most] = [f64::min, f64::max].map(|pick| changes.iter().copied().reduce(pick).unwrap_or(own));
        let part = 1.0 / (width * height) as f64;
        let error = f64::from(error.element_sum()) / 3.0;
        let (between, alone) = (part * part_between * most, part * f64::from(u8::from(part_between > 0.0)) * least);
        let block = &mut blocks[block(pixel, [image.width, image.height])];
        *block = block.with(&Block { mean: part * own, variance: (part * error).powi(2), between, alone });
    }
    blocks
}
