//! Checks whether outputs can be written, before the work begins.

use std::path::Path;

/// Rejects a file with another extension, or one that is known not to be writable.
pub fn check_output(path: &Path, extensions: &[&str]) -> Result<(), String> {
    check_extension(path, extensions)?;
    check_writable(path)
}

/// Rejects a file with another extension.
pub fn check_extension(path: &Path, extensions: &[&str]) -> Result<(), String> {
    if !extensions.contains(&extension(path).as_str()) {
        let endings = extensions.join(" or .");
        return Err(format!("cannot write '{}': give a file that ends in .{endings}", path.display()));
    }
    Ok(())
}

/// Rejects a file that is a folder or read-only, or whose folder does not exist or is not writable.
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
    // For a symbolic link, the file that it points to is replaced.
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
