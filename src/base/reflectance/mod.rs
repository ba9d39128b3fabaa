//! Specular reflectance of mirrors by angle of incidence, in linear Rec.709: metals and clear coats by the Fresnel
//! equations, from published optical constants. Independent of geometry and scenes.

mod fresnel;
mod ggx;
mod metals;
mod spectrum;

pub use fresnel::{coated, interface};
pub use metals::Metal;
pub use spectrum::{WAVELENGTHS, rec709_of_reflectance};

use glam::DVec3;

/// A mirror's material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Finish {
    /// Factor on the reflectance below the coat, per channel, in [0, 1]; without a metal, the reflectance at all
    /// angles.
    pub reflectance: DVec3,
    /// The metal; `None`: a constant reflectance.
    pub metal: Option<Metal>,
    /// The refractive index of a smooth clear coat, from 1 to 4.
    pub coat: Option<f64>,
    /// From 0 (smooth) to 1: the square root of the width α of the GGX distribution, as in most material formats.
    pub roughness: f64,
}

impl Finish {
    /// Width α of the GGX distribution of microfacets (Walter et al. 2007, Section 5.2): roughness² (Burley 2012,
    /// Section 5.4).
    pub fn alpha(&self) -> f64 {
        self.roughness * self.roughness
    }

    /// Whether the reflectance is the same at all angles.
    pub fn is_constant(&self) -> bool {
        self.metal.is_none() && self.coat.is_none() && self.roughness == 0.0
    }

    /// The reflectance of a microfacet, or of a smooth surface, for unpolarised light, by the cosine of the angle of
    /// incidence in [0, 1]. Channels that are outside [0, 1] as a metal's colour is outside Rec.709's gamut (gold's red, by 4.5 %) are cut off:
    /// no surface reflects more light than there is.
    pub fn reflectance_at(&self, cosine: f64) -> DVec3 {
        let unclamped = match (self.metal, self.coat) {
            (None, None) => self.reflectance,
            (None, Some(coat)) => self.reflectance.to_array().map(|r| mean(coated(cosine, coat, |_| [r; 2]))).into(),
            (Some(metal), None) => {
                self.reflectance * rec709_of_reflectance(|nm| mean(interface(cosine, metal.index(nm))))
            }
            (Some(metal), Some(coat)) => {
                // The factor applies to the metal only, so that the coat's reflection keeps the light's colour.
                let channel = |k: usize| {
                    let factor = self.reflectance[k];
                    let below = |nm, inside| interface(inside, metal.index(nm) / coat).map(|r| factor * r);
                    rec709_of_reflectance(|nm| mean(coated(cosine, coat, |inside| below(nm, inside))))[k]
                };
                DVec3::new(channel(0), channel(1), channel(2))
            }
        };
        unclamped.clamp(DVec3::ZERO, DVec3::ONE)
    }
}

fn mean([s, p]: [f64; 2]) -> f64 {
    0.5 * (s + p)
}

/// The directional albedo of a mirror, at equal steps of the cosine of the angle of incidence, from 0 to 1.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    values: Vec<DVec3>,
}

impl Curve {
    /// Evaluates a material at this many cosines; at least two.
    pub fn new(finish: &Finish, points: usize) -> Self {
        let facets = Self::of_facets(finish, points);
        if finish.roughness == 0.0 {
            return facets;
        }
        let whole = |cosine| ggx::directional_albedo(cosine, finish.alpha(), |on_facet| facets.at(on_facet));
        Self::tabulated(points, whole)
    }

    /// Like [`Self::new`], for a single microfacet.
    pub fn of_facets(finish: &Finish, points: usize) -> Self {
        Self::tabulated(points, |cosine| finish.reflectance_at(cosine))
    }

    fn tabulated(points: usize, value: impl Fn(f64) -> DVec3) -> Self {
        let last = (points.max(2) - 1) as f64;
        Self { values: (0..points.max(2)).map(|k| value(k as f64 / last)).collect() }
    }

    /// The values, from grazing to perpendicular incidence.
    pub fn values(&self) -> &[DVec3] {
        &self.values
    }

    /// Linear interpolation at a cosine in [0, 1].
    pub fn at(&self, cosine: f64) -> DVec3 {
        let place = cosine.clamp(0.0, 1.0) * (self.values.len() - 1) as f64;
        let first = (place as usize).min(self.values.len() - 2);
        self.values[first].lerp(self.values[first + 1], place - first as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn finish(metal: Option<Metal>, coat: Option<f64>) -> Finish {
        Finish { reflectance: DVec3::ONE, metal, coat, roughness: 0.0 }
    }

    /// Colours of metals at perpendicular incidence as other tables have them (Hoffman, *Physics and Math of Shading*,
    /// 2015, from the same or like constants, linear Rec.709).
    #[test]
    fn metals_have_their_known_colours() {
        for (metal, [r, g, b]) in [
            (Metal::Silver, [0.97, 0.96, 0.91]),
            (Metal::Gold, [1.00, 0.77, 0.34]),
            (Metal::Copper, [0.96, 0.64, 0.54]),
            (Metal::Aluminium, [0.91, 0.92, 0.92]),
            (Metal::Chromium, [0.55, 0.56, 0.55]),
            (Metal::Brass, [0.91, 0.78, 0.42]),
        ] {
            let found = finish(Some(metal), None).reflectance_at(1.0);
            assert!(found.abs_diff_eq(DVec3::new(r, g, b), 0.07), "{metal:?}: {found}");
        }
    }

    #[test]
    fn nothing_reflects_more_light_than_there_is() {
        for (metal, coat) in Metal::ALL.into_iter().flat_map(|metal| [None, Some(1.5)].map(|coat| (metal, coat))) {
            for value in Curve::new(&finish(Some(metal), coat), 32).values() {
                assert!(value.min_element() >= 0.0 && value.max_element() <= 1.0, "{metal:?} {coat:?}: {value}");
            }
        }
    }

    #[test]
    fn everything_mirrors_all_light_at_grazing_incidence() {
        for metal in Metal::ALL.map(Some).into_iter().chain([None]) {
            for coat in [None, Some(1.5)] {
                if metal.is_none() && coat.is_none() {
                    continue;
                }
                let found = finish(metal, coat).reflectance_at(0.0);
                assert!(found.abs_diff_eq(DVec3::ONE, 1e-9), "{metal:?} {coat:?}: {found}");
            }
        }
    }

    /// A curve of 128 points is as accurate as the equations, except in the step next to grazing incidence, which is
    /// irrelevant.
    #[test]
    fn curves_follow_the_equations() {
        for metal in Metal::ALL.map(Some).into_iter().chain([None]) {
            for coat in [None, Some(1.5)] {
                let finish = Finish { reflectance: DVec3::new(1.0, 0.5, 0.0), metal, coat, roughness: 0.0 };
                let curve = Curve::new(&finish, 128);
                for k in 0..1000 {
                    let cosine = f64::from(k) / 999.0;
                    let (exact, found) = (finish.reflectance_at(cosine), curve.at(cosine));
                    let most = if cosine < 1.0 / 127.0 { 5e-3 } else { 1.5e-3 };
                    assert!(found.abs_diff_eq(exact, most), "{finish:?} at {cosine}: {found} for {exact}");
                }
            }
        }
    }

    #[test]
    fn a_coat_that_is_air_changes_nothing() {
        for metal in Metal::ALL {
            let (bare, coated) = (finish(Some(metal), None), finish(Some(metal), Some(1.0)));
            for cosine in [0.1, 0.5, 1.0] {
                assert!(bare.reflectance_at(cosine).abs_diff_eq(coated.reflectance_at(cosine), 1e-12));
            }
        }
    }
}
