//! The exact Fresnel equations for smooth interfaces: dielectrics and conductors, bare and under a clear coat.

use num_complex::Complex64;

/// Reflectances of an interface for s- and p-polarised light, by the cosine of the angle of incidence in [0, 1];
/// `index` is the relative complex refractive index n + ik (Born & Wolf, *Principles of Optics*, §§1.5.2, 14.2).
pub fn interface(cosine: f64, index: Complex64) -> [f64; 2] {
    let behind = (1.0 - (1.0 - cosine * cosine) / (index * index)).sqrt();
    let s = (cosine - index * behind) / (cosine + index * behind);
    let p = (index * cosine - behind) / (index * cosine + behind);
    [s.norm_sqr().min(1.0), p.norm_sqr().min(1.0)]
}

/// Reflectances of a base under a smooth clear coat of refractive index `coat`, for s and p. Light is reflected
/// repeatedly within the coat; thick coats show no interference, so that intensities add up to a geometric series.
/// `base` gets the cosine inside the coat.
pub fn coated(cosine: f64, coat: f64, base: impl Fn(f64) -> [f64; 2]) -> [f64; 2] {
    let outer = interface(cosine, coat.into());
    let inside = (1.0 - (1.0 - cosine * cosine) / (coat * coat)).max(0.0).sqrt();
    let inner = base(inside);
    [0, 1].map(|k| {
        let through = (1.0 - outer[k]) * (1.0 - outer[k]);
        // No light enters a perfect interface; avoids 0/0 for a perfect base.
        if through == 0.0 { 1.0 } else { outer[k] + through * inner[k] / (1.0 - outer[k] * inner[k]) }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(a: f64, b: f64) -> bool {
        (a - b).abs() < 1e-12
    }

    #[test]
    fn perpendicular_incidence_has_a_closed_form() {
        for (n, k) in [(1.5, 0.0), (0.2, 3.0), (3.2, 3.3)] {
            let expected = ((n - 1.0_f64).powi(2) + k * k) / ((n + 1.0).powi(2) + k * k);
            let [s, p] = interface(1.0, Complex64::new(n, k));
            assert!(close(s, expected) && close(p, expected));
        }
    }

    #[test]
    fn brewsters_angle_mirrors_no_p() {
        let eta: f64 = 1.5;
        let [s, p] = interface(eta.atan().cos(), eta.into());
        assert!(p < 1e-25);
        assert!(close(s, ((1.0 - eta * eta) / (1.0 + eta * eta)).powi(2)));
    }

    #[test]
    fn dense_to_thin_mirrors_all_beyond_the_critical_angle() {
        let eta = 1.0 / 1.5;
        assert!(interface(0.7, eta.into()).iter().all(|r| close(*r, 1.0)), "critical cosine is 0.745");
        assert!(interface(0.8, eta.into())[0] < 0.5);
    }

    /// The textbook's conductor formula in real numbers (Born & Wolf; as in Mitsuba and pbrt).
    #[test]
    fn conductors_agree_with_the_formula_in_real_numbers() {
        for (n, k) in [(0.05_f64, 3.6_f64), (0.42, 2.4), (3.2, 3.3)] {
            for cosine in [0.05_f64, 0.3, 0.7, 1.0] {
                let (cos2, sin2) = (cosine * cosine, 1.0 - cosine * cosine);
                let t0 = n * n - k * k - sin2;
                let a2b2 = (t0 * t0 + 4.0 * n * n * k * k).sqrt();
                let a = (0.5 * (a2b2 + t0)).max(0.0).sqrt();
                let s = (a2b2 + cos2 - 2.0 * a * cosine) / (a2b2 + cos2 + 2.0 * a * cosine);
                let (t3, t4) = (cos2 * a2b2 + sin2 * sin2, 2.0 * a * cosine * sin2);
                let p = s * (t3 - t4) / (t3 + t4);
                let found = interface(cosine, Complex64::new(n, k));
                assert!((found[0] - s).abs() < 1e-9 && (found[1] - p).abs() < 1e-9, "{found:?} for {s}, {p}");
            }
        }
    }

    /// Over a black base only the coat reflects; over a perfect mirror nothing is lost.
    #[test]
    fn coats_keep_the_energy() {
        for cosine in [0.0, 0.2, 0.9, 1.0] {
            let bare = interface(cosine, 1.5.into());
            let black = coated(cosine, 1.5, |_| [0.0; 2]);
            let perfect = coated(cosine, 1.5, |_| [1.0; 2]);
            for k in 0..2 {
                assert!(close(black[k], bare[k]) && close(perfect[k], 1.0));
            }
        }
    }
}
