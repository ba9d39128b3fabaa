//! Sources of the files that a scene names: a folder, or memory.

use std::collections::HashMap;
use std::io;
use std::path::{Path, PathBuf};

/// The files that a scene names: meshes, materials, tables and environment images.
///
/// Implemented for a folder's [`Path`] and for a [`HashMap`] from paths to bytes, so that scenes load without a file
/// system.
pub trait Assets {
    /// A file's bytes; `path` is as written in the scene.
    fn read(&self, path: &Path) -> io::Result<Vec<u8>>;

    /// The file's name in messages.
    fn name(&self, path: &Path) -> String {
        path.display().to_string()
    }
}

/// A folder; paths are relative to it.
impl Assets for Path {
    fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        std::fs::read(self.join(path))
    }

    fn name(&self, path: &Path) -> String {
        self.join(path).display().to_string()
    }
}

/// Files in memory.
impl<B: AsRef<[u8]>, S: std::hash::BuildHasher> Assets for HashMap<PathBuf, B, S> {
    fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        let file = self.get(path).ok_or_else(|| io::Error::new(io::ErrorKind::NotFound, "no such file"))?;
        Ok(file.as_ref().to_vec())
    }
}

impl<A: Assets + ?Sized> Assets for &A {
    fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        (**self).read(path)
    }

    fn name(&self, path: &Path) -> String {
        (**self).name(path)
    }
}

/// A file's name for messages, with control characters escaped.
pub(super) fn readable_name(assets: &(impl Assets + ?Sized), path: &Path) -> String {
    crate::words::escaped(&assets.name(path))
}
