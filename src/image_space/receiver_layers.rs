//! What the texels of a caustic map show: receivers in layers, nearest first, as in layered depth images (Shade, Gortler, He and Szeliski,
//! *Layered Depth Images*, 1998). Knows no flux.

use bytemuck::{Pod, Zeroable};
use glam::{DVec2, Vec3};
use rayon::prelude::*;

use super::constants::{PHOTON_OFF_PLANE, SAME_SURFACE_COSINE};
use super::photons::Photon;
use super::projection::Projection;
use crate::scene::Ray;
use crate::tracing::Hit;

/// No receiver.
const NOTHING: u32 = u32::MAX;

/// From a place to itself and to the places in the texels around it.
const AROUND: [[f64; 2]; 9] =
    [[0.0, 0.0], [-1.0, 0.0], [1.0, 0.0], [0.0, -1.0], [0.0, 1.0], [-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]];

/// A receiver in the middle of a texel.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Texel {
    /// Metres.
    pub position: Vec3,
    /// `u32::MAX`: none.
    pub object: u32,
    /// Of its triangle, towards the viewer; unit length.
    pub normal: Vec3,
    /// The edge of a square with the area that the texel covers on the receiver, metres.
    pub edge: f32,
}

impl Texel {
    const EMPTY: Self = Self { position: Vec3::ZERO, object: NOTHING, normal: Vec3::ZERO, edge: 0.0 };

    fn of_hit(projection: &Projection, hit: &Hit) -> Self {
        let cosine = hit.face_normal.dot(projection.direction_to(hit.position)).abs().max(f32::MIN_POSITIVE);
        let edge = (projection.area_at(hit.position) / f64::from(cosine)).sqrt() as f32;
        Self { position: hit.position, normal: hit.face_normal, object: hit.object, edge }
    }

    /// Whether it shows a receiver.
    pub fn is_there(&self) -> bool {
        self.object != NOTHING
    }

    /// How far a point is from the plane of the receiver, metres.
    fn height_of(&self, point: Vec3) -> f32 {
        (point - self.position).dot(self.normal).abs()
    }

    fn is_same_surface(&self, object: u32, normal: Vec3) -> bool {
        self.object == object && self.normal.dot(normal) >= SAME_SURFACE_COSINE
    }
}

/// The receivers that a view shows.
#[derive(Debug)]
pub struct ReceiverLayers {
    projection: Projection,
    /// Layer by layer, in each row by row.
    texels: Vec<Texel>,
}

impl ReceiverLayers {
    /// What rays show in as many layers as they need, up to `most`, if these are receivers.
    pub fn new(projection: Projection, most: u32, receiver: &(impl Fn(Ray) -> Option<Hit> + Sync)) -> Self {
        let count = projection.texel_count();
        let columns: Vec<Vec<Texel>> =
            (0..count).into_par_iter().map(|index| column(&projection, index, most, receiver)).collect();
        let layers = columns.iter().map(Vec::len).max().unwrap_or(0).max(1);
        let mut texels = vec![Texel::EMPTY; count * layers];
        for (index, column) in columns.into_iter().enumerate() {
            for (layer, texel) in column.into_iter().enumerate() {
                texels[layer * count + index] = texel;
            }
        }
        Self { projection, texels }
    }

    /// With the texels of another program, layer by layer.
    #[cfg(feature = "gpu")]
    pub fn of_texels(projection: Projection, texels: Vec<Texel>) -> Self {
        Self { projection, texels }
    }

    /// The view.
    pub fn projection(&self) -> &Projection {
        &self.projection
    }

    /// Texels of all layers.
    pub fn len(&self) -> usize {
        self.texels.len()
    }

    /// A texel of any layer.
    pub fn texel(&self, index: usize) -> &Texel {
        &self.texels[index]
    }

    /// The texels of all layers in which a place appears.
    fn layers_of(&self, place: DVec2) -> impl Iterator<Item = usize> + use<> {
        let count = self.projection.texel_count();
        let end = self.texels.len();
        self.projection.index(place).into_iter().flat_map(move |first| (first..end).step_by(count))
    }

    /// Of the layers at a place, the one whose plane lies nearest to a point of a surface that is about as it is oriented there.
    fn nearest(&self, place: DVec2, point: Vec3, is_same: impl Fn(&Texel) -> bool) -> Option<usize> {
        let shown = self.layers_of(place).filter(|index| is_same(&self.texels[*index]));
        shown.min_by(|a, b| self.texels[*a].height_of(point).total_cmp(&self.texels[*b].height_of(point)))
    }

    /// The texel at a place that shows the surface which a photon lands on.
    pub fn surface_of(&self, place: DVec2, photon: &Photon) -> Option<usize> {
        self.nearest(place, photon.position, |texel| texel.is_same_surface(photon.object, photon.normal))
    }

    /// The same, if it shows the very place where the photon lands.
    pub fn place_of(&self, place: DVec2, photon: &Photon) -> Option<usize> {
        let index = self.surface_of(place, photon)?;
        let texel = &self.texels[index];
        (texel.height_of(photon.position) <= PHOTON_OFF_PLANE * texel.edge).then_some(index)
    }

    /// The texel at a place that shows a point of an object on the side of a normal.
    pub fn point_at(&self, place: DVec2, point: Vec3, (normal, object): (Vec3, u32)) -> Option<usize> {
        let index = self.nearest(place, point, |texel| texel.object == object && texel.normal.dot(normal) > 0.0)?;
        let texel = &self.texels[index];
        // As far off as the neighbouring texel may be.
        (texel.height_of(point) <= 2.0 * PHOTON_OFF_PLANE * texel.edge).then_some(index)
    }

    /// The same in the texels around, too: at the edges of surfaces, the middle of the texel may show something else.
    pub fn point_near(&self, place: DVec2, point: Vec3, surface: (Vec3, u32)) -> Option<usize> {
        AROUND.iter().find_map(|step| self.point_at(place + DVec2::from_array(*step), point, surface))
    }

    /// The texels at most so far from one in columns and rows that show the same surface, and how far they are.
    pub fn around(&self, index: usize, reach: i64) -> impl Iterator<Item = (usize, [i64; 2])> {
        let count = self.projection.texel_count();
        let width = self.projection.size[0] as usize;
        let [x, y] = [index % count % width, index % count / width].map(|k| k as f64 + 0.5);
        let own = self.texels[index];
        let offsets = (-reach..=reach).flat_map(move |dy| (-reach..=reach).map(move |dx| [dx, dy]));
        offsets.filter(move |_| own.is_there()).filter_map(move |[dx, dy]| {
            if [dx, dy] == [0, 0] {
                return Some((index, [0, 0]));
            }
            let place = DVec2::new(x + dx as f64, y + dy as f64);
            let is_same = |texel: &Texel| texel.is_same_surface(own.object, own.normal);
            Some((self.nearest(place, own.position, is_same)?, [dx, dy]))
        })
    }
}

/// What the ray in the middle of a texel meets, up to so many layers.
fn column(projection: &Projection, index: usize, most: u32, receiver: &impl Fn(Ray) -> Option<Hit>) -> Vec<Texel> {
    let width = projection.size[0] as usize;
    let mut ray = projection.ray(DVec2::new((index % width) as f64, (index / width) as f64) + 0.5);
    let mut texels = Vec::new();
    for _ in 0..most {
        let Some(hit) = receiver(ray) else { break };
        texels.push(Texel::of_hit(projection, &hit));
        ray.origin = hit.position;
    }
    texels
}
