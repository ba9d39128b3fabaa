//! Wavefront materials → what a surface does with light. Read are `Kd Ks Ns illum` and, of the physically based extension
//! (Clara.io), `Pr Pm`; textures are not.
//!
//! | material | becomes |
//! |---|---|
//! | `Pm` ½ or more | a reflector of reflectance `Kd` and roughness `Pr` |
//! | `illum` 3, 5 or 8 (mirrors) | a reflector of reflectance `Ks` and roughness `Pr`; a receiver, too, if `Kd` is not black |
//! | `Pr` | a GGX receiver of albedo `Kd` and specular reflectance .04 |
//! | `Ks` and `Ns`, unless `illum` is 0 or 1 | a Phong receiver |
//! | anything else | a Lambertian receiver of albedo `Kd` (.8 where there is none) |

use glam::Vec3;

use super::{Receiver, Reflector, Sides};
use crate::brdf::{Gloss, LEAST_ROUGHNESS};
use crate::reflectance::Finish;

/// What a material makes of a surface.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Surface {
    pub reflector: Option<Reflector>,
    pub receiver: Option<Receiver>,
}

/// Maps a material; the error says which number is out of its range.
pub(super) fn surface(material: &tobj::Material) -> Result<Surface, String> {
    let name = &material.name;
    let colour = |key: &str, value: Option<[f32; 3]>, default: f32| {
        let value = value.map_or(Vec3::splat(default), Vec3::from);
        let fits = value.is_finite() && value.min_element() >= 0.0 && value.max_element() <= 1.0;
        if fits { Ok(value) } else { Err(format!("material '{name}': {key} is {value}, but must be from 0 to 1")) }
    };
    let part = |key: &str| match material.unknown_param.get(key) {
        None => Ok(None),
        Some(text) => match text.trim().parse::<f32>() {
            Ok(value) if (0.0..=1.0).contains(&value) => Ok(Some(value)),
            _ => Err(format!("material '{name}': {key} is {text}, but must be a number from 0 to 1")),
        },
    };
    let (diffuse, specular) = (colour("Kd", material.diffuse, 0.8)?, colour("Ks", material.specular, 0.0)?);
    let (roughness, metallic) = (part("Pr")?, part("Pm")?);
    let exponent = material.shininess.unwrap_or(0.0);
    if !(0.0..=1e5).contains(&exponent) {
        return Err(format!("material '{name}': Ns is {exponent}, but must be from 0 to 100000"));
    }
    let mirror = |reflectance: Vec3| {
        let roughness = roughness.unwrap_or(0.0).into();
        let finish = Finish { reflectance: reflectance.as_dvec3(), metal: None, coat: None, roughness };
        Some(Reflector { sides: Sides::Front, finish })
    };
    if metallic.is_some_and(|metallic| metallic >= 0.5) {
        return Ok(Surface { reflector: mirror(diffuse), receiver: None });
    }
    let illumination = material.illumination_model;
    if matches!(illumination, Some(3 | 5 | 8)) {
        let reflectance = colour("Ks", material.specular, 1.0)?;
        let receiver = material.diffuse.filter(|kd| kd.iter().any(|c| *c > 0.0));
        let receiver = receiver.map(|kd| Receiver { albedo: kd.into(), gloss: Gloss::None });
        return Ok(Surface { reflector: mirror(reflectance), receiver });
    }
    let gloss = match roughness {
        Some(roughness) => Gloss::Ggx { specular: Vec3::splat(0.04), roughness: roughness.max(LEAST_ROUGHNESS) },
        None if specular != Vec3::ZERO && !matches!(illumination, Some(0 | 1)) => Gloss::Phong { specular, exponent },
        None => Gloss::None,
    };
    Ok(Surface { reflector: None, receiver: Some(Receiver { albedo: diffuse, gloss }) })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(text: &str) -> Result<Surface, String> {
        let (materials, _) = tobj::load_mtl_buf(&mut format!("newmtl m\n{text}\n").as_bytes()).unwrap();
        surface(&materials[0])
    }

    #[test]
    fn materials_become_what_their_numbers_say() {
        let lambert = of("Kd 0.1 0.2 0.3\nillum 1\nKs 1 1 1\nNs 10").unwrap();
        assert_eq!(lambert.receiver.unwrap(), Receiver { albedo: Vec3::new(0.1, 0.2, 0.3), gloss: Gloss::None });
        let phong = of("Kd 0.5 0.5 0.5\nKs 0.2 0.2 0.2\nNs 40\nillum 2").unwrap().receiver.unwrap();
        assert_eq!(phong.gloss, Gloss::Phong { specular: Vec3::splat(0.2), exponent: 40.0 });
        let plastic = of("Kd 0.5 0.5 0.5\nPr 0.4\nPm 0.0").unwrap().receiver.unwrap();
        assert_eq!(plastic.gloss, Gloss::Ggx { specular: Vec3::splat(0.04), roughness: 0.4 });
        let metal = of("Kd 0.9 0.6 0.2\nPr 0.25\nPm 1.0").unwrap();
        let finish = metal.reflector.unwrap().finish;
        assert!(metal.receiver.is_none() && (finish.roughness - 0.25).abs() < 1e-6);
        assert!((finish.reflectance.x - 0.9).abs() < 1e-6);
        let mirror = of("Kd 0 0 0\nKs 0.8 0.8 0.8\nillum 3").unwrap();
        assert!(mirror.receiver.is_none() && (mirror.reflector.unwrap().finish.reflectance.x - 0.8).abs() < 1e-6);
        let glazed = of("Kd 0.3 0 0\nKs 0.1 0.1 0.1\nillum 5").unwrap();
        assert!(glazed.receiver.is_some() && glazed.reflector.is_some());
    }

    #[test]
    fn numbers_out_of_range_are_named() {
        for (text, named) in [("Kd 2 0 0", "Kd is"), ("Pr 7", "Pr is 7"), ("Pm x", "Pm is x"), ("Ns -1", "Ns is -1")] {
            let message = of(text).unwrap_err();
            assert!(message.contains(named) && message.contains("'m'"), "{message}");
        }
    }
}
