//! What the texels of a caustic map show: receivers in layers, nearest first, as in layered depth images (Shade, Gortler, He and Szeliski,
//! *Layered Depth Images*, 1998). Knows no flux.

use glam::{DVec2, Vec3};

use super::constants::{EDGE_RAYS, MAX_EDGE_SURFACES, MAX_VISIBLE_LAYERS, PHOTON_OFF_PLANE, SAME_SURFACE_COSINE};
use super::photons::Photon;
use super::projection::Projection;
use crate::parallel;
use crate::scene::Ray;
use crate::tracing::Hit;

/// No receiver.
const NOTHING: u32 = u32::MAX;

/// From a place to itself and to the places in the texels around it.
const AROUND: [[f64; 2]; 9] =
    [[0.0, 0.0], [-1.0, 0.0], [1.0, 0.0], [0.0, -1.0], [0.0, 1.0], [-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]];

/// A receiver that a texel shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Texel {
    /// Metres.
    pub position: Vec3,
    /// `u32::MAX`: none.
    pub object: u32,
    /// Of its triangle, towards the viewer; unit length.
    pub normal: Vec3,
    /// The edge of a square with the area that the whole texel covers on the plane of the receiver, metres.
    pub edge: f32,
    /// The part of the texel in which it is seen, more than 0 and at most 1.
    pub part: f32,
}

impl Texel {
    const EMPTY: Self = Self { position: Vec3::ZERO, object: NOTHING, normal: Vec3::ZERO, edge: 0.0, part: 1.0 };

    fn of_hit(projection: &Projection, hit: &Hit) -> Self {
        let cosine = hit.face_normal.dot(projection.direction_to(hit.position)).abs().max(f32::MIN_POSITIVE);
        let edge = (projection.area_at(hit.position) / f64::from(cosine)).sqrt() as f32;
        Self { position: hit.position, normal: hit.face_normal, object: hit.object, edge, part: 1.0 }
    }

    /// The area in which it is seen, m².
    pub fn area(&self) -> f32 {
        self.part * self.edge * self.edge
    }

    /// Whether it shows a receiver.
    pub fn is_there(&self) -> bool {
        self.object != NOTHING
    }

    /// How far a point is from the plane of the receiver, metres.
    fn height_of(&self, point: Vec3) -> f32 {
        (point - self.position).dot(self.normal).abs()
    }

    /// Whether it shows the surface of a point: of the same object, or one that continues it in its plane, as joints do between tiles.
    fn shows(&self, (point, normal, object): SurfacePoint) -> bool {
        self.is_there()
            && self.normal.dot(normal) >= SAME_SURFACE_COSINE
            && (self.object == object || self.is_in_plane(point))
    }

    /// Whether a point is in its plane, as far as the map can tell.
    fn is_in_plane(&self, point: Vec3) -> bool {
        self.height_of(point) <= PHOTON_OFF_PLANE * self.edge
    }

    /// Whether a point that another ray through the texel meets is one of the same surface.
    fn is_surface_near(&self, other: &Self) -> bool {
        self.normal.dot(other.normal) >= SAME_SURFACE_COSINE && self.is_in_plane(other.position)
    }

    fn point(&self) -> SurfacePoint {
        (self.position, self.normal, self.object)
    }

    /// Whether another texel shows the same surface, or neither shows any.
    fn continues(&self, other: &Self) -> bool {
        if !self.is_there() || !other.is_there() {
            return self.is_there() == other.is_there();
        }
        self.shows(other.point()) && self.height_of(other.position) <= 2.0 * self.edge
    }
}

/// A point, the normal there, and the object.
type SurfacePoint = (Vec3, Vec3, u32);

/// The receivers that a view shows.
#[derive(Debug)]
pub struct ReceiverLayers {
    projection: Projection,
    /// Layer by layer, in each row by row.
    texels: Vec<Texel>,
}

impl ReceiverLayers {
    /// What rays show in as many layers as they need, up to `most`, if these are receivers.
    pub fn all(projection: Projection, most: u32, receiver: &(impl Fn(Ray) -> Option<Hit> + Sync)) -> Self {
        let count = projection.texel_count();
        let columns = parallel::collect(count, &|index| column(&projection, index, most, receiver));
        Self::of_columns(projection, columns)
    }

    /// What is seen first, if these are receivers. Texels at the edges of surfaces show several side by side, each in a part of the texel.
    pub fn visible(projection: Projection, receiver: &(impl Fn(Ray) -> Option<Hit> + Sync)) -> Self {
        let count = projection.texel_count();
        let middle = |index| column(&projection, index, 1, receiver).first().copied().unwrap_or(Texel::EMPTY);
        let middles: Vec<Texel> = parallel::collect(count, &middle);
        let column = |index: usize| {
            if is_at_edge(&projection, &middles, index) {
                return parts(&projection, index, receiver);
            }
            Some(middles[index]).filter(Texel::is_there).into_iter().collect()
        };
        let columns = parallel::collect(count, &column);
        Self::of_columns(projection, columns)
    }

    fn of_columns(projection: Projection, columns: Vec<Vec<Texel>>) -> Self {
        let count = projection.texel_count();
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
        let point = (photon.position, photon.normal, photon.object);
        self.nearest(place, photon.position, |texel| texel.shows(point))
    }

    /// The same, if it shows the very place where the photon lands.
    pub fn place_of(&self, place: DVec2, photon: &Photon) -> Option<usize> {
        let index = self.surface_of(place, photon)?;
        self.texels[index].is_in_plane(photon.position).then_some(index)
    }

    /// The texel at a place that shows a point of an object on the side of a normal.
    pub fn point_at(&self, place: DVec2, point: Vec3, (normal, object): (Vec3, u32)) -> Option<usize> {
        let is_its = |texel: &Texel| {
            let is_near = texel.object == object || texel.is_in_plane(point);
            texel.is_there() && is_near && texel.normal.dot(normal) > 0.0
        };
        let index = self.nearest(place, point, is_its)?;
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
            Some((self.nearest(place, own.position, |texel| texel.shows(own.point()))?, [dx, dy]))
        })
    }
}

/// The middle of a texel, in texels.
fn middle(projection: &Projection, index: usize) -> DVec2 {
    let width = projection.size[0] as usize;
    DVec2::new((index % width) as f64, (index / width) as f64) + 0.5
}

/// What the ray in the middle of a texel meets, up to so many layers.
fn column(projection: &Projection, index: usize, most: u32, receiver: &impl Fn(Ray) -> Option<Hit>) -> Vec<Texel> {
    let mut ray = projection.ray(middle(projection, index));
    let mut texels = Vec::new();
    for _ in 0..most {
        let Some(hit) = receiver(ray) else { break };
        let texel = Texel::of_hit(projection, &hit);
        // What lies just behind is the same surface, as far as the map can tell.
        if texels.last().is_none_or(|last: &Texel| !last.is_surface_near(&texel)) {
            texels.push(texel);
        }
        ray.origin = hit.position;
    }
    texels
}

/// Whether texels around one show something else than it does.
fn is_at_edge(projection: &Projection, middles: &[Texel], index: usize) -> bool {
    let place = middle(projection, index);
    let around = AROUND.iter().filter_map(|step| projection.index(place + DVec2::from_array(*step)));
    around.into_iter().any(|other| !middles[index].continues(&middles[other]))
}

/// The surfaces that rays through a texel meet first, the largest parts of it.
fn parts(projection: &Projection, index: usize, receiver: &impl Fn(Ray) -> Option<Hit>) -> Vec<Texel> {
    let corner = middle(projection, index) - 0.5;
    let rays = EDGE_RAYS * EDGE_RAYS;
    // Each row and each column of so many has one ray.
    let places = (0..rays).map(|k| {
        let (i, j) = (k % EDGE_RAYS, k / EDGE_RAYS);
        (DVec2::new(f64::from(EDGE_RAYS * i + j), f64::from(EDGE_RAYS * j + EDGE_RAYS - 1 - i)) + 0.5) / f64::from(rays)
    });
    let mut found: Vec<Part> = Vec::new();
    for place in places {
        let Some(hit) = receiver(projection.ray(corner + place)) else { continue };
        let texel = Texel::of_hit(projection, &hit);
        let off_middle = place.distance_squared(DVec2::splat(0.5));
        let Some(index) = found.iter().position(|part| part.texel.is_surface_near(&texel)) else {
            if found.len() < MAX_EDGE_SURFACES as usize {
                found.push(Part { texel, off_middle, rays: 1 });
            }
            continue;
        };
        let part = &mut found[index];
        part.rays += 1;
        if off_middle < part.off_middle {
            (part.texel, part.off_middle) = (texel, off_middle);
        }
    }
    found.sort_by_key(|part| std::cmp::Reverse(part.rays));
    let texel = |part: &Part| Texel { part: part.rays as f32 / rays as f32, ..part.texel };
    found.iter().take(MAX_VISIBLE_LAYERS as usize).map(texel).collect()
}

/// A surface that some of the rays through a texel meet.
struct Part {
    /// Where the ray that is nearest to the middle meets it.
    texel: Texel,
    /// How far that is from the middle, squared.
    off_middle: f64,
    rays: u32,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Camera, Projection as CameraProjection};

    /// The areas of texels (Wyman and Davis 2006, Equations 5 and 6) beside those of the quadrilaterals between the rays through their corners, on
    /// planes that are seen at up to 75 degrees from the front, by either kind of camera.
    #[test]
    fn texels_cover_the_areas_between_their_corners() {
        let projections =
            [CameraProjection::Perspective { fov_y_rad: 0.7 }, CameraProjection::Orthographic { height: 2.0 }];
        for projection in projections {
            let camera = Camera::look_at(Vec3::new(0.0, 3.0, 1.0), Vec3::ZERO, Vec3::Z, projection).unwrap();
            let view = Projection::of_camera(&camera, [64, 48]);
            for tilt in [0.0f32, 30.0, 60.0, 75.0] {
                let (u, v) = camera.forward.any_orthonormal_pair();
                let normal = tilt.to_radians().cos() * -camera.forward + tilt.to_radians().sin() * (0.6 * u + 0.8 * v);
                let on_plane = |place: DVec2| {
                    let ray = view.ray(place);
                    let distance = -ray.origin.dot(normal) / ray.direction.dot(normal);
                    ray.origin + distance * ray.direction
                };
                for k in 0..64 {
                    let corner = DVec2::new(f64::from(k % 8) * 8.0, f64::from(k / 8) * 6.0);
                    let [a, b, c, d] = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
                        .map(|(x, y)| on_plane(corner + DVec2::new(x, y)).as_dvec3());
                    let exact = 0.5 * (c - a).cross(d - b).length();
                    let (position, object, front) = (on_plane(corner + 0.5), 0, true);
                    let hit = Hit { object, position, distance: 1.0, normal, face_normal: normal, front };
                    // Places seen at more than 75 degrees are hardly texels any more.
                    if -normal.dot(view.direction_to(position)) > 75.0f32.to_radians().cos() {
                        let area = f64::from(Texel::of_hit(&view, &hit).area());
                        assert!((area / exact - 1.0).abs() < 0.01, "{projection:?} {tilt} {k}: {area} {exact}");
                    }
                }
            }
        }
    }

    /// A wall that hides half of a floor: texels across its edge have the floor's part, and the parts of both add up.
    #[test]
    fn texels_at_edges_show_parts() {
        let camera =
            Camera::look_at(5.0 * Vec3::Y, Vec3::ZERO, Vec3::NEG_Z, CameraProjection::Orthographic { height: 1.6 });
        let view = Projection::of_camera(&camera.unwrap(), [16, 16]);
        // The edge is at 0.3 of the texels of its column.
        let edge = -0.8 + 0.1 * 7.3;
        let floor_and_shelf = |ray: Ray| {
            let (object, height) = if ray.origin.x < edge { (1, 1.0) } else { (0, 0.0) };
            let position = Vec3::new(ray.origin.x, height, ray.origin.z);
            let (distance, normal) = (ray.origin.y - height, Vec3::Y);
            Some(Hit { object, position, distance, normal, face_normal: normal, front: true })
        };
        let shown = ReceiverLayers::visible(view, &floor_and_shelf);
        let of = |x: usize, layer: usize| *shown.texel(layer * 256 + 16 * 5 + x);
        assert_eq!([6, 7, 8].map(|x| (of(x, 0).object, of(x, 0).part)), [(1, 1.0), (0, 11.0 / 16.0), (0, 1.0)]);
        assert_eq!((of(7, 1).object, of(7, 1).part), (1, 5.0 / 16.0));
        assert!(!of(6, 1).is_there() && !of(8, 1).is_there());
        // Without the shelf as a receiver its part is missing.
        let floor_alone = |ray: Ray| floor_and_shelf(ray).filter(|hit| hit.object == 0);
        let shown = ReceiverLayers::visible(view, &floor_alone);
        assert_eq!((shown.len(), shown.texel(16 * 5 + 7).part), (256, 11.0 / 16.0));
        assert!(!shown.texel(16 * 5 + 6).is_there());
    }
}
