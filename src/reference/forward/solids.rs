//! Rays through closed objects: where they leave them, and where they pass another one.

use super::rays::{Caster, Leaving, Rays};
use crate::refraction::{Interface, refract};

impl Rays<'_> {
    /// The ray that leaves the closed object that one has entered, and the part of the light that does.
    pub(super) fn leave(
        &self,
        (object, interface): (u32, &Interface),
        entered: &Leaving,
        channel: usize,
    ) -> Option<(Leaving, f64)> {
        let hit = self.next_hit(entered)?;
        let exit = &self.geometry.triangles[hit.triangle as usize];
        if exit.object != object {
            return None;
        }
        let eta = interface.index(channel);
        let (position, normal) = (exit.position(hit.barycentric), exit.normal(hit.barycentric));
        let cosine = entered.direction.dot(normal);
        let passed = interface.factor(cosine, eta) / (eta * eta);
        let direction = refract(entered.direction, normal, eta);
        (cosine > 0.0 && passed > 0.0).then_some((Leaving { id: hit.triangle, position, direction }, passed))
    }

    /// The ray that has passed the next closed object, and the part of the light that does; `None` if it meets something else.
    pub(super) fn pass_another(&self, left: &Leaving, channel: usize) -> Option<(Leaving, f64)> {
        let hit = self.next_hit(left)?;
        let entry = &self.geometry.triangles[hit.triangle as usize];
        let Caster::Interface(interface) = self.casters[entry.object as usize].as_ref()? else { return None };
        let (position, normal) = (entry.position(hit.barycentric), entry.normal(hit.barycentric));
        let cosine = -left.direction.dot(normal);
        if !interface.is_closed || cosine <= 0.0 {
            return None;
        }
        let eta = interface.index(channel);
        let passed = interface.passed_from_front(cosine, eta);
        let direction = refract(left.direction, -normal, 1.0 / eta);
        let entered = Leaving { id: hit.triangle, position, direction };
        let (ray, part) = self.leave((entry.object, interface), &entered, channel)?;
        (passed > 0.0).then_some((ray, passed * part))
    }
}
