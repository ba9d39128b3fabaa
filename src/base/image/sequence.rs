//! Numbered pictures of an animation: ranges of frames, and the names of their files. Knows no scenes.

use std::ops::Range;
use std::path::{Path, PathBuf};

/// The largest number of a frame.
const MAX_FRAME: u32 = 9_999_999;

/// Parses `A..B`: frames from A up to, but not including, B.
///
/// ```
/// assert_eq!(pinspot::image::parse_frames("0..120"), Ok(0..120));
/// assert!(pinspot::image::parse_frames("7..7").is_err());
/// ```
///
/// # Errors
/// Anything else, or a range without frames.
pub fn parse_frames(text: &str) -> Result<Range<u32>, String> {
    let (first, end) = text.split_once("..").ok_or("give FIRST..END, such as 0..120 for frames 0 to 119")?;
    let number = |text: &str| {
        let number = text.trim().parse().ok().filter(|number| *number <= MAX_FRAME);
        number.ok_or_else(|| format!("'{text}' is no frame; give a number from 0 to {MAX_FRAME}"))
    };
    let frames = number(first)?..number(end)?;
    if frames.is_empty() {
        return Err(format!("{text} has no frames; the second number must be larger"));
    }
    Ok(frames)
}

/// A file's name with its number signs replaced by a frame's number, padded by zeros: `f-####.exr` is `f-0007.exr` for frame 7.
/// `None` if there are no number signs, or several groups of them.
///
/// ```
/// use std::path::Path;
///
/// let seventh = pinspot::image::numbered(Path::new("out/f-####.exr"), 7);
/// assert_eq!(seventh.as_deref(), Some(Path::new("out/f-0007.exr")));
/// ```
pub fn numbered(path: &Path, frame: u32) -> Option<PathBuf> {
    let name = path.file_name()?.to_str()?;
    let first = name.find('#')?;
    let digits = name[first..].bytes().take_while(|byte| *byte == b'#').count();
    let (before, after) = (&name[..first], &name[first + digits..]);
    (!after.contains('#')).then(|| path.with_file_name(format!("{before}{frame:0digits$}{after}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_have_names_of_their_own() {
        let name = |pattern: &str, frame| numbered(Path::new(pattern), frame).map(|p| p.display().to_string());
        assert_eq!(name("#.png", 12).as_deref(), Some("12.png"), "longer numbers are not cut off");
        assert_eq!(name("a/ring ###.exr", 5).as_deref(), Some("a/ring 005.exr"));
        assert_eq!([name("ring.png", 1), name("#-#.png", 1), name("#/ring.png", 1)], [const { None }; 3]);
    }

    #[test]
    fn ranges_are_half_open() {
        assert_eq!(parse_frames("3..5"), Ok(3..5));
        for wrong in ["", "3", "3..", "..3", "5..3", "-1..3", "0..99999999", "a..b", "0...3"] {
            assert!(parse_frames(wrong).is_err(), "{wrong}");
        }
    }
}
