//! Built-in scenes and lights with what is derived from them. Each is made once, by the test that needs it first, for all of this process.

use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use pinspot::low_level::cell_tree::{CellTree, TreeOptions};
use pinspot::low_level::environment::{CubeMap, Environment, LightBounds};
use pinspot::low_level::pinhole::cpu::Light;
use pinspot::low_level::pinhole::{PinholeTree, Receivers};
use pinspot::low_level::sampling::{self, Strategy, Surface, sample};
use pinspot::low_level::tracing::Tracer;
use pinspot::low_level::visible_receivers;
use pinspot::scene::{self, Scene, Visibility};
use pinspot::{Backend, CubeSize, Engine, NoProgress, Options};

/// Values by their keys. Whoever needs one while another test makes it waits for that one alone.
pub struct Kept<K, V>(Mutex<Vec<(K, Place<V>)>>);

/// Where a value is once it is made.
type Place<V> = Arc<OnceLock<Arc<V>>>;

impl<K: PartialEq, V> Kept<K, V> {
    pub const fn new() -> Self {
        Self(Mutex::new(Vec::new()))
    }

    /// The value of a key.
    pub fn get(&self, key: K, make: impl FnOnce() -> V) -> Arc<V> {
        let place = {
            let mut all = self.0.lock().unwrap();
            let known = all.iter().find(|(known, _)| *known == key).map(|(_, place)| place.clone());
            known.unwrap_or_else(|| {
                let place = Arc::default();
                all.push((key, Arc::clone(&place)));
                place
            })
        };
        place.get_or_init(|| Arc::new(make())).clone()
    }
}

/// The values that were used last, by their keys: large ones, of which a few fit in memory.
struct Recent<K, V> {
    most: usize,
    values: Mutex<Vec<(K, Arc<V>)>>,
}

impl<K: PartialEq, V> Recent<K, V> {
    const fn new(most: usize) -> Self {
        Self { most, values: Mutex::new(Vec::new()) }
    }

    /// The value of a key. While it is made, others wait.
    fn get(&self, key: K, make: impl FnOnce() -> V) -> Arc<V> {
        let mut values = self.values.lock().unwrap_or_else(PoisonError::into_inner);
        let known = values.iter().position(|(known, _)| *known == key).map(|at| values.remove(at).1);
        let value = known.unwrap_or_else(|| Arc::new(make()));
        values.push((key, value.clone()));
        if values.len() > self.most {
            values.remove(0);
        }
        value
    }
}

/// A light and its bounds.
pub struct PreparedLight {
    pub cube: CubeMap,
    pub bounds: LightBounds,
}

impl PreparedLight {
    /// A light in a cube map of a size.
    pub fn of(light: &scene::Light, size: CubeSize) -> Arc<Self> {
        static LIGHTS: Recent<(scene::Light, CubeSize), PreparedLight> = Recent::new(4);
        LIGHTS.get((light.clone(), size), || Self::new(Environment::new(light, size).unwrap().cube))
    }

    pub fn new(cube: CubeMap) -> Self {
        let bounds = LightBounds::new(&cube);
        Self { cube, bounds }
    }

    pub fn as_light(&self) -> Light<'_> {
        Light::Environment { cube: &self.cube, bounds: &self.bounds }
    }
}

/// A built-in scene.
pub struct PreparedScene {
    pub scene: Scene,
    pub options: Options,
    pub tracer: Tracer,
    receivers: Kept<[u32; 2], Receivers>,
    trees: Kept<(u32, u32, Visibility), PinholeTree>,
}

/// The engines of a scene.
#[derive(Default)]
struct Engines {
    on_cpu: Option<Engine>,
    on_gpu: Option<Engine>,
}

/// A built-in scene by its name.
pub fn prepared(name: &str) -> Arc<PreparedScene> {
    static SCENES: Kept<String, PreparedScene> = Kept::new();
    SCENES.get(name.to_owned(), || {
        let (scene, options) = pinspot::load(name).unwrap();
        PreparedScene { tracer: Tracer::new(&scene), scene, options, receivers: Kept::new(), trees: Kept::new() }
    })
}

impl PreparedScene {
    /// What the scene's camera sees.
    pub fn receivers(&self, size: [u32; 2]) -> Arc<Receivers> {
        self.receivers.get(size, || visible_receivers(&self.scene, &self.tracer, size))
    }

    /// Samples by the neighbourhood strategy, divided into leaves.
    pub fn tree(&self, samples: u32, leaves: u32, visibility: Visibility) -> Arc<PinholeTree> {
        self.trees.get((samples, leaves, visibility), || {
            if visibility == Visibility::Full {
                let mut tree = PinholeTree::clone(&self.tree(samples, leaves, Visibility::None));
                tree.trace_visibility(&self.scene, &self.tracer, &NoProgress);
                return tree;
            }
            let surface = Surface::of_scene(&self.scene);
            let options = sampling::Options { samples, strategy: Strategy::Neighbourhood, seed: 1 };
            let set = sample(&surface, &options).unwrap();
            PinholeTree::new(&self.scene, CellTree::new(&surface, &set, &TreeOptions { leaves, seed: 1 }))
        })
    }

    /// The scene's own light.
    pub fn light(&self, size: CubeSize) -> Arc<PreparedLight> {
        PreparedLight::of(&self.scene.environment.light, size)
    }
}

impl Engines {
    /// The scene's engine on a back end, with the scene's own options: what earlier tests prepared is kept where it is the same.
    fn on(&mut self, backend: &Backend, prepared: &PreparedScene) -> &mut Engine {
        let engine = if backend.is_gpu() { &mut self.on_gpu } else { &mut self.on_cpu };
        let new = || Engine::new(prepared.scene.clone(), prepared.options.clone(), backend.clone());
        let engine = engine.get_or_insert_with(new);
        *engine.scene_mut() = prepared.scene.clone();
        *engine.options_mut() = prepared.options.clone();
        engine
    }
}

/// What a test does with a built-in scene's engine. One test uses it at a time; those of the telling scenes are kept, and two more.
pub fn with_engine<T>(name: &str, backend: &Backend, work: impl FnOnce(&mut Engine) -> T) -> T {
    static ENGINES: Recent<String, Mutex<Engines>> = Recent::new(super::TELLING.len() + 2);
    let engines = ENGINES.get(name.to_owned(), Mutex::default);
    let mut engines = engines.lock().unwrap_or_else(|poisoned| {
        // A test has failed in the middle of something.
        let mut engines = PoisonError::into_inner(poisoned);
        *engines = Engines::default();
        engines
    });
    work(engines.on(backend, &prepared(name)))
}
