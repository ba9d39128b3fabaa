//! What the tests share: both back ends behind one function, and surfaces without a scene file.

pub mod meshes;
mod prepared;

use std::sync::{Arc, Mutex, OnceLock};

use glam::{DVec3, Vec3};
use pinspot::blocking::wait;
use pinspot::image::{Aov, Image};
use pinspot::low_level::differential::differentials;
use pinspot::low_level::environment::CubeMap;
use pinspot::low_level::gpu::Gpu;
use pinspot::low_level::pinhole::gpu::{Engine, EnvironmentCube, FrameInputs, FrameLight, FrameViewers, GatherOptions};
use pinspot::low_level::pinhole::{Params, Pinholes, Receivers, cpu, pinholes};
use pinspot::low_level::sampling::{self, Surface, sample};
use pinspot::reference::{self, Quantity, Reference, StoppingCriterion};
use pinspot::scene::{BUILT_IN, Scene, Visibility, parse};
use pinspot::{Backend, BackendChoice, Error, EvaluationChoice, Footprint, NoProgress, Rendered, Strategy};

pub use prepared::{Kept, PreparedLight, PreparedScene, prepared, with_engine};

const NEEDS_ADAPTER: &str = "GPU tests need an adapter; run them by tests/run";

/// The adapter under test.
pub fn gpu() -> &'static Gpu {
    static GPU: OnceLock<Gpu> = OnceLock::new();
    GPU.get_or_init(|| wait(None, Gpu::open(None)).unwrap_or_else(|e| panic!("{NEEDS_ADAPTER}: {e}")))
}

/// The adapter under test as a back end, which is opened once: compiling its pipelines takes longer than most tests.
pub fn gpu_backend() -> Backend {
    static SHARED: OnceLock<Backend> = OnceLock::new();
    let open = || Backend::gpu(wait(None, Gpu::open(None)).unwrap_or_else(|e| panic!("{NEEDS_ADAPTER}: {e}")));
    SHARED.get_or_init(open).clone()
}

/// The names of the built-in scenes without a medium: for the others back ends are compared in `media_gpu.rs`, as their shaders take long to
/// compile.
pub fn clear_scenes() -> impl Iterator<Item = &'static str> {
    BUILT_IN.iter().map(|scene| scene.name).filter(|name| prepared(name).scene.medium.is_none())
}

/// One scene for each kind of light and surface: a map, on a mirror that is seen from one side; a mirror that lights itself; an interface;
/// emitters and lamps that are near; rough mirrors; a medium. The quick run looks at these, the full run at all others, too.
const TELLING: [&str; 7] = ["ring-natural", "cup", "pool", "dance-floor", "gloss", "candle", "haze"];

/// Whether the quick run looks at a scene.
pub fn is_telling(name: &str) -> bool {
    TELLING.contains(&name)
}

/// A scene from the text of its objects; the light and the camera are of no importance.
pub fn scene(objects: &str) -> Scene {
    let head = "[environment]\nconstant = [1.0, 1.0, 1.0]\n[camera]\nposition = [0.0, 5.0, 0.0]\ntarget = [0.0, 0.0, 0.0]\n\
                up = [0.0, 0.0, -1.0]\northographic = { height = 3.0 }\n";
    parse::<toml::Table>("test.toml", &format!("{head}{objects}"), std::path::Path::new(".")).unwrap().scene
}

/// The pinholes of a scene.
pub fn pinholes_of(scene: &Scene, samples: u32, strategy: Strategy, footprint: Footprint, seed: u64) -> Pinholes {
    let set = sample(&Surface::of_scene(scene), &sampling::Options { samples, strategy, seed }).unwrap();
    pinholes(scene, &differentials(&set), footprint)
}

/// Irradiance by the CPU twin.
pub fn on_cpu(receivers: &Receivers, pinholes: &Pinholes, cube: &CubeMap, params: &Params) -> Vec<[f32; 4]> {
    cpu::gather(receivers, pinholes, cube, params, &pinspot::NoProgress).unwrap()
}

/// The engine on the adapter under test, made once for all tests with the same options.
fn engine(options: &GatherOptions) -> Arc<Engine> {
    static ENGINES: Mutex<Vec<(GatherOptions, Arc<Engine>)>> = Mutex::new(Vec::new());
    let mut engines = ENGINES.lock().unwrap();
    if let Some((_, known)) = engines.iter().find(|(known, _)| known == options) {
        return known.clone();
    }
    let made = Arc::new(Engine::new(&gpu().device, options));
    engines.push((*options, made.clone()));
    made
}

/// Irradiance by the GPU, all batches in one submission.
pub fn on_gpu(receivers: &Receivers, pinholes: &Pinholes, cube: &CubeMap, params: &Params) -> Vec<[f32; 4]> {
    on_gpu_with(
        receivers,
        pinholes,
        cube,
        params,
        &GatherOptions {
            filter: params.filter,
            visibility: pinholes.visibility.is_some(),
            refraction: pinholes.refracts(),
            ..Default::default()
        },
        u32::MAX,
    )
}

/// The same with engine options, `step` batches a submission.
pub fn on_gpu_with(
    receivers: &Receivers,
    pinholes: &Pinholes,
    cube: &CubeMap,
    params: &Params,
    options: &GatherOptions,
    step: u32,
) -> Vec<[f32; 4]> {
    let gpu = gpu();
    let size = [receivers.width, receivers.height];
    let uploaded = EnvironmentCube::upload(&gpu.device, &gpu.queue, cube).unwrap();
    // As a host does that has a cube texture of its own.
    let environment = EnvironmentCube::from_view(uploaded.view().clone(), uploaded.size(), uploaded.radiance_scale());
    let positions = gpu.upload_texture(size, &receivers.positions);
    let normals = gpu.upload_texture(size, &receivers.normals);
    let views = receivers.view_directions.as_ref().map(|viewers| gpu.upload_texture(size, &viewers.directions));
    let viewers = views.as_ref().zip(receivers.view_directions.as_ref());
    let viewers = viewers.map(|(directions, v)| FrameViewers { directions, materials: &v.materials });
    let engine = engine(options);
    let inputs = FrameInputs {
        positions: &positions,
        normals: &normals,
        viewers,
        size,
        pinholes,
        maps: None,
        light: FrameLight::Environment(&environment),
        params: *params,
    };
    let mut frame = engine.frame(&gpu.device, &inputs).unwrap();
    let mut first = 0;
    while first < frame.batch_count() {
        let last = first.saturating_add(step).min(frame.batch_count());
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        frame.record(&mut encoder, first..last);
        gpu.queue.submit([encoder.finish()]);
        first = last;
    }
    wait(Some(&gpu.device), gpu.read_texture(frame.caustic())).unwrap()
}

/// A function that gathers on some back end.
pub type Gather = fn(&Receivers, &Pinholes, &CubeMap, &Params) -> Vec<[f32; 4]>;

/// Both back ends.
pub const BACK_ENDS: [(&str, Gather); 2] = [("cpu", on_cpu), ("gpu", on_gpu)];

/// Receivers on a horizontal square of edge `extent` around the origin, `n`² points.
pub fn floor(extent: f32, n: u32) -> Receivers {
    let mut points = Vec::new();
    for j in 0..n {
        for i in 0..n {
            let at = |k: u32| extent * ((k as f32 + 0.5) / n as f32 - 0.5);
            points.push((Vec3::new(at(i), 0.0, at(j)), Vec3::Y, 1));
        }
    }
    Receivers::from_points(&points, n)
}

/// Light without symmetry, rotated about +Y.
pub fn rotated_light(rotation_rad: f32) -> CubeMap {
    let light_from_world = glam::Mat3::from_rotation_y(-rotation_rad);
    CubeMap::from_radiance(64, None, move |d| {
        let d = light_from_world * d;
        Vec3::new(1.0 + d.x, 2.0 + d.y + d.z, (9.0 * d.z + 4.0 * d.x).sin().abs())
    })
}

/// ‖a − b‖₂ / ‖b‖₂ over R, G and B.
pub fn rel_l2(a: &[[f32; 4]], b: &[[f32; 4]]) -> f64 {
    let rgb = |[r, g, b, _]: [f32; 4]| DVec3::new(r.into(), g.into(), b.into());
    let b: Vec<DVec3> = b.iter().map(|b| rgb(*b)).collect();
    rel_l2_of(a, &b)
}

/// The same against values that are known better; sums may be padded to whole rows.
pub fn rel_l2_of(a: &[[f32; 4]], b: &[DVec3]) -> f64 {
    let a = &a[..b.len()];
    let image = |pixels: Vec<Vec3>| Image { width: pixels.len() as u32, height: 1, pixels };
    let a = image(a.iter().map(|a| Vec3::from_slice(&a[..3])).collect());
    pinspot::image::rel_l2(&a, &image(b.iter().map(|b| b.as_vec3()).collect()), None)
}

/// The pictures of a new engine.
pub fn render(scene: Scene, options: pinspot::Options, choice: &BackendChoice) -> Result<Rendered, Error> {
    render_again(&mut new_engine(scene, options, choice)?)
}

/// The pictures of an engine.
pub fn render_again(engine: &mut pinspot::Engine) -> Result<Rendered, Error> {
    let backend = engine.backend().clone();
    wait(backend.device(), engine.render(&NoProgress))
}

/// A new engine. The adapter under test is opened once.
pub fn new_engine(scene: Scene, options: pinspot::Options, choice: &BackendChoice) -> Result<pinspot::Engine, Error> {
    let backend = match choice {
        BackendChoice::Gpu(None) => gpu_backend(),
        choice => wait(None, Backend::open(choice))?,
    };
    Ok(pinspot::Engine::new(scene, options, backend))
}

/// A built-in scene's caustic by 1,000 samples, one by one, on the CPU, or whatever `change` asks for.
pub fn rendered(name: &str, size: u32, change: impl FnOnce(&mut pinspot::Options)) -> Image {
    with_engine(name, &Backend::cpu(), |engine| {
        let options = engine.options_mut();
        options.size = [size; 2];
        options.samples = 1000;
        options.aovs = vec![Aov::Caustic];
        options.evaluation = EvaluationChoice::Flat;
        change(options);
        render_again(engine).unwrap().layers.remove(0).1
    })
}

/// The ground truth of a built-in scene, which is computed once for all tests.
pub fn truth(name: &str, quantity: Quantity, visibility: Visibility, size: u32, rel_error: f64) -> Arc<Image> {
    type Key = (String, Quantity, Visibility, u32, f64);
    static TRUTHS: Kept<Key, Image> = Kept::new();
    TRUTHS.get((name.to_owned(), quantity, visibility, size, rel_error), || {
        let scene = prepared(name).scene.clone();
        let options = reference::Options { size: [size; 2], quantity, visibility, ..Default::default() };
        let goal = StoppingCriterion::new(rel_error);
        Reference::new(scene, options).unwrap().solve(&goal, None, &NoProgress, &mut |_| Ok(())).unwrap().irradiance
    })
}

/// The middle one of three or more.
pub fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// What passes an interface from the front at an angle of this cosine.
pub fn transmittance(cosine: f64, eta: f64) -> f64 {
    let inside = (1.0 - (1.0 - cosine * cosine) / (eta * eta)).sqrt();
    let s = (cosine - eta * inside) / (cosine + eta * inside);
    let p = (eta * cosine - inside) / (eta * cosine + inside);
    1.0 - 0.5 * (s * s + p * p)
}

/// Options of a picture of the caustic alone by photons.
pub fn photon_options(image_space: pinspot::ImageSpaceOptions) -> pinspot::Options {
    pinspot::Options::default()
        .with_technique(pinspot::Technique::ImageSpace)
        .with_image_space(image_space)
        .with_size([128, 128])
        .with_cube_size(pinspot::CubeSize::Texels(16))
        .with_aovs(vec![pinspot::image::Aov::Caustic])
}

/// A floor that is seen from above, 2 m high and wide, and what else there is.
pub fn above_floor(environment: &str, rest: &str) -> Scene {
    above_floor_in(std::path::Path::new("."), environment, rest)
}

/// The same with files from a folder.
pub fn above_floor_in(folder: &std::path::Path, environment: &str, rest: &str) -> Scene {
    let text = format!(
        "[environment]\n{environment}\n[camera]\nposition = [0, 9, 0]\ntarget = [0, 0, 0]\nup = [0, 0, -1]\n\
         orthographic = {{ height = 2.0 }}\n[[object]]\nname = \"floor\"\nshape = {{ plane = {{ size = [8, 8] }} }}\n\
         receiver = {{ albedo = [0.5, 0.5, 0.5] }}\n{rest}"
    );
    parse::<toml::Table>("test.toml", &text, folder).unwrap().scene
}
