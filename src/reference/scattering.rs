//! Light that the medium scatters once to the camera: the integral over a line of sight and over all that lights its points.
//!
//! The place on the line of sight is one more dimension of the domain: a region is a piece of the line of sight times a region of what
//! lights it, with a bound for all of its points together. So the cut that is made for a pixel finds where on the line there is light,
//! and is itself the density along it, and each replicate is an independent estimate of the whole integral: no places are shared by
//! replicates, and the standard error holds for all dimensions alike.

use glam::DVec3;

use super::domain::{Domain, Fineness, Lighting};
use super::medium::Medium;
use super::sights::Sight;

/// Halvings of a line of sight, at most.
const MOST_HALVINGS: u8 = 40;
/// The radians that a mean free path counts for where either a piece or what lights it is to be split: the light of a piece falls by
/// the factor e along it, but bounds of light depend on directions far more.
const PER_FREE_PATH: f64 = 0.25;
/// Bits of a path that name the root.
const ROOT_BITS: u8 = 16;

/// What is scattered of the light of another domain.
pub(super) struct Scattering<'a, D> {
    pub medium: &'a Medium,
    pub light: D,
}

/// A piece of a line of sight, and a region of what lights it.
#[derive(Clone, Copy)]
pub(super) struct Region<R> {
    lit_by: R,
    /// From and to which part of the line of sight.
    parts: [f64; 2],
    halvings: u8,
    /// Which root, and which part of every split, from the highest bit down; and how many bits that takes.
    path: u64,
    bits: u8,
}

impl<R: Copy> Region<R> {
    /// One part of it, which takes so many bits to name.
    fn part(&self, which: u64, bits: u8) -> Self {
        // What is deeper than the bits reach is neighbours anyway.
        let place = 64u32.checked_sub(u32::from(self.bits + bits));
        let path = self.path | place.map_or(0, |place| which << place);
        Self { path, bits: (self.bits + bits).min(64), ..*self }
    }

    fn halves(&self) -> [Self; 2] {
        let [from, to] = self.parts;
        let middle = 0.5 * (from + to);
        let half = |which, parts| Self { parts, halvings: self.halvings + 1, ..self.part(which, 1) };
        [half(0, [from, middle]), half(1, [middle, to])]
    }
}

impl<D: Lighting> Domain for Scattering<'_, D> {
    type Region = Region<D::Region>;
    type Receiver = Sight;

    /// In three dimensions cuts take more splits to become fine, and the points converge more slowly.
    fn fineness(&self) -> Fineness {
        Fineness { worthwhile: 0.6, refined_above: None, least_splits: 512, fewer_points: 1 }
    }

    fn roots(&self, visit: &mut dyn FnMut(Self::Region)) {
        let mut roots = 0u64;
        self.light.roots(&mut |lit_by| {
            let path = roots << (64 - ROOT_BITS);
            visit(Region { lit_by, parts: [0.0, 1.0], halvings: 0, path, bits: ROOT_BITS });
            roots += 1;
        });
    }

    /// Along the line of sight in parts of its length.
    fn measure(&self, region: &Self::Region) -> f64 {
        (region.parts[1] - region.parts[0]) * self.light.measure(&region.lit_by)
    }

    fn bound(&self, region: &Self::Region, sight: &Sight) -> f64 {
        let piece = sight.piece(region.parts, self.medium.phase);
        let nearest = region.parts[0] * sight.length;
        let light = self.light.bound(&region.lit_by, &piece);
        light * self.medium.scattered_to_camera(nearest).max_element() * sight.length
    }

    /// Splits that which makes directions differ more.
    fn split(&self, region: &Self::Region, sight: &Sight, visit: &mut dyn FnMut(Self::Region)) {
        let piece = sight.piece(region.parts, self.medium.phase);
        let [of_light, of_piece] = self.light.angles(&region.lit_by, &piece);
        let fading = PER_FREE_PATH * self.medium.optical_thickness(2.0 * piece.half_length());
        let can_halve = region.halvings < MOST_HALVINGS;
        if can_halve && of_piece.max(fading) > of_light {
            return region.halves().into_iter().for_each(visit);
        }
        let mut parts = 0u64;
        self.light.split(&region.lit_by, &piece, &mut |lit_by| {
            visit(Region { lit_by, ..region.part(parts, 2) });
            parts += 1;
        });
        if parts == 0 && can_halve {
            region.halves().into_iter().for_each(visit);
        }
    }

    fn order(&self, region: &Self::Region) -> u64 {
        region.path
    }

    fn needs_all_numbers(&self) -> bool {
        true
    }

    fn integrand(&self, region: &Self::Region, u: [f64; 8], sight: &Sight) -> DVec3 {
        let [from, to] = region.parts;
        let part = from + (to - from) * u[5];
        let point = sight.piece([part; 2], self.medium.phase);
        let light = self.light.integrand(&region.lit_by, u, &point);
        light * self.medium.scattered_to_camera(part * sight.length) * sight.length
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use glam::Vec3;

    use super::super::medium::{Phase, transmittance};
    use super::super::{Density, Estimate, Options, Quantity, Reference, StoppingCriterion};
    use super::*;
    use crate::scene::Scene;
    use pinspot_base::NoProgress;

    const DARK: &str = "environment = { constant = [0, 0, 0] }\n";

    fn parsed(text: &str) -> Scene {
        crate::scene::parse::<toml::Table>("t", text, std::path::Path::new(".")).unwrap().scene
    }

    /// One narrow line of sight, from a place in a direction.
    fn looking(from: [f64; 3], towards: [f64; 3]) -> String {
        let target = [0, 1, 2].map(|k| from[k] + towards[k]);
        let up = if towards[1].abs() > 0.9 { "[0, 0, -1]" } else { "[0, 1, 0]" };
        format!(
            "camera = {{ position = {from:?}, target = {target:?}, up = {up}, orthographic = {{ height = 1e-3 }} }}\n"
        )
    }

    fn solved(scene: Scene, options: Options, criterion: &StoppingCriterion) -> Estimate {
        let reference = Reference::new(scene, options).unwrap();
        reference.solve(criterion, None, &NoProgress, &mut |_| Ok(())).unwrap()
    }

    fn one_pixel(text: &str, quantity: Quantity, error: f64) -> DVec3 {
        let options = Options { size: [1, 1], quantity, ..Default::default() };
        solved(parsed(text), options, &StoppingCriterion::new(error)).irradiance.pixels[0].as_dvec3()
    }

    fn assert_close(got: DVec3, expected: DVec3, relative: f64) {
        assert!(got.abs_diff_eq(expected, relative * expected.max_element()), "{got} is not {expected}");
    }

    /// A beam across the line of sight, by a mirror or by an interface that lets it straight through:
    /// L = σs p E (e^(−σt a) − e^(−σt b)) / σt · e^(−σt d) from a to b metres, at a distance d of the surface.
    #[test]
    fn a_beam_across_the_line_of_sight() {
        let (sigma, radiance, g) = (0.01, 1000.0, 0.4);
        let environment = |y: f64| {
            format!(
                "environment.spot = {{ direction = [0, {y:?}, 0], sigma_rad = {sigma:?}, radiance = [{radiance:?}, 500, 0] }}\n"
            )
        };
        let (scattering, extinction) = (DVec3::new(0.3, 0.1, 0.2), DVec3::new(0.4, 0.3, 0.2));
        let medium = format!("medium = {{ sigma_s = [0.3, 0.1, 0.2], sigma_a = [0.1, 0.2, 0.0], g = {g:?} }}\n");
        let plane = "[[object]]\nshape = { plane = { size = [2, 2] } }\n";
        let light = 2.0 * PI * sigma * sigma * DVec3::new(radiance, 500.0, 0.0);
        let (distance, from, to) = (0.5, 2.0, 4.0);
        let along = (transmittance(extinction, from) - transmittance(extinction, to)) / extinction;
        let expected = Phase(g).value(0.0) * scattering * light * along * transmittance(extinction, distance);
        for (y, material) in
            [(-distance, "refractor = { eta = 1.0, fresnel = false }\n"), (distance, "reflector = {}\n")]
        {
            let camera = looking([-3.0, y, 0.1], [1.0, 0.0, 0.0]);
            let text = format!("{medium}{}{camera}{plane}{material}", environment(1.0));
            assert_close(one_pixel(&text, Quantity::Scattered, 0.002), expected, 0.01);
        }
    }

    /// L = σs/σt · L (1 − e^(−σt D)), whatever the phase function.
    #[test]
    fn a_uniform_sky_with_nothing_else() {
        let extinction = DVec3::new(0.5, 0.3, 0.9);
        for g in [-0.7, 0.0, 0.8] {
            let text = format!(
                "environment = {{ constant = [1, 2, 3] }}\nmedium = {{ sigma_s = [0.2, 0.2, 0.9], sigma_a = [0.3, 0.1, 0.0], g = {g:?} }}\n{}",
                looking([0.0, 0.0, 0.0], [0.6, 0.0, 0.8])
            );
            let albedo = DVec3::new(0.2, 0.2, 0.9) / extinction;
            let hidden = transmittance(extinction, 1e4f64.ln() / 0.3);
            let expected = albedo * DVec3::new(1.0, 2.0, 3.0) * (DVec3::ONE - hidden);
            assert_close(one_pixel(&text, Quantity::ScatteredDirect, 5e-4), expected, 0.002);
        }
    }

    /// Against the integral of I p e^(−σt (s + r)) / r² along the line of sight, in steps; behind the floor there is nothing.
    #[test]
    fn a_lamp_beside_the_line_of_sight() {
        let (lamp, length, extinction) = (DVec3::new(0.3, -0.8, 0.1), 2.0, DVec3::splat(0.7));
        let floor = "[[object]]\nshape = { plane = { size = [3, 3] } }\ntranslate = [0, -2, 0]\nreceiver = {}\n";
        let light = "[[light]]\nposition = [0.3, -0.8, 0.1]\nradius = 0.001\nintensity = [1, 2, 3]\n";
        for g in [0.0, 0.6] {
            let medium = format!("medium = {{ sigma_s = 0.5, sigma_a = 0.2, g = {g:?} }}\n");
            let text = format!("{DARK}{medium}{}{floor}{light}", looking([0.0; 3], [0.0, -1.0, 0.0]));
            let steps = 100_000;
            let at = |k: u32| {
                let s = length * (f64::from(k) + 0.5) / f64::from(steps);
                let away = DVec3::new(0.0, -s, 0.0) - lamp;
                let r = away.length();
                Phase(g).value(away.dot(DVec3::Y) / r) * transmittance(extinction, s + r) / (r * r)
            };
            let integral = (0..steps).map(at).sum::<DVec3>() * (length / f64::from(steps));
            let expected = 0.5 * integral * DVec3::new(1.0, 2.0, 3.0);
            assert_close(one_pixel(&text, Quantity::ScatteredDirect, 0.001), expected, 0.004);
        }
    }

    /// A half-polished ball and the light of a lamp and a broad spot, seen through haze; waves from below.
    fn scenes() -> [Scene; 2] {
        let light = "spot = { direction = [0.3, 1, 0.2], sigma_rad = 0.3, radiance = [3, 2, 1] }";
        let ball = format!(
            "environment = {{ {light} }}\nmedium = {{ sigma_s = [0.4, 0.3, 0.2], sigma_a = 0.1, g = 0.5 }}\n\
             camera = {{ position = [0, 0.4, 3], target = [0, 0.3, 0], perspective = {{ fov_y_deg = 35 }} }}\n\
             [[object]]\nshape = {{ sphere = {{ radius = 0.5, divisions = 8 }} }}\nreflector = {{ reflectance = [0.8, 0.8, 0.8] }}\n\
             camera_visible = false\n[[object]]\nshape = {{ plane = {{ size = [4, 4] }} }}\ntranslate = [0, -0.6, 0]\nreceiver = {{}}\n\
             [[light]]\nposition = [-0.7, 0.9, 0.3]\nradius = 0.2\nintensity = [0.5, 0.5, 1]\n"
        );
        let waves = format!(
            "environment = {{ {light} }}\nmedium = {{ sigma_s = [0.4, 0.3, 0.2], sigma_a = 0.1, g = -0.3 }}\n\
             camera = {{ position = [0, -0.7, 2], target = [0, -0.5, 0], perspective = {{ fov_y_deg = 30 }} }}\n\
             [[object]]\nshape = {{ sheet = {{ size = [2, 2], amplitude = 0.06 }} }}\nrefractor = {{ eta = [1.3, 1.33, 1.4] }}\n\
             [[object]]\nshape = {{ plane = {{ size = [4, 4] }} }}\ntranslate = [0, -1, 0]\nreceiver = {{}}\n"
        );
        [ball, waves].map(|text| parsed(&text))
    }

    /// Points that are chosen uniformly over everything, brute force, give the same.
    #[test]
    #[ignore = "full: statistics over many points"]
    fn the_density_changes_nothing() {
        for (scene, quantity) in
            scenes().into_iter().flat_map(|s| [(s.clone(), Quantity::Scattered), (s, Quantity::ScatteredDirect)])
        {
            let of_density = |density, error| {
                let options = Options { size: [4, 3], quantity, density, ..Default::default() };
                solved(scene.clone(), options, &StoppingCriterion::new(error).with_max_points(5e5))
            };
            let (bounded, uniform) = (of_density(Density::Bounded, 0.02), of_density(Density::Uniform, 0.05));
            assert!(bounded.irradiance.pixels.iter().all(|p| *p != Vec3::ZERO));
            println!("{quantity:?}: {:.4} {:.4}", bounded.rel_error(), uniform.rel_error());
            assert!(uniform.rel_error() < 0.15);
            let mut squares = 0.0;
            for k in 0..12 {
                let of = |image: &dyn Fn(&Estimate) -> Vec3| [&bounded, &uniform].map(|e| image(e).as_dvec3());
                let [a, b] = of(&|e| e.irradiance.pixels[k]);
                let [error_a, error_b] = of(&|e| e.standard_error.pixels[k]);
                let off = (a - b) / (error_a * error_a + error_b * error_b).map(f64::sqrt);
                assert!(off.abs().max_element() < 5.0, "{quantity:?}, pixel {k}: {a} {b}, {off} standard errors");
                squares += off.length_squared() / 36.0;
            }
            assert!(squares < 2.5, "{quantity:?}: {squares}");
        }
    }

    /// References with other seeds scatter as their standard errors say.
    #[test]
    fn standard_errors_are_honest() {
        for (scene, quantity) in scenes().into_iter().zip([Quantity::Scattered, Quantity::ScatteredDirect]) {
            let of_seed = |seed| {
                let options = Options { size: [3, 2], quantity, seed, ..Default::default() };
                solved(scene.clone(), options, &StoppingCriterion::new(0.05))
            };
            let estimates: Vec<Estimate> = (0..12).map(of_seed).collect();
            let count = estimates.len() as f64;
            let (mut scatter, mut claimed) = (0.0, 0.0);
            for pixel in 0..6 {
                let means = estimates.iter().map(|e| e.irradiance.pixels[pixel].as_dvec3());
                let mean = means.clone().sum::<DVec3>() / count;
                let size = mean.length_squared();
                scatter += means.map(|m| (m - mean).length_squared()).sum::<f64>() / (count - 1.0) / size;
                let errors = estimates.iter().map(|e| e.standard_error.pixels[pixel].as_dvec3().length_squared());
                claimed += errors.sum::<f64>() / count / size;
            }
            let ratio = (scatter / claimed).sqrt();
            println!("scatter {:.5}, over the standard error {ratio:.3}", (scatter / 6.0).sqrt());
            assert!((0.75..1.3).contains(&ratio), "{ratio}");
        }
    }

    #[test]
    fn without_a_medium_that_scatters_there_is_nothing_to_compute() {
        for medium in ["", "medium = { sigma_a = 0.1 }\n"] {
            let scene = parsed(&format!("{DARK}{medium}{}", looking([0.0; 3], [1.0, 0.0, 0.0])));
            let options = Options { quantity: Quantity::ScatteredDirect, ..Default::default() };
            let message = Reference::new(scene, options).unwrap_err().to_string();
            assert!(message.contains("medium") && message.contains("sigma_s"), "{message}");
        }
    }
}
