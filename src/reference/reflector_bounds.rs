//! Bounds of what regions of mirrors and interfaces send to a receiver, from which the density of points is made.

use std::f64::consts::{FRAC_PI_2, PI};

use glam::DVec3;

use super::cone::{Cone, angle};
use super::domain::Receiver;
use super::reflectors::{Mirror, Reflectors, reflect};
use super::refraction::{Interface, Refracted, refract};
use super::seen::Seen;
use super::tree::Bounds;

/// Widths of a rough mirror's lobe within which light counts in full for the density,
const LOBES: f64 = 2.0;
/// and the part of the brightest light that counts everywhere, per roughness.
const TAILS: f64 = 0.01;

impl Reflectors<'_> {
    /// At least the largest sum of the channels that a region mirrors to a receiver, over the attenuation.
    pub(super) fn mirrored(&self, mirror: &Mirror, seen: &Seen, receiver: &Receiver) -> f64 {
        let Seen { bounds, towards, received, .. } = seen;
        let spread = towards.half_angle;
        let mut facing = bounds.normals.largest_cosine(-towards.axis, spread);
        if mirror.two_sided {
            facing = facing.max(bounds.normals.largest_cosine(towards.axis, spread));
        }
        let cosines = if mirror.two_sided {
            seen.nearer_cosines(received * facing, true, receiver)
        } else {
            seen.cosines_on_one_side(facing, receiver)
        };
        if cosines == 0.0 {
            return 0.0;
        }
        // How far the mirrored direction can lie from that at the centre.
        let turn = spread + 2.0 * bounds.normals.half_angle;
        let light = match &seen.corners {
            // To first order the mirrored directions fill the triangle between those at the corners.
            Some(corners) if turn < 0.4 && mirror.alpha == 0.0 => {
                let directions = corners.map(|c| reflect(c.offset.normalize(), c.normal));
                self.light_over(bounds, directions, 1.5 * turn * turn + seen.swing, 2)
            }
            _ => {
                let lobe = 2.0 * (LOBES * mirror.alpha).atan();
                let axis = reflect(towards.axis, bounds.normals.axis);
                let cone = Cone { axis, half_angle: (turn + lobe).min(PI) };
                if mirror.alpha == 0.0 {
                    self.light_within(bounds, &cone)
                } else {
                    // What the tails of a lobe reach; no bound, but enough that nothing is left out.
                    let emitted = self.emitters.bound((bounds.centre, bounds.radius), &cone);
                    let likely = self.light.bound(&cone).max(emitted).max(TAILS * mirror.alpha * self.brightest);
                    likely + self.surfaces.brightest + self.blurred_lamps(mirror.alpha, facing, bounds, &cone)
                }
            }
        };
        cosines * mirror.most_reflectance * light
    }

    /// The same for an interface, which reflects to receivers in front of it and refracts to those behind: a region may have both sides
    /// towards a receiver.
    pub(super) fn through(&self, interface: &Interface, seen: &Seen, receiver: &Receiver) -> f64 {
        let reflected =
            if self.chains.reflected && interface.reflects() { self.reflected(interface, seen, receiver) } else { 0.0 };
        if interface.is_closed {
            return reflected + self.bound_through_solid(interface, seen, receiver);
        }
        let refracted = if self.chains.refracted { self.refracted(interface, seen, receiver) } else { 0.0 };
        reflected.max(refracted)
    }

    fn reflected(&self, interface: &Interface, seen: &Seen, receiver: &Receiver) -> f64 {
        let Cone { axis, half_angle } = seen.towards;
        let flattest = angle(-axis, seen.bounds.normals.axis) + half_angle + seen.bounds.normals.half_angle;
        let most_reflectance = interface.reflectance(flattest.min(FRAC_PI_2).cos()).max_element();
        self.mirrored(&Mirror { most_reflectance, ..Mirror::PERFECT }, seen, receiver)
    }

    fn refracted(&self, interface: &Interface, seen: &Seen, receiver: &Receiver) -> f64 {
        let Seen { bounds, towards, received, .. } = seen;
        let facing = bounds.normals.largest_cosine(towards.axis, towards.half_angle);
        let cosines = seen.nearer_cosines(received * facing, true, receiver);
        if cosines == 0.0 {
            return 0.0;
        }
        let light = |eta: &f64| {
            let Refracted { cone, bend, stretch, factor } = interface.refracted(towards, &bounds.normals, *eta);
            let light = match &seen.corners {
                _ if factor == 0.0 => 0.0,
                Some(corners) if cone.half_angle < 0.4 && bend + stretch * seen.swing < cone.half_angle => {
                    let directions = corners.map(|c| refract(c.offset.normalize(), c.normal, *eta));
                    self.light_over(bounds, directions, bend + stretch * seen.swing, 2)
                }
                _ => self.light_within(bounds, &cone),
            };
            light * factor
        };
        cosines * interface.indices().iter().map(light).sum::<f64>() * self.most_transmittance(seen)
    }

    /// At least the largest radiance over a triangle of directions and `margin` around it; long triangles are cut in two.
    fn light_over(&self, bounds: &Bounds, directions: [DVec3; 3], margin: f64, cuts: u32) -> f64 {
        let around = Cone::around(&directions);
        let [a, b, c] = longest_first(directions);
        let long = a.distance(b);
        let high = (c - a).cross(b - a).length() / long.max(f64::MIN_POSITIVE);
        if cuts == 0 || long < 4.0 * margin.max(high) {
            return self.light_within(bounds, &Cone { half_angle: (around.half_angle + margin).min(PI), ..around });
        }
        let middle = (a + b).normalize();
        let over = |half: [DVec3; 3]| self.light_over(bounds, half, margin, cuts - 1);
        over([a, middle, c]).max(over([middle, b, c]))
    }

    /// At least the largest sum of the channels that arrives at any point of a region in a cone of directions.
    pub(super) fn light_within(&self, bounds: &Bounds, cone: &Cone) -> f64 {
        let lamps = if self.lamps.is_empty() { 0.0 } else { self.lamps.bound((bounds.centre, bounds.radius), cone) };
        let emitted = self.emitters.bound((bounds.centre, bounds.radius), cone);
        self.light.bound(cone).max(emitted) + lamps + self.surfaces.bound((bounds.centre, bounds.radius), cone)
    }

    /// What lamps add to that for a rough mirror whose cosine towards the receiver is at most `facing`, and whose lobe lies in a cone.
    fn blurred_lamps(&self, alpha: f64, facing: f64, bounds: &Bounds, cone: &Cone) -> f64 {
        if self.lamps.is_empty() {
            return 0.0;
        }
        let region = (bounds.centre, bounds.radius);
        let likely = self.lamps.bound_of_irradiance(region, cone);
        let anywhere = self.lamps.bound_of_irradiance(region, &Cone::everything());
        let densest = 1.0 / (4.0 * PI * alpha * alpha * facing.max(0.05));
        densest * likely.max(TAILS * alpha * anywhere)
    }
}

/// The corners of a triangle, turned so that the longest edge is between the first two.
fn longest_first(corners: [DVec3; 3]) -> [DVec3; 3] {
    let edge = |k: usize| corners[k].distance_squared(corners[(k + 1) % 3]);
    let longest = (0..3).max_by(|a, b| edge(*a).total_cmp(&edge(*b))).unwrap_or(0);
    [0, 1, 2].map(|k| corners[(longest + k) % 3])
}
