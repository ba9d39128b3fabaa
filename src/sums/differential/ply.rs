//! Samples as a point cloud: binary PLY with position, normal, area, curvatures and directions.

use std::io::{self, Write};

use super::DifferentialSample;

const PROPERTIES: [&str; 16] = [
    "x",
    "y",
    "z",
    "nx",
    "ny",
    "nz",
    "area",
    "curvature_max",
    "curvature_min",
    "max_x",
    "max_y",
    "max_z",
    "min_x",
    "min_y",
    "min_z",
    "object",
];

/// Writes samples as little-endian binary PLY; all properties are 32-bit floats, in metres, m² and 1/m. `object` is the
/// index of the object in the scene.
pub fn write_ply(samples: &[DifferentialSample], out: &mut impl Write) -> io::Result<()> {
    writeln!(out, "ply\nformat binary_little_endian 1.0")?;
    writeln!(out, "comment Pinspot samples: positions, normals, cell areas, principal curvatures and directions")?;
    writeln!(out, "element vertex {}", samples.len())?;
    for property in PROPERTIES {
        writeln!(out, "property float {property}")?;
    }
    writeln!(out, "end_header")?;
    for s in samples {
        let vectors = [s.position, s.normal].into_iter().flat_map(|v| v.to_array());
        let scalars = [s.cell.area, s.curvatures[0], s.curvatures[1]];
        let directions = s.directions.into_iter().flat_map(|v| v.to_array());
        for value in vectors.chain(scalars).chain(directions).chain([s.object as f32]) {
            out.write_all(&value.to_le_bytes())?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::Cell;
    use super::*;
    use glam::Vec3;

    #[test]
    fn the_header_counts_what_follows() {
        let cell = Cell { area: 0.5, centroid: Vec3::ZERO, normal: Vec3::Y, sides: [Vec3::X, Vec3::Z] };
        let sample = DifferentialSample {
            position: Vec3::new(1.0, 2.0, 3.0),
            normal: Vec3::Y,
            area: 0.5,
            object: 4,
            cell,
            curvatures: [1.0, -1.0],
            directions: [Vec3::X, Vec3::Z],
        };
        let mut bytes = Vec::new();
        write_ply(&[sample; 3], &mut bytes).unwrap();
        let header_end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
        let header = std::str::from_utf8(&bytes[..header_end]).unwrap();
        assert!(header.contains("element vertex 3"));
        assert_eq!(header.matches("property float").count(), PROPERTIES.len());
        assert_eq!(bytes.len() - header_end, 3 * 4 * PROPERTIES.len());
        assert_eq!(&bytes[header_end + 4..header_end + 8], 2.0f32.to_le_bytes());
    }
}
