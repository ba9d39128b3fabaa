//! A space-filling order of triangles, so that every k-th of them is spread evenly.

use glam::Vec3;

/// Morton key of a point in a box, behind the octant of its normal: the two faces of a thin sheet stay apart.
pub(super) fn key(point: Vec3, normal: Vec3, low: Vec3, extent: f32) -> u64 {
    let cell = ((point - low) / extent.max(f32::MIN_POSITIVE) * 1_048_575.0).as_uvec3();
    let octant = u64::from(normal.x < 0.0) | u64::from(normal.y < 0.0) << 1 | u64::from(normal.z < 0.0) << 2;
    octant << 60 | spread(cell.x) | spread(cell.y) << 1 | spread(cell.z) << 2
}

/// Two zero bits between any two of the lowest 20 bits.
fn spread(value: u32) -> u64 {
    let mut v = u64::from(value) & 0xf_ffff;
    v = (v | v << 32) & 0x001f_0000_0000_ffff;
    v = (v | v << 16) & 0x001f_0000_ff00_00ff;
    v = (v | v << 8) & 0x100f_00f0_0f00_f00f;
    v = (v | v << 4) & 0x10c3_0c30_c30c_30c3;
    (v | v << 2) & 0x1249_2492_4924_9249
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_interleave() {
        assert_eq!(spread(0b1011), 0b001_000_001_001);
        assert_eq!(spread(1 << 19), 1 << 57);
    }

    #[test]
    fn neighbours_in_space_are_neighbours_in_order() {
        let k = |x: f32| key(Vec3::new(x, 0.1, 0.1), Vec3::Y, Vec3::ZERO, 1.0);
        assert!(k(0.1) < k(0.2) && k(0.2) < k(0.9));
    }
}
