//! The desktop's own file dialogs. A thread waits for each; this module does not know the window, which it only wakes.

use std::path::{Path, PathBuf};
use std::pin::Pin;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

use rfd::{AsyncFileDialog, FileHandle};

use crate::blocking::wait;

/// Nobody closes a dialog faster: there was none.
const FASTEST: Duration = Duration::from_millis(100);

/// What a file is wanted for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// Scenes, meshes and maps.
    Open,
    OpenMap,
    SaveScene,
    SavePicture,
    Record,
}

impl Purpose {
    /// The dialog's title, and the kinds of files that it offers.
    fn dialog(self) -> AsyncFileDialog {
        let dialog = AsyncFileDialog::new();
        match self {
            Self::Open => dialog
                .set_title("Open a scene, a mesh or a map")
                .add_filter("Scenes, meshes and maps", &["toml", "obj", "exr", "hdr"]),
            Self::OpenMap => {
                dialog.set_title("Open an environment map").add_filter("Environment maps", &["exr", "hdr"])
            }
            Self::SaveScene => dialog.set_title("Save the scene").add_filter("Scenes", &["toml"]),
            Self::SavePicture => {
                dialog.set_title("Save the picture").add_filter("PNG", &["png"]).add_filter("OpenEXR", &["exr"])
            }
            Self::Record => dialog.set_title("Record the animation").add_filter("Animated PNG", &["apng"]),
        }
    }

    fn opens(self) -> bool {
        matches!(self, Self::Open | Self::OpenMap)
    }
}

/// What was chosen.
#[derive(Debug, PartialEq, Eq)]
pub enum Chosen {
    File(Purpose, PathBuf),
    /// The desktop has no dialog.
    NoDialog,
}

/// The dialogs that are open.
pub struct Dialogs {
    sender: Sender<Option<Chosen>>,
    receiver: Receiver<Option<Chosen>>,
    wake: Arc<dyn Fn() + Send + Sync>,
    is_open: bool,
}

impl Dialogs {
    /// `wake` is called whenever a dialog is closed.
    pub fn new(wake: impl Fn() + Send + Sync + 'static) -> Self {
        let (sender, receiver) = channel();
        Self { sender, receiver, wake: Arc::new(wake), is_open: false }
    }

    /// Opens a dialog, unless there is one. A file that is written is called `file` at first.
    pub fn ask(&mut self, purpose: Purpose, file: &str) {
        if std::mem::replace(&mut self.is_open, true) {
            return;
        }
        let mut dialog = purpose.dialog();
        let file = Path::new(file.trim());
        if let Some(folder) = std::path::absolute(file).ok().and_then(|file| Some(file.parent()?.to_owned())) {
            dialog = dialog.set_directory(folder);
        }
        if let Some(name) = file.file_name() {
            dialog = dialog.set_file_name(name.to_string_lossy());
        }
        let began = Instant::now();
        // macOS wants its dialogs to be opened by the thread that draws.
        let closed: Pin<Box<dyn Future<Output = Option<FileHandle>> + Send>> =
            if purpose.opens() { Box::pin(dialog.pick_file()) } else { Box::pin(dialog.save_file()) };
        let (sender, wake) = (self.sender.clone(), self.wake.clone());
        std::thread::spawn(move || {
            let file = wait(None, closed).map(|file| Chosen::File(purpose, file.path().to_owned()));
            let has_failed = file.is_none() && began.elapsed() < FASTEST;
            // The window may be closed by now.
            let _ = sender.send(file.or(has_failed.then_some(Chosen::NoDialog)));
            wake();
        });
    }

    /// What was chosen in a dialog that has been closed.
    pub fn chosen(&mut self) -> Option<Chosen> {
        let closed = self.receiver.try_recv().ok()?;
        self.is_open = false;
        closed
    }
}
