//! FLIP's colour spaces and its distance of colours (Andersson et al. 2020, color pipeline).

use std::sync::LazyLock;

use glam::{Mat3, Vec3};

/// XYZ of linear sRGB's primaries, a column each, relative to that of white (D65): rows sum to 1.
const XYZ_FROM_RGB: Mat3 = Mat3::from_cols(
    Vec3::new(10135552.0 / 23359437.0, 2613072.0 / 12288897.0, 1425312.0 / 80288307.0),
    Vec3::new(8788810.0 / 23359437.0, 8788810.0 / 12288897.0, 8788810.0 / 80288307.0),
    Vec3::new(4435075.0 / 23359437.0, 887015.0 / 12288897.0, 70074185.0 / 80288307.0),
);
static RGB_FROM_XYZ: LazyLock<Mat3> = LazyLock::new(|| XYZ_FROM_RGB.inverse());

/// Exponent of the distance of colours: q_c.
const DISTANCE_EXPONENT: f32 = 0.7;
/// Distances up to this share p_c of the largest are mapped to errors up to p_t.
const KNEE_DISTANCE: f32 = 0.4;
const KNEE_ERROR: f32 = 0.95;

/// The largest distance, between sRGB's green and blue.
static LARGEST_DISTANCE: LazyLock<f32> = LazyLock::new(|| distance(hunt_lab(Vec3::Y), hunt_lab(Vec3::Z)));

/// YCxCz of an sRGB colour: a linear form of L*a*b*, whose channels the eye resolves differently.
pub(super) fn opponent_from_srgb(srgb: [u8; 3]) -> Vec3 {
    let xyz = XYZ_FROM_RGB * Vec3::from_array(srgb.map(linear_from_srgb));
    Vec3::new(116.0 * xyz.y - 16.0, 500.0 * (xyz.x - xyz.y), 200.0 * (xyz.y - xyz.z))
}

/// Linear RGB of YCxCz.
fn rgb_from_opponent(c: Vec3) -> Vec3 {
    let y = relative_luminance(c);
    *RGB_FROM_XYZ * Vec3::new(y + c.y / 500.0, y, y - c.z / 200.0)
}

/// Y of YCxCz, 0 to 1.
pub(super) fn relative_luminance(opponent: Vec3) -> f32 {
    (opponent.x + 16.0) / 116.0
}

/// Hunt-adjusted L*a*b* of the closest colour of sRGB.
pub(super) fn hunt_lab_from_opponent(opponent: Vec3) -> Vec3 {
    hunt_lab(rgb_from_opponent(opponent).clamp(Vec3::ZERO, Vec3::ONE))
}

/// 0 to 1, of two Hunt-adjusted colours: small distances, which most errors of pictures are, take most of the range.
pub(super) fn difference(a: Vec3, b: Vec3) -> f32 {
    let largest = *LARGEST_DISTANCE;
    let (distance, knee) = (distance(a, b), KNEE_DISTANCE * largest);
    if distance < knee {
        distance / knee * KNEE_ERROR
    } else {
        KNEE_ERROR + (distance - knee) / (largest - knee) * (1.0 - KNEE_ERROR)
    }
}

/// HyAB, for large distances (Abasi et al. 2020), to the power q_c.
fn distance(a: Vec3, b: Vec3) -> f32 {
    let d = a - b;
    (d.x.abs() + d.y.hypot(d.z)).powf(DISTANCE_EXPONENT)
}

/// L*a*b* of linear RGB, less chromatic where it is dark (Hunt effect).
fn hunt_lab(rgb: Vec3) -> Vec3 {
    let f = Vec3::from_array((XYZ_FROM_RGB * rgb).to_array().map(lab_response));
    let lightness = 116.0 * f.y - 16.0;
    let chroma = 0.01 * lightness;
    Vec3::new(lightness, chroma * 500.0 * (f.x - f.y), chroma * 200.0 * (f.y - f.z))
}

/// CIE 1976: a cube root, linear near black.
fn lab_response(t: f32) -> f32 {
    const DELTA: f32 = 6.0 / 29.0;
    if t > DELTA.powi(3) { t.cbrt() } else { t / (3.0 * DELTA * DELTA) + 4.0 / 29.0 }
}

fn linear_from_srgb(byte: u8) -> f32 {
    let c = f32::from(byte) / 255.0;
    if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
}
