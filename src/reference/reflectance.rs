//! How much the ground truth's mirrors reflect, by its own formulas: Fresnel's equations in real numbers, the colour of a
//! spectrum from the CIE's tables. Of the engine it shares the description of the finish and the metals' measured constants.

use glam::{DMat3, DVec3};

use pinspot_base::reflectance::{Finish, Metal};

/// A facet's reflectance by the cosine of the angle of incidence, tabulated.
pub(super) struct Reflectance {
    /// At equal steps of the cosine, from 0 to 1.
    values: Vec<DVec3>,
}

/// So many that interpolation costs nothing.
const POINTS: usize = 2048;

impl Reflectance {
    pub fn new(finish: &Finish) -> Self {
        let last = (POINTS - 1) as f64;
        Self { values: (0..POINTS).map(|k| of_facet(finish, k as f64 / last)).collect() }
    }

    /// At a cosine in [0, 1].
    pub fn at(&self, cosine: f64) -> DVec3 {
        let place = cosine.clamp(0.0, 1.0) * (POINTS - 1) as f64;
        let below = (place.floor() as usize).min(POINTS - 2);
        let part = place - below as f64;
        self.values[below] * (1.0 - part) + self.values[below + 1] * part
    }

    /// The largest of any channel at any angle.
    pub fn largest(&self) -> f64 {
        self.values.iter().map(|v| v.max_element()).fold(0.0, f64::max)
    }
}

/// For unpolarised light. What lies outside of Rec.709's gamut is cut off: no surface reflects more light than there is.
fn of_facet(finish: &Finish, cosine: f64) -> DVec3 {
    let factors = finish.reflectance;
    let unclamped = match (finish.metal, finish.coat) {
        (None, None) => factors,
        (None, Some(coat)) => factors.to_array().map(|factor| mean(under_coat(cosine, coat, |_| [factor; 2]))).into(),
        (Some(metal), None) => factors * colour(|nm| DVec3::splat(mean(fresnel(cosine, index(metal, nm))))),
        // The factor belongs to the metal, not to the coat above it.
        (Some(metal), Some(coat)) => colour(|nm| {
            let [n, k] = index(metal, nm);
            let metal = |inside| fresnel(inside, [n / coat, k / coat]);
            let channel = |factor: f64| mean(under_coat(cosine, coat, |inside| metal(inside).map(|r| factor * r)));
            factors.to_array().map(channel).into()
        }),
    };
    unclamped.clamp(DVec3::ZERO, DVec3::ONE)
}

fn mean([s, p]: [f64; 2]) -> f64 {
    0.5 * (s + p)
}

fn index(metal: Metal, nm: f64) -> [f64; 2] {
    let index = metal.index(nm);
    [index.re, index.im]
}

/// Fresnel's equations for s- and p-polarised light on a medium of relative refractive index n + ik, in real numbers
/// (Born & Wolf, *Principles of Optics*, Section 14.4; the form that renderers use).
fn fresnel(cosine: f64, [n, k]: [f64; 2]) -> [f64; 2] {
    if cosine <= 0.0 {
        return [1.0; 2];
    }
    let (cos2, sin2) = (cosine * cosine, 1.0 - cosine * cosine);
    let difference = n * n - k * k - sin2;
    // (a + ib)² = (n + ik)² − sin²
    let squares = difference.hypot(2.0 * n * k);
    let a = (0.5 * (squares + difference)).max(0.0).sqrt();
    let s = (squares + cos2 - 2.0 * a * cosine) / (squares + cos2 + 2.0 * a * cosine);
    let (even, odd) = (cos2 * squares + sin2 * sin2, 2.0 * a * cosine * sin2);
    [s, s * (even - odd) / (even + odd)]
}

/// A base below a smooth, clear coat, for s and p: the incoherent sum over all paths between the two (Stokes, *On the
/// Intensity of the Light Reflected from or Transmitted through a Pile of Plates*, 1862). `base` gets the cosine in the coat.
fn under_coat(cosine: f64, coat: f64, base: impl Fn(f64) -> [f64; 2]) -> [f64; 2] {
    let upper = fresnel(cosine, [coat, 0.0]);
    let sine = (1.0 - cosine * cosine).sqrt() / coat;
    let lower = base((1.0 - sine * sine).max(0.0).sqrt());
    [0, 1].map(|k| {
        let (u, l) = (upper[k], lower[k]);
        if u < 1.0 { (u + l - 2.0 * u * l) / (1.0 - u * l) } else { 1.0 }
    })
}

/// Three spectral reflectances as linear Rec.709 red, green and blue under D65, whose white is (1, 1, 1).
fn colour(spectra: impl Fn(f64) -> DVec3) -> DVec3 {
    // By output channel: each is a weighted sum over the spectrum that belongs to it.
    let (mut sum, mut white) = (DVec3::ZERO, DVec3::ZERO);
    for (k, (observer, daylight)) in OBSERVER.iter().zip(D65).enumerate() {
        let weights = rec709_from_xyz() * DVec3::from(*observer) * daylight;
        sum += weights * spectra(380.0 + 10.0 * k as f64);
        white += weights;
    }
    sum / white
}

/// The inverse of the matrix whose columns are the primaries of ITU-R BT.709, scaled to D65's white.
fn rec709_from_xyz() -> DMat3 {
    DMat3::from_cols_array_2d(&[
        [3.2404542, -0.9692660, 0.0556434],
        [-1.5371385, 1.8760108, -0.2040259],
        [-0.4985314, 0.0415560, 1.0572252],
    ])
}

/// CIE 1931 standard observer (CIE 15, Table T.4), every 10 nm from 380 to 780 nm.
const OBSERVER: [[f64; 3]; 41] = [
    [0.0014, 0.0000, 0.0065],
    [0.0042, 0.0001, 0.0201],
    [0.0143, 0.0004, 0.0679],
    [0.0435, 0.0012, 0.2074],
    [0.1344, 0.0040, 0.6456],
    [0.2839, 0.0116, 1.3856],
    [0.3483, 0.0230, 1.7471],
    [0.3362, 0.0380, 1.7721],
    [0.2908, 0.0600, 1.6692],
    [0.1954, 0.0910, 1.2876],
    [0.0956, 0.1390, 0.8130],
    [0.0320, 0.2080, 0.4652],
    [0.0049, 0.3230, 0.2720],
    [0.0093, 0.5030, 0.1582],
    [0.0633, 0.7100, 0.0782],
    [0.1655, 0.8620, 0.0422],
    [0.2904, 0.9540, 0.0203],
    [0.4334, 0.9950, 0.0087],
    [0.5945, 0.9950, 0.0039],
    [0.7621, 0.9520, 0.0021],
    [0.9163, 0.8700, 0.0017],
    [1.0263, 0.7570, 0.0011],
    [1.0622, 0.6310, 0.0008],
    [1.0026, 0.5030, 0.0003],
    [0.8544, 0.3810, 0.0002],
    [0.6424, 0.2650, 0.0],
    [0.4479, 0.1750, 0.0],
    [0.2835, 0.1070, 0.0],
    [0.1649, 0.0610, 0.0],
    [0.0874, 0.0320, 0.0],
    [0.0468, 0.0170, 0.0],
    [0.0227, 0.0082, 0.0],
    [0.0114, 0.0041, 0.0],
    [0.0058, 0.0021, 0.0],
    [0.0029, 0.0010, 0.0],
    [0.0014, 0.0005, 0.0],
    [0.0007, 0.0002, 0.0],
    [0.0003, 0.0001, 0.0],
    [0.0002, 0.0001, 0.0],
    [0.0001, 0.0, 0.0],
    [0.0, 0.0, 0.0],
];

/// Relative spectral power of CIE standard illuminant D65 (CIE 15, Table T.1) at the same wavelengths.
const D65: [f64; 41] = [
    49.98, 54.65, 82.75, 91.49, 93.43, 86.68, 104.86, 117.01, 117.81, 114.86, 115.92, 108.81, 109.35, 107.80, 104.79,
    107.69, 104.41, 104.05, 100.00, 96.33, 95.79, 88.69, 90.01, 89.60, 87.70, 83.29, 83.70, 80.03, 80.21, 82.28, 78.28,
    69.72, 71.61, 74.35, 61.60, 69.89, 75.09, 63.59, 46.42, 66.81, 63.38,
];

#[cfg(test)]
mod tests {
    use super::*;

    /// Formulas and tables of two hands: the engine has complex numbers and a fit of the observer.
    #[test]
    fn the_engines_reflectances_are_these() {
        for metal in Metal::ALL.map(Some).into_iter().chain([None]) {
            for coat in [None, Some(1.0), Some(1.5), Some(2.4)] {
                let reflectance = DVec3::new(0.9, 0.5, 1.0);
                let finish = Finish { reflectance, metal, coat, roughness: 0.0 };
                let own = Reflectance::new(&finish);
                for cosine in [0.03, 0.2, 0.5, 0.8, 1.0] {
                    let (found, engines) = (own.at(cosine), finish.reflectance_at(cosine));
                    assert!(found.abs_diff_eq(engines, 3e-3), "{finish:?} at {cosine}: {found}, {engines}");
                }
            }
        }
    }

    #[test]
    fn brewsters_angle_and_the_middle_of_white_are_known() {
        assert!(fresnel(1.5f64.atan().cos(), [1.5, 0.0])[1] < 1e-20);
        assert!(colour(|_| DVec3::splat(0.4)).abs_diff_eq(DVec3::splat(0.4), 1e-12));
        let (x, y) = {
            let sum: DVec3 = OBSERVER.iter().zip(D65).map(|(o, d)| DVec3::from(*o) * d).sum();
            (sum.x / sum.element_sum(), sum.y / sum.element_sum())
        };
        assert!((x - 0.3127).abs() < 3e-4 && (y - 0.3290).abs() < 3e-4, "D65's white is at {x}, {y}");
    }
}
