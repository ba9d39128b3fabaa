//! What no picture shows: photons one by one, the batches of a traversal, and counts.

use glam::{DVec2, Vec3};

use super::adaptive::Traverser;
use super::caustic_map::{CausticMap, ForGloss};
use super::coverage::Coverage;
use super::emission::{Emission, Kind, Pattern, Surroundings, emit};
use super::lights::{LightView, PhotonLight};
use super::maps::MapInputs;
use super::multi_resolution::{DIAMETERS, Resolutions};
use super::options::{Hits, ImageSpaceOptions, Traversal};
use super::photons::{Photon, PhotonGrid};
use super::projection::{Bounds, Projection};
use super::receiver_layers::ReceiverLayers;
use super::splats::points;
use super::strips::Strip;
use crate::Settings;
use crate::pinhole::reflectance_curves;
use crate::progress::NoProgress;
use crate::reflectance::Curve;
use crate::scene::{Chain, Mesh, Object, Ray, Scene, parse};
use crate::tracing::{SeenBy, Tracer};

/// A lamp above a floor, and what casts its caustic.
const LAMP_AND_FLOOR: &str = r#"
[environment]
constant = [0, 0, 0]
[camera]
position = [0, 9, 0]
target = [0, 0, 0]
up = [0, 0, -1]
orthographic = { height = 2 }
[[light]]
position = [0.3, 3.0, 0.2]
intensity = [1, 2, 3]
[[object]]
name = "floor"
shape = { plane = { size = [8, 8] } }
receiver = {}
"#;
const MIRROR: &str = r"
[[object]]
shape = { sphere = { radius = 0.4, divisions = 96 } }
translate = [0, 0.8, 0]
reflector = {}
";
const WAVES: &str = r"
[[object]]
shape = { water = { size = [2.0, 2.0], amplitude = 0.008, wavelength = 0.7, depth = 1.0, period = 12.0 } }
translate = [0, 1, 0]
refractor = { eta = 1.333 }
";
const BALL: &str = r"
[[object]]
shape = { sphere = { radius = 0.4, divisions = 96 } }
translate = [0, 0.8, 0]
refractor = { eta = 1.5, interfaces = 2 }
";

/// A scene with what is computed of it once.
struct Prepared {
    scene: Scene,
    tracer: Tracer,
    receivers: Tracer,
    solids: Vec<(u32, Tracer)>,
    mirrors: Vec<Option<Curve>>,
    lights: Vec<PhotonLight>,
    casters: Vec<Vec3>,
    points: Vec<Vec3>,
    triangles: Vec<[Vec3; 3]>,
    bounds: Bounds,
    kinds: Vec<Kind>,
}

impl Prepared {
    fn new(caster: &str, chain: Chain) -> Self {
        let text = format!("{LAMP_AND_FLOOR}{caster}");
        let scene = parse::<Settings>("photons.toml", &text, std::path::Path::new(".")).unwrap().scene;
        let meshes: Vec<Mesh> = scene.objects.iter().map(Object::mesh_in_world).collect();
        let alone = |is_met: &dyn Fn(usize) -> bool| {
            let seen = (0..meshes.len()).map(|k| SeenBy::all_but_camera(is_met(k)));
            Tracer::of_meshes(meshes.iter().zip(seen))
        };
        let (floor, caster) = (&meshes[0], &meshes[1]);
        Self {
            tracer: Tracer::new(&scene),
            receivers: alone(&|k| k == 0),
            solids: if chain == Chain::TT { vec![(1, alone(&|k| k == 1))] } else { Vec::new() },
            mirrors: reflectance_curves(&scene),
            lights: scene.lamps.iter().cloned().map(PhotonLight::Lamp).collect(),
            casters: caster.positions().to_vec(),
            points: floor.positions().to_vec(),
            triangles: (0..caster.triangles().len()).map(|k| caster.corners(k)).collect(),
            bounds: Bounds::around(meshes.iter().flat_map(Mesh::positions).copied()).unwrap(),
            kinds: vec![Kind { chain, channel: None }],
            scene,
        }
    }

    fn surroundings(&self) -> Surroundings<'_> {
        Surroundings { tracer: &self.tracer, objects: &self.scene.objects, mirrors: &self.mirrors }
    }

    fn inputs<'a>(&'a self, options: &'a ImageSpaceOptions) -> MapInputs<'a> {
        MapInputs {
            surroundings: self.surroundings(),
            receivers: &self.receivers,
            receiver_points: &self.points,
            solids: &self.solids,
            casters: &self.casters,
            triangles: &self.triangles,
            bounds: self.bounds,
            lights: &self.lights,
            draws: None,
            few: None,
            kinds: &self.kinds,
            view: (self.scene.camera, [64; 2]),
            options,
            pattern: PATTERN,
            glossy: None,
        }
    }

    fn view(&self, photons: u32) -> LightView {
        self.lights[0].views(&self.casters, &self.bounds, photons).remove(0)
    }

    /// Photons of the lamp, found by rays or in images.
    fn photons(&self, hits: Hits, photons: u32) -> PhotonGrid {
        let options = ImageSpaceOptions { hits, photons, ..Default::default() };
        let (inputs, view) = (self.inputs(&options), self.view(options.photons));
        let images = inputs.images_of(&view);
        let surroundings = self.surroundings();
        let emission = Emission { surroundings: &surroundings, images: images.as_ref(), view: &view, pattern: PATTERN };
        emit(&emission, &self.kinds, Strip::whole(view.projection.size), &NoProgress).0.remove(0)
    }

    /// A map of the floor from above.
    fn map(&self, texels: u32) -> CausticMap<'static> {
        let view = Projection::parallel(Vec3::NEG_Y, self.points.iter().copied(), &self.bounds, texels);
        let floor = |ray: Ray| self.receivers.secondary_hit(ray);
        CausticMap::new(ReceiverLayers::all(view, 1, &floor), (100.0, ForGloss::Nothing))
    }
}

/// Rays between the middles of the texels of images.
const PATTERN: Pattern = Pattern { seed: 1, offset: DVec2::splat(0.25), is_papers: false };

fn median(mut values: Vec<f64>) -> f64 {
    assert!(values.len() > 1000, "{}", values.len());
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Where photons land, from where, and with how much flux: in images of what the lamp sees it is the same as by rays (Wyman and Davis 2006,
/// Section 3.1). Distances are in those to the next photon.
#[test]
fn photons_in_images_are_those_of_rays() {
    for (caster, chain) in [(MIRROR, Chain::R), (WAVES, Chain::T), (BALL, Chain::TT)] {
        let scene = Prepared::new(caster, chain);
        let [traced, found] = [Hits::Traced, Hits::Image].map(|hits| scene.photons(hits, 256));
        let pair = |index: usize| {
            let [x, y] = traced.texels[index].map(i64::from);
            let other = &found.photons[found.index_at(x, y)?];
            let next = &traced.photons[traced.index_at(x + 1, y)?];
            let own = &traced.photons[index];
            let spacing = own.position.distance(next.position).max(1e-6);
            Some((*own, *other, f64::from(spacing)))
        };
        let pairs: Vec<(Photon, Photon, f64)> = (0..traced.photons.len()).filter_map(pair).collect();
        let of = |value: fn(&(Photon, Photon, f64)) -> f64| median(pairs.iter().map(value).collect());
        let apart = of(|(own, other, spacing)| f64::from(own.position.distance(other.position)) / spacing);
        let turned = of(|(own, other, _)| f64::from(own.direction.cross(other.direction).length()));
        let brighter = of(|(own, other, _)| f64::from((own.flux / other.flux - 1.0).abs().max_element()));
        println!("{chain:?}: {apart:.4} spacings, {turned:.1e} rad, flux {brighter:.1e}");
        assert!(found.photons.len() as f64 > 0.95 * traced.photons.len() as f64, "{chain:?}");
        assert!(apart <= 0.25 && turned <= 1e-3 && brighter <= 1e-4, "{chain:?}: {apart}, {turned}, {brighter}");
    }
}

/// However a traversal is divided into batches, which never have more photons than fit, the sums are the same bits (Wyman and Nichols 2009,
/// Section 4.3).
#[test]
fn batches_do_not_matter() {
    let scene = Prepared::new(BALL, Chain::TT);
    let (surroundings, view) = (scene.surroundings(), scene.view(512));
    let coverage = Coverage::new(&view.projection, 0.0, scene.triangles.iter().copied());
    let sums = [4096, 2048, 1024, 256].map(|batch| {
        let map = scene.map(256);
        let emission = Emission { surroundings: &surroundings, images: None, view: &view, pattern: PATTERN };
        let (traversal, kind) = (Traversal::TexelError, scene.kinds[0]);
        let traverser = Traverser { emission, coverage: &coverage, kind, map: &map, traversal, finest: 1024, batch };
        let mut batches = 0;
        let (_, effort) = traverser.run(&mut |grid| {
            assert!(grid.photons.len() <= 4 * batch);
            batches += 1;
            points(&map, grid);
        });
        println!("{batch} clusters: {batches} batches, {effort:?}");
        let flux: Vec<_> = (0..map.len()).map(|texel| map.flux(texel)).collect();
        assert!(flux.iter().any(|flux| flux.x > 0.0));
        (effort, flux)
    });
    assert!(sums.iter().all(|sum| *sum == sums[0]));
}

/// Every resolution has all of the flux, and counts exactly the photons whose splats reach a texel (Wyman and Dachsbacher 2006, Section 4.1).
#[test]
fn resolutions_count_their_photons() {
    let scene = Prepared::new(WAVES, Chain::T);
    let (grid, map) = (scene.photons(Hits::Traced, 128), scene.map(64));
    let resolutions = Resolutions::like(&map);
    resolutions.add(&grid);
    let texels: Vec<usize> = grid.photons.iter().filter_map(|photon| Some(map.place(photon).ok()?.1)).collect();
    let width = map.size()[0] as usize;
    let deposited = points(&map, &grid).deposited;
    for (size, diameter) in DIAMETERS.into_iter().enumerate() {
        let mut expected = vec![0; map.len()];
        for texel in &texels {
            let (x, y) = ((texel % width) as i64, (texel / width) as i64);
            for (index, count) in expected.iter_mut().enumerate() {
                let (dx, dy) = ((index % width) as i64 - x, (index / width) as i64 - y);
                *count += u32::from(4 * (dx * dx + dy * dy) <= i64::from(diameter).pow(2));
            }
        }
        let (counts, flux) = resolutions.sums(size);
        assert!(counts == expected, "{diameter} texels");
        assert!((flux / deposited - 1.0).abs() < 1e-5, "{diameter} texels: {flux} of {deposited}");
    }
}
