//! Statements of Wavefront files (.obj, .mtl): removes comments, and joins continued lines.

use std::borrow::Cow;

/// Decodes a file: UTF-16 by its byte order mark, UTF-8 without one, else Latin-1, which older exporters write.
pub(super) fn decoded(bytes: &[u8]) -> Cow<'_, str> {
    let utf_16 = |unit: fn([u8; 2]) -> u16| {
        let units = bytes.as_chunks::<2>().0.iter().skip(1).map(|pair| unit(*pair));
        Cow::Owned(char::decode_utf16(units).map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER)).collect())
    };
    match bytes {
        [0xff, 0xfe, ..] => return utf_16(u16::from_le_bytes),
        [0xfe, 0xff, ..] => return utf_16(u16::from_be_bytes),
        _ => {}
    }
    match str::from_utf8(bytes) {
        Ok(text) => Cow::Borrowed(text.strip_prefix('\u{feff}').unwrap_or(text)),
        Err(_) => Cow::Owned(bytes.iter().map(|byte| char::from(*byte)).collect()),
    }
}

/// A statement and the line that it starts in, from 1.
pub(super) struct Statement<'a> {
    pub line: usize,
    text: Cow<'a, str>,
}

impl Statement<'_> {
    /// The keyword; empty on an empty line.
    pub fn keyword(&self) -> &str {
        self.text.split_whitespace().next().unwrap_or_default()
    }

    /// Everything after the keyword.
    pub fn rest(&self) -> &str {
        self.text.trim_start()[self.keyword().len()..].trim()
    }

    /// The words after the keyword.
    pub fn words(&self) -> impl Iterator<Item = &str> {
        self.rest().split_whitespace()
    }

    /// The numbers after the keyword. The error names the word that is not a number.
    pub fn numbers<N: std::str::FromStr>(&self) -> Result<Vec<N>, String> {
        self.words().map(|word| word.parse().map_err(|_| format!("'{word}' is not a number"))).collect()
    }
}

/// The statements of a text.
pub(super) fn statements(text: &str) -> impl Iterator<Item = Statement<'_>> {
    let mut lines = text.lines().enumerate();
    std::iter::from_fn(move || {
        let (index, first) = lines.next()?;
        let mut text = Cow::Borrowed(without_comment(first));
        while let Some(unfinished) = text.strip_suffix('\\') {
            let next = lines.next().map_or("", |(_, line)| without_comment(line));
            text = Cow::Owned(format!("{unfinished} {next}"));
        }
        Some(Statement { line: index + 1, text })
    })
}

/// Removes a comment, whose `#` starts a word: names may contain a `#`.
fn without_comment(line: &str) -> &str {
    let starts_word = |at: usize| line[..at].chars().next_back().is_none_or(char::is_whitespace);
    let end = line.match_indices('#').map(|(at, _)| at).find(|at| starts_word(*at));
    line[..end.unwrap_or(line.len())].trim_end()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comments_and_continuations_are_understood() {
        let text = "f 1 2 \\\n 3 # note\n\n# all of it \\\nusemtl mat#1\nf 1 \\";
        let found: Vec<(usize, String)> = statements(text)
            .map(|s| (s.line, format!("{}|{}", s.keyword(), s.words().collect::<Vec<_>>().join(" "))))
            .collect();
        let expected = [(1, "f|1 2 3"), (3, "|"), (4, "|"), (5, "usemtl|mat#1"), (6, "f|1")];
        assert_eq!(found, expected.map(|(line, text)| (line, text.to_owned())));
    }

    #[test]
    fn other_encodings_are_read() {
        assert_eq!(decoded(b"\xef\xbb\xbfv 1"), "v 1");
        assert_eq!(decoded(b"usemtl gr\xfcn"), "usemtl grün");
        assert_eq!(decoded(b"\xff\xfev\0 \x001\0"), "v 1");
        assert_eq!(decoded(b"\xfe\xff\0v\0 \x001"), "v 1");
    }
}
