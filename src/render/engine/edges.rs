//! Anti-aliasing of light: where it differs from one pixel to the next on one surface, several points of the pixel share in it.

use std::collections::HashMap;
use std::sync::Arc;

use glam::{UVec2, Vec2, Vec3, Vec4};

use super::ends::{POINTS_IN_A_GROUP, POINTS_IN_A_ROW};
use super::every_other::PixelGrid;
use super::frame::FrameInputs;
use super::paths::share_light;
use crate::Error;
use crate::parallel;
use crate::pinhole::Receivers;
use crate::progress::Uncounted;
use crate::scene::Ray;
use crate::stages::CameraRays;
use crate::technique::Sum;
use crate::tracing::Hit;

/// A pixel is divided if its caustic differs from a neighbour's by more than this part of all light there, and its second difference along
/// that row or column is as large: where light rises evenly, that in the middle of a pixel is the pixel's mean.
pub(super) const MIN_CONTRAST: f32 = 0.1;
/// The same in mirrors, which seldom show an edge along many pixels.
pub(super) const MIN_MIRRORED_CONTRAST: f32 = 0.2;
/// It differs by more than this many times what the tolerance alone may make of it, too.
const MIN_TOLERANCES: f32 = 10.0;
/// Parts of a divided pixel.
pub(super) const PARTS: usize = 4;
/// Their places, from its centre, in pixels: no two share a row or a column.
pub(super) const PLACES: [Vec2; PARTS] =
    [Vec2::new(-0.125, -0.375), Vec2::new(0.375, -0.125), Vec2::new(0.125, 0.375), Vec2::new(-0.375, 0.125)];
/// The parts that are nearest to 4×4 points of a pixel, row by row.
pub(super) const NEAREST_PARTS: [usize; 16] = [0, 0, 0, 1, 3, 0, 1, 1, 3, 3, 2, 1, 3, 2, 2, 2];

/// Light in the parts of pixels that are divided, W/m², by point.
pub(super) type Parts = HashMap<u32, [Vec3; PARTS]>;

/// The caustic's irradiance, W/m².
#[derive(Debug)]
pub(super) struct Caustic {
    /// By point, with the number of fetches in w; may be padded to whole rows.
    pub sums: Vec<[f32; 4]>,
    /// Their mean is the sum.
    pub parts: Parts,
}

/// Direct irradiance, W/m².
#[derive(Debug)]
pub(super) struct Direct {
    /// By point.
    pub light: Vec<Vec3>,
    /// Their mean is the point's light.
    pub parts: Parts,
}

impl From<Vec<[f32; 4]>> for Caustic {
    /// Of pixels that are not divided.
    fn from(sums: Vec<[f32; 4]>) -> Self {
        Self { sums, parts: Parts::new() }
    }
}

impl From<Vec<Vec3>> for Direct {
    /// Of pixels that are not divided.
    fn from(light: Vec<Vec3>) -> Self {
        Self { light, parts: Parts::new() }
    }
}

/// A caustic beside direct light, whose edges are looked for.
#[derive(Clone, Copy, Debug)]
pub(super) struct SeenCaustic<'a> {
    pub direct: &'a [Vec3],
    pub caustic: &'a [[f32; 4]],
}

impl SeenCaustic<'_> {
    /// Of a point: its irradiance, and that of all light.
    pub fn at(&self, point: usize) -> [Vec3; 2] {
        let caustic = Vec3::from_slice(&self.caustic[point]);
        [caustic, caustic + self.direct[point]]
    }
}

/// The contrast from which on a caustic of this relative tolerance has an edge, at least `min_contrast`.
pub(super) fn contrast_of_edges(min_contrast: f32, tolerance: f32) -> f32 {
    min_contrast.max(MIN_TOLERANCES * tolerance)
}

/// A part of a divided pixel.
#[derive(Clone, Copy, Debug)]
pub(super) enum Part {
    /// It shows something else.
    Other,
    /// Its light is known.
    Known(Vec3),
    /// Its light is to be computed.
    Open(Hit),
}

/// Points of a grid whose pixels are divided: their indices, and the parts.
#[derive(Debug)]
pub(super) struct DividedPixels(Vec<(usize, [Part; PARTS])>);

impl DividedPixels {
    /// Points and the parts of their pixels.
    pub fn new(points: Vec<usize>, parts: Vec<[Part; PARTS]>) -> Self {
        let is_divided = |parts: &[Part; PARTS]| parts.iter().any(|part| !matches!(part, Part::Other));
        Self(points.into_iter().zip(parts).filter(|(_, parts)| is_divided(parts)).collect())
    }

    /// The open parts, with the indices of their points.
    fn open(&self) -> impl Iterator<Item = (usize, &Hit)> {
        self.0.iter().flat_map(|(index, parts)| {
            parts.iter().filter_map(|part| if let Part::Open(hit) = part { Some((*index, hit)) } else { None })
        })
    }

    /// Computes the caustic in all open parts.
    pub async fn with_caustic(
        self,
        (inputs, sum): (&FrameInputs<'_>, &Arc<dyn Sum>),
        direct: &[Vec3],
        sums: Vec<[f32; 4]>,
    ) -> Result<Caustic, Error> {
        let places: Vec<_> = self.open().map(|(_, hit)| (hit.position, hit.normal, hit.object)).collect();
        let mut of_parts = Vec::new();
        if !places.is_empty() {
            let mut receivers = Receivers::from_points(&places, POINTS_IN_A_ROW);
            for (place, (index, _)) in self.open().enumerate() {
                let error = inputs.hidden_error(direct[index] + Vec3::from_slice(&sums[index]));
                // Each is a part of what is seen.
                receivers.tolerate(place, PARTS as f32 * error);
            }
            of_parts = sum.irradiance(&receivers, &Uncounted(inputs.progress)).await?;
        }
        let mut caustic = Caustic::from(sums);
        for (index, parts) in self.lit(of_parts.into_iter().map(Vec4::from_array)) {
            let [.., fetches] = &mut caustic.sums[index];
            let fetches = *fetches + parts.iter().map(|part| part.w).sum::<f32>();
            let parts = parts.map(Vec4::truncate);
            caustic.sums[index] = mean(parts).extend(fetches).to_array();
            caustic.parts.insert(index as u32, parts);
        }
        Ok(caustic)
    }

    /// What is hit in all open parts, in groups of points that are close to each other.
    pub fn open_in_groups(&self) -> Vec<Vec<&Hit>> {
        let open: Vec<&Hit> = self.open().map(|(_, hit)| hit).collect();
        open.chunks(POINTS_IN_A_GROUP).map(<[_]>::to_vec).collect()
    }

    /// Direct light with that in all open parts.
    pub fn with_direct(self, of_parts: Vec<Vec3>, light: Vec<Vec3>) -> Direct {
        let mut direct = Direct::from(light);
        for (index, parts) in self.lit(of_parts.into_iter().map(|light| light.extend(0.0))) {
            let parts = parts.map(Vec4::truncate);
            direct.light[index] = mean(parts);
            direct.parts.insert(index as u32, parts);
        }
        direct
    }

    /// The light in all parts, from that in the open ones. Parts that show something else get the mean of the others.
    fn lit(self, mut of_open: impl Iterator<Item = Vec4>) -> impl Iterator<Item = (usize, [Vec4; PARTS])> {
        self.0.into_iter().map(move |(index, parts)| {
            let own = parts.map(|part| match part {
                Part::Other => None,
                Part::Known(light) => Some(light.extend(0.0)),
                Part::Open(_) => of_open.next(),
            });
            let known = || own.iter().flatten();
            let mean = known().map(|light| light.truncate()).sum::<Vec3>() / known().count() as f32;
            (index, own.map(|light| light.unwrap_or(mean.extend(0.0))))
        })
    }
}

fn mean(parts: [Vec3; PARTS]) -> Vec3 {
    parts.iter().sum::<Vec3>() / PARTS as f32
}

/// The points of a grid, of `count`, at an edge of light between them and their neighbours on the same surface, along a Z-order curve.
/// `light` is the irradiance at a point, and that of all light there.
pub(super) fn beside_edges(
    (grid, count): (&impl PixelGrid, usize),
    min_contrast: f32,
    light: impl Fn(usize) -> [Vec3; 2] + Sync,
) -> Vec<usize> {
    let is_beside = |index: usize| is_beside_edge(grid, index, min_contrast, &light);
    let mut found = parallel::filter(count, &is_beside);
    found.sort_by_cached_key(|index| grid.place_on_curve(*index));
    found
}

/// Whether there is an edge between a point and any of its neighbours on the same surface.
fn is_beside_edge(grid: &impl PixelGrid, index: usize, min_contrast: f32, light: &impl Fn(usize) -> [Vec3; 2]) -> bool {
    if grid.hit(index).is_none() {
        return false;
    }
    let (x, y) = grid.pixel(index);
    let neighbour = |column: Option<usize>, row: Option<usize>| {
        let other = grid.counterpart(index, column.filter(|x| *x < grid.width())?, row?)?;
        grid.may_interpolate(index, other).then(|| light(other))
    };
    let along_row = [x.checked_sub(1), Some(x + 1)].map(|column| neighbour(column, Some(y)));
    let along_column = [y.checked_sub(1), Some(y + 1)].map(|row| neighbour(Some(x), row));
    let point = light(index);
    [along_row, along_column].into_iter().any(|neighbours| is_uneven(point, neighbours, min_contrast))
}

/// Whether light differs between a point and either of two opposite neighbours and, where both are known, has a second difference as large.
/// Of each point: its irradiance, and that of all light.
fn is_uneven([own, all]: [Vec3; 2], neighbours: [Option<[Vec3; 2]>; 2], min_contrast: f32) -> bool {
    let is_step = |[other, all_there]: [Vec3; 2]| {
        (own - other).abs().max_element() > min_contrast * all.max(all_there).max_element()
    };
    if !neighbours.into_iter().flatten().any(is_step) {
        return false;
    }
    let [Some([before, all_before]), Some([after, all_after])] = neighbours else { return true };
    let bend = (before - 2.0 * own + after).abs().max_element();
    bend > min_contrast * all.max(all_before).max(all_after).max_element()
}

/// The parts of pixels that show the same surface as their centres.
pub(super) async fn parts_of_pixels(
    inputs: &FrameInputs<'_>,
    rays: &CameraRays,
    points: &[usize],
) -> Result<Vec<[Part; PARTS]>, Error> {
    let of_parts: Vec<Ray> = points.iter().flat_map(|&index| rays_of_parts(rays, index)).collect();
    let hits = inputs.camera_hits(&of_parts).await?;
    let of_pixels = points.iter().zip(hits.as_chunks().0);
    Ok(of_pixels.map(|(&index, hits)| parts_with(rays.hits[index].as_ref(), hits)).collect())
}

/// The camera's rays through the parts of a pixel.
fn rays_of_parts(rays: &CameraRays, index: usize) -> [Ray; PARTS] {
    let (view, width) = (&rays.view, rays.width as usize);
    let centre = Vec2::new((index % width) as f32, (index / width + view.first_row as usize) as f32) + 0.5;
    PLACES.map(|place| view.camera.ray(centre + place, UVec2::from_array(view.size).as_vec2()))
}

/// The parts of a pixel, of which its centre and each part see this.
fn parts_with(own: Option<&Hit>, hits: &[Option<Hit>; PARTS]) -> [Part; PARTS] {
    hits.map(|hit| {
        let hit = hit.filter(|hit| own.is_some_and(|own| share_light(own, hit)));
        hit.map_or(Part::Other, Part::Open)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::load;
    use crate::stages::View;
    use crate::tracing::Tracer;

    /// Light on one side of a column of a picture of a table.
    #[test]
    fn points_at_an_edge_of_light_are_found() {
        let scene = load::<toml::Table>("mirror-sphere").unwrap().scene;
        let tracer = Tracer::new(&scene);
        let view = View { camera: scene.camera, size: [32, 32], pixel_samples: 1, first_row: 0, rows: 32 };
        let rays = CameraRays::trace(|ray| tracer.camera_hit(ray), view);
        let caustic: Vec<[f32; 4]> = (0..1024).map(|k| [if k % 32 < 5 { 0.5 } else { 0.0 }; 4]).collect();
        let at_edge = |direct: f32, tolerance: f32| -> Vec<usize> {
            let direct = vec![Vec3::splat(direct); 1024];
            let light = SeenCaustic { direct: &direct, caustic: &caustic };
            let min_contrast = contrast_of_edges(MIN_CONTRAST, tolerance);
            let mut found = beside_edges((&rays, 1024), min_contrast, |point| light.at(point));
            found.sort_unstable();
            found
        };
        let found = at_edge(1.0, 0.01);
        assert!(found.len() > 10);
        assert!(found.iter().all(|index| [4, 5].contains(&(index % 32))));
        assert!(found.iter().all(|&index| {
            let hits = rays_of_parts(&rays, index).map(|ray| tracer.camera_hit(ray));
            parts_with(rays.hits[index].as_ref(), &hits).iter().all(|part| matches!(part, Part::Open(_)))
        }));
        assert!(at_edge(100.0, 0.01).is_empty(), "beside much more light nothing is seen of it");
        assert!(at_edge(1.0, 0.05).is_empty(), "coarse sums differ by themselves");
    }

    #[test]
    fn even_slopes_are_no_edges() {
        let light = |value: f32| [Vec3::splat(value); 2];
        let neighbours = |before: f32, after: f32| [before, after].map(|value| Some(light(value)));
        let is_uneven = |own: f32, neighbours| is_uneven(light(own), neighbours, 0.1);
        assert!(!is_uneven(1.0, neighbours(0.7, 1.3)), "a slope");
        assert!(is_uneven(1.0, neighbours(1.0, 0.7)), "a step");
        assert!(is_uneven(1.0, neighbours(0.7, 0.8)), "a ridge");
        assert!(is_uneven(1.0, [None, Some(light(0.7))]), "one side is unknown");
        assert!(!is_uneven(1.0, neighbours(1.0, 0.95)), "hardly a step");
    }

    #[test]
    fn light_of_a_pixel_is_the_mean_of_its_parts() {
        let hit =
            Hit { object: 0, position: Vec3::ZERO, distance: 1.0, normal: Vec3::Y, face_normal: Vec3::Y, front: true };
        let divided = DividedPixels(vec![
            (2, [Part::Open(hit), Part::Other, Part::Open(hit), Part::Other]),
            (0, [Part::Known(Vec3::ONE), Part::Other, Part::Other, Part::Open(hit)]),
        ]);
        let count = divided.open_in_groups().concat().len();
        let of_parts = (0..count).map(|k| Vec3::new(2.0 + 2.0 * k as f32, k as f32, 0.0)).collect();
        let direct = divided.with_direct(of_parts, vec![Vec3::ONE; 3]);
        let means = [Vec3::new(3.5, 1.5, 0.5), Vec3::ONE, Vec3::new(3.0, 0.5, 0.0)];
        assert_eq!(direct.light, means);
        assert_eq!(direct.parts[&2], [Vec3::new(2.0, 0.0, 0.0), means[2], Vec3::new(4.0, 1.0, 0.0), means[2]]);
        assert_eq!(direct.parts[&0], [Vec3::ONE, means[0], means[0], Vec3::new(6.0, 2.0, 0.0)]);
        assert_eq!(direct.parts.len(), 2);
    }

    #[test]
    fn points_belong_to_the_nearest_part() {
        for (k, part) in NEAREST_PARTS.into_iter().enumerate() {
            let at = (Vec2::new((k % 4) as f32, (k / 4) as f32) - 1.5) / 4.0;
            let nearest = PLACES.iter().map(|place| place.distance(at)).fold(f32::INFINITY, f32::min);
            assert!(PLACES[part].distance(at) < nearest + 1e-6, "{k}");
        }
    }
}
