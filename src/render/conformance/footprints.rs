//! The footprints that filters are tried with.

use glam::Vec3;

use super::patterns::SIZE;
use crate::environment::face_direction;
use crate::pinhole::Probe;

/// Length over width.
pub(super) const ASPECTS: [f64; 7] = [1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0];
/// Widths, texels of level 0.
const MINORS: [f64; 10] = [0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0];
/// Angles of the major axis against the face's rows; the second half is perpendicular to the first.
const ANGLES_DEG: [f64; 8] = [0.0, 22.5, 45.0, 67.5, 90.0, 112.5, 135.0, 157.5];
/// Longer footprints than half a face are no parallelograms on the sphere any more, and no sample's.
const LONGEST: f64 = 0.5 * SIZE as f64;

/// Where on a face a footprint's centre lies, in [−1, 1]².
pub(super) struct Place {
    pub name: &'static str,
    at: [(usize, f32, f32); 3],
}

pub(super) const PLACES: [Place; 4] = [
    Place { name: "face centre", at: [(0, 0.013, 0.021), (3, -0.042, 0.017), (4, 0.03, -0.011)] },
    Place { name: "between", at: [(1, 0.47, -0.33), (2, -0.38, 0.52), (5, 0.61, 0.29)] },
    Place { name: "edge", at: [(0, 0.996, 0.21), (2, -0.3, 0.993), (4, -0.998, -0.45)] },
    Place { name: "corner", at: [(1, 0.985, 0.991), (3, -0.994, 0.989), (5, 0.99, -0.996)] },
];

/// One footprint.
pub(super) struct Case {
    pub probe: Probe,
    pub aspect: f64,
    /// Length and width, texels of level 0.
    pub texels: [f64; 2],
    pub place: &'static str,
    /// The same footprint turned by 90°.
    pub perpendicular: Option<usize>,
}

/// All combinations that are footprints of samples.
pub(super) fn cases() -> Vec<Case> {
    let mut cases = Vec::new();
    for place in &PLACES {
        for &(face, s, t) in &place.at {
            for aspect in ASPECTS {
                for minor in MINORS.iter().copied().filter(|minor| aspect * minor <= LONGEST) {
                    let first = cases.len();
                    for (k, angle) in ANGLES_DEG.iter().enumerate() {
                        let probe = footprint(face, s, t, angle.to_radians() as f32, [aspect * minor, minor]);
                        let perpendicular = (k < 4).then_some(first + k + 4);
                        cases.push(Case {
                            probe,
                            aspect,
                            texels: [aspect * minor, minor],
                            place: place.name,
                            perpendicular,
                        });
                    }
                }
            }
        }
    }
    cases
}

/// A rectangle of `texels` by its centre on a face and the angle of its longer side.
pub(super) fn footprint(face: usize, s: f32, t: f32, angle: f32, texels: [f64; 2]) -> Probe {
    let at = face_direction(face, s, t);
    let direction = at.normalize();
    // Texels shrink away from a face's centre: their solid angle goes with the cube of the largest component.
    let texel = 2.0 / SIZE as f32 * direction.abs().max_element().powf(1.5);
    let along_row = face_direction(face, s + 0.01, t) - at;
    let u = (along_row - direction * along_row.dot(direction)).normalize();
    let v: Vec3 = direction.cross(u);
    let (sin, cos) = angle.sin_cos();
    let [major, minor] = texels.map(|t| t as f32 * texel);
    Probe { direction, sides: [major * (cos * u + sin * v), minor * (cos * v - sin * u)] }
}
