//! Lines of sight through the medium: from the camera to what it sees at every point of every pixel.

use glam::DVec3;

use super::domain::{Place, Receiver};
use super::geometry::Geometry;
use super::medium::{Medium, Phase};
use super::receivers::Receivers;
use crate::scene::{Interfaces, Scene};

/// A line of sight.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sight {
    pub origin: DVec3,
    /// Unit vector.
    pub direction: DVec3,
    /// m.
    pub length: f64,
}

impl Sight {
    /// The piece between two parts of its length; for points both are the same.
    pub fn piece(&self, [from, to]: [f64; 2], phase: Phase) -> Receiver {
        let middle = 0.5 * (from + to) * self.length;
        let half_length = 0.5 * (to - from) * self.length;
        Receiver {
            position: self.origin + middle * self.direction,
            view: -self.direction,
            place: Place::Medium { phase, half_length },
        }
    }
}

impl Receivers<Sight> {
    /// All lines of sight, as far as the first thing that the camera sees, or as anything can be seen; none if the camera is not
    /// in the medium.
    pub fn through(medium: &Medium, scene: &Scene, size: [u32; 2], per_edge: u32) -> Self {
        // Light geometry ends them, too.
        let geometry = Geometry::of_objects(scene, |_| true);
        let sight = scene.medium.map_or(0.0, |medium| medium.sight().into());
        let is_within = !medium.is_behind_interfaces || is_behind_interfaces(scene, &geometry);
        Self::at_all_points(&scene.camera, size, per_edge, |(origin, direction)| {
            let hit = geometry.first_hit(origin, direction, |o| scene.objects[o as usize].camera_visible);
            let distance = |hit: super::geometry::Hit| {
                geometry.triangles[hit.triangle as usize].position(hit.barycentric).distance(origin)
            };
            is_within.then(|| Sight { origin, direction, length: hit.map_or(sight, distance) })
        })
    }
}

/// Whether the camera is behind the scene's interfaces: by the first one on the way to the middle of their largest triangle.
fn is_behind_interfaces(scene: &Scene, geometry: &Geometry) -> bool {
    let is_interface = |object: u32| scene.objects[object as usize].has_interfaces(Interfaces::One);
    let across = |[a, b, c]: [DVec3; 3]| (b - a).cross(c - a);
    let interfaces = geometry.triangles.iter().filter(|triangle| is_interface(triangle.object));
    let area = |corners: [DVec3; 3]| across(corners).length_squared();
    let Some(largest) = interfaces.max_by(|a, b| area(a.corners).total_cmp(&area(b.corners))) else { return false };
    let camera = scene.camera.position.as_dvec3();
    let third = [1.0 / 3.0; 3];
    let Some(towards) = (largest.position(third) - camera).try_normalize() else { return false };
    let Some(hit) = geometry.first_hit(camera, towards, is_interface) else { return false };
    let triangle = &geometry.triangles[hit.triangle as usize];
    let face = across(triangle.corners);
    // The side of the facet decides; which one is the front, the normals say.
    face.dot(towards) * face.dot(triangle.normal(hit.barycentric)) > 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sights(scene: &str) -> Receivers<Sight> {
        let text = format!(
            "medium = {{ sigma_s = 0.5, sigma_a = [0.5, 0.7, 0.9] }}\n[environment]\nconstant = [1.0, 1.0, 1.0]\n{scene}"
        );
        let scene = crate::scene::parse::<toml::Table>("t", &text, std::path::Path::new(".")).unwrap().scene;
        Receivers::through(&Medium::of_scene(&scene).unwrap(), &scene, [2, 1], 1)
    }

    fn lengths(sights: &Receivers<Sight>) -> [Option<f64>; 2] {
        [0, 1].map(|pixel| sights.of_pixel(pixel)[0].map(|sight| sight.length))
    }

    /// Two pixels, 1 m apart, downwards from a height.
    fn camera(height: f64) -> String {
        format!(
            "[camera]\nposition = [0.0, {height:?}, 0.0]\ntarget = [0.0, -9.0, 0.0]\nup = [0.0, 0.0, -1.0]\n\
             orthographic = {{ height = 1.0 }}\n"
        )
    }

    #[test]
    fn they_end_where_the_camera_sees_something() {
        let emitter = "[[object]]\nshape = { plane = { size = [0.8, 0.8] } }\ntranslate = [-0.5, 0.5, 0.0]\n\
                       emitter = { radiance = [1.0, 1.0, 1.0] }\n";
        let hidden = "[[object]]\nshape = { plane = { size = [3.0, 3.0] } }\ncamera_visible = false\nreceiver = {}\n\
                      translate = [0.0, 1.0, 0.0]\n";
        let [left, right] = lengths(&sights(&format!("{}{emitter}{hidden}", camera(2.0))));
        assert!((left.unwrap() - 1.5).abs() < 1e-9, "{left:?}");
        assert!((right.unwrap() - 1e4f64.ln()).abs() < 1e-5, "{right:?}");
    }

    #[test]
    fn there_are_none_outside_of_the_water() {
        let water = "[[object]]\nshape = { plane = { size = [3.0, 3.0] } }\nrefractor = { eta = 1.333 }\n\
                     [[object]]\nshape = { plane = { size = [3.0, 3.0] } }\ntranslate = [0.0, -1.0, 0.0]\nreceiver = {}\n";
        assert_eq!(lengths(&sights(&format!("{}{water}", camera(0.5)))), [None; 2]);
        let [left, right] = lengths(&sights(&format!("{}{water}", camera(-0.5))));
        assert!((left.unwrap() - 0.5).abs() < 1e-9 && (right.unwrap() - 0.5).abs() < 1e-9, "{left:?} {right:?}");
    }
}
