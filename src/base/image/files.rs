//! EXR files and masks. A file is written completely or not at all.

use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use exr::prelude::{
    AnyChannel, AnyChannels, AttributeValue, Encoding, FlatSamples, Layer, LayerAttributes, Text, WritableImage,
};
use glam::Vec3;

use super::Image;

/// Why a picture could not be written or read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ImageError {
    /// The file could not be written.
    #[error("cannot write '{}': {reason}; check that the folder exists and can be written to", path.display())]
    Write {
        /// File.
        path: PathBuf,
        /// The system's reason.
        reason: String,
    },
    /// The name does not fit what is to be written.
    #[error("'{}' {reason}", path.display())]
    Name {
        /// File.
        path: PathBuf,
        /// What is wrong, and what would be right.
        reason: String,
    },
    /// The image could not be read.
    #[error("cannot read image '{}': {reason}", path.display())]
    Read {
        /// File.
        path: PathBuf,
        /// The reason.
        reason: String,
    },
}

/// A temporary file next to the one that it replaces once it is complete.
#[derive(Debug)]
pub struct AtomicFile {
    path: PathBuf,
    target: PathBuf,
    replaced: Option<std::fs::Metadata>,
    file: tempfile::NamedTempFile,
}

impl AtomicFile {
    /// Creates a temporary file beside `path`.
    pub fn create(path: &Path) -> Result<Self, ImageError> {
        let fail = |reason: String| ImageError::Write { path: path.into(), reason };
        let target = target_of(path).map_err(|e| fail(e.to_string()))?;
        let replaced = std::fs::metadata(&target).ok();
        if replaced.as_ref().is_some_and(std::fs::Metadata::is_dir) {
            return Err(fail("it is a folder".into()));
        }
        if replaced.as_ref().is_some_and(|old| old.permissions().readonly()) {
            return Err(fail("it is read-only".into()));
        }
        let folder = match target.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent,
            _ => Path::new("."),
        };
        let mut builder = tempfile::Builder::new();
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        let file = builder.prefix(".pinspot-").tempfile_in(folder).map_err(|e| fail(reason_of(&e)))?;
        Ok(Self { path: path.into(), target, replaced, file })
    }

    /// The temporary file, to be written to.
    pub fn file(&self) -> &std::fs::File {
        self.file.as_file()
    }

    /// Replaces the old file; everything has been written.
    pub fn commit(self) -> Result<(), ImageError> {
        let Self { path, target, replaced, file } = self;
        let fail = |reason: String| ImageError::Write { path: path.clone(), reason };
        if let Some(old) = replaced {
            file.as_file().set_permissions(old.permissions()).map_err(|e| fail(e.to_string()))?;
        }
        file.persist(target).map_err(|e| fail(reason_of(&e.error)))?;
        Ok(())
    }
}

/// Writes a temporary file next to the given path, and replaces the old file once it is complete.
pub fn write_atomically(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<&std::fs::File>) -> Result<(), String>,
) -> Result<(), ImageError> {
    let fail = |reason: String| ImageError::Write { path: path.into(), reason };
    let file = AtomicFile::create(path)?;
    let mut writer = BufWriter::new(file.file());
    write(&mut writer).map_err(fail)?;
    writer.flush().map_err(|e| fail(e.to_string()))?;
    drop(writer);
    file.commit()
}

/// The file at the end of a chain of symbolic links; it need not exist.
fn target_of(path: &Path) -> std::io::Result<PathBuf> {
    let mut target = path.to_owned();
    // As many links as Linux follows.
    for _ in 0..40 {
        match std::fs::read_link(&target) {
            Ok(next) => target = target.parent().unwrap_or(Path::new("")).join(next),
            Err(_) => return Ok(target),
        }
    }
    Err(std::io::Error::other("too many symbolic links"))
}

/// The system's reason, without the name of the temporary file.
fn reason_of(error: &std::io::Error) -> String {
    let inner = error.get_ref().and_then(|inner| inner.source());
    inner.map_or_else(|| error.to_string(), ToString::to_string)
}

/// Reads a .png or .exr as a mask: width, height, and whether each pixel is brighter than half (a .png) or 0 (an .exr).
pub fn read_mask(path: &Path) -> Result<(u32, u32, Vec<bool>), ImageError> {
    let fail = |reason: String| ImageError::Read { path: path.into(), reason };
    match path.extension().unwrap_or_default().to_string_lossy().to_lowercase().as_str() {
        "exr" => {
            let image = read_exr(path, "")?;
            Ok((image.width, image.height, image.pixels.iter().map(|p| p.max_element() > 0.0).collect()))
        }
        "png" => {
            let bytes = std::fs::read(path).map_err(|e| fail(e.to_string()))?;
            let image = ::image::load_from_memory_with_format(&bytes, ::image::ImageFormat::Png);
            let grey = image.map_err(|e| fail(e.to_string()))?.into_luma8();
            Ok((grey.width(), grey.height(), grey.pixels().map(|p| p.0[0] > 127).collect()))
        }
        _ => Err(fail("a mask is a .png or an .exr".into())),
    }
}

/// Writes 32-bit float layers, lossless. One layer has the channels R G B; several have `name.R` and so on, or R G B
/// for the one without a name.
///
/// ```
/// use pinspot::glam::Vec3;
/// use pinspot::image::{Image, read_exr, write_exr};
///
/// # let folder = tempfile::tempdir().unwrap();
/// let path = folder.path().join("layers.exr");
/// let white = Image::new(4, 3).map(|_| Vec3::ONE);
/// write_exr(&path, &[("", &white), ("caustic", &white.map(|colour| 0.1 * colour))])?;
/// assert_eq!(read_exr(&path, "caustic")?.pixels[0], Vec3::splat(0.1));
/// # Ok::<(), pinspot::image::ImageError>(())
/// ```
pub fn write_exr(path: &Path, layers: &[(&str, &Image)]) -> Result<(), ImageError> {
    write_exr_with_text(path, layers, &[])
}

/// Like [`write_exr`], with named texts in the file's header.
pub fn write_exr_with_text(path: &Path, layers: &[(&str, &Image)], texts: &[(&str, String)]) -> Result<(), ImageError> {
    let (width, height) = (layers[0].1.width as usize, layers[0].1.height as usize);
    let mut channels = Vec::new();
    for (name, image) in layers {
        let prefix = if layers.len() == 1 || name.is_empty() { String::new() } else { format!("{name}.") };
        for (axis, letter) in ["R", "G", "B"].iter().enumerate() {
            let values: Vec<f32> = image.pixels.iter().map(|p| p[axis]).collect();
            channels.push(AnyChannel::new(Text::from(format!("{prefix}{letter}").as_str()), FlatSamples::F32(values)));
        }
    }
    let software_name = Some(concat!("pinspot ", env!("CARGO_PKG_VERSION")).into());
    let mut attributes = LayerAttributes { software_name, ..Default::default() };
    for (name, text) in texts {
        let text = AttributeValue::Text(Text::from(text.as_str()));
        attributes.other.insert(Text::from(*name), text);
    }
    let layer = Layer::new((width, height), attributes, Encoding::SMALL_LOSSLESS, AnyChannels::sort(channels.into()));
    write_atomically(path, |out| {
        let mut bytes = std::io::Cursor::new(Vec::new());
        exr::prelude::Image::from_layer(layer).write().to_buffered(&mut bytes).map_err(|e| e.to_string())?;
        out.write_all(bytes.get_ref()).map_err(|e| e.to_string())
    })
}

/// Reads the R, G and B channels of a layer (`""` for the channels without a prefix).
pub fn read_exr(path: &Path, layer: &str) -> Result<Image, ImageError> {
    use exr::prelude::{ReadChannels, ReadLayers};
    let fail = |reason: String| ImageError::Read { path: path.into(), reason };
    let file = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_file(path)
        .map_err(|e| fail(e.to_string()))?;
    let data = file.layer_data;
    let prefix = if layer.is_empty() { String::new() } else { format!("{layer}.") };
    let channel = |letter: &str| -> Result<Vec<f32>, ImageError> {
        let name = format!("{prefix}{letter}");
        let found = data.channel_data.list.iter().find(|c| c.name.eq(name.as_str()));
        found
            .map(|c| c.sample_data.values_as_f32().collect())
            .ok_or_else(|| fail(format!("it has no channel '{name}'")))
    };
    let (r, g, b) = (channel("R")?, channel("G")?, channel("B")?);
    let pixels = r.into_iter().zip(g).zip(b).map(|((r, g), b)| Vec3::new(r, g, b)).collect();
    Ok(Image { width: data.size.0 as u32, height: data.size.1 as u32, pixels })
}

/// A named text of a file's header; `None` if there is none of that name.
pub fn read_exr_text(path: &Path, name: &str) -> Result<Option<String>, ImageError> {
    let meta = exr::meta::MetaData::read_from_file(path, false)
        .map_err(|e| ImageError::Read { path: path.into(), reason: e.to_string() })?;
    let header = meta.headers.first();
    let value = header.and_then(|h| h.own_attributes.other.get(&Text::from(name)));
    Ok(match value {
        Some(AttributeValue::Text(text)) => Some(text.to_string()),
        _ => None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::write_png;

    #[test]
    fn exr_layers_come_back_bit_for_bit() {
        let dir = tempfile::tempdir().unwrap();
        let mut caustic = Image::new(3, 2);
        caustic.pixels[1] = Vec3::new(1.0e6, -2.5, 1e-20);
        let depth = caustic.map(|p| p + 1.0);
        let path = dir.path().join("one.exr");
        write_exr(&path, &[("caustic", &caustic)]).unwrap();
        assert_eq!(read_exr(&path, "").unwrap(), caustic);
        let path = dir.path().join("two.exr");
        write_exr(&path, &[("caustic", &caustic), ("depth", &depth)]).unwrap();
        assert_eq!(read_exr(&path, "depth").unwrap(), depth);
        assert!(read_exr(&path, "").is_err());
    }

    #[cfg(unix)]
    #[test]
    fn links_are_followed_and_modes_are_kept() {
        use std::os::unix::fs::{PermissionsExt, symlink};
        let dir = tempfile::tempdir().unwrap();
        let [link, hop, file] = ["link.png", "hop.png", "real/file.png"].map(|name| dir.path().join(name));
        std::fs::create_dir(dir.path().join("real")).unwrap();
        symlink("hop.png", &link).unwrap();
        symlink("real/file.png", &hop).unwrap();
        write_png(&link, &Image::new(1, 1)).unwrap();
        assert!(link.is_symlink() && hop.is_symlink() && file.is_file(), "a dangling chain of links is followed");
        let mode = |path: &Path| std::fs::metadata(path).unwrap().permissions().mode() & 0o777;
        let set_mode = |mode| std::fs::set_permissions(&file, PermissionsExt::from_mode(mode)).unwrap();
        set_mode(0o600);
        write_png(&link, &Image::new(2, 1)).unwrap();
        assert_eq!((mode(&file), link.is_symlink()), (0o600, true));
        set_mode(0o444);
        let message = write_png(&link, &Image::new(1, 1)).unwrap_err().to_string();
        assert!(message.contains("link.png") && message.contains("read-only"), "{message}");
        symlink("round.png", dir.path().join("round.png")).unwrap();
        let message = write_png(&dir.path().join("round.png"), &Image::new(1, 1)).unwrap_err().to_string();
        assert!(message.contains("too many symbolic links"), "{message}");
        let left = std::fs::read_dir(dir.path()).unwrap().map(|f| f.unwrap().file_name());
        assert!(!left.into_iter().any(|f| f.to_string_lossy().starts_with(".pinspot")));
    }

    #[test]
    fn a_failed_write_leaves_the_old_file_and_nothing_else() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("picture.png");
        std::fs::write(&path, "old").unwrap();
        assert!(write_atomically(&path, |_| Err("disk on fire".into())).is_err());
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "old");
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
        let message = write_png(&dir.path().join("no/such/folder.png"), &Image::new(1, 1)).unwrap_err().to_string();
        assert!(message.contains("folder.png") && message.contains("folder exists"), "{message}");
    }
}
