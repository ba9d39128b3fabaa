//! What an interface between two media does to a ray that the camera sends out: it goes on as a reflected and a refracted one.

use glam::{DVec3, Vec3};

use crate::pinhole::constants::MIN_HEIGHT;
use crate::reflectance::interface;
use crate::scene::{Ray, Refractor};
use crate::tracing::Hit;

/// The part of a ray that is refracted.
pub struct Refracted {
    /// Its unit direction.
    pub direction: Vec3,
    /// The radiance that comes back along the ray, relative to that which arrives from there. Radiance changes with the square of the
    /// refractive index (Veach, *Robust Monte Carlo Methods for Light Transport Simulation*, Section 5.2).
    pub factor: f32,
}

/// The ray divided at a hit of an interface, for light of the relative refractive index `eta`: the reflectance, and what is refracted,
/// unless all is reflected.
pub fn divided(refractor: &Refractor, eta: f64, (found, ray): (&Hit, &Ray)) -> (f32, Option<Refracted>) {
    // The index of the medium that the ray enters over that of the one that it leaves.
    let entered = if found.front { eta } else { 1.0 / eta };
    let (direction, normal) = (ray.direction.normalize().as_dvec3(), found.normal.as_dvec3());
    // Interpolated normals may look away from the ray.
    let cosine = (-direction.dot(normal)).clamp(0.0, 1.0);
    let beyond2 = 1.0 - (1.0 - cosine * cosine) / (entered * entered);
    if beyond2 <= 0.0 {
        return (1.0, None);
    }
    let [s, p] = interface(cosine, entered.into());
    let reflectance = if refractor.fresnel { 0.5 * (s + p) } else { 0.0 };
    let refracted = (direction / entered + (cosine / entered - beyond2.sqrt()) * normal).normalize();
    let factor = (1.0 - reflectance) / (entered * entered);
    (reflectance as f32, Some(Refracted { direction: inwards(refracted, found), factor: factor as f32 }))
}

/// An interpolated normal may refract back through the triangle, at grazing angles.
fn inwards(direction: DVec3, found: &Hit) -> Vec3 {
    let direction = direction.as_vec3();
    let depth = -direction.dot(found.face_normal);
    (direction - (MIN_HEIGHT - depth).max(0.0) * found.face_normal).normalize()
}

/// The colours of a ray that are refracted alike: factors on its channels, and their index.
pub fn colours(refractor: &Refractor, throughput: Vec3) -> impl Iterator<Item = (Vec3, f64)> {
    let eta = refractor.eta;
    let count = if refractor.is_dispersive() { 3 } else { 1 };
    let of_channel =
        move |k: usize| if count == 1 { (throughput, eta.x) } else { (throughput * Vec3::AXES[k], eta[k]) };
    (0..count).map(of_channel).filter(|(throughput, _)| *throughput != Vec3::ZERO)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Interfaces;

    fn hit(front: bool) -> Hit {
        Hit { object: 0, position: Vec3::ZERO, distance: 1.0, normal: Vec3::Y, face_normal: Vec3::Y, front }
    }

    /// A ray into water and back out of it along the same way: its factors cancel but for what is reflected.
    #[test]
    fn rays_come_back_the_way_that_they_went() {
        let water = Refractor { eta: DVec3::splat(1.333), fresnel: true, interfaces: Interfaces::One };
        let direction = Vec3::new(0.6, -0.8, 0.0);
        let (reflected, refracted) = divided(&water, 1.333, (&hit(true), &Ray { origin: Vec3::Y, direction }));
        let Refracted { direction: within, factor } = refracted.unwrap();
        assert!((within.x - 0.6 / 1.333).abs() < 1e-6 && within.y < 0.0);
        let back = Vec3::new(within.x, within.y, within.z);
        let (again, refracted) = divided(&water, 1.333, (&hit(false), &Ray { origin: Vec3::Y, direction: back }));
        let out = refracted.unwrap();
        assert!(out.direction.abs_diff_eq(direction, 1e-5), "{}", out.direction);
        assert!((reflected - again).abs() < 1e-6, "one reflectance from both sides");
        assert!((factor * out.factor - (1.0 - reflected).powi(2)).abs() < 1e-5);
    }

    #[test]
    fn beyond_the_critical_angle_all_is_reflected() {
        let water = Refractor { eta: DVec3::splat(1.333), fresnel: false, interfaces: Interfaces::One };
        let ray = |direction: Vec3| Ray { origin: Vec3::Y, direction };
        assert!(divided(&water, 1.333, (&hit(false), &ray(Vec3::new(0.8, -0.6, 0.0)))).1.is_none());
        let (reflected, refracted) = divided(&water, 1.333, (&hit(false), &ray(Vec3::new(0.6, -0.8, 0.0))));
        assert!(reflected == 0.0 && (refracted.unwrap().factor - 1.333 * 1.333).abs() < 1e-5);
    }
}
