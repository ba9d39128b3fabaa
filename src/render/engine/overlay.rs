//! Overlays: marks for the samples that the camera sees (Wand and Straßer, Figures 5 and 7), for the surface around them, and for photons and
//! their maps.

use glam::{UVec2, Vec2, Vec3};

use crate::differential::DifferentialSample;
use crate::image::Image;
use crate::image_space::MapPicture;
use crate::options::Overlay;
use crate::parallel;
use crate::scene::{Ray, Scene};
use crate::tracing::CameraTracer;

/// Dot radius, in pixels of a picture 512 pixels high.
const RADIUS: f32 = 1.4;
/// Half the width of lines, in the same pixels.
const HALF_WIDTH: f32 = 0.7;
/// Lengths of normals and of arms along the more curved direction, in edges of a square of the sample's area.
const NORMAL_LENGTH: f32 = 0.7;
const ARM_LENGTH: f32 = 0.42;
/// The arm along the less curved direction has at least this part of the other's length.
const SHORTEST_ARM: f32 = 0.12;

/// A map in a corner takes this part of the picture's shorter edge.
const PART_OF_CORNER: f32 = 0.4;

/// Something that is drawn over a picture, in pixels from its top left corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Mark {
    /// Where a sample is.
    Dot(Vec2),
    /// A straight line.
    Line {
        /// Its ends.
        ends: [Vec2; 2],
        /// What it shows.
        kind: LineKind,
    },
    /// A texel of a picture in a corner.
    Texel {
        /// Its corners, the upper left one first.
        corners: [Vec2; 2],
        /// Display-linear.
        colour: Vec3,
    },
}

/// What a line shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LineKind {
    /// A sample's normal.
    Normal,
    /// A principal direction in which the mirror is convex; its length tells how curved it is beside the other one.
    Convex,
    /// A principal direction in which the mirror is concave.
    Concave,
    /// An edge of a sample's cell.
    Cell,
}

impl LineKind {
    /// Its colour, display-linear.
    pub fn colour(self) -> Vec3 {
        match self {
            Self::Normal => Vec3::new(0.02, 0.3, 1.0),
            Self::Convex => Vec3::new(1.0, 0.3, 0.01),
            Self::Concave => Vec3::new(0.0, 0.6, 0.7),
            Self::Cell => Vec3::new(1.0, 0.85, 0.1),
        }
    }
}

impl Mark {
    /// The same mark in a picture of another size.
    #[must_use]
    pub fn scaled(self, factor: Vec2) -> Self {
        match self {
            Self::Dot(at) => Self::Dot(factor * at),
            Self::Line { ends, kind } => Self::Line { ends: ends.map(|end| factor * end), kind },
            Self::Texel { corners, colour } => Self::Texel { corners: corners.map(|corner| factor * corner), colour },
        }
    }
}

/// What the camera sees of the samples.
pub(super) struct Marker<'a> {
    pub scene: &'a Scene,
    pub tracer: &'a CameraTracer,
    /// Of the picture, pixels.
    pub size: Vec2,
}

impl Marker<'_> {
    /// The positions of the samples that the camera sees.
    pub fn dots(&self, positions: &[Vec3]) -> Vec<Vec2> {
        parallel::map(positions, &|position| self.visible(*position)).into_iter().flatten().collect()
    }

    /// A caustic map in the lower left corner, of a white that a hundredth of its lit texels exceed.
    pub fn corner(&self, map: &MapPicture) -> Vec<Mark> {
        let edge = PART_OF_CORNER * self.size.min_element() / map.size[0].max(map.size[1]) as f32;
        let origin = Vec2::new(0.0, self.size.y - edge * map.size[1] as f32);
        let mut lit: Vec<f32> = map.irradiance.iter().map(|e| e.max_element()).filter(|e| *e > 0.0).collect();
        lit.sort_by(f32::total_cmp);
        let white = lit.get(lit.len() * 99 / 100).map_or(1.0, |brightest| brightest.max(f32::MIN_POSITIVE));
        let texel = |(k, irradiance): (u32, &Vec3)| {
            let low = origin + edge * UVec2::new(k % map.size[0], k / map.size[0]).as_vec2();
            Mark::Texel { corners: [low, low + edge], colour: (*irradiance / white).min(Vec3::ONE) }
        };
        (0..).zip(&map.irradiance).map(texel).collect()
    }

    /// The marks of an overlay of samples and the surface around them.
    pub fn marks(&self, overlay: Overlay, samples: &[DifferentialSample]) -> Vec<Mark> {
        let of_seen: &(dyn Fn(&DifferentialSample) -> Vec<Mark> + Sync) = match overlay {
            Overlay::None | Overlay::Photons | Overlay::CausticMap => return Vec::new(),
            Overlay::Samples => &|sample| self.visible(sample.position).map(Mark::Dot).into_iter().collect(),
            Overlay::Normals => &|sample| self.normal(sample).into_iter().collect(),
            Overlay::Curvature => &|sample| self.curvature(sample).into_iter().flatten().collect(),
            Overlay::Cells => &|sample| self.cell(sample).into_iter().flatten().collect(),
        };
        let marks = |sample: &DifferentialSample| {
            if self.visible(sample.cell.centroid).is_some() { of_seen(sample) } else { Vec::new() }
        };
        parallel::map(samples, &marks).concat()
    }

    fn visible(&self, position: Vec3) -> Option<Vec2> {
        let (pixel, depth) = self.scene.camera.project(position, self.size);
        (depth > 0.0 && is_visible(self.tracer, self.scene.camera.ray(pixel, self.size), position)).then_some(pixel)
    }

    fn line(&self, ends: [Vec3; 2], kind: LineKind) -> Option<Mark> {
        let ends = ends.map(|end| self.scene.camera.project(end, self.size));
        ends.iter().all(|(_, depth)| *depth > 0.0).then(|| Mark::Line { ends: ends.map(|(pixel, _)| pixel), kind })
    }

    fn normal(&self, sample: &DifferentialSample) -> Option<Mark> {
        let tip = sample.position + NORMAL_LENGTH * sample.area.sqrt() * sample.normal;
        self.line([sample.position, tip], LineKind::Normal)
    }

    fn curvature(&self, sample: &DifferentialSample) -> [Option<Mark>; 2] {
        let largest = sample.curvatures[0].abs().max(sample.curvatures[1].abs()).max(f32::MIN_POSITIVE);
        [0, 1].map(|k| {
            let curvature = sample.curvatures[k];
            let arm = ARM_LENGTH * sample.area.sqrt() * (curvature.abs() / largest).max(SHORTEST_ARM);
            let (middle, arm) = (sample.cell.centroid, arm * sample.directions[k]);
            let kind = if curvature >= 0.0 { LineKind::Convex } else { LineKind::Concave };
            self.line([middle - arm, middle + arm], kind)
        })
    }

    fn cell(&self, sample: &DifferentialSample) -> [Option<Mark>; 4] {
        let [u, v] = sample.cell.sides.map(|side| 0.5 * side);
        let corners = [u + v, v - u, -u - v, u - v].map(|offset| sample.cell.centroid + offset);
        [0, 1, 2, 3].map(|k| self.line([corners[k], corners[(k + 1) % 4]], LineKind::Cell))
    }
}

/// Draws marks over a picture of their size.
pub(super) fn draw(image: &mut Image, marks: &[Mark]) {
    let scale = (image.height as f32 / 512.0).max(0.75);
    for mark in marks {
        match *mark {
            Mark::Dot(at) => draw_capsule(image, [at; 2], RADIUS * scale, Vec3::ZERO),
            Mark::Line { ends, kind } => draw_capsule(image, ends, HALF_WIDTH * scale, kind.colour()),
            Mark::Texel { corners, colour } => fill(image, corners, colour),
        }
    }
}

/// Whether a point on a ray is unoccluded, with some slack: quantised samples lie a little off their surface.
fn is_visible(tracer: &CameraTracer, ray: Ray, point: Vec3) -> bool {
    let along = |p: Vec3| (p - ray.origin).dot(ray.direction);
    let slack = 0.02 * (point - ray.origin).length();
    tracer.hit(ray).is_none_or(|hit| along(hit.position) > along(point) - slack)
}

/// Fills the pixels whose centres are in a rectangle.
fn fill(image: &mut Image, corners: [Vec2; 2], colour: Vec3) {
    let size = UVec2::new(image.width, image.height);
    let [low, high] = corners.map(|corner| (corner - 0.5).ceil().max(Vec2::ZERO).as_uvec2().min(size));
    for y in low.y..high.y {
        let row = (y * image.width) as usize;
        image.pixels[row + low.x as usize..row + high.x as usize].fill(colour);
    }
}

/// Draws everything within a distance of a line, anti-aliased.
fn draw_capsule(image: &mut Image, [one, other]: [Vec2; 2], radius: f32, colour: Vec3) {
    let size = UVec2::new(image.width, image.height);
    let low = (one.min(other) - radius - 1.0).floor().max(Vec2::ZERO).as_uvec2();
    let high = (one.max(other) + radius + 1.0).ceil().max(Vec2::ZERO).as_uvec2().min(size);
    let along = other - one;
    for y in low.y..high.y {
        for x in low.x..high.x {
            let from_one = UVec2::new(x, y).as_vec2() + 0.5 - one;
            let part = (from_one.dot(along) / along.length_squared().max(1e-12)).clamp(0.0, 1.0);
            let distance = (from_one - part * along).length();
            let coverage = (radius + 0.5 - distance).clamp(0.0, 1.0);
            let pixel = &mut image.pixels[(y * image.width + x) as usize];
            *pixel = pixel.lerp(colour, coverage);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::differential::differentials;
    use crate::sampling::{Options, Strategy, Surface, sample};
    use crate::tracing::Tracer;

    /// On a ball seen from outside, all normals point away from its centre, and it is convex in all directions.
    #[test]
    fn marks_show_the_surface_around_the_samples() {
        let scene = crate::scene::load::<toml::Table>("mirror-sphere").unwrap().scene;
        let surface = Surface::of_scene(&scene);
        let options = Options { samples: 200, strategy: Strategy::Neighbourhood, seed: 1 };
        let samples = differentials(&sample(&surface, &options).unwrap());
        let tracer = CameraTracer::new(Arc::new(Tracer::new(&scene)), None, None);
        let marker = Marker { scene: &scene, tracer: &tracer, size: Vec2::splat(200.0) };
        let mirror = scene.objects.iter().find(|object| object.reflector.is_some()).unwrap();
        let (centre, _) = scene.camera.project(mirror.placement.translate, marker.size);
        let (mut outwards, mut kinds) = (0, Vec::new());
        let normals = marker.marks(Overlay::Normals, &samples);
        for mark in &normals {
            let Mark::Line { ends: [foot, tip], kind } = *mark else { panic!("{mark:?}") };
            outwards += usize::from((tip - centre).length() >= (foot - centre).length() - 0.5);
            kinds.push(kind);
        }
        // The camera sees about half of them.
        assert!((60..140).contains(&normals.len()) && outwards == normals.len(), "{outwards} of {}", normals.len());
        let arms = marker.marks(Overlay::Curvature, &samples);
        assert_eq!(arms.len(), 2 * normals.len());
        assert!(arms.iter().all(|mark| matches!(mark, Mark::Line { kind: LineKind::Convex, .. })));
        assert_eq!(marker.marks(Overlay::Cells, &samples).len(), 4 * normals.len());
        assert!(kinds.iter().all(|kind| *kind == LineKind::Normal));
    }

    #[test]
    fn lines_are_drawn_where_they_are_and_clipped() {
        let mut image = Image { width: 20, height: 10, pixels: vec![Vec3::ONE; 200] };
        let line = |a: [f32; 2], b: [f32; 2]| Mark::Line { ends: [a.into(), b.into()], kind: LineKind::Cell };
        draw(&mut image, &[line([-30.0, 5.0], [50.0, 5.0]), Mark::Dot(Vec2::new(400.0, -3.0))]);
        let changed = |y: usize| image.pixels[y * 20..(y + 1) * 20].iter().filter(|p| **p != Vec3::ONE).count();
        assert_eq!([changed(2), changed(4), changed(5), changed(8)], [0, 20, 20, 0]);
    }
}
