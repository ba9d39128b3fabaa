//! What receivers reflect to the camera, in f64 and from the textbooks' formulas, so that nothing is shared with the engine but a
//! table's entries.

use std::f64::consts::{FRAC_PI_2, PI};

use glam::DVec3;

use crate::scene::Receiver;
use pinspot_base::brdf::Gloss;

/// f(l, v), 1/sr, for unit vectors above a surface with unit normal n.
pub(super) fn value(receiver: &Receiver, n: DVec3, l: DVec3, v: DVec3) -> DVec3 {
    let (cos_l, cos_v) = (n.dot(l), n.dot(v));
    if cos_l <= 0.0 || cos_v <= 0.0 {
        return DVec3::ZERO;
    }
    let diffuse = receiver.albedo.as_dvec3() / PI;
    match &receiver.gloss {
        Gloss::None => diffuse,
        Gloss::Phong { specular, exponent } => {
            let exponent = f64::from(*exponent);
            let mirrored = 2.0 * cos_l * n - l;
            let lobe = mirrored.dot(v).max(0.0).powf(exponent);
            diffuse + specular.as_dvec3() * ((exponent + 2.0) / (2.0 * PI) * lobe)
        }
        Gloss::Ggx { specular, roughness } => {
            let specular = specular.as_dvec3();
            let alpha = f64::from(*roughness).powi(2);
            let fresnel = |c: f64| specular + (DVec3::ONE - specular) * (1.0 - c).powi(5);
            let h = (l + v).normalize();
            let tan2 = |c: f64| 1.0 / (c * c) - 1.0;
            let facets =
                1.0 / (PI * alpha * alpha * n.dot(h).powi(4) * (1.0 + tan2(n.dot(h)) / (alpha * alpha)).powi(2));
            let lambda = |c: f64| 0.5 * ((1.0 + alpha * alpha * tan2(c)).sqrt() - 1.0);
            let lobe = facets / ((1.0 + lambda(cos_l) + lambda(cos_v)) * 4.0 * cos_l * cos_v);
            diffuse * (DVec3::ONE - fresnel(cos_l)) * (DVec3::ONE - fresnel(cos_v)) + fresnel(l.dot(h)) * lobe
        }
        Gloss::Table(table) => tabulated(table.entries(), n, l, v),
    }
}

/// The entry that the directions fall into, as the database's own reader looks it up.
fn tabulated(entries: &[[f32; 4]], n: DVec3, l: DVec3, v: DVec3) -> DVec3 {
    let h = (l + v).normalize();
    let turned = n.angle_between(h);
    // l as seen with h where n is, by the rotation about the axis across both.
    let seen = match n.cross(h).try_normalize() {
        Some(axis) => glam::DQuat::from_axis_angle(axis, -turned) * l,
        None => l,
    };
    let away = (h - n.dot(h) * n).try_normalize().unwrap_or_else(|| n.any_orthonormal_vector());
    let phi = seen.dot(n.cross(away)).atan2(seen.dot(away)).rem_euclid(PI);
    let step = |part: f64, steps: usize| ((part * steps as f64) as usize).min(steps - 1);
    let half = step((turned / FRAC_PI_2).sqrt(), 90);
    let difference = step(l.angle_between(h) / FRAC_PI_2, 90);
    let [r, g, b, _] = entries[(half * 90 + difference) * 180 + step(phi / PI, 180)];
    DVec3::new(r.into(), g.into(), b.into())
}
