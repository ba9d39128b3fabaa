//! What can be known about outputs before the work: whether they can be written.

use std::path::Path;

/// Refuses a file that has another extension, or that cannot be written as far as can be known before.
pub fn check_output(path: &Path, extensions: &[&str]) -> Result<(), String> {
    if !extensions.contains(&extension(path).as_str()) {
        let endings = extensions.join(" or .");
        return Err(format!("cannot write '{}': give a file that ends in .{endings}", path.display()));
    }
    check_writable(path)
}

/// Refuses a file that is a folder or read-only, or whose folder does not exist or cannot be written to.
pub fn check_writable(path: &Path) -> Result<(), String> {
    let refuse = |why: String| Err(format!("cannot write '{}': {why}", path.display()));
    if let Ok(metadata) = std::fs::metadata(path) {
        if metadata.is_dir() {
            return refuse("it is a folder; give the name of a file".into());
        }
        if metadata.permissions().readonly() {
            return refuse("it is read-only; give another name, or allow writing to it".into());
        }
    }
    // Of a symbolic link the file that it points to is replaced.
    let target = std::fs::canonicalize(path).unwrap_or_else(|_| path.into());
    let folder = target.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if !folder.is_dir() {
        return refuse(format!("the folder '{}' does not exist; create it first", folder.display()));
    }
    match tempfile::Builder::new().prefix(".pinspot-").tempfile_in(folder) {
        Ok(_) => Ok(()),
        Err(e) => refuse(format!("the folder '{}' cannot be written to ({})", folder.display(), e.kind())),
    }
}

pub fn extension(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_lowercase()
}
