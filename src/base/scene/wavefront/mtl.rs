//! Wavefront materials, as reflectors and receivers. Reads `Kd Ks Ns illum` and, from the physically based extension
//! (Clara.io), `Pr Pm`, but no textures.
//!
//! | material | becomes |
//! |---|---|
//! | `Pm` ½ or more | a reflector of reflectance `Kd` and roughness `Pr` |
//! | `illum` 3, 5 or 8 (mirrors) | a reflector of reflectance `Ks` and roughness `Pr`; a receiver, too, if `Kd` is not black |
//! | `Pr` | a GGX receiver of albedo `Kd` and specular reflectance .04 |
//! | `Ks` and `Ns`, unless `illum` is 0 or 1 | a Phong receiver |
//! | anything else | a Lambertian receiver of albedo `Kd` (.8 where there is none) |
//!
//! This is not `tobj`'s reader, which panics on colours of one number, although the format allows them, and reports no
//! lines.

use glam::Vec3;

use super::text::{Statement, decoded, statements};
use crate::brdf::{Gloss, LEAST_ROUGHNESS};
use crate::reflectance::Finish;
use crate::scene::{MeshError, Receiver, Reflector, Sides};
use crate::words::escaped;

/// A surface with a material.
#[derive(Clone, Debug, Default, PartialEq)]
pub(in crate::scene) struct Surface {
    pub reflector: Option<Reflector>,
    pub receiver: Option<Receiver>,
}

/// A material, and the surface that it defines.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Material {
    pub name: String,
    /// The surface, or the line and the reason why it is invalid.
    pub surface: Result<Surface, (usize, String)>,
}

/// Reads the materials of a library; `name` is used in messages.
pub(super) fn materials(name: &str, bytes: &[u8]) -> Result<Vec<Material>, MeshError> {
    let text = decoded(bytes);
    let mut found: Vec<Numbers> = Vec::new();
    for statement in statements(&text) {
        let line = statement.line;
        let fail = |reason: String| MeshError::Statement { file: name.into(), line, reason: escaped(&reason) };
        if statement.keyword() == "newmtl" {
            if statement.rest().is_empty() {
                return Err(fail("a material needs a name".into()));
            }
            found.push(Numbers { name: statement.rest().to_owned(), ..Default::default() });
        } else if let Some(numbers) = found.last_mut() {
            numbers.read(&statement).map_err(fail)?;
        }
    }
    Ok(found.into_iter().map(|n| Material { surface: n.surface(), name: n.name }).collect())
}

/// A number or a colour, and its line.
type Entry<T> = Option<(usize, T)>;

#[derive(Debug, Default)]
struct Numbers {
    name: String,
    diffuse: Entry<Vec3>,
    specular: Entry<Vec3>,
    exponent: Entry<f32>,
    illumination: Entry<f32>,
    roughness: Entry<f32>,
    metallic: Entry<f32>,
}

impl Numbers {
    fn read(&mut self, statement: &Statement) -> Result<(), String> {
        let line = statement.line;
        let one = || one_number(statement).map(|number| Some((line, number)));
        match statement.keyword() {
            "Kd" => self.diffuse = Some((line, colour(statement)?)),
            "Ks" => self.specular = Some((line, colour(statement)?)),
            "Ns" => self.exponent = one()?,
            "illum" => self.illumination = one()?,
            "Pr" => self.roughness = one()?,
            "Pm" => self.metallic = one()?,
            _ => {}
        }
        Ok(())
    }

    /// Checks every number, and combines them to a surface.
    fn surface(&self) -> Result<Surface, (usize, String)> {
        let outside = |line: usize, key: &str, value: &dyn std::fmt::Display, most: u32| {
            let name = escaped(&self.name);
            (line, format!("{key} of material '{name}' is {value}, but must be from 0 to {most}"))
        };
        let number = |key: &str, entry: Entry<f32>, most: u32| match entry {
            Some((line, value)) if !(0.0..=most as f32).contains(&value) => Err(outside(line, key, &value, most)),
            _ => Ok(entry.map(|(_, value)| value)),
        };
        let colour = |key: &str, entry: Entry<Vec3>| match entry {
            Some((line, value)) if !(value.is_finite() && value.min_element() >= 0.0 && value.max_element() <= 1.0) => {
                Err(outside(line, key, &value, 1))
            }
            _ => Ok(entry.map(|(_, value)| value)),
        };
        let (diffuse, specular) = (colour("Kd", self.diffuse)?, colour("Ks", self.specular)?);
        let (roughness, metallic) = (number("Pr", self.roughness, 1)?, number("Pm", self.metallic, 1)?);
        let exponent = number("Ns", self.exponent, 100_000)?.unwrap_or(0.0);
        let illumination = self.illumination.map(|(_, model)| model as u32);

        let mirror = |reflectance: Vec3| {
            let roughness = roughness.unwrap_or(0.0).into();
            let finish = Finish { reflectance: reflectance.as_dvec3(), metal: None, coat: None, roughness };
            Some(Reflector { sides: Sides::Front, finish })
        };
        let albedo = diffuse.unwrap_or(Vec3::splat(0.8));
        if metallic.is_some_and(|metallic| metallic >= 0.5) {
            return Ok(Surface { reflector: mirror(albedo), receiver: None });
        }
        if matches!(illumination, Some(3 | 5 | 8)) {
            let receiver = diffuse.filter(|kd| *kd != Vec3::ZERO).map(|albedo| Receiver { albedo, gloss: Gloss::None });
            return Ok(Surface { reflector: mirror(specular.unwrap_or(Vec3::ONE)), receiver });
        }
        let gloss = match (roughness, specular) {
            (Some(roughness), _) => {
                Gloss::Ggx { specular: Vec3::splat(0.04), roughness: roughness.max(LEAST_ROUGHNESS) }
            }
            (None, Some(specular)) if specular != Vec3::ZERO && !matches!(illumination, Some(0 | 1)) => {
                Gloss::Phong { specular, exponent }
            }
            _ => Gloss::None,
        };
        Ok(Surface { reflector: None, receiver: Some(Receiver { albedo, gloss }) })
    }
}

/// A colour; a single number is a grey.
fn colour(statement: &Statement) -> Result<Vec3, String> {
    let key = statement.keyword();
    if matches!(statement.words().next(), Some("spectral" | "xyz")) {
        return Err(format!("{key} is a spectrum or CIEXYZ; give it as red, green and blue"));
    }
    match statement.numbers().map_err(|reason| format!("{key}: {reason}"))?[..] {
        [grey] => Ok(Vec3::splat(grey)),
        [r, g, b] => Ok(Vec3::new(r, g, b)),
        ref numbers => Err(format!("{key} has {} numbers, but a colour has one or three", numbers.len())),
    }
}

fn one_number(statement: &Statement) -> Result<f32, String> {
    let key = statement.keyword();
    match statement.numbers().map_err(|reason| format!("{key}: {reason}"))?[..] {
        [number] => Ok(number),
        ref numbers => Err(format!("{key} has {} numbers, but needs one", numbers.len())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Vec<Material>, String> {
        materials("m.mtl", format!("newmtl m\n{text}\n").as_bytes()).map_err(|e| e.to_string())
    }

    fn of(text: &str) -> Surface {
        read(text).unwrap().remove(0).surface.unwrap()
    }

    #[test]
    fn materials_become_what_their_numbers_say() {
        let lambert = of("Kd 0.1 0.2 0.3\nillum 1\nKs 1 1 1\nNs 10");
        assert_eq!(lambert.receiver.unwrap(), Receiver { albedo: Vec3::new(0.1, 0.2, 0.3), gloss: Gloss::None });
        let phong = of("Kd 0.5 0.5 0.5\nKs 0.2 0.2 0.2\nNs 40\nillum 2").receiver.unwrap();
        assert_eq!(phong.gloss, Gloss::Phong { specular: Vec3::splat(0.2), exponent: 40.0 });
        let plastic = of("Kd 0.5 0.5 0.5\nPr 0.4\nPm 0.0").receiver.unwrap();
        assert_eq!(plastic.gloss, Gloss::Ggx { specular: Vec3::splat(0.04), roughness: 0.4 });
        let metal = of("Kd 0.9 0.6 0.2\nPr 0.25\nPm 1.0");
        let finish = metal.reflector.unwrap().finish;
        assert!(metal.receiver.is_none() && (finish.roughness - 0.25).abs() < 1e-6);
        assert!((finish.reflectance.x - 0.9).abs() < 1e-6);
        let mirror = of("Kd 0 0 0\nKs 0.8 0.8 0.8\nillum 3");
        assert!(mirror.receiver.is_none() && (mirror.reflector.unwrap().finish.reflectance.x - 0.8).abs() < 1e-6);
        let glazed = of("Kd 0.3 0 0\nKs 0.1 0.1 0.1\nillum 5");
        assert!(glazed.receiver.is_some() && glazed.reflector.is_some());
    }

    #[test]
    fn a_colour_of_one_number_is_grey() {
        assert_eq!(of("Kd 0.5\nKa 1").receiver.unwrap().albedo, Vec3::splat(0.5));
    }

    #[test]
    fn malformed_lines_are_named() {
        for (text, named) in [
            ("Ks 1 2", "m.mtl:2: Ks has 2 numbers"),
            ("\nKd red", "m.mtl:3: Kd: 'red' is not a number"),
            ("Pm", "m.mtl:2: Pm has 0 numbers"),
            ("newmtl", "m.mtl:2: a material needs a name"),
            ("Kd spectral sky.rfl", "m.mtl:2: Kd is a spectrum"),
        ] {
            let message = read(text).unwrap_err();
            assert!(message.contains(named), "{message}");
        }
    }

    #[test]
    fn numbers_out_of_range_are_named() {
        for (text, line, named) in [
            ("Kd 2 0 0", 2, "Kd of material 'm' is [2, 0, 0]"),
            ("Pr 7", 2, "Pr of material 'm' is 7"),
            ("Kd 0 0 0\nNs -1", 3, "Ns of material 'm' is -1"),
            ("Ks nan 0 0", 2, "Ks of material 'm' is [NaN, 0, 0]"),
        ] {
            let (at, message) = read(text).unwrap().remove(0).surface.unwrap_err();
            assert!(at == line && message.contains(named), "{at}: {message}");
        }
    }
}
