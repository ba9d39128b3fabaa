//! The ranges of the dimensions of shapes.

use super::{
    Cuboid, Cup, DiscoBall, Ellipsoid, Knot, Plane, Ring, Shape, Sheet, SolidRing, Sphere, Spoon, Tiles, Torus, Water,
};

/// Amplitude of a sheet's waves over their length, at most: steeper ones would not be resolved by its triangles.
const MAX_STEEPNESS: f32 = 0.1;
/// Root mean square of the height of water over the length of its dominant waves, at most.
const MAX_RMS_STEEPNESS: f32 = 0.03;

impl Shape {
    /// Says which dimension is out of its range.
    pub(super) fn check(&self) -> Result<(), String> {
        let positive = |name: &str, value: f32| {
            if value > 0.0 && value.is_finite() {
                Ok(())
            } else {
                Err(format!("{} of shape '{}' is {value}, but must be a positive length", name, self.name()))
            }
        };
        let thin = |name: &str, thickness: f32, of: f32| {
            positive("thickness", thickness)?;
            if thickness < 0.5 * of {
                Ok(())
            } else {
                Err(format!("thickness of shape '{}' must be less than {name}", self.name()))
            }
        };
        match *self {
            Self::Ring(Ring { radius, height }) => positive("radius", radius).and(positive("height", height)),
            Self::SolidRing(SolidRing { radius, height, thickness }) => {
                positive("radius", radius)?;
                positive("height", height)?;
                thin("half its radius", thickness, radius)?;
                thin("half its height", thickness, height)
            }
            Self::Spoon(Spoon { length, width, depth, thickness }) => {
                positive("length", length)?;
                positive("width", width)?;
                positive("depth", depth)?;
                thin("half its width", thickness, width)
            }
            Self::Cup(Cup { radius, height, thickness }) => {
                positive("radius", radius)?;
                positive("height", height)?;
                thin("a quarter of its radius", thickness, 0.5 * radius)?;
                thin("a quarter of its height", thickness, 0.5 * height)
            }
            Self::Sphere(Sphere { radius, divisions }) => {
                positive("radius", radius)?;
                if (1..=128).contains(&divisions) {
                    Ok(())
                } else {
                    Err(format!("divisions of shape 'sphere' is {divisions}, but must be from 1 to 128"))
                }
            }
            Self::Ellipsoid(Ellipsoid { radii, divisions }) => {
                radii.into_iter().try_for_each(|radius| positive("radii", radius))?;
                if (1..=128).contains(&divisions) {
                    Ok(())
                } else {
                    Err(format!("divisions of shape 'ellipsoid' is {divisions}, but must be from 1 to 128"))
                }
            }
            Self::Box(Cuboid { size }) => size.into_iter().try_for_each(|size| positive("size", size)),
            Self::Knot(Knot { radius, tube, turns }) => {
                positive("radius", radius)?;
                positive("tube", tube)?;
                if tube >= 0.4 * radius {
                    return Err(format!(
                        "tube of shape 'knot' is {tube}, but must be less than 0.4 of its radius, {radius}"
                    ));
                }
                let [p, q] = turns;
                if (1..=16).contains(&p) && (1..=16).contains(&q) && (2..=p.min(q)).all(|k| p % k != 0 || q % k != 0) {
                    Ok(())
                } else {
                    Err(format!(
                        "turns of shape 'knot' is {turns:?}, but must be from 1 to 16 without a common divisor"
                    ))
                }
            }
            Self::Torus(Torus { radius, tube }) => {
                positive("tube", tube)?;
                if tube < radius && radius.is_finite() {
                    Ok(())
                } else {
                    Err(format!("tube of shape 'torus' is {tube}, but must be less than its radius, {radius}"))
                }
            }
            Self::DiscoBall(DiscoBall { radius, rows, joint }) => {
                positive("radius", radius)?;
                if !(3..=512).contains(&rows) {
                    return Err(format!("rows of shape 'disco-ball' is {rows}, but must be from 3 to 512"));
                }
                if (0.0..=0.5).contains(&joint) {
                    Ok(())
                } else {
                    Err(format!("joint of shape 'disco-ball' is {joint}, but must be from 0 to 0.5"))
                }
            }
            Self::Plane(Plane { size }) => positive("size", size[0]).and(positive("size", size[1])),
            Self::Sheet(Sheet { size, amplitude, wavelength, phase_deg }) => {
                positive("size", size[0]).and(positive("size", size[1]))?;
                positive("amplitude", amplitude).and(positive("wavelength", wavelength))?;
                if amplitude > MAX_STEEPNESS * wavelength {
                    return Err(format!(
                        "amplitude of shape 'sheet' is {amplitude}, but must be at most a tenth of its wavelength"
                    ));
                }
                if phase_deg.is_finite() { Ok(()) } else { Err("phase_deg of shape 'sheet' must be finite".into()) }
            }
            Self::Tiles(Tiles { size, count, gap }) | Self::Joints(Tiles { size, count, gap }) => {
                positive("size", size[0]).and(positive("size", size[1]))?;
                positive("gap", gap)?;
                if count.iter().any(|count| !(1..=512).contains(count)) {
                    return Err(format!(
                        "count of shape '{}' is {count:?}, but must be from 1 to 512 along both axes",
                        self.name()
                    ));
                }
                if (0..2).any(|axis| 2.0 * gap > size[axis] / count[axis] as f32) {
                    return Err(format!(
                        "gap of shape '{}' is {gap}, but must be at most half as wide as a tile with its gap",
                        self.name()
                    ));
                }
                Ok(())
            }
            Self::Water(Water { size, amplitude, wavelength, depth, period, phase_deg }) => {
                positive("size", size[0]).and(positive("size", size[1]))?;
                positive("amplitude", amplitude).and(positive("wavelength", wavelength))?;
                positive("depth", depth)?;
                if amplitude > MAX_RMS_STEEPNESS * wavelength {
                    return Err(format!(
                        "amplitude of shape 'water' is {amplitude}, but must be at most {MAX_RMS_STEEPNESS} of its wavelength: higher waves break"
                    ));
                }
                if !(0.1..=1e4).contains(&period) {
                    return Err(format!("period of shape 'water' is {period}, but must be from 0.1 to 10000 seconds"));
                }
                if phase_deg.is_finite() { Ok(()) } else { Err("phase_deg of shape 'water' must be finite".into()) }
            }
        }
    }
}
