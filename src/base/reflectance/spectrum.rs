//! Converts spectral reflectances to linear Rec.709, under daylight (CIE D65, the white point of Rec.709).

use glam::{DMat3, DVec3};

/// The range of integration, nanometres.
pub const WAVELENGTHS: std::ops::RangeInclusive<u32> = 380..=780;
const STEP: usize = 5;

/// The colour of a spectral reflectance (by wavelength in nanometres) under D65; a perfect reflector is exactly 1.
pub fn rec709_of_reflectance(reflectance: impl Fn(f64) -> f64) -> DVec3 {
    let mut colour = DVec3::ZERO;
    let mut white = DVec3::ZERO;
    for nm in WAVELENGTHS.step_by(STEP) {
        let nm = f64::from(nm);
        let seen = d65(nm) * observer(nm);
        white += seen;
        colour += reflectance(nm) * seen;
    }
    // Each channel is relative to white, so that errors of the observer's fit cancel.
    (rec709_from_xyz() * colour) / (rec709_from_xyz() * white)
}

/// CIE XYZ to linear Rec.709 (ITU-R BT.709 primaries, D65).
fn rec709_from_xyz() -> DMat3 {
    DMat3::from_cols(
        DVec3::new(3.2404542, -0.9692660, 0.0556434),
        DVec3::new(-1.5371385, 1.8760108, -0.2040259),
        DVec3::new(-0.4985314, 0.0415560, 1.0572252),
    )
}

/// The CIE 1931 standard observer as fitted by Wyman, Sloan and Shirley, *Simple Analytic Approximations to the CIE XYZ
/// Color Matching Functions*, JCGT 2(2), 2013: the multi-lobe fit.
fn observer(nm: f64) -> DVec3 {
    let lobe = |height: f64, centre: f64, below: f64, above: f64| {
        let slope = if nm < centre { below } else { above };
        height * (-0.5 * ((nm - centre) * slope).powi(2)).exp()
    };
    DVec3::new(
        lobe(0.362, 442.0, 0.0624, 0.0374) + lobe(1.056, 599.8, 0.0264, 0.0323) + lobe(-0.065, 501.1, 0.0490, 0.0382),
        lobe(0.821, 568.8, 0.0213, 0.0247) + lobe(0.286, 530.9, 0.0613, 0.0322),
        lobe(1.217, 437.0, 0.0845, 0.0278) + lobe(0.681, 459.0, 0.0385, 0.0725),
    )
}

/// The relative spectral power of CIE standard illuminant D65 (CIE 15), tabulated every 10 nm.
fn d65(nm: f64) -> f64 {
    const TABLE: [f64; 41] = [
        49.98, 54.65, 82.75, 91.49, 93.43, 86.68, 104.86, 117.01, 117.81, 114.86, 115.92, 108.81, 109.35, 107.80,
        104.79, 107.69, 104.41, 104.05, 100.00, 96.33, 95.79, 88.69, 90.01, 89.60, 87.70, 83.29, 83.70, 80.03, 80.21,
        82.28, 78.28, 69.72, 71.61, 74.35, 61.60, 69.89, 75.09, 63.59, 46.42, 66.81, 63.38,
    ];
    let place = (nm - 380.0) / 10.0;
    let first = (place as usize).min(TABLE.len() - 2);
    let t = place - first as f64;
    (1.0 - t) * TABLE[first] + t * TABLE[first + 1]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The tables are typed in: their white point shows a slip.
    #[test]
    fn white_is_d65() {
        let sum: DVec3 = WAVELENGTHS.step_by(STEP).map(|nm| d65(f64::from(nm)) * observer(f64::from(nm))).sum();
        let (x, y) = (sum.x / sum.element_sum(), sum.y / sum.element_sum());
        assert!((x - 0.3127).abs() < 0.002 && (y - 0.3290).abs() < 0.002, "x {x}, y {y}");
    }

    #[test]
    fn equal_reflectance_is_grey_and_long_waves_are_red() {
        assert!(rec709_of_reflectance(|_| 0.4).abs_diff_eq(DVec3::splat(0.4), 1e-12));
        let red = rec709_of_reflectance(|nm| if nm > 600.0 { 1.0 } else { 0.0 });
        assert!(red.x > 0.5 && red.y.abs() < 0.1 && red.z.abs() < 0.05, "{red}");
    }
}
