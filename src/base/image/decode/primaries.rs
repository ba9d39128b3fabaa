//! Colours of other primaries and another white, as those of Rec.709 and D65: what scenes are computed in.

use glam::{DMat3, DVec3, Vec3};

/// Chromaticities of Rec.709's red, green and blue,
const REC_709: [[f32; 2]; 3] = [[0.64, 0.33], [0.30, 0.60], [0.15, 0.06]];
/// and of its white.
const D65: [f32; 2] = [0.3127, 0.3290];
/// Chromaticities that differ less are the same.
const SAME: f32 = 2e-3;

/// Converts colours with these chromaticities (CIE 1931 x and y) to those of Rec.709, white to white by the Bradford transform; returns a note
/// if they were others. The error says why they are none.
pub(super) fn convert(
    pixels: &mut [[f32; 3]],
    primaries: [[f32; 2]; 3],
    white: [f32; 2],
) -> Result<Option<String>, String> {
    let all = |primaries: [[f32; 2]; 3], white: [f32; 2]| [primaries[0], primaries[1], primaries[2], white];
    let is_same = |(a, b): (&[f32; 2], &[f32; 2])| (a[0] - b[0]).abs() <= SAME && (a[1] - b[1]).abs() <= SAME;
    if all(primaries, white).iter().zip(&all(REC_709, D65)).all(is_same) {
        return Ok(None);
    }
    let named = format!("the chromaticities {primaries:?} with white {white:?}");
    let to_xyz =
        xyz_of(primaries, white).ok_or_else(|| format!("has {named}, which are none; export it in Rec.709"))?;
    let rec_709 = xyz_of(REC_709, D65).expect("Rec.709 has primaries");
    let matrix = rec_709.inverse() * adaptation(white, D65) * to_xyz;
    for pixel in pixels {
        // What is not finite is for later checks to find.
        *pixel = (matrix * DVec3::from(pixel.map(f64::from))).as_vec3().to_array();
    }
    Ok(Some(format!("its colours were converted from {named} to those of Rec.709")))
}

/// Converts CIE XYZ to colours of Rec.709.
pub(super) fn convert_from_xyz(pixels: &mut [[f32; 3]]) {
    let from_xyz = from_xyz();
    for pixel in pixels {
        *pixel = (from_xyz * DVec3::from(pixel.map(f64::from))).as_vec3().to_array();
    }
}

/// A colour of Rec.709 by its CIE XYZ; outside of what the primaries can show, it has negative parts.
pub fn rec_709_from_xyz(xyz: [f32; 3]) -> Vec3 {
    (from_xyz() * DVec3::from(xyz.map(f64::from))).as_vec3()
}

fn from_xyz() -> DMat3 {
    xyz_of(REC_709, D65).expect("Rec.709 has primaries").inverse()
}

/// CIE XYZ of a chromaticity, at Y = 1.
fn xyz([x, y]: [f32; 2]) -> DVec3 {
    let [x, y] = [f64::from(x), f64::from(y)];
    DVec3::new(x / y, 1.0, (1.0 - x - y) / y)
}

/// From colours to CIE XYZ; `None` if the primaries span no space.
fn xyz_of([r, g, b]: [[f32; 2]; 3], white: [f32; 2]) -> Option<DMat3> {
    let primaries = DMat3::from_cols(xyz(r), xyz(g), xyz(b));
    let is_space = primaries.is_finite() && primaries.determinant().abs() > 1e-6 && xyz(white).is_finite();
    let amounts = is_space.then(|| primaries.inverse() * xyz(white))?;
    (amounts.is_finite() && amounts.min_element() > 0.0).then(|| primaries * DMat3::from_diagonal(amounts))
}

/// Chromatic adaptation from one white to another (Bradford).
fn adaptation(from: [f32; 2], to: [f32; 2]) -> DMat3 {
    let cones = DMat3::from_cols_array(&[0.8951, -0.7502, 0.0389, 0.2664, 1.7135, -0.0685, -0.1614, 0.0367, 1.0296]);
    let scale = (cones * xyz(to)) / (cones * xyz(from));
    cones.inverse() * DMat3::from_diagonal(scale) * cones
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The published matrix from ACEScg (AP1, white near D60) to Rec.709, with Bradford adaptation.
    #[test]
    fn acescg_is_converted_as_published() {
        let ap1 = [[0.713, 0.293], [0.165, 0.830], [0.128, 0.044]];
        let mut pixels = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0; 3]];
        assert!(convert(&mut pixels, ap1, [0.32168, 0.33767]).unwrap().is_some());
        let expected =
            [[1.70505, -0.13026, -0.02400], [-0.62179, 1.14080, -0.12897], [-0.08326, -0.01055, 1.15297], [1.0; 3]];
        for (pixel, expected) in pixels.iter().zip(expected) {
            assert!(pixel.iter().zip(expected).all(|(a, b)| (a - b).abs() < 5e-4), "{pixel:?} {expected:?}");
        }
    }

    #[test]
    fn rec_709_is_left_alone_and_nonsense_refused() {
        let mut pixels = [[0.1, 0.2, 0.3]];
        assert_eq!(convert(&mut pixels, REC_709, D65).unwrap(), None);
        assert_eq!(pixels, [[0.1, 0.2, 0.3]]);
        for (primaries, white) in [([[0.3, 0.3]; 3], D65), (REC_709, [0.0, 0.0]), ([[f32::NAN; 2]; 3], D65)] {
            assert!(convert(&mut pixels, primaries, white).unwrap_err().contains("which are none"));
        }
    }
}
