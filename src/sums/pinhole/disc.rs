//! How much of a footprint a disc of light fills.

use std::f32::consts::PI;

use glam::{Vec2, Vec3};

use super::constants::{BLUR_RADIUS, MIN_DISC_LENGTH, MIN_SLENDERNESS};

/// The part of a footprint around a unit direction that a disc fills: from 0 to 1. The disc lies in the unit direction `towards`, `chord` is
/// twice the sine of half its angular radius, and `sides` are the footprint's full sides, perpendicular to its own direction, radians.
///
/// Directions are taken to the plane by Lambert's azimuthal projection around the footprint, which keeps solid angles.
pub fn filled_part(direction: Vec3, sides: [Vec3; 2], towards: Vec3, chord: f32) -> f32 {
    let (e1, e2) = direction.any_orthonormal_pair();
    let on_plane = |v: Vec3| Vec2::new(v.dot(e1), v.dot(e2)) / chord;
    let stretch = (2.0 / (1.0 + direction.dot(towards)).max(1e-6)).sqrt();
    part_in_unit_disc(stretch * on_plane(towards), sides.map(on_plane))
}

/// The part of a cell's footprint that a disc fills, as in [`filled_part`], but blurred where the footprint is much larger than the disc: cells are
/// not exact parallelograms, and small lamps would show the gaps between them. The disc keeps its flux, and is blurred by an ellipse whose
/// semi-axes are [`BLUR_RADIUS`] times the vectors `blur`, those of [`EvenSides`](super::cell_shapes::EvenSides).
pub fn softly_filled_part(direction: Vec3, sides: [Vec3; 2], blur: [Vec3; 2], towards: Vec3, chord: f32) -> f32 {
    let (e1, e2) = direction.any_orthonormal_pair();
    let on_plane = |v: Vec3| Vec2::new(v.dot(e1), v.dot(e2));
    let scale = chord.max(sides[0].length()).max(sides[1].length());
    let [a, b] = sides.map(|v| on_plane(v) / scale);
    let stretch = (2.0 / (1.0 + direction.dot(towards)).max(1e-6)).sqrt();
    let blurred = BlurredDisc::new(chord / scale, blur.map(|v| on_plane(v) * (BLUR_RADIUS / scale)));
    let part =
        part_in_unit_disc(blurred.to_unit(stretch / scale * on_plane(towards)), [a, b].map(|v| blurred.to_unit(v)));
    blurred.radiance * part
}

/// An ellipse in place of a disc, which is the unit disc in coordinates of its own.
struct BlurredDisc {
    /// Cholesky's factor of its moments.
    l11: f32,
    l21: f32,
    l22: f32,
    /// Relative to the disc's.
    radiance: f32,
}

impl BlurredDisc {
    /// A disc, blurred by an ellipse with these semi-axes. The squares of its own are √(r⁴ + b⁴), r being its radius and b the blur: a disc
    /// that is wide anyway stays what it is.
    fn new(radius: f32, [a, b]: [Vec2; 2]) -> Self {
        let (g11, g12, g22) = (a.x * a.x + b.x * b.x, a.x * a.y + b.x * b.y, a.y * a.y + b.y * b.y);
        // The square of the moments, and these as its root.
        let own = radius.powi(4);
        let (m11, m12, m22) = (own + g11 * g11 + g12 * g12, g12 * (g11 + g22), own + g12 * g12 + g22 * g22);
        let of_blur = g11 * g22 - g12 * g12;
        let determinant = (own * (m11 + m22 - own) + of_blur * of_blur).sqrt();
        let inverse_trace = 1.0 / (m11 + m22 + 2.0 * determinant).sqrt();
        let l11 = ((m11 + determinant) * inverse_trace).sqrt();
        let area = determinant.sqrt().max(radius * radius);
        Self { l11, l21: m12 * inverse_trace / l11, l22: area / l11, radiance: radius * radius / area }
    }

    fn to_unit(&self, v: Vec2) -> Vec2 {
        let x = v.x / self.l11;
        Vec2::new(x, (v.y - self.l21 * x) / self.l22)
    }
}

/// The part of a parallelogram around the origin that a unit disc fills.
fn part_in_unit_disc(disc: Vec2, [mut a, mut b]: [Vec2; 2]) -> f32 {
    let (distance, reach) = (disc.length(), 0.5 * (a.length() + b.length()));
    let longest = a.length_squared().max(b.length_squared());
    if distance >= 1.0 + reach {
        return 0.0;
    }
    if distance + reach <= 1.0 || longest < MIN_DISC_LENGTH * MIN_DISC_LENGTH {
        return if distance < 1.0 { 1.0 } else { 0.0 };
    }
    if a.perp_dot(b).abs() < MIN_SLENDERNESS * longest {
        let (long, short) = if a.length_squared() >= b.length_squared() { (a, &mut b) } else { (b, &mut a) };
        *short += MIN_SLENDERNESS * long.perp();
    }
    let (sum, difference) = (0.5 * (a + b), 0.5 * (a - b));
    let corners = [sum, -difference, -sum, difference].map(|corner| corner - disc);
    let area: f32 = (0..4).map(|k| area_in_unit_disc(corners[k], corners[(k + 1) % 4])).sum();
    (area / a.perp_dot(b)).clamp(0.0, 1.0)
}

/// The area, positive counter-clockwise, that the unit disc around the origin shares with the triangle from there to an edge.
fn area_in_unit_disc(from: Vec2, to: Vec2) -> f32 {
    let edge = to - from;
    let squared = edge.length_squared();
    if squared == 0.0 {
        return 0.0;
    }
    let sector = |a: Vec2, b: Vec2| 0.5 * a.perp_dot(b).atan2(a.dot(b));
    // Where the edge is inside, from one part of its length to another.
    let middle = -from.dot(edge) / squared;
    let distance2 = from.perp_dot(edge).powi(2) / squared;
    if distance2 >= 1.0 {
        return sector(from, to);
    }
    let half = ((1.0 - distance2) / squared).sqrt();
    let (first, last) = ((middle - half).max(0.0), (middle + half).min(1.0));
    if first >= last {
        return sector(from, to);
    }
    let (enters, leaves) = (from + first * edge, from + last * edge);
    let before = if first > 0.0 { sector(from, enters) } else { 0.0 };
    let after = if last < 1.0 { sector(leaves, to) } else { 0.0 };
    before + 0.5 * enters.perp_dot(leaves) + after
}

/// Twice the sine of half the angular radius of a sphere, by its radius over its distance.
pub fn chord_of_sphere(sine: f32) -> f32 {
    let cosine = (1.0 - sine * sine).max(0.0).sqrt();
    sine * (2.0 / (1.0 + cosine)).sqrt()
}

/// The solid angle of a disc, sr.
pub fn solid_angle_of(chord: f32) -> f32 {
    PI * chord * chord
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3Swizzles;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn parts_are_those_that_points_count() {
        let mut rng = rand::rngs::ChaCha8Rng::seed_from_u64(4);
        for _ in 0..300 {
            let mut vector = |scale: f32| Vec2::new(rng.random_range(-scale..scale), rng.random_range(-scale..scale));
            let (disc, a, b) = (vector(2.0), vector(3.0), vector(3.0));
            let steps = 200;
            let at = |k: usize| (k as f32 + 0.5) / steps as f32 - 0.5;
            let is_inside = |k: usize| (at(k % steps) * a + at(k / steps) * b).distance_squared(disc) < 1.0;
            let counted = (0..steps * steps).filter(|k| is_inside(*k)).count() as f32 / (steps * steps) as f32;
            let part = part_in_unit_disc(disc, [a, b]);
            assert!((part - counted).abs() < 0.02, "{disc} {a} {b}: {part} {counted}");
        }
    }

    /// Cells that tile a plane of directions share a disc without a remainder, whatever its size.
    #[test]
    fn tiles_share_a_disc() {
        for radius in [1e-4, 0.01, 0.3, 2.0] {
            let (a, b) = (Vec2::new(0.13, 0.02), Vec2::new(-0.05, 0.11));
            let disc = Vec2::new(0.037, -0.021);
            let tile = |i: i32, j: i32| {
                let centre = i as f32 * a + j as f32 * b;
                part_in_unit_disc((disc - centre) / radius, [a / radius, b / radius])
            };
            let sum: f32 = (-40..=40).flat_map(|i| (-40..=40).map(move |j| (i, j))).map(|(i, j)| tile(i, j)).sum();
            let expected = PI * radius * radius / a.perp_dot(b);
            assert!((sum / expected - 1.0).abs() < 2e-3, "radius {radius}: {sum} {expected}");
        }
    }

    /// Blurred discs keep their flux, whatever the shape of the cells, and stay within reach of a long footprint across it.
    #[test]
    fn blurred_discs_keep_their_flux() {
        for (radius, [a, b]) in [
            (0.5, [Vec3::new(0.0, 0.1, 0.0), Vec3::new(0.0, 0.02, 0.05)]),
            (0.01, [Vec3::new(0.0, 0.1, 0.0), Vec3::new(0.0, 0.0, 0.08)]),
            (0.005, [Vec3::new(0.0, 0.15, 0.01), Vec3::new(0.0, 0.0, 0.002)]),
        ] {
            let small = [a, b].map(|side| 1e-3 * side);
            let part = |i: i32, j: i32| {
                let place = 0.25 * (i as f32 * small[0] + j as f32 * small[1]);
                softly_filled_part(Vec3::X, small, small, (Vec3::X + place).normalize(), 1e-3 * radius)
            };
            let steps = (4.0 * (radius / a.length().min(b.length().max(1e-9)) + 3.0)).ceil() as i32;
            let sum: f32 =
                (-steps..=steps).flat_map(|i| (-steps..=steps).map(move |j| (i, j))).map(|(i, j)| part(i, j)).sum();
            let expected = PI * radius * radius / (a.cross(b).length() / 16.0);
            assert!((sum / expected - 1.0).abs() < 0.02, "{radius}: {sum} {expected}");
        }
        let [long, short] = [Vec3::new(0.0, 0.15, 0.0), Vec3::new(0.0, 0.0, 1e-6)];
        let across = |off: f32| {
            softly_filled_part(Vec3::X, [long, short], [long, short], Vec3::new(1.0, 0.0, off).normalize(), 0.005)
        };
        assert!(across(0.004) > 0.03 && across(0.006) < 1e-5, "{} {}", across(0.004), across(0.006));
    }

    #[test]
    fn points_and_lines_are_inside_or_not() {
        assert_eq!(part_in_unit_disc(Vec2::new(0.5, 0.0), [Vec2::ZERO; 2]), 1.0);
        assert_eq!(part_in_unit_disc(Vec2::new(1.5, 0.0), [Vec2::ZERO; 2]), 0.0);
        let line = part_in_unit_disc(Vec2::ZERO, [Vec2::new(4.0, 0.0), Vec2::ZERO]);
        assert!((line - 0.5).abs() < 1e-3, "{line}");
    }

    #[test]
    fn discs_keep_their_solid_angle() {
        let chord = chord_of_sphere(0.6);
        // 2π(1 − cos) of a sphere whose cosine is .8.
        assert!((solid_angle_of(chord) - 2.0 * PI * 0.2).abs() < 1e-5);
        let small = Vec3::new(0.0, 1e-5, 0.0);
        let part =
            |angle: f32| filled_part(Vec3::X, [small, small.yzx()], Vec3::new(angle.cos(), 0.0, angle.sin()), chord);
        let edge = 0.6f32.asin();
        assert_eq!([part(edge - 1e-3), part(edge + 1e-3)], [1.0, 0.0]);
    }
}
