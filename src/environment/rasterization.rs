//! Triangles drawn on a face of a cube map with a z-buffer, seen from the cube's centre.

use glam::{Vec2, Vec3, Vec4};

use super::cube::face_direction;

/// Points along a texel's edge that are tested, and up to how many points of the rectangle that is drawn: small lights need more.
const POINTS_OF_TEXELS: [(usize, usize); 5] =
    [(16, 1 << 17), (8, 1 << 17), (4, 1 << 22), (2, 1 << 22), (1, usize::MAX)];
/// Planes through the cube's centre are seen edge-on: the sine of their angle to a corner, at least.
const MIN_SINE: f32 = 1e-6;

/// A triangle of one radiance, relative to the cube's centre.
#[derive(Clone, Copy, Debug)]
pub(super) struct ShiningTriangle {
    pub corners: [Vec3; 3],
    pub radiance: Vec3,
}

/// What is drawn on a face: a rectangle of points.
pub(super) struct FaceImage {
    /// Points along a texel's edge, and along the face's.
    per_texel: usize,
    per_edge: usize,
    /// The first point of the rectangle, and its width and height.
    origin: [usize; 2],
    extent: [usize; 2],
    /// Inverse depths; zero where nothing is drawn.
    nearness: Vec<f32>,
    radiance: Vec<Vec3>,
}

/// A triangle's part on a face.
struct Polygon {
    /// Corners in points; in texels at first.
    corners: Vec<Vec2>,
    /// Inverse depth by place in the same unit: constant part and derivatives.
    nearness: [f32; 3],
    radiance: Vec3,
}

impl FaceImage {
    /// Draws triangles on a face of so many texels along its edge.
    pub fn draw(face: usize, size: u32, triangles: &[ShiningTriangle]) -> Self {
        let mut polygons: Vec<Polygon> = triangles.iter().filter_map(|t| polygon(face, size, t)).collect();
        let corners = polygons.iter().flat_map(|polygon| &polygon.corners);
        let (low, high) =
            corners.fold((Vec2::splat(size as f32), Vec2::ZERO), |(l, h), corner| (l.min(*corner), h.max(*corner)));
        let first = [low.x, low.y].map(|x| (x.max(0.0) as usize).min(size as usize));
        let last = [high.x, high.y].map(|x| (x.ceil() as usize).min(size as usize));
        let texels = [0, 1].map(|axis| last[axis].saturating_sub(first[axis]));
        let fits = |(points, most): &(usize, usize)| texels[0] * texels[1] * points * points <= *most;
        let per_texel = POINTS_OF_TEXELS.into_iter().find(fits).map_or(1, |(points, _)| points);
        let (origin, extent) = (first.map(|x| per_texel * x), texels.map(|x| per_texel * x));
        let count = extent[0] * extent[1];
        let mut image = Self {
            per_texel,
            per_edge: per_texel * size as usize,
            origin,
            extent,
            nearness: vec![0.0; count],
            radiance: vec![Vec3::ZERO; count],
        };
        for polygon in &mut polygons {
            polygon.refine(per_texel as f32);
            image.fill(polygon);
        }
        image
    }

    /// Fills the points within a convex polygon that lie before what is there.
    fn fill(&mut self, polygon: &Polygon) {
        let heights = polygon.corners.iter().map(|corner| corner.y);
        let (top, bottom) = heights.fold((f32::INFINITY, 0.0f32), |(l, h), y| (l.min(y), h.max(y)));
        let rows = (top - 0.5).ceil().max(0.0) as usize..((bottom - 0.5).ceil().max(0.0) as usize).min(self.per_edge);
        let [constant, by_x, by_y] = polygon.nearness;
        for y in rows {
            let height = y as f32 + 0.5;
            let Some([from, to]) = span(&polygon.corners, height) else { continue };
            let columns =
                (from - 0.5).ceil().max(0.0) as usize..((to - 0.5).ceil().max(0.0) as usize).min(self.per_edge);
            for x in columns {
                let nearness = constant + by_x * (x as f32 + 0.5) + by_y * height;
                let index = (y - self.origin[1]) * self.extent[0] + x - self.origin[0];
                if nearness > self.nearness[index] {
                    (self.nearness[index], self.radiance[index]) = (nearness, polygon.radiance);
                }
            }
        }
    }

    /// Blends the drawn points into row `y` of the face's texels.
    pub fn blend(&self, y: usize, row: &mut [Vec4]) {
        let within = |texel: usize, axis: usize| {
            let (first, end) = (self.origin[axis], self.origin[axis] + self.extent[axis]);
            (self.per_texel * texel).max(first)..(self.per_texel * (texel + 1)).min(end)
        };
        let rows = within(y, 1);
        let columns = self.origin[0] / self.per_texel..(self.origin[0] + self.extent[0]) / self.per_texel;
        if rows.is_empty() {
            return;
        }
        for (x, texel) in columns.clone().zip(&mut row[columns]) {
            let (mut sum, mut count) = (Vec3::ZERO, 0);
            for j in rows.clone() {
                let start = (j - self.origin[1]) * self.extent[0];
                for i in within(x, 0) {
                    let index = start + i - self.origin[0];
                    if self.nearness[index] > 0.0 {
                        (sum, count) = (sum + self.radiance[index], count + 1);
                    }
                }
            }
            let part = 1.0 / (self.per_texel * self.per_texel) as f32;
            *texel = (part * sum + (1.0 - part * count as f32) * texel.truncate()).extend(1.0);
        }
    }
}

impl Polygon {
    /// Changes the unit to a fraction of it.
    fn refine(&mut self, fraction: f32) {
        self.corners.iter_mut().for_each(|corner| *corner *= fraction);
        let [constant, by_x, by_y] = self.nearness;
        self.nearness = [constant, by_x / fraction, by_y / fraction];
    }
}

/// Where a row of points crosses a convex polygon.
fn span(corners: &[Vec2], height: f32) -> Option<[f32; 2]> {
    let mut span: Option<[f32; 2]> = None;
    for (k, &one) in corners.iter().enumerate() {
        let other = corners[(k + 1) % corners.len()];
        // Neighbours share edges, which they must cross at the same place.
        let (upper, lower) = if one.y < other.y { (one, other) } else { (other, one) };
        if upper.y <= height && height < lower.y {
            let x = upper.x + (height - upper.y) / (lower.y - upper.y) * (lower.x - upper.x);
            span = Some(span.map_or([x, x], |[from, to]| [from.min(x), to.max(x)]));
        }
    }
    span
}

/// The part of a triangle that a face shows, if there is one, in texels.
fn polygon(face: usize, size: u32, triangle: &ShiningTriangle) -> Option<Polygon> {
    let axis = face_direction(face, 0.0, 0.0);
    let (across, down) = (face_direction(face, 1.0, 0.0) - axis, face_direction(face, 0.0, 1.0) - axis);
    // x and y to the right and down, z along the face's axis.
    let corners = triangle.corners.map(|p| Vec3::new(p.dot(across), p.dot(down), p.dot(axis)));
    let [a, b, c] = corners;
    let normal = (b - a).cross(c - a);
    let distance = normal.dot(a);
    let farthest = corners.iter().map(|p| p.length()).fold(0.0, f32::max);
    if distance.abs() <= MIN_SINE * normal.length() * farthest {
        return None;
    }
    let mut clipped = corners.to_vec();
    for side in [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y] {
        clipped = clip(&clipped, Vec3::Z - side);
    }
    if clipped.len() < 3 || clipped.iter().any(|p| p.z <= 0.0) {
        return None;
    }
    let scale = 0.5 * size as f32;
    let corners = clipped.iter().map(|p| scale * (p.truncate() / p.z + Vec2::ONE)).collect();
    // The plane is met at 1/nearness along (s, t, 1); s and t are −1 at the first edge.
    let by_place = normal / distance;
    let nearness = [by_place.z - by_place.x - by_place.y, by_place.x / scale, by_place.y / scale];
    Some(Polygon { corners, nearness, radiance: triangle.radiance })
}

/// The part of a convex polygon on the positive side of a plane through the origin.
fn clip(corners: &[Vec3], plane: Vec3) -> Vec<Vec3> {
    let mut clipped = Vec::with_capacity(corners.len() + 1);
    for (k, &corner) in corners.iter().enumerate() {
        let next = corners[(k + 1) % corners.len()];
        let (here, there) = (plane.dot(corner), plane.dot(next));
        if here >= 0.0 {
            clipped.push(corner);
        }
        if (here >= 0.0) != (there >= 0.0) {
            clipped.push(corner + here / (here - there) * (next - corner));
        }
    }
    clipped
}
