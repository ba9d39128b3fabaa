//! Light by one mirror or interface: the integral over all of them (Wand & Straßer, Equation 1), with or without occlusion.
//!
//! For a receiver at p with normal n_p and a mirror point x with normal n, d = x − p and r = d − 2(d·n)n, the integrand is
//! ρ · L(r̂) · ⟨n, −d̂⟩⁺ · ⟨n_p, d̂⟩⁺ / |d|², per m² of mirror. In a medium the transmittance of |d| is a further factor, and for a point of
//! it the phase function stands instead of ⟨n_p, d̂⟩⁺. For a receiver behind an interface r̂ is the refracted direction, ⟨n, d̂⟩⁺
//! the cosine, and the factor that of `refraction`. Regions are nodes of a hierarchy over each object's triangles,
//! and below them parts of a triangle, with bounds from a sphere around their points and a cone around their normals.

use glam::DVec3;

use super::cone::Cone;
use super::domain::{Domain, Fineness, Lighting, ON_SURFACES, Place, Receiver};
use super::emitters::Emitters;
use super::geometry::{Geometry, Triangle};
use super::lamps::Lamps;
use super::light::Light;
use super::lit_surfaces::LitSurfaces;
use super::medium::Medium;
use super::reflectance::Reflectance;
use super::reflector_light::{Numbers, Point};
use super::refraction::Interface;
use super::seen::{Corner, Seen, sine_to_line};
use super::tree::{Bounds, Content, Part, Tree, WHOLE};
use super::{Options, Quantity, brdf};
use crate::scene::{Chain, Chains, Object, Receiver as Surface, Reflector, Scene, Sides, Specular, Visibility};

/// Triangles are halved at most this many times.
const MAX_DEPTH: u8 = 32;
/// The radians that e times the distance counts for where either a piece of a line of sight or a region is to be split.
const NEARER: f64 = 0.25;

/// All that mirrors or refracts, as a tree.
pub(super) struct Reflectors<'a> {
    pub(super) geometry: &'a Geometry,
    pub(super) light: &'a Light,
    pub(super) lamps: &'a Lamps,
    pub(super) emitters: &'a Emitters,
    pub(super) visibility: Visibility,
    attenuation: bool,
    pub(super) medium: Option<Medium>,
    pub(super) chains: Chains,
    /// Light through one closed object and another counts, and there are several.
    pub(super) follows_two_solids: bool,
    /// What mirrors show of surfaces in the light of lamps.
    pub(super) surfaces: LitSurfaces<'a>,
    /// By object, where what they reflect to the camera is in question.
    viewed: Option<Vec<Option<Surface>>>,
    materials: Vec<Option<Material>>,
    pub(super) reflectances: Vec<Reflectance>,
    tree: Tree,
    /// The brightest light.
    pub(super) brightest: f64,
}

#[derive(Clone, Copy)]
struct Material {
    surface: Kind,
    /// −1 where light falls on the back.
    side: f64,
}

#[derive(Clone, Copy)]
enum Kind {
    Mirror(Mirror),
    Interface(Interface),
}

#[derive(Clone, Copy)]
pub(super) struct Mirror {
    /// In `reflectances`.
    pub(super) reflectance: usize,
    /// The largest of any channel at any angle.
    pub(super) most_reflectance: f64,
    pub(super) alpha: f64,
    pub(super) two_sided: bool,
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
    pub fn new(
        scene: &Scene,
        geometry: &'a Geometry,
        (light, lamps, emitters): (&'a Light, &'a Lamps, &'a Emitters),
        options: &Options,
    ) -> Self {
        let mut reflectances = Vec::new();
        let chains = options.chains;
        let material = |o: &Object| {
            let specular = o.specular()?;
            let surface = match specular {
                Specular::Reflector(reflector) if chains.reflected => {
                    reflectances.push(Reflectance::new(&reflector.finish));
                    Kind::Mirror(Mirror::new(&reflector, &reflectances))
                }
                Specular::Refractor(refractor) => Kind::Interface(Interface::new(&refractor)),
                Specular::Reflector(_) => return None,
            };
            Some(Material { surface, side: if specular.sides() == Sides::Back { -1.0 } else { 1.0 } })
        };
        let materials: Vec<_> = scene.objects.iter().map(material).collect();
        let solids = scene.objects.iter().filter(|object| object.casts(Chain::TTTT)).count();
        let sides: Vec<_> = materials.iter().map(|m| m.as_ref().map(|m| m.side)).collect();
        let tree = Tree::new(geometry, &sides);
        Self {
            geometry,
            light,
            lamps,
            emitters,
            surfaces: LitSurfaces::new(scene, geometry, (lamps, emitters), options.visibility),
            visibility: options.visibility,
            attenuation: options.attenuation,
            medium: Medium::of_scene(scene),
            chains,
            follows_two_solids: chains.refracted_four_times && solids > 1,
            viewed: (options.quantity == Quantity::Reflected)
                .then(|| scene.objects.iter().map(|o| o.receiver.clone()).collect()),
            materials,
            reflectances,
            tree,
            brightest: light.bound(&Cone::everything()).max(emitters.brightest()),
        }
    }

    /// Takes another environment and other lamps, but for what they bring to surfaces that mirrors show.
    pub fn set_light(&mut self, light: &'a Light, lamps: &'a Lamps) {
        (self.light, self.lamps) = (light, lamps);
        self.brightest = light.bound(&Cone::everything()).max(self.emitters.brightest());
    }

    fn material(&self, object: u32) -> Material {
        self.materials[object as usize].expect("only what mirrors or refracts is in the tree")
    }

    /// The interface of an object that is closed.
    pub(super) fn closed_interface(&self, object: u32) -> Option<Interface> {
        match self.materials[object as usize].as_ref()?.surface {
            Kind::Interface(interface) if interface.is_closed => Some(interface),
            _ => None,
        }
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

    /// Of the way from a point of a surface to a receiver at whose direction the normal has this cosine: the medium is behind interfaces,
    /// unless these enclose an object.
    fn transmittance(&self, material: &Material, cosine: f64, distance: f64) -> DVec3 {
        match (&self.medium, material.surface) {
            (Some(_), Kind::Interface(interface)) if cosine < 0.0 && !interface.is_closed => DVec3::ONE,
            (Some(medium), _) => medium.transmittance(distance),
            (None, _) => DVec3::ONE,
        }
    }

    /// The largest one of the ways through the medium from a region.
    pub(super) fn most_transmittance(&self, seen: &Seen) -> f64 {
        self.medium.as_ref().map_or(1.0, |medium| medium.most_transmittance(seen.gap()))
    }

    fn distance_factor(&self, squared_distance: f64) -> f64 {
        if self.attenuation { 1.0 / squared_distance } else { 1.0 }
    }
}

/// The mirrored direction.
pub(super) fn reflect(d: DVec3, n: DVec3) -> DVec3 {
    d - 2.0 * d.dot(n) * n
}

impl Mirror {
    pub(super) const PERFECT: Self = Self { reflectance: 0, most_reflectance: 1.0, alpha: 0.0, two_sided: false };

    /// Of a reflector whose reflectance is the last one.
    fn new(reflector: &Reflector, reflectances: &[Reflectance]) -> Self {
        let last = reflectances.len() - 1;
        Self {
            reflectance: last,
            // α = roughness² (Burley 2012, Section 5.4).
            alpha: reflector.finish.roughness.powi(2),
            most_reflectance: reflectances[last].largest(),
            two_sided: reflector.sides == Sides::Both,
        }
    }
}

impl Domain for Reflectors<'_> {
    type Region = Region;
    type Receiver = Receiver;

    fn fineness(&self) -> Fineness {
        let is_closed = |m: &Material| matches!(m.surface, Kind::Interface(interface) if interface.is_closed);
        let passes = self.chains.refracted_twice || self.follows_two_solids;
        if passes && self.materials.iter().flatten().any(is_closed) {
            // What comes through is known for small regions only.
            return Fineness { worthwhile: 0.8, least_splits: 512, ..ON_SURFACES };
        }
        ON_SURFACES
    }

    fn roots(&self, visit: &mut dyn FnMut(Region)) {
        for &node in &self.tree.roots {
            visit(Region { node, depth: 0, path: 0, corners: WHOLE });
        }
    }

    fn measure(&self, region: &Region) -> f64 {
        self.tree.nodes[region.node as usize].bounds.area * 0.5f64.powi(i32::from(region.depth))
    }

    fn bound(&self, region: &Region, receiver: &Receiver) -> f64 {
        let seen = Seen::new(self.bounds(region), receiver);
        if seen.received == 0.0 {
            return 0.0;
        }
        let triangle = match self.tree.nodes[region.node as usize].content {
            Content::Triangle(id) => Some(id),
            Content::Inner { .. } => None,
        };
        let corners = triangle.map(|id| self.corners(&self.geometry.triangles[id as usize], region, receiver));
        let seen = Seen { triangle, corners, ..seen };
        let nearest = seen.nearest;
        let light = match self.material(seen.bounds.object).surface {
            Kind::Mirror(mirror) => self.mirrored(&mirror, &seen, receiver) * self.most_transmittance(&seen),
            Kind::Interface(interface) => self.through(&interface, &seen, receiver),
        };
        light * self.distance_factor(nearest * nearest)
    }

    fn split(&self, region: &Region, _: &Receiver, visit: &mut dyn FnMut(Region)) {
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

    fn needs_all_numbers(&self) -> bool {
        let is_rough = |m: &Material| matches!(m.surface, Kind::Mirror(mirror) if mirror.alpha > 0.0);
        self.surfaces.brightest > 0.0 || self.materials.iter().flatten().any(is_rough)
    }

    fn integrand(&self, region: &Region, u: [f64; 8], receiver: &Receiver) -> DVec3 {
        let [mut choice, u, v, facet_u, facet_v, _, surface_u, surface_v] = u;
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
        let numbers = Numbers { facet: [facet_u, facet_v], surface: [surface_u, surface_v] };
        self.at(id, barycentric, receiver, numbers)
    }
}

impl Lighting for Reflectors<'_> {
    fn angles(&self, region: &Region, piece: &Receiver) -> [f64; 2] {
        let bounds = self.bounds(region);
        let turn = match self.material(bounds.object).surface {
            Kind::Mirror(_) => 2.0 * bounds.normals.half_angle,
            Kind::Interface(_) => bounds.normals.half_angle,
        };
        let distance = piece.distance(bounds.centre).max(0.25 * bounds.radius);
        // Along the line of sight directions stay, but distances and cosines do not.
        let across = sine_to_line(bounds.centre - piece.position, bounds.radius, piece.view).max(NEARER);
        [bounds.radius / distance + turn, across * piece.half_length() / distance]
    }
}

impl Reflectors<'_> {
    /// What a receiver reflects to the camera of light from a direction, 1/sr.
    fn seen_part(&self, surfaces: &[Option<Surface>], receiver: &Receiver, from: DVec3) -> DVec3 {
        let Place::Surface { normal, triangle } = receiver.place else { return DVec3::ONE };
        let object = self.geometry.triangles[triangle as usize].object;
        let surface = surfaces[object as usize].as_ref();
        surface.map_or(DVec3::ZERO, |surface| brdf::value(surface, normal, from, receiver.view))
    }

    /// The integrand at a point of a triangle.
    fn at(&self, id: u32, barycentric: [f64; 3], receiver: &Receiver, numbers: Numbers) -> DVec3 {
        let triangle = &self.geometry.triangles[id as usize];
        let material = self.material(triangle.object);
        let (x, n) = (triangle.position(barycentric), material.side * triangle.normal(barycentric));
        let d = x - receiver.position;
        let (distance, received) = (d.length(), receiver.received(d));
        let towards = d / distance;
        let cosine = towards.dot(n);
        if received <= 0.0 || !material.surface.lights(cosine) {
            return DVec3::ZERO;
        }
        if self.visibility == Visibility::Full
            && self.geometry.blocks_segment(receiver.position, x, [receiver.triangle(), id])
        {
            return DVec3::ZERO;
        }
        let point = Point { id, position: x, normal: n, towards, cosine };
        let light = match material.surface {
            Kind::Mirror(mirror) => self.light_mirrored_at(&mirror, &point, numbers),
            Kind::Interface(interface) => self.light_through(&interface, &point, numbers),
        };
        let seen = match &self.viewed {
            None => DVec3::ONE,
            Some(surfaces) => self.seen_part(surfaces, receiver, towards),
        };
        let squared = distance * distance;
        let dimmed = self.transmittance(&material, cosine, distance);
        seen * dimmed * light * (cosine.abs() * received / distance * self.distance_factor(squared))
    }
}

impl Kind {
    /// Whether it sends light to a receiver, by the cosine between the direction from there and the normal.
    fn lights(&self, cosine: f64) -> bool {
        match self {
            Self::Mirror(mirror) => {
                if mirror.two_sided {
                    cosine != 0.0
                } else {
                    cosine < 0.0
                }
            }
            Self::Interface(_) => cosine != 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::receivers::Receivers;
    use super::*;
    use glam::Vec3;
    use rand::{RngExt, SeedableRng};

    /// Walks down from a random root by random splits and checks the integrand at random points on the way: it must not
    /// exceed the region's bound (but where the receiver touches the region, and the bound does not promise it).
    #[test]
    fn nothing_exceeds_its_bound() {
        let mut rng = rand::rngs::ChaCha8Rng::seed_from_u64(1);
        let options = Options { visibility: Visibility::None, ..Default::default() };
        let built_in = |name| (name, crate::scene::load::<toml::Table>(name).unwrap().scene);
        let scenes = ["ring", "ring-solid", "cup", "spoon", "disco-ball", "dynamic"].map(built_in);
        let waters =
            ["eta = 1.333", "eta = [1.3, 1.5, 1.7], fresnel = false", "eta = 0.7"].map(|water| ("water", waves(water)));
        for (name, scene) in scenes.into_iter().chain(waters) {
            let geometry = Geometry::new(&scene);
            let light = Light::new(&scene.environment).unwrap();
            let lamps = Lamps::of_scene(&scene, DVec3::ZERO);
            let emitters = Emitters::of_scene(&scene, DVec3::ZERO);
            let domain = Reflectors::new(&scene, &geometry, (&light, &lamps, &emitters), &options);
            let receivers = Receivers::find(&scene, (&geometry, &emitters), [24, 16], 1);
            for pixel in 0..24 * 16 {
                let Some(receiver) = receivers.of_pixel(pixel)[0] else { continue };
                for _ in 0..20 {
                    check_one_path(name, &domain, &receiver, &mut rng);
                }
            }
        }
    }

    /// The same for pieces of lines of sight through a medium.
    #[test]
    fn nothing_in_the_medium_exceeds_its_bound() {
        let mut rng = rand::rngs::ChaCha8Rng::seed_from_u64(4);
        let options = Options { visibility: Visibility::None, ..Default::default() };
        let built_in = |name| (name, crate::scene::load::<toml::Table>(name).unwrap().scene);
        let waters = ["eta = 1.333", "eta = [1.3, 1.5, 1.7], fresnel = false", "eta = 0.7"];
        let waters = waters.map(|water| ("water", waves(water)));
        for (name, mut scene) in ["ring", "cup", "disco-ball", "dynamic"].map(built_in).into_iter().chain(waters) {
            let g = rng.random_range(-0.9..0.9);
            let sigma_s = Vec3::new(0.3, 0.1, 2.0);
            scene.medium = Some(crate::scene::Medium { sigma_s, sigma_a: Vec3::splat(0.1), g });
            let geometry = Geometry::new(&scene);
            let light = Light::new(&scene.environment).unwrap();
            let medium = Medium::of_scene(&scene).unwrap();
            let extinction = medium.extinction_before_surfaces();
            let lamps = Lamps::of_scene(&scene, extinction);
            let emitters = Emitters::of_scene(&scene, extinction);
            let domain = Reflectors::new(&scene, &geometry, (&light, &lamps, &emitters), &options);
            let mut everywhere = medium;
            everywhere.is_behind_interfaces = false;
            let sights = Receivers::through(&everywhere, &scene, [24, 16], 1);
            for pixel in 0..24 * 16 {
                let Some(sight) = sights.of_pixel(pixel)[0] else { continue };
                let length = 10f64.powf(rng.random_range(-4.0..0.0));
                let from = rng.random_range(0.0..1.0 - length);
                let piece = sight.piece([from, from + length], medium.phase);
                for _ in 0..20 {
                    check_one_path(name, &domain, &piece, &mut rng);
                }
            }
        }
    }

    /// Waves, seen from above and from below, between two planes.
    fn waves(refractor: &str) -> Scene {
        let text = format!(
            "[environment]\nmap = \"forest\"\n[camera]\nposition = [0.0, 0.0, 0.0]\ntarget = [0.0, 0.0, 1.0]\nup = [0.0, 1.0, 0.0]\n\
             perspective = {{ fov_y_deg = 120.0 }}\n[[object]]\nshape = {{ sheet = {{ size = [2.0, 2.0], amplitude = 0.06 }} }}\n\
             camera_visible = false\nrefractor = {{ {refractor} }}\n[[object]]\nshape = {{ plane = {{ size = [3.0, 3.0] }} }}\n\
             translate = [0.0, -0.5, 0.0]\nreceiver = {{}}\n[[object]]\nshape = {{ plane = {{ size = [3.0, 3.0] }} }}\n\
             rotate_deg = [180.0, 0.0, 0.0]\ntranslate = [0.0, 0.6, 0.0]\nreceiver = {{}}\n"
        );
        crate::scene::parse::<toml::Table>("waves", &text, std::path::Path::new(".")).unwrap().scene
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
            let distance = receiver.distance(bounds.centre);
            let bound = domain.bound(&region, receiver);
            for _ in 0..4 {
                let off = receiver.half_length() * rng.random_range(-1.0..=1.0);
                let point = Receiver { position: receiver.position + off * receiver.view, ..*receiver };
                let got = domain.integrand(&region, [(); 8].map(|()| rng.random()), &point).element_sum();
                assert!(
                    got <= bound * (1.0 + 1e-6) + 1e-12 || distance < 1.25 * bounds.radius,
                    "{name}: {got} > {bound} at distance {distance}, radius {}, normals {}, depth {}",
                    bounds.radius,
                    bounds.normals.half_angle,
                    region.depth
                );
            }
            parts.clear();
            domain.split(&region, receiver, &mut |part| parts.push(part));
        }
    }
}
