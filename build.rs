//! Names the code, so that pictures that other code made are not taken for its own: `PINSPOT_CODE` is a hash of all that they may depend on.

use std::path::{Path, PathBuf};
use std::{fs, io};

/// Folders and files of this package. Cargo.lock stands for the dependencies.
const SOURCES: [&str; 5] = ["Cargo.lock", "Cargo.toml", "envmaps", "shaders", "src"];

fn main() -> io::Result<()> {
    let mut files = Vec::new();
    for source in SOURCES.map(Path::new).into_iter().filter(|source| source.exists()) {
        println!("cargo::rerun-if-changed={}", source.display());
        add_files(source, &mut files)?;
    }
    // Folders list their files in any order.
    files.sort();
    let mut hash = Fnv::default();
    for file in files {
        let contents = fs::read(&file)?;
        let name = file.to_string_lossy().replace('\\', "/");
        for bytes in [name.as_bytes(), &contents] {
            hash.add(&bytes.len().to_le_bytes());
            hash.add(bytes);
        }
    }
    println!("cargo::rustc-env=PINSPOT_CODE={:016x}", hash.0);
    Ok(())
}

fn add_files(path: &Path, files: &mut Vec<PathBuf>) -> io::Result<()> {
    if path.is_file() {
        files.push(path.into());
        return Ok(());
    }
    fs::read_dir(path)?.try_for_each(|entry| add_files(&entry?.path(), files))
}

/// FNV-1a, 64 bits: the same with every version of Rust, without a dependency.
struct Fnv(u64);

impl Default for Fnv {
    fn default() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }
}

impl Fnv {
    fn add(&mut self, bytes: &[u8]) {
        self.0 = bytes.iter().fold(self.0, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3));
    }
}
