//! A count of light by random rays: from every light to a random point of a mirror or an interface, and on to the picture. Slow to tell single
//! pixels, but it finds all light, with an error that is known.

use std::f64::consts::TAU;

use glam::{DVec2, DVec3};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

use super::environment::Directions;
use super::rays::Rays;
use crate::emitters::Emitters;
use crate::geometry::Geometry;
use crate::lamps::Lamps;
use crate::lit_surfaces::LitSurfaces;
use crate::parallel;

/// The picture is divided into so many columns, and as many rows.
pub(super) const BLOCKS: usize = 4;
/// Independent parts, by which the error is told.
const BATCHES: usize = 32;
/// Points on mirrors in each part of the first round; each round has as many again as all before, until the error of the picture's mean is
/// small enough, or for so many rounds.
const FIRST_POINTS: usize = 512;
const MOST_ROUNDS: u32 = 8;
const WANTED_ERROR: f64 = 0.005;
const WANTED_ERROR_AT_POINTS: f64 = 0.01;

/// All light, and what it is followed through.
pub(crate) struct Count<'a> {
    pub rays: &'a Rays<'a>,
    pub geometry: &'a Geometry,
    pub lamps: &'a Lamps,
    pub emitters: &'a Emitters,
    pub environment: Directions<'a>,
    /// If they and emitters count.
    pub surfaces: Option<LitSurfaces<'a>>,
    pub size: [u32; 2],
    /// Where in pixels light counts.
    pub window: Window,
}

/// Where in pixels light counts: all over, or, for what is known at points, around each point of a square grid of so many along each edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Window {
    Pixels,
    Points(u32),
}

/// A window's width, in distances of points.
const WINDOW: f64 = 0.25;

/// A mean and its standard error.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Counted {
    pub mean: f64,
    pub error: f64,
}

/// What was counted; of light the mean of the three channels.
#[derive(Clone, Debug)]
pub(crate) struct Flux {
    /// What falls on mirrors and interfaces, W.
    pub met: Counted,
    /// What of that arrives where the camera sees it, W,
    pub seen: Counted,
    /// and in how many rays.
    pub rays: u64,
    /// The mean irradiance over the picture's pixels, W/m²,
    pub picture: Counted,
    /// and that which each block of pixels brings to it.
    pub blocks: [Counted; BLOCKS * BLOCKS],
    /// The same over whole pixels, wherever light counts in them.
    pub in_pixels: [f64; BLOCKS * BLOCKS],
}

/// Sums of one part.
#[derive(Clone, Copy, Default)]
struct Sums {
    met: f64,
    seen: f64,
    rays: u64,
    blocks: [f64; BLOCKS * BLOCKS],
    in_pixels: [f64; BLOCKS * BLOCKS],
}

/// Points are chosen on triangles by these sums of area × about the irradiance up to and including each.
struct Choice {
    ids: Vec<u32>,
    cumulative: Vec<f64>,
}

/// The block of a pixel.
pub(super) fn block(pixel: usize, [width, height]: [u32; 2]) -> usize {
    let (width, height) = (width as usize, height as usize);
    (pixel / width) * BLOCKS / height * BLOCKS + (pixel % width) * BLOCKS / width
}

impl Count<'_> {
    /// Counts until the error is small, or `is_over`.
    pub fn flux(&self, seed: u64, is_over: &(dyn Fn() -> bool + Sync)) -> Flux {
        let choice = self.choice();
        let mut batches = [Sums::default(); BATCHES];
        let mut points = 0;
        let mut flux = Flux::of(&batches, 1, self.size);
        if choice.ids.is_empty() {
            return flux;
        }
        for round in 0..MOST_ROUNDS {
            let more = points.max(FIRST_POINTS);
            let of_batch = |k: usize| self.batch(&choice, more, seed ^ ((k as u64) << 32 | u64::from(round)));
            let found: Vec<Sums> = parallel::collect(BATCHES, &of_batch);
            batches.iter_mut().zip(&found).for_each(|(sums, found)| sums.add(found));
            points += more;
            flux = Flux::of(&batches, points, self.size);
            if flux.picture.error <= self.window.wanted_error() * flux.picture.mean && flux.picture.mean > 0.0
                || is_over()
            {
                break;
            }
        }
        flux
    }

    fn choice(&self) -> Choice {
        let ids = self.rays.casting_triangles();
        let from_all_around = match &self.environment {
            Directions::None => 0.0,
            Directions::Spot { irradiance, .. } => irradiance.element_sum(),
            Directions::Boxes { cumulative, .. } => {
                cumulative.last().map_or(0.0, |sum| TAU * sum / cumulative.len() as f64)
            }
        };
        let others = self.surfaces.as_ref().map_or(0.0, |s| TAU * (s.brightest + self.emitters.brightest()));
        let mut sum = 0.0;
        let weight = |id: &u32| {
            let [a, b, c] = self.geometry.triangles[*id as usize].corners;
            let (middle, extent) = ((a + b + c) / 3.0, a.distance(b).max(a.distance(c)));
            let of_lamp = |lamp: &crate::lamps::Source| {
                lamp.most_irradiance((middle.distance(lamp.position) - 0.5 * extent).max(0.5 * extent))
            };
            let of_lamps: f64 = self.lamps.sources().iter().map(of_lamp).sum();
            sum += 0.5 * (b - a).cross(c - a).length() * (from_all_around + others + of_lamps);
            sum
        };
        let cumulative: Vec<f64> = ids.iter().map(weight).collect();
        if sum > 0.0 { Choice { ids, cumulative } } else { Choice { ids: Vec::new(), cumulative: Vec::new() } }
    }

    fn batch(&self, choice: &Choice, points: usize, seed: u64) -> Sums {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut sums = Sums::default();
        let total = choice.cumulative.last().copied().unwrap_or(0.0);
        for k in 0..points {
            let at = (k as f64 + rng.random::<f64>()) / points as f64 * total;
            let index = choice.cumulative.partition_point(|sum| *sum <= at).min(choice.ids.len() - 1);
            let before = if index == 0 { 0.0 } else { choice.cumulative[index - 1] };
            let part = (choice.cumulative[index] - before) / total;
            self.point(choice.ids[index], part, &mut rng, &mut sums);
        }
        sums
    }

    /// Follows light of every kind by a random point of a triangle that was chosen with a probability.
    fn point(&self, id: u32, probability: f64, rng: &mut ChaCha8Rng, sums: &mut Sums) {
        let triangle = &self.geometry.triangles[id as usize];
        let (root, v) = (rng.random::<f64>().sqrt(), rng.random::<f64>());
        let barycentric = [1.0 - root, root * (1.0 - v), root * v];
        let [a, b, c] = triangle.corners;
        // Its length is the area over the probability.
        let area = 0.5 * (b - a).cross(c - a) / probability;
        let numbers = [(); 8].map(|()| rng.random::<f64>());
        let ways = self.rays.ways_of(triangle.object);
        self.light_at(triangle.position(barycentric), id, numbers, &mut |direction, irradiance| {
            let flux = irradiance * area.dot(direction).abs();
            if flux == DVec3::ZERO {
                return;
            }
            sums.met += flux.element_sum() / 3.0;
            let start = self.rays.start(id, barycentric, -direction);
            for way in &ways {
                let numbers = [rng.random(), rng.random()];
                let Some((landing, passed)) = self.rays.follow(&start, *way, numbers) else { continue };
                let Some(pixel) = self.rays.plane.pixel(landing.place).filter(|_| landing.is_seen) else { continue };
                sums.rays += 1;
                sums.seen += (flux * passed).element_sum() / 3.0;
                let weight = self.window.weight(landing.place);
                let (block, irradiance) = (block(pixel, self.size), (flux * landing.per_area).element_sum() / 3.0);
                sums.blocks[block] += weight * irradiance;
                sums.in_pixels[block] += irradiance;
            }
        });
    }

    /// Calls with unit directions to light that a point gets, and what it would bring to a surface that faces it, W/m²: on average all.
    fn light_at(&self, from: DVec3, id: u32, numbers: [f64; 8], call: &mut dyn FnMut(DVec3, DVec3)) {
        let [u, v, w, lamp_u, lamp_v, other_u, other_v, _] = numbers;
        let is_hidden = |position: DVec3| self.geometry.blocks_segment(from, position, [id; 2]);
        for lamp in self.lamps.samples(from, [lamp_u, lamp_v]).filter(|lamp| !is_hidden(lamp.position)) {
            call(lamp.direction, lamp.radiance * lamp.solid_angle);
        }
        let is_free = |direction: DVec3| {
            self.emitters.met(from, direction).is_none() && !self.geometry.blocks_ray(from, direction, id)
        };
        if let Some((direction, irradiance)) = self.environment.sample([u, v, w]).filter(|(d, _)| is_free(*d)) {
            call(direction, irradiance);
        }
        let Some(surfaces) = &self.surfaces else { return };
        let emitters = [self.emitters.sample(from, [u, v]), self.emitters.sample_distant(from, [lamp_u, lamp_v])];
        for point in emitters.into_iter().flatten() {
            if self.emitters.shows(from, &point) && !is_hidden(point.position) {
                call(point.direction, point.irradiance);
            }
        }
        if surfaces.brightest > 0.0 {
            let height = 2.0 * other_u - 1.0;
            let (sin, cos) = (TAU * other_v).sin_cos();
            let across = (1.0 - height * height).max(0.0).sqrt();
            let direction = DVec3::new(across * cos, height, across * sin);
            call(direction, 2.0 * TAU * surfaces.radiance((from, id), direction, [u, v]));
        }
    }
}

impl Window {
    fn wanted_error(self) -> f64 {
        if self == Self::Pixels { WANTED_ERROR } else { WANTED_ERROR_AT_POINTS }
    }

    /// How much light counts that arrives at a place, in pixels; 1 on average.
    fn weight(self, place: DVec2) -> f64 {
        let Self::Points(per_edge) = self else { return 1.0 };
        let from_point = (place * f64::from(per_edge)).fract() - 0.5;
        if from_point.abs().max_element() < 0.5 * WINDOW { 1.0 / (WINDOW * WINDOW) } else { 0.0 }
    }
}

impl Sums {
    fn add(&mut self, other: &Self) {
        self.met += other.met;
        self.seen += other.seen;
        self.rays += other.rays;
        self.blocks.iter_mut().zip(other.blocks).for_each(|(sum, more)| *sum += more);
        self.in_pixels.iter_mut().zip(other.in_pixels).for_each(|(sum, more)| *sum += more);
    }
}

impl Flux {
    /// From parts of so many points each.
    fn of(batches: &[Sums; BATCHES], points: usize, [width, height]: [u32; 2]) -> Self {
        let pixels = f64::from(width) * f64::from(height);
        let counted = |value: &dyn Fn(&Sums) -> f64| {
            let count = BATCHES as f64;
            let of_batch = || batches.iter().map(|sums| value(sums) / points as f64);
            let mean = of_batch().sum::<f64>() / count;
            let variance = of_batch().map(|value| (value - mean).powi(2)).sum::<f64>() / (count * (count - 1.0));
            Counted { mean, error: variance.sqrt() }
        };
        Self {
            met: counted(&|sums| sums.met),
            seen: counted(&|sums| sums.seen),
            rays: batches.iter().map(|sums| sums.rays).sum(),
            picture: counted(&|sums| sums.blocks.iter().sum::<f64>() / pixels),
            blocks: std::array::from_fn(|block| counted(&|sums| sums.blocks[block] / pixels)),
            in_pixels: std::array::from_fn(|block| counted(&|sums| sums.in_pixels[block] / pixels).mean),
        }
    }
}
