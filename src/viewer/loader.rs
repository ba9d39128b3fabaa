//! Reads and writes files beside the window, and notices when files of the scene change on disk.

use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, SystemTime};

use eframe::egui::ColorImage;

use super::document::Document;
use crate::image::{Image, write_png};
use crate::low_level::environment::BUILT_IN_MAPS;
use crate::scene::{BUILT_IN, Light};

/// How often files are looked at.
const INTERVAL: Duration = Duration::from_millis(400);

/// What was read, or why it could not be.
#[derive(Debug)]
pub enum Loaded {
    /// Another scene.
    Scene(Result<Box<Document>, String>),
    /// The scene with one more mesh.
    Mesh(Result<Box<Document>, String>),
    /// An environment map, and what scene files call it.
    Map(Result<(Light, String), String>),
    /// A screenshot was written.
    Written(PathBuf),
    /// Files of the scene have changed on disk.
    Touched,
    /// The same scene, read again.
    Changed(Result<Box<Document>, String>),
}

/// Files, and when each was last written.
type Stamps = Vec<(PathBuf, Option<SystemTime>)>;

/// Threads that read files.
pub struct Loader {
    sender: LoaderSender,
    receiver: Receiver<Loaded>,
    watched: Arc<Mutex<Stamps>>,
}

/// Tells the window what was read.
#[derive(Clone)]
pub struct LoaderSender {
    sender: Sender<Loaded>,
    wake: Arc<dyn Fn() + Send + Sync>,
}

impl LoaderSender {
    fn send(&self, loaded: Loaded) {
        // Without a window nobody listens.
        let _ = self.sender.send(loaded);
        (self.wake)();
    }

    /// Writes what the window shows.
    pub fn save_screenshot(&self, path: PathBuf, shown: &ColorImage) {
        let image = image_of(shown);
        let sender = self.clone();
        std::thread::spawn(move || {
            sender.send(match write_png(&path, &image) {
                Ok(()) => Loaded::Written(path),
                Err(error) => Loaded::Scene(Err(error.to_string())),
            });
        });
    }
}

/// What the window shows, display-linear.
pub fn image_of(shown: &ColorImage) -> Image {
    let [width, height] = shown.size;
    let linear = |c: u8| {
        let c = f32::from(c) / 255.0;
        if c <= 0.040_45 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
    };
    let pixels = shown.pixels.iter().map(|p| [p.r(), p.g(), p.b()].map(linear).into()).collect();
    Image { width: width as u32, height: height as u32, pixels }
}

impl Loader {
    /// `wake` is called whenever something has been read.
    pub fn new(wake: impl Fn() + Send + Sync + 'static) -> Self {
        let (sender, receiver) = channel();
        let sender = LoaderSender { sender, wake: Arc::new(wake) };
        let watched: Arc<Mutex<Stamps>> = Arc::default();
        let of_thread = Arc::downgrade(&watched);
        let teller = sender.clone();
        std::thread::spawn(move || {
            // Ends with the loader.
            while let Some(watched) = of_thread.upgrade() {
                if take_changes(&mut watched.lock().unwrap_or_else(PoisonError::into_inner)) {
                    teller.send(Loaded::Touched);
                }
                drop(watched);
                std::thread::sleep(INTERVAL);
            }
        });
        Self { sender, receiver, watched }
    }

    pub fn sender(&self) -> LoaderSender {
        self.sender.clone()
    }

    /// What has been read since.
    pub fn loaded(&self) -> Option<Loaded> {
        self.receiver.try_recv().ok()
    }

    /// Watches these files instead of others.
    pub fn watch(&self, files: Vec<PathBuf>) {
        let stamps = files.into_iter().map(|file| (file.clone(), written(&file))).collect();
        *self.watched.lock().unwrap_or_else(PoisonError::into_inner) = stamps;
    }

    /// Opens a scene, a mesh or an environment map, by the ending of its name; scenes and maps that are built in have none. Meshes are
    /// added to the open document.
    pub fn open(&self, path: PathBuf, document: &Document) {
        let sender = self.sender.clone();
        let document = document.clone();
        std::thread::spawn(move || {
            let name = path.display().to_string();
            let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
            sender.send(match extension.as_str() {
                "toml" => Loaded::Scene(Document::open(&name).map(Box::new)),
                "obj" => Loaded::Mesh(document.with_mesh(&path).map(Box::new)),
                "exr" | "hdr" => Loaded::Map(Document::read_map(&path)),
                "" if BUILT_IN_MAPS.iter().any(|map| map.name == name) => Loaded::Map(Document::read_map(&path)),
                "" if BUILT_IN.iter().any(|scene| scene.name == name) => {
                    Loaded::Scene(Document::open(&name).map(Box::new))
                }
                _ => Loaded::Scene(Err(format!(
                    "cannot open '{name}': drop a scene (.toml), a mesh (.obj) or an environment map (.exr, .hdr)"
                ))),
            });
        });
    }

    /// Reads the document's files again.
    pub fn reload(&self, document: &Document) {
        let (sender, document) = (self.sender.clone(), document.clone());
        std::thread::spawn(move || sender.send(Loaded::Changed(document.reloaded().map(Box::new))));
    }

    /// Opens a scene by its path or name.
    pub fn open_scene(&self, name: String) {
        let sender = self.sender.clone();
        std::thread::spawn(move || sender.send(Loaded::Scene(Document::open(&name).map(Box::new))));
    }
}

fn written(path: &Path) -> Option<SystemTime> {
    std::fs::metadata(path).and_then(|metadata| metadata.modified()).ok()
}

/// Whether any file has been written since it was looked at last.
fn take_changes(stamps: &mut Stamps) -> bool {
    let mut has_changed = false;
    for (path, known) in stamps {
        let now = written(path);
        // An editor that replaces a file removes it for a moment.
        if now.is_some() && now != *known {
            *known = now;
            has_changed = true;
        }
    }
    has_changed
}
