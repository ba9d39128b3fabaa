//! Light by one mirror: the integral over all reflectors (Wand & Straßer, Equation 1), with or without occlusion.
//!
//! For a receiver at p with normal n_p and a mirror point x with normal n, d = x − p and r = d − 2(d·n)n, the integrand is
//! ρ · L(r̂) · ⟨n, −d̂⟩⁺ · ⟨n_p, d̂⟩⁺ / |d|², per m² of mirror. Regions are nodes of a hierarchy over each object's triangles,
//! and below them parts of a triangle, with bounds from a sphere around their points and a cone around their normals.

use std::f64::consts::PI;

use glam::DVec3;

use super::cone::{Cone, angle};
use super::domain::{Domain, Receiver};
use super::geometry::{Geometry, Triangle};
use super::gloss;
use super::light::Light;
use super::reflectance::Reflectance;
use super::tree::{Bounds, Content, Part, Tree, WHOLE};
use super::{Options, Quantity, brdf};
use crate::scene::{Object, Receiver as Surface, Scene, Sides, Visibility};

/// Widths of a rough mirror's lobe within which light counts in full for the density,
const LOBES: f64 = 2.0;
/// and the part of the brightest light that counts everywhere, per roughness.
const TAILS: f64 = 0.01;
/// Triangles are halved at most this many times.
const MAX_DEPTH: u8 = 32;

/// All that mirrors, as a tree.
pub(super) struct Reflectors<'a> {
    geometry: &'a Geometry,
    light: &'a Light,
    visibility: Visibility,
    attenuation: bool,
    /// By object, where what they reflect to the camera is in question.
    viewed: Option<Vec<Option<Surface>>>,
    materials: Vec<Option<Material>>,
    reflectances: Vec<Reflectance>,
    tree: Tree,
    /// The brightest light.
    brightest: f64,
}

#[derive(Clone, Copy)]
struct Material {
    /// In `reflectances`.
    reflectance: usize,
    /// The largest of any channel at any angle.
    most_reflectance: f64,
    alpha: f64,
    two_sided: bool,
    /// −1 where the back mirrors.
    side: f64,
}

/// A node, or a part of the triangle of a leaf.
#[derive(Clone, Copy)]
pub(super) struct Region {
    node: u32,
    /// Halvings of the triangle, and which half of each, a bit a level.
    depth: u8,
    path: u32,
    /// Corners of the part, barycentric.
    corners: Part,
}

impl<'a> Reflectors<'a> {
    pub fn new(scene: &Scene, geometry: &'a Geometry, light: &'a Light, options: &Options) -> Self {
        let mut reflectances = Vec::new();
        let material = |o: &Object| {
            let reflector = o.reflector?;
            let reflectance = Reflectance::new(&reflector.finish);
            let most_reflectance = reflectance.largest();
            reflectances.push(reflectance);
            Some(Material {
                reflectance: reflectances.len() - 1,
                // α = roughness² (Burley 2012, Section 5.4).
                alpha: reflector.finish.roughness.powi(2),
                most_reflectance,
                two_sided: reflector.sides == Sides::Both,
                side: if reflector.sides == Sides::Back { -1.0 } else { 1.0 },
            })
        };
        let materials: Vec<_> = scene.objects.iter().map(material).collect();
        let sides: Vec<_> = materials.iter().map(|m| m.as_ref().map(|m| m.side)).collect();
        let tree = Tree::new(geometry, &sides);
        Self {
            geometry,
            light,
            visibility: options.visibility,
            attenuation: options.attenuation,
            viewed: (options.quantity == Quantity::Reflected)
                .then(|| scene.objects.iter().map(|o| o.receiver.clone()).collect()),
            materials,
            reflectances,
            tree,
            brightest: light.bound(&Cone::everything()),
        }
    }

    fn material(&self, object: u32) -> Material {
        self.materials[object as usize].expect("only reflectors are in the tree")
    }

    fn bounds(&self, region: &Region) -> Bounds {
        let node = &self.tree.nodes[region.node as usize];
        match node.content {
            Content::Triangle(id) if region.depth > 0 => Bounds::of_part(
                &self.geometry.triangles[id as usize],
                &region.corners,
                self.material(node.bounds.object).side,
            ),
            _ => node.bounds,
        }
    }

    fn corners(&self, triangle: &Triangle, region: &Region, receiver: &Receiver) -> [Corner; 3] {
        let side = self.material(triangle.object).side;
        region
            .corners
            .map(|b| Corner { offset: triangle.position(b) - receiver.position, normal: side * triangle.normal(b) })
    }

    /// At least the largest radiance that a small part of a triangle mirrors. To first order the mirrored directions fill
    /// the triangle between those at the corners; the second order is below 1.5 · `turn`².
    fn mirrored_light(&self, corners: &[Corner; 3], turn: f64) -> f64 {
        let directions = corners.map(|c| reflect(c.offset.normalize(), c.normal));
        self.light_over(directions, 1.5 * turn * turn, 2)
    }

    /// At least the largest radiance over a triangle of directions and `margin` around it; long triangles are cut in two.
    fn light_over(&self, directions: [DVec3; 3], margin: f64, cuts: u32) -> f64 {
        let around = Cone::around(&directions);
        let [a, b, c] = longest_first(directions);
        let long = a.distance(b);
        let high = (c - a).cross(b - a).length() / long.max(f64::MIN_POSITIVE);
        if cuts == 0 || long < 4.0 * margin.max(high) {
            return self.light.bound(&Cone { half_angle: (around.half_angle + margin).min(PI), ..around });
        }
        let middle = (a + b).normalize();
        self.light_over([a, middle, c], margin, cuts - 1).max(self.light_over([middle, b, c], margin, cuts - 1))
    }

    fn distance_factor(&self, squared_distance: f64) -> f64 {
        if self.attenuation { 1.0 / squared_distance } else { 1.0 }
    }
}

/// A corner of a part of a triangle, seen from the receiver.
#[derive(Clone, Copy)]
struct Corner {
    offset: DVec3,
    normal: DVec3,
}

fn reflect(d: DVec3, n: DVec3) -> DVec3 {
    d - 2.0 * d.dot(n) * n
}

/// The corners of a triangle, turned so that the longest edge is between the first two.
fn longest_first(corners: [DVec3; 3]) -> [DVec3; 3] {
    let edge = |k: usize| corners[k].distance_squared(corners[(k + 1) % 3]);
    let longest = (0..3).max_by(|a, b| edge(*a).total_cmp(&edge(*b))).unwrap_or(0);
    [0, 1, 2].map(|k| corners[(longest + k) % 3])
}

/// A bound of both cosines times the squared distance where the receiver is so near that directions say little: heights
/// over the receiver's plane and under the mirror's normals are (bi)linear, so their largest values are at corners.
fn near_cosines(corners: &[Corner; 3], bounds: &Bounds, receiver: &Receiver, material: &Material) -> f64 {
    let height = |n: DVec3| corners.iter().map(|c| n.dot(c.offset)).fold(0.0, f64::max);
    let over_receiver = height(receiver.normal);
    let mut under_mirror = corners.iter().map(|c| height(-c.normal)).fold(0.0, f64::max);
    if material.two_sided {
        under_mirror = corners.iter().map(|c| height(c.normal)).fold(under_mirror, f64::max);
    }
    let shortest = bounds.normals.half_angle.cos().max(0.1);
    over_receiver * under_mirror / shortest
}

impl Domain for Reflectors<'_> {
    type Region = Region;

    fn roots(&self, visit: &mut dyn FnMut(Region)) {
        for &node in &self.tree.roots {
            visit(Region { node, depth: 0, path: 0, corners: WHOLE });
        }
    }

    fn measure(&self, region: &Region) -> f64 {
        self.tree.nodes[region.node as usize].bounds.area * 0.5f64.powi(i32::from(region.depth))
    }

    fn bound(&self, region: &Region, receiver: &Receiver) -> f64 {
        let bounds = self.bounds(region);
        let material = self.material(bounds.object);
        let to_centre = bounds.centre - receiver.position;
        let distance = to_centre.length();
        // Within its own sphere a region has no direction; further out the distance is at least this.
        let nearest = (distance - bounds.radius).max(0.25 * bounds.radius);
        let inside = distance <= bounds.radius;
        let towards = if inside { receiver.normal } else { to_centre / distance };
        let spread = if inside { PI } else { (bounds.radius / distance).asin() };
        let received = Cone { axis: towards, half_angle: spread }.largest_cosine(receiver.normal, 0.0);
        if received == 0.0 {
            return 0.0;
        }
        let mut facing = bounds.normals.largest_cosine(-towards, spread);
        if material.two_sided {
            facing = facing.max(bounds.normals.largest_cosine(towards, spread));
        }
        if facing == 0.0 {
            return 0.0;
        }
        let mut cosines = if material.two_sided {
            received * facing
        } else {
            // Light can go between two sides of a surface only as far as their normals differ: d̂·n_p > 0 > d̂·n makes
            // both cosines at most |n_p − n|. That keeps a mirror that receives its own light from being singular.
            let apart = (angle(bounds.normals.axis, receiver.normal) + bounds.normals.half_angle).min(PI);
            let limit = 2.0 * (0.5 * apart).sin();
            received.min(limit) * facing.min(limit)
        };
        // How far the mirrored direction can lie from that at the centre.
        let turn = spread + 2.0 * bounds.normals.half_angle;
        let everything_within = |turn: f64| {
            let lobe = 2.0 * (LOBES * material.alpha).atan();
            let axis = reflect(towards, bounds.normals.axis);
            let likely = self.light.bound(&Cone { axis, half_angle: (turn + lobe).min(PI) });
            // What the tails of a lobe reach; no bound, but enough that nothing is left out.
            likely.max(TAILS * material.alpha * self.brightest)
        };
        let light = match self.tree.nodes[region.node as usize].content {
            Content::Triangle(id) => {
                let corners = self.corners(&self.geometry.triangles[id as usize], region, receiver);
                if distance < 4.0 * bounds.radius {
                    cosines = cosines.min(near_cosines(&corners, &bounds, receiver, &material) / (nearest * nearest));
                    if cosines == 0.0 {
                        return 0.0;
                    }
                }
                if turn < 0.4 && material.alpha == 0.0 {
                    self.mirrored_light(&corners, turn)
                } else {
                    everything_within(turn)
                }
            }
            Content::Inner { .. } => everything_within(turn),
        };
        cosines * self.distance_factor(nearest * nearest) * material.most_reflectance * light
    }

    fn split(&self, region: &Region, visit: &mut dyn FnMut(Region)) {
        match self.tree.nodes[region.node as usize].content {
            Content::Inner { second } => {
                visit(Region { node: region.node + 1, ..*region });
                visit(Region { node: second, ..*region });
            }
            Content::Triangle(id) if region.depth < MAX_DEPTH => {
                // Across the longest edge, so that slivers become compact.
                let triangle = &self.geometry.triangles[id as usize];
                let edge = |k: usize| {
                    let end = |k: usize| triangle.position(region.corners[k % 3]);
                    end(k).distance_squared(end(k + 1))
                };
                let longest = (0..3).max_by(|a, b| edge(*a).total_cmp(&edge(*b))).unwrap_or(0);
                let [a, b, c] = [0, 1, 2].map(|k| region.corners[(longest + k) % 3]);
                let middle = [0, 1, 2].map(|k| 0.5 * (a[k] + b[k]));
                let path = region.path << 1;
                let half = |corners, bit| Region { depth: region.depth + 1, path: path | bit, corners, ..*region };
                visit(half([a, middle, c], 0));
                visit(half([middle, b, c], 1));
            }
            Content::Triangle(_) => {}
        }
    }

    fn order(&self, region: &Region) -> u64 {
        u64::from(region.node) << 32 | u64::from(region.path) << (MAX_DEPTH - region.depth)
    }

    fn is_mean(&self) -> bool {
        self.materials.iter().flatten().any(|m| m.alpha > 0.0)
    }

    fn integrand(&self, region: &Region, [mut choice, u, v, facet_u, facet_v]: [f64; 5], receiver: &Receiver) -> DVec3 {
        let mut node = region.node;
        let id = loop {
            match self.tree.nodes[node as usize].content {
                Content::Triangle(id) => break id,
                Content::Inner { second } => {
                    let first_part =
                        self.tree.nodes[node as usize + 1].bounds.area / self.tree.nodes[node as usize].bounds.area;
                    if choice < first_part {
                        (node, choice) = (node + 1, choice / first_part);
                    } else {
                        (node, choice) = (second, (choice - first_part) / (1.0 - first_part));
                    }
                }
            }
        };
        let [a, b, c] = region.corners;
        let root = u.sqrt();
        let weights = [1.0 - root, root * (1.0 - v), root * v];
        let barycentric = [0, 1, 2].map(|k| weights[0] * a[k] + weights[1] * b[k] + weights[2] * c[k]);
        self.at(id, barycentric, receiver, [facet_u, facet_v])
    }
}

impl Reflectors<'_> {
    /// What a receiver reflects to the camera of light from a direction, 1/sr.
    fn seen_part(&self, surfaces: &[Option<Surface>], receiver: &Receiver, from: DVec3) -> DVec3 {
        let object = self.geometry.triangles[receiver.triangle as usize].object;
        let surface = surfaces[object as usize].as_ref();
        surface.map_or(DVec3::ZERO, |surface| brdf::value(surface, receiver.normal, from, receiver.view))
    }

    /// The integrand at a point of a triangle.
    fn at(&self, id: u32, barycentric: [f64; 3], receiver: &Receiver, facet: [f64; 2]) -> DVec3 {
        let triangle = &self.geometry.triangles[id as usize];
        let material = self.material(triangle.object);
        let (x, n) = (triangle.position(barycentric), material.side * triangle.normal(barycentric));
        let d = x - receiver.position;
        let (squared, dn) = (d.length_squared(), d.dot(n));
        let facing = if material.two_sided { dn.abs() } else { -dn };
        let received = d.dot(receiver.normal);
        if facing <= 0.0 || received <= 0.0 {
            return DVec3::ZERO;
        }
        let out = -d / squared.sqrt();
        let reflectance = &self.reflectances[material.reflectance];
        let (reflected, reflectance) = if material.alpha == 0.0 {
            ((d - 2.0 * dn * n) / squared.sqrt(), reflectance.at(facing / squared.sqrt()))
        } else {
            let seen_side = if dn > 0.0 { -n } else { n };
            let Some(facet) = gloss::facet(seen_side, out, material.alpha, facet) else { return DVec3::ZERO };
            (facet.towards_light, facet.weight * reflectance.at(facet.cosine))
        };
        if self.visibility == Visibility::Full
            && (self.geometry.blocks_segment(receiver.position, x, [receiver.triangle, id])
                || self.geometry.blocks_ray(x, reflected, id))
        {
            return DVec3::ZERO;
        }
        let cosines = facing * received / squared;
        let seen = match &self.viewed {
            None => DVec3::ONE,
            Some(surfaces) => self.seen_part(surfaces, receiver, -out),
        };
        seen * reflectance * self.light.radiance(reflected) * (cosines * self.distance_factor(squared))
    }
}

#[cfg(test)]
mod tests {
    use super::super::receivers::Receivers;
    use super::*;
    use rand::{RngExt, SeedableRng};

    /// Walks down from a random root by random splits and checks the integrand at random points on the way: it must not
    /// exceed the region's bound (but where the receiver touches the region, and the bound does not promise it).
    #[test]
    fn nothing_exceeds_its_bound() {
        let mut rng = rand::rngs::ChaCha8Rng::seed_from_u64(1);
        let options = Options { visibility: Visibility::None, ..Default::default() };
        for name in ["ring", "ring-solid", "cup", "spoon", "disco-ball"] {
            let scene = crate::scene::load::<toml::Table>(name).unwrap().scene;
            let geometry = Geometry::new(&scene);
            let light = Light::new(&scene.environment).unwrap();
            let domain = Reflectors::new(&scene, &geometry, &light, &options);
            let receivers = Receivers::find(&scene, &geometry, [24, 16], 1);
            for pixel in 0..24 * 16 {
                let Some(receiver) = receivers.of_pixel(pixel)[0] else { continue };
                for _ in 0..20 {
                    check_one_path(name, &domain, &receiver, &mut rng);
                }
            }
        }
    }

    fn check_one_path(name: &str, domain: &Reflectors, receiver: &Receiver, rng: &mut impl rand::Rng) {
        let mut parts = Vec::new();
        domain.roots(&mut |root| parts.push(root));
        for _ in 0..40 {
            if parts.is_empty() {
                return;
            }
            let region = parts[rng.random_range(0..parts.len())];
            let bounds = domain.bounds(&region);
            let distance = bounds.centre.distance(receiver.position);
            let bound = domain.bound(&region, receiver);
            for _ in 0..4 {
                let got = domain.integrand(&region, [(); 5].map(|()| rng.random()), receiver).element_sum();
                assert!(
                    got <= bound * (1.0 + 1e-6) + 1e-12 || distance < 1.25 * bounds.radius,
                    "{name}: {got} > {bound} at distance {distance}, radius {}, normals {}, depth {}",
                    bounds.radius,
                    bounds.normals.half_angle,
                    region.depth
                );
            }
            parts.clear();
            domain.split(&region, &mut |part| parts.push(part));
        }
    }
}
