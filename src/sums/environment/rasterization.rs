//! Triangles drawn on a face of a cube map with a z-buffer, seen from the cube's centre.

use std::ops::Range;

use arrayvec::ArrayVec;
use glam::{Mat3, Vec2, Vec3, Vec4};

use super::cube::face_direction;
use crate::parallel;

/// Points along a texel's edge that are tested, and up to how many points of the rectangle that is drawn: small lights need more.
const POINTS_OF_TEXELS: [(usize, usize); 5] =
    [(16, 1 << 17), (8, 1 << 17), (4, 1 << 22), (2, 1 << 22), (1, usize::MAX)];
/// Planes through the cube's centre are seen edge-on: the sine of their angle to a corner, at least.
const MIN_SINE: f32 = 1e-6;

/// A mesh of one radiance, relative to the cube's centre.
#[derive(Clone, Debug)]
pub(super) struct ShiningMesh {
    pub triangles: Vec<[Vec3; 3]>,
    pub radiance: Vec3,
    /// A sphere around all of it.
    pub centre: Vec3,
    pub radius: f32,
}

/// What is drawn on a face.
pub(super) struct FaceImage {
    /// Points along a texel's edge, and along the face's.
    per_texel: usize,
    per_edge: usize,
    /// In points.
    polygons: Vec<Polygon>,
    /// The numbers of those that reach into each row of texels, row after row, and where each row's begin.
    by_row: Vec<u32>,
    rows: Vec<u32>,
}

/// Neighbouring points of a row that lie in a polygon.
struct Span<'a> {
    polygon: &'a Polygon,
    y: usize,
    columns: Range<usize>,
}

/// Corners of a triangle that is cut by the four sides of a face: 7, but each cut adds up to half as many where rounding makes it concave.
const MAX_CORNERS: usize = 13;

/// Triangles that one thread takes in a row.
const RUN: usize = 1024;

/// A triangle's part on a face.
struct Polygon {
    /// Corners in points; in texels at first.
    corners: ArrayVec<Vec2, MAX_CORNERS>,
    /// Inverse depth by place in the same unit: constant part and derivatives.
    nearness: [f32; 3],
    radiance: Vec3,
}

impl FaceImage {
    /// Draws meshes on a face, of so many texels along its edge, of a cube in a frame of its own.
    pub fn draw(face: usize, size: u32, world_from_cube: Mat3, meshes: &[ShiningMesh]) -> Self {
        let axes = FaceAxes::new(face, world_from_cube);
        let of_mesh = |mesh: &ShiningMesh| -> Vec<Polygon> {
            let polygon = |corners: &[Vec3; 3]| axes.polygon(size, corners, mesh.radiance);
            let of_run = |run: &[[Vec3; 3]]| run.iter().filter_map(polygon).collect::<Vec<_>>();
            parallel::map_chunks(&mesh.triangles, RUN, &of_run).into_iter().flatten().collect()
        };
        let mut polygons: Vec<Polygon> =
            meshes.iter().filter(|mesh| axes.may_show(mesh.centre, mesh.radius)).flat_map(of_mesh).collect();
        let corners = polygons.iter().flat_map(|polygon| &polygon.corners);
        let (low, high) =
            corners.fold((Vec2::splat(size as f32), Vec2::ZERO), |(l, h), corner| (l.min(*corner), h.max(*corner)));
        let first = [low.x, low.y].map(|x| (x.max(0.0) as usize).min(size as usize));
        let last = [high.x, high.y].map(|x| (x.ceil() as usize).min(size as usize));
        let texels = [0, 1].map(|axis| last[axis].saturating_sub(first[axis]));
        let fits = |(points, most): &(usize, usize)| texels[0] * texels[1] * points * points <= *most;
        let per_texel = POINTS_OF_TEXELS.into_iter().find(fits).map_or(1, |(points, _)| points);
        parallel::for_each_chunk(&mut polygons, RUN, &|_, run| {
            for polygon in run {
                polygon.refine(per_texel as f32);
            }
        });
        let (by_row, rows) = sorted_by_row(&polygons, per_texel, size as usize);
        Self { per_texel, per_edge: per_texel * size as usize, polygons, by_row, rows }
    }

    /// Draws row `y` of texels over the row that is there.
    pub fn blend(&self, y: usize, row: &mut [Vec4]) {
        let spans = self.spans(y);
        let Some(first) = spans.iter().map(|span| span.columns.start).min() else { return };
        let end = spans.iter().map(|span| span.columns.end).max().unwrap_or(first);
        let texels = first / self.per_texel..end.div_ceil(self.per_texel);
        let (start, width) = (self.per_texel * texels.start, self.per_texel * texels.len());
        // Inverse depths, zero where nothing is drawn, and radiance.
        let mut points = vec![(0.0, Vec3::ZERO); self.per_texel * width];
        for Span { polygon, y, columns } in spans {
            let line = &mut points[y % self.per_texel * width..][..width];
            let [constant, by_x, by_y] = polygon.nearness;
            for x in columns {
                let nearness = constant + by_x * (x as f32 + 0.5) + by_y * (y as f32 + 0.5);
                let point = &mut line[x - start];
                if nearness > point.0 {
                    *point = (nearness, polygon.radiance);
                }
            }
        }
        let part = 1.0 / (self.per_texel * self.per_texel) as f32;
        for (x, texel) in row[texels].iter_mut().enumerate() {
            let in_texel = |line| &points[line * width + x * self.per_texel..][..self.per_texel];
            let drawn = (0..self.per_texel).flat_map(in_texel).filter(|(nearness, _)| *nearness > 0.0);
            let (sum, count) = drawn.fold((Vec3::ZERO, 0), |(sum, count), (_, radiance)| (sum + radiance, count + 1));
            *texel = (part * sum + (1.0 - part * count as f32) * texel.truncate()).extend(1.0);
        }
    }

    /// What the polygons cover of a row of texels.
    fn spans(&self, y: usize) -> Vec<Span<'_>> {
        let mut spans = Vec::new();
        let of_row = self.rows[y] as usize..self.rows[y + 1] as usize;
        for polygon in self.by_row[of_row].iter().map(|&index| &self.polygons[index as usize]) {
            let rows = polygon.rows();
            for y in (self.per_texel * y).max(rows.start)..(self.per_texel * (y + 1)).min(rows.end) {
                let Some([from, to]) = span(&polygon.corners, y as f32 + 0.5) else { continue };
                let columns = first_point_after(from)..first_point_after(to).min(self.per_edge);
                if !columns.is_empty() {
                    spans.push(Span { polygon, y, columns });
                }
            }
        }
        spans
    }
}

/// The numbers of the polygons that reach into each row of texels, and where each row's begin.
fn sorted_by_row(polygons: &[Polygon], per_texel: usize, size: usize) -> (Vec<u32>, Vec<u32>) {
    let rows_of = |polygon: &Polygon| {
        let rows = polygon.rows();
        let last = rows.end.div_ceil(per_texel).min(size);
        (rows.start / per_texel).min(last)..last
    };
    let mut ends = vec![0; size + 1];
    for polygon in polygons {
        ends[rows_of(polygon)].iter_mut().for_each(|count| *count += 1);
    }
    let mut sum = 0;
    for end in &mut ends {
        sum += *end;
        *end = sum;
    }
    let mut sorted = vec![0; sum as usize];
    // From the last polygon on, so that each row's are in order and the ends become beginnings.
    for (index, polygon) in polygons.iter().enumerate().rev() {
        for end in &mut ends[rows_of(polygon)] {
            *end -= 1;
            sorted[*end as usize] = index as u32;
        }
    }
    (sorted, ends)
}

/// The first point whose middle does not lie before a place.
fn first_point_after(place: f32) -> usize {
    (place - 0.5).ceil().max(0.0) as usize
}

impl Polygon {
    /// Changes the unit to a fraction of it.
    fn refine(&mut self, fraction: f32) {
        self.corners.iter_mut().for_each(|corner| *corner *= fraction);
        let [constant, by_x, by_y] = self.nearness;
        self.nearness = [constant, by_x / fraction, by_y / fraction];
    }

    /// The rows of points whose middles it may cover.
    fn rows(&self) -> Range<usize> {
        let heights = self.corners.iter().map(|corner| corner.y);
        let (top, bottom) = heights.fold((f32::INFINITY, 0.0f32), |(l, h), y| (l.min(y), h.max(y)));
        first_point_after(top)..first_point_after(bottom)
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

/// How a face looks at the world.
pub struct FaceAxes {
    /// To the right, down, and towards it.
    pub axes: [Vec3; 3],
    /// Normals of the planes, 45° from its axis, between which it is seen.
    sides: [Vec3; 4],
}

impl FaceAxes {
    /// Of a cube in a frame of its own.
    pub fn new(face: usize, world_from_cube: Mat3) -> Self {
        let axis = face_direction(face, 0.0, 0.0);
        let axes = [face_direction(face, 1.0, 0.0) - axis, face_direction(face, 0.0, 1.0) - axis, axis];
        let [right, down, towards] = axes.map(|axis| world_from_cube * axis);
        let sides = [towards - right, towards + right, towards - down, towards + down];
        Self { axes: [right, down, towards], sides }
    }

    /// Whether any of a sphere, relative to the cube's centre, may lie on the face.
    pub fn may_show(&self, centre: Vec3, radius: f32) -> bool {
        self.sides.iter().all(|side| side.dot(centre) >= -radius * side.length())
    }

    /// The part of a triangle that a face of so many texels shows, if there is one, in texels.
    fn polygon(&self, size: u32, corners: &[Vec3; 3], radiance: Vec3) -> Option<Polygon> {
        if self.sides.iter().any(|side| corners.iter().all(|p| side.dot(*p) < 0.0)) {
            return None;
        }
        let corners = corners.map(|p| Vec3::from_array(self.axes.map(|axis| p.dot(axis))));
        let sides = [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y].map(|side| Vec3::Z - side);
        let [a, b, c] = corners;
        let normal = (b - a).cross(c - a);
        let distance = normal.dot(a);
        let farthest = corners.iter().map(|p| p.length()).fold(0.0, f32::max);
        if distance.abs() <= MIN_SINE * normal.length() * farthest {
            return None;
        }
        let mut clipped: ArrayVec<Vec3, MAX_CORNERS> = corners.into_iter().collect();
        for side in sides {
            if clipped.iter().any(|p| side.dot(*p) < 0.0) {
                clipped = clip(&clipped, side);
            }
        }
        if clipped.len() < 3 || clipped.iter().any(|p| p.z <= 0.0) {
            return None;
        }
        let scale = 0.5 * size as f32;
        let corners = clipped.iter().map(|p| scale * (p.truncate() / p.z + Vec2::ONE)).collect();
        // The plane is met at 1/nearness along (s, t, 1); s and t are −1 at the first edge.
        let by_place = normal / distance;
        let nearness = [by_place.z - by_place.x - by_place.y, by_place.x / scale, by_place.y / scale];
        Some(Polygon { corners, nearness, radiance })
    }
}

/// The part of a convex polygon on the positive side of a plane through the origin.
fn clip(corners: &[Vec3], plane: Vec3) -> ArrayVec<Vec3, MAX_CORNERS> {
    let mut clipped = ArrayVec::new();
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
