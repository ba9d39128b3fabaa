//! Normalisation of vectors of any length.

use glam::Vec3;

/// The unit vector of a direction; `None` for zero and for vectors that are not finite. Vectors are scaled by their
/// largest component first, so that squares neither overflow nor underflow.
pub fn direction(vector: Vec3) -> Option<Vec3> {
    let largest = vector.abs().max_element();
    match largest {
        _ if !vector.is_finite() || largest == 0.0 => None,
        1e-9..=1e9 => Some(vector.normalize()),
        _ => Some((vector / largest).normalize()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_of_any_length_are_unit() {
        for length in [1e-40, 1e-30, 1.0, 1e30, f32::MAX] {
            let unit = direction(Vec3::new(0.0, length, -length)).unwrap();
            assert!(unit.abs_diff_eq(Vec3::new(0.0, 1.0, -1.0).normalize(), 1e-6), "{length}: {unit}");
        }
        assert_eq!(direction(Vec3::ZERO), None);
        assert_eq!(direction(Vec3::new(f32::NAN, 1.0, 0.0)), None);
    }
}
