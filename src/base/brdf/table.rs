//! Measured BRDFs: isotropic tables in the format of the MERL database (Matusik et al. 2003, *A Data-Driven Reflectance
//! Model*), by half and difference angles (Rusinkiewicz 1998).

use std::f32::consts::{FRAC_PI_2, PI};

use glam::Vec3;

/// Steps of θ_half (dense towards 0: its square root is uniform), θ_diff and φ_diff.
pub const STEPS: [usize; 3] = [90, 90, 180];
const ENTRIES: usize = STEPS[0] * STEPS[1] * STEPS[2];
/// Scale factors of the database for R, G and B.
const SCALE: [f64; 3] = [1.0 / 1500.0, 1.15 / 1500.0, 1.66 / 1500.0];

/// The largest value of a table, 1/sr: that of a lobe a thousandth of a radian wide.
const MAX_VALUE: f64 = 1e6;

/// A table of BRDF values, 1/sr.
#[derive(Clone, PartialEq)]
pub struct BrdfTable {
    name: String,
    /// By θ_half, then θ_diff, then φ_diff; the fourth component is unused.
    entries: Vec<[f32; 4]>,
}

impl std::fmt::Debug for BrdfTable {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        // Scenes are told apart by what this says.
        write!(f, "BrdfTable({}, {})", self.name, blake3::hash(bytemuck::cast_slice(&self.entries)).to_hex())
    }
}

/// Why a table cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TableError {
    /// The file could not be read.
    #[error("cannot read '{file}': {reason}; check the path")]
    Read {
        /// File.
        file: String,
        /// The system's reason.
        reason: String,
    },
    /// The file is not in the format.
    #[error(
        "'{file}' is no table of the MERL format: {reason}; such files have three sizes (90, 90, 180) and 4,374,000 doubles"
    )]
    Format {
        /// File.
        file: String,
        /// What is wrong.
        reason: String,
    },
}

impl BrdfTable {
    /// Decodes a `.binary` file of the MERL database; `name` is used in messages and to tell tables apart. Negative
    /// entries (directions below the surface) become 0.
    pub fn decode(name: &str, bytes: &[u8]) -> Result<Self, TableError> {
        let wrong = |reason: String| TableError::Format { file: name.into(), reason };
        if bytes.len() < 12 {
            return Err(wrong("it is truncated".into()));
        }
        let size = |k: usize| i32::from_le_bytes(bytes[4 * k..4 * k + 4].try_into().expect("four bytes"));
        if [0, 1, 2].map(size) != STEPS.map(|s| s as i32) {
            return Err(wrong(format!("its sizes are {}, {}, {}", size(0), size(1), size(2))));
        }
        let expected = 12 + 3 * 8 * ENTRIES;
        if bytes.len() != expected {
            return Err(wrong(format!("it has {} bytes, not {expected}", bytes.len())));
        }
        let value = |k: usize| f64::from_le_bytes(bytes[12 + 8 * k..20 + 8 * k].try_into().expect("eight bytes"));
        if let Some(k) = (0..3 * ENTRIES).find(|&k| !(0.0..=MAX_VALUE).contains(&(value(k).abs() * SCALE[k / ENTRIES])))
        {
            return Err(wrong(format!("entry {k} is {}, which no surface reflects", value(k))));
        }
        let channel = |k: usize, c: usize| (SCALE[c] * value(c * ENTRIES + k)).max(0.0) as f32;
        let entries = (0..ENTRIES).map(|k| [channel(k, 0), channel(k, 1), channel(k, 2), 0.0]).collect();
        Ok(Self { name: name.into(), entries })
    }

    /// Tabulates a function of θ_half, θ_diff (both up to π/2) and φ_diff (up to π), in radians.
    pub fn from_function(name: &str, f: impl Fn(f32, f32, f32) -> Vec3) -> Self {
        let part = |k: usize, steps: usize| (k as f32 + 0.5) / steps as f32;
        let entry = |k: usize| {
            let (half, diff, phi) = (k / (STEPS[2] * STEPS[1]), k / STEPS[2] % STEPS[1], k % STEPS[2]);
            let half = FRAC_PI_2 * part(half, STEPS[0]).powi(2);
            f(half, FRAC_PI_2 * part(diff, STEPS[1]), PI * part(phi, STEPS[2])).extend(0.0).to_array()
        };
        Self { name: name.into(), entries: (0..ENTRIES).map(entry).collect() }
    }

    /// The entries, as the gather reads them.
    pub fn entries(&self) -> &[[f32; 4]] {
        &self.entries
    }
}

/// The table's value for unit directions above a surface, interpolated linearly.
pub(super) fn value(entries: &[[f32; 4]], n: Vec3, l: Vec3, v: Vec3) -> Vec3 {
    let h = (l + v).normalize();
    // The frame of h: away from n, and perpendicular to both; arbitrary where they coincide.
    let across = n.cross(h).try_normalize().unwrap_or_else(|| n.any_orthonormal_vector());
    let away = across.cross(h);
    let theta_half = n.dot(h).clamp(-1.0, 1.0).acos();
    let theta_diff = l.dot(h).clamp(-1.0, 1.0).acos();
    let phi = l.dot(across).atan2(l.dot(away)).rem_euclid(PI);
    let place = |part: f32, steps: usize| (part * steps as f32 - 0.5).clamp(0.0, (steps - 1) as f32);
    let half = place((theta_half / FRAC_PI_2).max(0.0).sqrt(), STEPS[0]);
    let diff = place(theta_diff / FRAC_PI_2, STEPS[1]);
    // φ_diff wraps around, because the BRDF is reciprocal.
    let around = (phi / PI * STEPS[2] as f32 + STEPS[2] as f32 - 0.5) % STEPS[2] as f32;
    let (i, j, k) = (half as usize, diff as usize, around as usize % STEPS[2]);
    let at = |i: usize, j: usize, k: usize| {
        let (i, j) = (i.min(STEPS[0] - 1), j.min(STEPS[1] - 1));
        Vec3::from_slice(&entries[(i * STEPS[1] + j) * STEPS[2] + k % STEPS[2]])
    };
    let along_phi = |i: usize, j: usize| at(i, j, k).lerp(at(i, j, k + 1), around.fract());
    let along_diff = |i: usize| along_phi(i, j).lerp(along_phi(i, j + 1), diff.fract());
    along_diff(i).lerp(along_diff(i + 1), half.fract())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_of_the_format_is_read_back() {
        let mut bytes: Vec<u8> = STEPS.iter().flat_map(|s| (*s as i32).to_le_bytes()).collect();
        for (c, scale) in SCALE.iter().enumerate() {
            bytes.extend((0..ENTRIES).flat_map(|_| (0.1 * (c + 1) as f64 / scale).to_le_bytes()));
        }
        let table = BrdfTable::decode("grey.binary", &bytes).unwrap();
        let found = value(table.entries(), Vec3::Y, Vec3::Y, Vec3::new(0.6, 0.8, 0.0));
        assert!(found.abs_diff_eq(Vec3::new(0.1, 0.2, 0.3), 1e-6), "{found}");
        let refused = |bytes: &[u8]| BrdfTable::decode("grey.binary", bytes).unwrap_err().to_string();
        assert!(refused(&bytes[..1000]).contains("1000 bytes"));
        assert!(refused(&[0; 20]).contains("sizes are 0, 0, 0"));
        for entry in [1e300, f64::NAN, -1e300, f64::INFINITY] {
            bytes[12 + 8 * 7..20 + 8 * 7].copy_from_slice(&entry.to_le_bytes());
            assert!(refused(&bytes).contains("grey.binary") && refused(&bytes).contains("entry 7"), "{entry}");
        }
    }

    #[test]
    fn angles_are_those_of_the_half_vector() {
        let table = BrdfTable::from_function("angles", Vec3::new);
        let (l, v) = (Vec3::new(0.5, 0.8, 0.1).normalize(), Vec3::new(-0.1, 0.9, 0.4).normalize());
        let h = (l + v).normalize();
        let found = value(table.entries(), Vec3::Y, l, v);
        assert!((found.x - Vec3::Y.angle_between(h)).abs() < 1e-2, "{found}");
        assert!((found.y - l.angle_between(h)).abs() < 1e-3, "{found}");
        // Seen from the light or from the viewer: the same.
        assert!(found.abs_diff_eq(value(table.entries(), Vec3::Y, v, l), 1e-3));
    }
}
