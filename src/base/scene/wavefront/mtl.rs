//! Wavefront materials, as reflectors, refractors, receivers and emitters. Reads `Kd Ks Ke Ns Ni illum` and, from the physically based
//! extension (Clara.io), `Pr Pm`, but no textures.
//!
//! | material | becomes |
//! |---|---|
//! | `Ke` that is not black | an emitter of this radiance |
//! | `illum` 4, 6, 7 or 9 (glass), and an `Ni` other than 1 | a refractor of this index |
//! | `Pm` ½ or more | a reflector of reflectance `Kd` and roughness `Pr` |
//! | `illum` 3, 5 or 8 (mirrors) | a reflector of reflectance `Ks` and roughness `Pr`; a receiver, too, if `Kd` is not black |
//! | `Pr` | a GGX receiver of albedo `Kd` and specular reflectance .04 |
//! | `Ks` and `Ns`, unless `illum` is 0 or 1 | a Phong receiver |
//! | anything else | a Lambertian receiver of albedo `Kd` (.8 where there is none) |
//!
//! Blender writes its own material into these keys: `illum` 3 is a metal of colour `Kd`, `Ks` the specular level of what is none, and `Ns` a
//! thousand times the square of 1 − roughness.
//!
//! This is not `tobj`'s reader, which panics on colours of one number, although the format allows them, and reports no
//! lines.

use glam::{DVec3, Vec3};

use super::text::{Statement, decoded, statements};
use crate::brdf::{Gloss, LEAST_ROUGHNESS};
use crate::image::rec_709_from_xyz;
use crate::reflectance::Finish;
use crate::scene::{Emitter, Interfaces, MAX_RADIANCE, MeshError, Receiver, Reflector, Refractor, Sides};
use crate::words::escaped;

/// A surface with a material.
#[derive(Clone, Debug, Default, PartialEq)]
pub(in crate::scene) struct Surface {
    pub reflector: Option<Reflector>,
    /// Of one interface; closed meshes have two.
    pub refractor: Option<Refractor>,
    pub receiver: Option<Receiver>,
    pub emitter: Option<Emitter>,
}

/// A material, and the surface that it defines.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Material {
    pub name: String,
    /// The surface, or the line and the reason why it is invalid.
    pub surface: Result<Surface, (usize, String)>,
    /// What was changed, or has no effect.
    pub notes: Vec<String>,
}

/// Reads the materials of a library; `name` is used in messages.
pub(super) fn materials(name: &str, bytes: &[u8]) -> Result<Vec<Material>, MeshError> {
    let text = decoded(bytes);
    let is_from_blender = text.trim_start().starts_with("# Blender");
    let mut found: Vec<Numbers> = Vec::new();
    for statement in statements(&text) {
        let line = statement.line;
        let fail = |reason: String| MeshError::Statement { file: name.into(), line, reason: escaped(&reason) };
        if statement.keyword() == "newmtl" {
            if statement.rest().is_empty() {
                return Err(fail("a material needs a name".into()));
            }
            found.push(Numbers { name: statement.rest().to_owned(), is_from_blender, ..Default::default() });
        } else if let Some(numbers) = found.last_mut() {
            numbers.read(&statement).map_err(fail)?;
        }
    }
    let material = |numbers: Numbers| {
        let mut notes = numbers.notes();
        let surface = numbers.surface(&mut notes);
        Material { name: numbers.name, surface, notes }
    };
    Ok(found.into_iter().map(material).collect())
}

/// A number or a colour, and its line.
type Entry<T> = Option<(usize, T)>;

#[derive(Debug, Default)]
struct Numbers {
    name: String,
    is_from_blender: bool,
    diffuse: Entry<Vec3>,
    specular: Entry<Vec3>,
    emitted: Entry<Vec3>,
    exponent: Entry<f32>,
    index: Entry<f32>,
    illumination: Entry<f32>,
    roughness: Entry<f32>,
    metallic: Entry<f32>,
    /// How opaque it is.
    opacity: Option<f32>,
    /// Keys that have no effect.
    unused: Vec<String>,
}

/// Roughness that Blender wrote as an exponent.
fn roughness_from_blender(exponent: f32) -> f32 {
    1.0 - (exponent / 1000.0).clamp(0.0, 1.0).sqrt()
}

/// Specular reflectance at Blender's specular level 1.
const BLENDERS_SPECULAR: f32 = 0.08;

impl Numbers {
    fn read(&mut self, statement: &Statement) -> Result<(), String> {
        let line = statement.line;
        let one = || one_number(statement).map(|number| Some((line, number)));
        match statement.keyword() {
            "Kd" => self.diffuse = Some((line, colour(statement)?)),
            "Ks" => self.specular = Some((line, colour(statement)?)),
            "Ke" => self.emitted = Some((line, colour(statement)?)),
            "Ns" => self.exponent = one()?,
            "Ni" => self.index = one()?,
            "illum" => self.illumination = one()?,
            "Pr" => self.roughness = one()?,
            "Pm" => self.metallic = one()?,
            "d" => self.opacity = statement.words().last().and_then(|word| word.parse().ok()),
            "Tr" => self.opacity = statement.words().last().and_then(|word| word.parse().ok()).map(|t: f32| 1.0 - t),
            "Tf" if statement.words().any(|word| word.parse() != Ok(1.0f32)) => self.unused.push("Tf".into()),
            key if key.starts_with("map_") || ["bump", "norm", "disp", "decal", "refl"].contains(&key) => {
                self.unused.push(key.into());
            }
            _ => {}
        }
        Ok(())
    }

    /// What has no effect.
    fn notes(&self) -> Vec<String> {
        let mut unused = self.unused.clone();
        unused.sort_unstable();
        unused.dedup();
        let mut notes = Vec::new();
        if !unused.is_empty() {
            let has = if unused.len() == 1 { "has" } else { "have" };
            notes.push(format!(
                "{} {has} no effect yet",
                unused.iter().map(|key| escaped(key)).collect::<Vec<_>>().join(", ")
            ));
        }
        if self.opacity.is_some_and(|opacity| opacity < 1.0) && !self.is_glass() {
            notes.push(
                "it is not opaque (d, Tr), but rendered as if it were; glass has illum 4, 6, 7 or 9, and Ni".into(),
            );
        }
        notes
    }

    fn model(&self) -> Option<u32> {
        self.illumination.map(|(_, model)| model as u32)
    }

    fn is_glass(&self) -> bool {
        let refracts = self.index.is_some_and(|(_, index)| (index - 1.0).abs() > 1e-3);
        refracts && matches!(self.model(), Some(4 | 6 | 7 | 9))
    }

    /// Checks every number, and combines them to a surface.
    fn surface(&self, notes: &mut Vec<String>) -> Result<Surface, (usize, String)> {
        let outside = |line: usize, key: &str, value: &dyn std::fmt::Display, most: u32| {
            let name = escaped(&self.name);
            (line, format!("{key} of material '{name}' is {value}, but must be from 0 to {most}"))
        };
        let number = |key: &str, entry: Entry<f32>, most: u32| match entry {
            Some((line, value)) if !(0.0..=most as f32).contains(&value) => Err(outside(line, key, &value, most)),
            _ => Ok(entry.map(|(_, value)| value)),
        };
        let mut colour = |key: &str, entry: Entry<Vec3>| match entry {
            Some((line, value)) if !(value.is_finite() && value.min_element() >= 0.0) => {
                Err(outside(line, key, &value, 1))
            }
            Some((_, value)) if value.max_element() > 1.0 => {
                // What is due to rounding is not worth a word.
                if value.max_element() > 1.0 + 1e-5 {
                    notes.push(format!("{key} is {value}, more than all light; it is cut off at 1"));
                }
                Ok(Some(value.min(Vec3::ONE)))
            }
            _ => Ok(entry.map(|(_, value)| value)),
        };
        let (diffuse, specular) = (colour("Kd", self.diffuse)?, colour("Ks", self.specular)?);
        let (roughness, metallic) = (number("Pr", self.roughness, 1)?, number("Pm", self.metallic, 1)?);
        let exponent = number("Ns", self.exponent, 100_000)?.unwrap_or(0.0);
        if let Some((line, radiance)) = self.emitted.filter(|(_, radiance)| *radiance != Vec3::ZERO) {
            if !(radiance.min_element() >= 0.0 && radiance.max_element() <= MAX_RADIANCE) {
                let reason = format!("Ke of material '{}' is {radiance}, which is no radiance", escaped(&self.name));
                return Err((line, reason));
            }
            return Ok(Surface { emitter: Some(Emitter { radiance, is_near: false }), ..Surface::default() });
        }
        if let Some((line, index)) = self.index.filter(|_| self.is_glass()) {
            let (least, most) = Refractor::INDICES.into_inner();
            if !Refractor::INDICES.contains(&f64::from(index)) {
                let name = escaped(&self.name);
                return Err((line, format!("Ni of material '{name}' is {index}, but must be from {least} to {most}")));
            }
            let eta = DVec3::splat(f64::from(index));
            let refractor = Refractor { eta, fresnel: true, interfaces: Interfaces::One };
            return Ok(Surface { refractor: Some(refractor), ..Surface::default() });
        }

        let is_from_blender = self.is_from_blender && self.exponent.is_some();
        let blenders = is_from_blender.then(|| roughness_from_blender(exponent));
        let mirror = |reflectance: Vec3| {
            let roughness = roughness.or(blenders).unwrap_or(0.0).into();
            let finish = Finish { reflectance: reflectance.as_dvec3(), metal: None, coat: None, roughness };
            Some(Reflector { sides: Sides::Both, finish })
        };
        let albedo = diffuse.unwrap_or(Vec3::splat(0.8));
        let is_mirror = matches!(self.model(), Some(3 | 5 | 8));
        if metallic.is_some_and(|metallic| metallic >= 0.5) || is_mirror && self.is_from_blender {
            return Ok(Surface { reflector: mirror(albedo), ..Surface::default() });
        }
        if is_mirror {
            let receiver = diffuse.filter(|kd| *kd != Vec3::ZERO).map(|albedo| Receiver { albedo, gloss: Gloss::None });
            let reflector = mirror(specular.unwrap_or(Vec3::ONE));
            return Ok(Surface { reflector, receiver, ..Surface::default() });
        }
        let gloss = match (roughness.or(blenders), specular) {
            (Some(roughness), specular) => {
                let of_blender = specular.filter(|_| self.is_from_blender).map(|level| BLENDERS_SPECULAR * level);
                Gloss::Ggx {
                    specular: of_blender.unwrap_or(Vec3::splat(0.04)),
                    roughness: roughness.max(LEAST_ROUGHNESS),
                }
            }
            (None, Some(specular)) if specular != Vec3::ZERO && !matches!(self.model(), Some(0 | 1)) => {
                Gloss::Phong { specular, exponent }
            }
            _ => Gloss::None,
        };
        Ok(Surface { receiver: Some(Receiver { albedo, gloss }), ..Surface::default() })
    }
}

/// A colour; a single number is a grey.
fn colour(statement: &Statement) -> Result<Vec3, String> {
    let key = statement.keyword();
    if statement.words().next() == Some("spectral") {
        return Err(format!("{key} is a spectrum; give it as red, green and blue"));
    }
    if statement.words().next() == Some("xyz") {
        let numbers: Result<Vec<f32>, _> = statement.words().skip(1).map(str::parse).collect();
        return match numbers.as_deref() {
            Ok([x, y, z]) => Ok(rec_709_from_xyz([*x, *y, *z]).max(Vec3::ZERO)),
            _ => Err(format!("{key} is CIE XYZ, but has not three numbers")),
        };
    }
    match statement.numbers::<f32>().map_err(|reason| format!("{key}: {reason}"))?[..] {
        [grey] => Ok(Vec3::splat(grey)),
        [r, g, b] => Ok(Vec3::new(r, g, b)),
        ref numbers => Err(format!("{key} has {} numbers, but a colour has one or three", numbers.len())),
    }
}

fn one_number(statement: &Statement) -> Result<f32, String> {
    let key = statement.keyword();
    match statement.numbers::<f32>().map_err(|reason| format!("{key}: {reason}"))?[..] {
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

    /// What Blender 4.2 writes for a gold metal, paper, glass and a lamp.
    #[test]
    fn blenders_materials_are_what_they_are_in_blender() {
        let text = "# Blender 4.2.1 LTS MTL File: 'ring.blend'\n# www.blender.org\n\nnewmtl Gold\nNs 1000\nKa 1 1 1\nKd 1 .766 .336\n\
                    Ks .5 .5 .5\nKe 0 0 0\nNi 1.5\nd 1\nillum 3\n\nnewmtl Paper\nNs 250\nKa 1 1 1\nKd .5 .5 .5\nKs .5 .5 .5\nNi 1.5\n\
                    d 1\nillum 2\nnewmtl Glass\nNs 1000\nKd .8 .8 .8\nKs .5 .5 .5\nNi 1.45\nd 1\nillum 9\nnewmtl Lamp\nKe 5 4 3\n";
        let found = materials("m.mtl", text.as_bytes()).unwrap();
        assert!(found.iter().all(|material| material.notes.is_empty()));
        let [gold, paper, glass, lamp] =
            found.try_into().map(|all: [Material; 4]| all.map(|m| m.surface.unwrap())).unwrap();
        let finish = gold.reflector.unwrap().finish;
        assert!(gold.receiver.is_none() && finish.reflectance.as_vec3() == Vec3::new(1.0, 0.766, 0.336));
        assert!(finish.roughness == 0.0);
        let Receiver { albedo, gloss } = paper.receiver.unwrap();
        assert_eq!((albedo, gloss), (Vec3::splat(0.5), Gloss::Ggx { specular: Vec3::splat(0.04), roughness: 0.5 }));
        assert!((glass.refractor.unwrap().eta.x - 1.45).abs() < 1e-6 && glass.receiver.is_none());
        assert_eq!(lamp.emitter.unwrap().radiance, Vec3::new(5.0, 4.0, 3.0));
    }

    #[test]
    fn what_has_no_effect_is_named() {
        let notes = |text: &str| read(text).unwrap().remove(0).notes.join("; ");
        assert_eq!(notes("Kd .5 .5 .5\nd 1\nTf 1 1 1\nKa 1 1 1"), "");
        assert!(notes("map_Kd -s 1 1 1 wood.png\nTf .5 1 1\nmap_Kd b.png").contains("Tf, map_Kd have no effect"));
        assert!(notes("d 0.2").contains("not opaque") && notes("Tr .3").contains("not opaque"));
        assert_eq!(notes("d .2\nNi 1.5\nillum 7"), "");
        assert!(notes("Ks 1.2 1 1\nillum 3").contains("cut off at 1"));
        let clamped = of("Ks 1.000001 1 1\nillum 3").reflector.unwrap();
        assert_eq!((clamped.finish.reflectance, clamped.sides), (DVec3::ONE, Sides::Both));
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
            ("Kd xyz 1 2", "m.mtl:2: Kd is CIE XYZ"),
        ] {
            let message = read(text).unwrap_err();
            assert!(message.contains(named), "{message}");
        }
    }

    #[test]
    fn numbers_out_of_range_are_named() {
        for (text, line, named) in [
            ("Kd -2 0 0", 2, "Kd of material 'm' is [-2, 0, 0]"),
            ("Ni 9\nillum 4", 2, "Ni of material 'm' is 9"),
            ("Ke -1 0 0", 2, "Ke of material 'm' is [-1, 0, 0]"),
            ("Pr 7", 2, "Pr of material 'm' is 7"),
            ("Kd 0 0 0\nNs -1", 3, "Ns of material 'm' is -1"),
            ("Ks nan 0 0", 2, "Ks of material 'm' is [NaN, 0, 0]"),
        ] {
            let (at, message) = read(text).unwrap().remove(0).surface.unwrap_err();
            assert!(at == line && message.contains(named), "{at}: {message}");
        }
    }
}
