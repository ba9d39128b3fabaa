//! BRDFs of receivers (Wand and Straßer 2003, Section 5, propose Phong's and tables), packed as the gather reads them.
//! Independent of geometry.
//!
//! `n`, `l` and `v` are unit vectors: the normal, towards the light, towards the viewer. Shader twin:
//! `shaders/shared/brdf.wgsl`.

mod table;

pub use table::STEPS as TABLE_STEPS;
pub use table::{BrdfTable, TableError};

use std::f32::consts::{FRAC_1_PI, TAU};
use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// What a receiver's BRDF has in addition to diffuse reflection.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Gloss {
    /// Nothing.
    #[default]
    None,
    /// Phong's lobe, normalised (Lafortune and Willems 1994): specular · (e + 2)/2π · cosᵉ of the angle to the mirrored
    /// direction.
    Phong {
        /// The largest reflectance of the lobe, per channel, in [0, 1].
        specular: Vec3,
        /// Exponent e; not negative.
        exponent: f32,
    },
    /// A GGX surface (Walter et al. 2007) with Schlick's Fresnel factor over the diffuse one.
    Ggx {
        /// Reflectance at perpendicular incidence, per channel, in [0, 1].
        specular: Vec3,
        /// √α, from [`LEAST_ROUGHNESS`] to 1.
        roughness: f32,
    },
    /// A measured BRDF, which replaces the diffuse part, too.
    Table(Arc<BrdfTable>),
}

/// The smallest roughness of a GGX receiver; smoother surfaces are mirrors.
pub const LEAST_ROUGHNESS: f32 = 0.05;

/// A receiver's BRDF in 48 bytes, as the shader reads it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Material {
    /// Diffuse albedo.
    pub albedo: [f32; 3],
    /// One of the constants `MATERIAL_…`.
    pub kind: u32,
    /// Specular reflectance.
    pub specular: [f32; 3],
    /// Phong's exponent, or GGX's α.
    pub width: f32,
    /// The first entry of its table.
    pub table: u32,
    /// Unused.
    pub padding: [u32; 3],
}

const MATERIAL_LAMBERT: u32 = 0;
/// A Phong lobe.
pub const MATERIAL_PHONG: u32 = 1;
/// A GGX lobe.
pub const MATERIAL_GGX: u32 = 2;
/// A measured table.
pub const MATERIAL_TABLE: u32 = 3;

/// The BRDFs of a scene's objects.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Materials {
    /// By the object's index.
    pub of_object: Vec<Material>,
    /// The entries of all tables.
    pub tables: Vec<[f32; 4]>,
}

impl Materials {
    /// Packs the BRDFs of objects in order, from the albedo and gloss of each; `None` is not a receiver.
    pub fn new<'a>(objects: impl Iterator<Item = Option<(Vec3, &'a Gloss)>>) -> Self {
        let mut tables = Vec::new();
        let mut pack = |albedo: Vec3, gloss: &Gloss| {
            let (kind, specular, width, table) = match gloss {
                Gloss::None => (MATERIAL_LAMBERT, Vec3::ZERO, 0.0, 0),
                Gloss::Phong { specular, exponent } => (MATERIAL_PHONG, *specular, *exponent, 0),
                Gloss::Ggx { specular, roughness } => (MATERIAL_GGX, *specular, roughness * roughness, 0),
                Gloss::Table(table) => {
                    tables.extend_from_slice(table.entries());
                    (MATERIAL_TABLE, Vec3::ZERO, 0.0, tables.len() - table.entries().len())
                }
            };
            Material {
                albedo: albedo.to_array(),
                kind,
                specular: specular.to_array(),
                width,
                table: table as u32,
                padding: [0; 3],
            }
        };
        let of_object = objects.map(|o| o.map_or(Material::default(), |(albedo, gloss)| pack(albedo, gloss))).collect();
        Self { of_object, tables }
    }

    /// The BRDF of an object, 1/sr, for `l` and `v` above the surface; 0 elsewhere. Lobes are widened to approximate
    /// their average over light from `solid_angle` sr around `l`; tables are not.
    #[inline]
    pub fn value(&self, object: u32, n: Vec3, l: Vec3, v: Vec3, solid_angle: f32) -> Vec3 {
        let material = &self.of_object[object as usize];
        let (cos_l, cos_v) = (n.dot(l), n.dot(v));
        if cos_l <= 0.0 || cos_v <= 0.0 {
            return Vec3::ZERO;
        }
        let diffuse = FRAC_1_PI * Vec3::from(material.albedo);
        let (specular, width) = (Vec3::from(material.specular), material.width);
        match material.kind {
            MATERIAL_PHONG => {
                // Variances add: that of cosᵉ is 1/e, that of a square is a twelfth of its area.
                let width = width / (1.0 + width * solid_angle / 12.0);
                let mirrored = (2.0 * cos_l * n - l).dot(v).max(0.0);
                diffuse + specular * ((width + 2.0) / TAU * mirrored.powf(width))
            }
            MATERIAL_GGX => {
                let h = (l + v).normalize();
                // The half vector rotates by half the angle of the light; α² is twice the variance.
                let width = (width * width + solid_angle / 24.0).sqrt().min(1.0);
                let passes = |cosine: f32| Vec3::ONE - schlick(specular, cosine);
                let lobe = distribution(n.dot(h), width) * visibility(cos_l, cos_v, width);
                diffuse * passes(cos_l) * passes(cos_v) + schlick(specular, l.dot(h)) * lobe
            }
            MATERIAL_TABLE => table::value(&self.tables[material.table as usize..], n, l, v),
            _ => diffuse,
        }
    }

    /// Whether an object's BRDF is a lobe over a diffuse part.
    pub fn has_lobe(&self, object: u32) -> bool {
        matches!(self.of_object[object as usize].kind, MATERIAL_PHONG | MATERIAL_GGX)
    }

    /// The diffuse part of an object's BRDF, 1/sr, under even light, seen at a cosine to the normal.
    pub fn mean_diffuse(&self, object: u32, cos_v: f32) -> Vec3 {
        let material = &self.of_object[object as usize];
        let diffuse = FRAC_1_PI * Vec3::from(material.albedo);
        if material.kind != MATERIAL_GGX {
            return diffuse;
        }
        let specular = Vec3::from(material.specular);
        // The mean of Schlick's (1 − cos)⁵ over a diffuse hemisphere is 1/21.
        let arrives = (Vec3::ONE - specular) * (20.0 / 21.0);
        diffuse * arrives * (Vec3::ONE - schlick(specular, cos_v))
    }

    /// What a microfacet, drawn in proportion to those of a surface of [`Self::lobe_alpha`], reflects of the radiance from `l`: the lobe of
    /// an object's BRDF times the cosine of the light, over the density of such directions.
    pub fn lobe_weight(&self, object: u32, [n, facet, v]: [Vec3; 3], l: Vec3) -> Vec3 {
        let material = &self.of_object[object as usize];
        let (cos_l, cos_v, cos_facet) = (n.dot(l), n.dot(v), n.dot(facet));
        let Some(alpha) = self.lobe_alpha(object).filter(|_| cos_l > 0.0 && cos_v > 0.0) else { return Vec3::ZERO };
        let specular = Vec3::from(material.specular);
        let over_distribution = 4.0 * v.dot(facet) * cos_l / cos_facet.max(1e-4);
        match material.kind {
            MATERIAL_GGX => schlick(specular, l.dot(facet)) * visibility(cos_l, cos_v, alpha) * over_distribution,
            MATERIAL_PHONG => {
                let mirrored = (2.0 * cos_l * n - l).dot(v).max(0.0);
                let lobe = (material.width + 2.0) / TAU * mirrored.powf(material.width);
                specular * (lobe / distribution(cos_facet, alpha).max(1e-9) * over_distribution)
            }
            _ => Vec3::ZERO,
        }
    }

    /// Whether an object's BRDF is not Lambertian.
    pub fn is_glossy(&self, object: u32) -> bool {
        self.of_object[object as usize].kind != MATERIAL_LAMBERT
    }

    /// The approximate width of an object's lobe, if it has one, as α of a GGX surface: for importance sampling.
    pub fn lobe_alpha(&self, object: u32) -> Option<f32> {
        let material = &self.of_object[object as usize];
        let width = material.width;
        match material.kind {
            // Lobes of cosᵉ around the mirrored direction are about as wide as those of microfacets with α² = 8/(e +
            // 2).
            MATERIAL_PHONG => Some((8.0 / (width + 2.0)).sqrt().min(1.0)),
            MATERIAL_GGX => Some(width),
            MATERIAL_TABLE => Some(TABLE_ALPHA),
            _ => None,
        }
    }
}

/// Lobe width assumed for tables: typical of glossy measured materials.
const TABLE_ALPHA: f32 = 0.1;

fn schlick(specular: Vec3, cosine: f32) -> Vec3 {
    specular + (Vec3::ONE - specular) * (1.0 - cosine.clamp(0.0, 1.0)).powi(5)
}

/// The GGX distribution D (Walter et al. 2007, Equation 33), by the cosine of the microfacet's normal.
pub fn distribution(cosine: f32, alpha: f32) -> f32 {
    let a2 = alpha * alpha;
    let bump = cosine * cosine * (a2 - 1.0) + 1.0;
    a2 * FRAC_1_PI / (bump * bump)
}

/// The height-correlated masking and shadowing over 4·cos·cos (Heitz 2014, Equation 99).
fn visibility(cos_l: f32, cos_v: f32, alpha: f32) -> f32 {
    let a2 = alpha * alpha;
    let part = |a: f32, b: f32| a * (b * b * (1.0 - a2) + a2).sqrt();
    0.5 / (part(cos_l, cos_v) + part(cos_v, cos_l)).max(1e-9)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn glosses() -> Vec<Gloss> {
        vec![
            Gloss::None,
            Gloss::Phong { specular: Vec3::splat(0.4), exponent: 20.0 },
            Gloss::Ggx { specular: Vec3::splat(0.5), roughness: 0.5 },
            Gloss::Table(Arc::new(BrdfTable::from_function("test", |_, diff, _| Vec3::splat(0.2 + 0.1 * diff.cos())))),
        ]
    }

    fn direction(u: f32, v: f32) -> Vec3 {
        let (sin, cos) = (TAU * v).sin_cos();
        let radius = u.sqrt();
        Vec3::new(radius * cos, (1.0 - u).sqrt(), radius * sin)
    }

    #[test]
    fn functions_are_reciprocal_and_keep_energy() {
        for gloss in glosses() {
            let materials = Materials::new([Some((Vec3::splat(0.5), &gloss))].into_iter());
            for view in [0.05, 0.5, 0.9] {
                let v = direction(view, 0.1);
                let mut reflected = 0.0;
                let n = 64 * 64;
                for k in 0..n {
                    let [x, y, ..] = sobol_burley::sample_4d(k, 0, 3);
                    let l = direction(x, y);
                    let there = materials.value(0, Vec3::Y, l, v, 0.0).x;
                    let back = materials.value(0, Vec3::Y, v, l, 0.0).x;
                    assert!((there - back).abs() <= 2e-3 * there.max(0.1), "{gloss:?}: {there} {back}");
                    reflected += there * std::f32::consts::PI / n as f32;
                }
                assert!(reflected > 0.2 && reflected < 1.0, "{gloss:?} at {view}: {reflected}");
            }
        }
    }

    /// Without a diffuse part and with a mirror's Fresnel factor, smooth GGX reflects nearly everything.
    #[test]
    fn the_lobes_are_normalised() {
        for gloss in
            [Gloss::Phong { specular: Vec3::ONE, exponent: 30.0 }, Gloss::Ggx { specular: Vec3::ONE, roughness: 0.4 }]
        {
            let materials = Materials::new([Some((Vec3::ZERO, &gloss))].into_iter());
            let n = 256 * 256;
            let reflected: f32 = (0..n)
                .map(|k| {
                    let [x, y, ..] = sobol_burley::sample_4d(k, 0, 3);
                    materials.value(0, Vec3::Y, direction(x, y), Vec3::Y, 0.0).x * std::f32::consts::PI / n as f32
                })
                .sum();
            assert!((reflected - 1.0).abs() < 0.06, "{gloss:?}: {reflected}");
        }
    }
}
