//! Lines, words and numbers of the text formats.

use super::error::{FileLocation, MeshError, quoted};
use super::{Format, Vec3};

/// The lines of a text, numbered from 1. `\n`, `\r\n` and a lone `\r` end a line.
pub(super) struct Lines<'a> {
    rest: &'a [u8],
    number: u64,
}

impl<'a> Lines<'a> {
    pub(super) fn new(text: &'a [u8]) -> Self {
        Self { rest: text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(text), number: 0 }
    }

    /// Lines of a text that starts after `lines_before` others.
    pub(super) fn after(text: &'a [u8], lines_before: u64) -> Self {
        Self { rest: text, number: lines_before }
    }

    /// Number of the line returned last.
    pub(super) fn number(&self) -> u64 {
        self.number
    }

    /// The text after the line returned last.
    pub(super) fn rest(&self) -> &'a [u8] {
        self.rest
    }
}

impl<'a> Iterator for Lines<'a> {
    type Item = &'a [u8];

    fn next(&mut self) -> Option<&'a [u8]> {
        if self.rest.is_empty() {
            return None;
        }
        self.number += 1;
        let Some(end) = memchr::memchr2(b'\n', b'\r', self.rest) else {
            return Some(std::mem::take(&mut self.rest));
        };
        let (line, tail) = self.rest.split_at(end);
        self.rest = if tail.starts_with(b"\r\n") { &tail[2..] } else { &tail[1..] };
        Some(line)
    }
}

/// The words of a line.
#[derive(Clone)]
pub(super) struct Words<'a>(&'a [u8]);

impl<'a> Words<'a> {
    pub(super) fn new(line: &'a [u8]) -> Self {
        Self(line)
    }

    /// Bytes after the words returned so far.
    pub(super) fn bytes_left(&self) -> usize {
        self.0.len()
    }

    /// What follows the words returned so far, without the space around it.
    pub(super) fn rest(&self) -> &'a [u8] {
        trim(self.0)
    }
}

impl<'a> Iterator for Words<'a> {
    type Item = &'a [u8];

    #[inline]
    fn next(&mut self) -> Option<&'a [u8]> {
        let start = self.0.iter().position(|b| !is_space(*b))?;
        let tail = &self.0[start..];
        let end = tail.iter().position(|b| is_space(*b)).unwrap_or(tail.len());
        let (word, rest) = tail.split_at(end);
        self.0 = rest;
        Some(word)
    }
}

#[inline]
fn is_space(b: u8) -> bool {
    matches!(b, b' ' | b'\t' | b'\x0b' | b'\x0c' | b'\r' | b'\n')
}

fn trim(mut text: &[u8]) -> &[u8] {
    while let [b, rest @ ..] = text
        && is_space(*b)
    {
        text = rest;
    }
    while let [rest @ .., b] = text
        && is_space(*b)
    {
        text = rest;
    }
    text
}

/// A decimal number; `nan` and `inf` are numbers here.
#[inline]
pub(super) fn number(word: &[u8]) -> Option<f64> {
    fast_float2::parse(word.strip_prefix(b"+").unwrap_or(word)).ok()
}

/// The text of a file, without the NUL bytes that some programs pad its end with.
///
/// # Errors
/// Of UTF-16 and of text with NUL bytes: names the encoding, or the place of the first such byte.
pub(super) fn decoded(format: Format, bytes: &[u8]) -> Result<&[u8], MeshError> {
    let end = bytes.iter().rposition(|b| *b != 0).map_or(0, |last| last + 1);
    let text = &bytes[..end];
    if text.starts_with(b"\xff\xfe") || text.starts_with(b"\xfe\xff") {
        return Err(MeshError::Encoding { found: "UTF-16" });
    }
    let Some(nul) = memchr::memchr(0, text) else { return Ok(text) };
    let head = &text[..text.len().min(512)];
    let nuls = |parity: usize| head.iter().skip(parity).step_by(2).filter(|b| **b == 0).count();
    let (even, odd) = (nuls(0), nuls(1));
    if even.max(odd) * 4 > head.len() && even.min(odd) == 0 {
        return Err(MeshError::Encoding { found: "UTF-16 without a byte order mark" });
    }
    Err(MeshError::Malformed {
        format,
        place: FileLocation::Byte(nul as u64),
        expected: "text".into(),
        found: "a NUL byte".into(),
        remedy: "the file is binary or damaged: export it again",
    })
}

/// The line that a text reader is at, for its messages.
#[derive(Clone, Copy)]
pub(super) struct TextPosition {
    pub(super) format: Format,
    pub(super) line: u64,
}

impl TextPosition {
    /// An error at this line.
    pub(super) fn error(self, expected: &'static str, found: String, remedy: &'static str) -> MeshError {
        MeshError::Malformed {
            format: self.format,
            place: FileLocation::Line(self.line),
            expected: expected.into(),
            found,
            remedy,
        }
    }

    /// The next word as a number.
    ///
    /// # Errors
    /// The word is missing or no number; commas for points are named.
    #[inline]
    pub(super) fn number(self, words: &mut Words<'_>, expected: &'static str) -> Result<f64, MeshError> {
        let word = words.next().unwrap_or_default();
        number(word).ok_or_else(|| self.no_number(word, expected))
    }

    /// The next three words as a point.
    ///
    /// # Errors
    /// See [`Self::number`].
    #[inline]
    pub(super) fn point(self, words: &mut Words<'_>, expected: &'static str) -> Result<Vec3, MeshError> {
        let x = self.number(words, expected)?;
        let y = self.number(words, expected)?;
        let z = self.number(words, expected)?;
        Ok(Vec3::new(x, y, z))
    }

    #[cold]
    pub(super) fn no_number(self, word: &[u8], expected: &'static str) -> MeshError {
        let remedy = if word.is_empty() {
            "the line is cut short: export the file again"
        } else if word.contains(&b',') {
            "write decimals with a point, not a comma"
        } else if word.contains(&b'#') {
            "this is how some programs write a number that is not one: correct it where it came from"
        } else {
            "correct the line or export the file again"
        };
        self.error(expected, quoted(word), remedy)
    }
}

/// Fails when there is more of something than admitted.
///
/// # Errors
/// [`MeshError::TooLarge`].
#[inline]
pub(super) fn within(what: &'static str, found: usize, limit: usize) -> Result<(), MeshError> {
    if found > limit {
        return Err(MeshError::TooLarge { what, found: found as u64, limit: limit as u64 });
    }
    Ok(())
}

/// Appends the shortest decimal that reads back as `value`.
pub(super) fn push_number(out: &mut Vec<u8>, value: f64) {
    let mut buffer = [0; lexical_core::BUFFER_SIZE];
    let text = lexical_core::write(value, &mut buffer);
    out.extend_from_slice(text.strip_suffix(b".0").unwrap_or(text));
}

/// Appends the shortest decimal that reads back as `value`.
pub(super) fn push_number_f32(out: &mut Vec<u8>, value: f32) {
    let mut buffer = [0; lexical_core::BUFFER_SIZE];
    let text = lexical_core::write(value, &mut buffer);
    out.extend_from_slice(text.strip_suffix(b".0").unwrap_or(text));
}

/// Appends a whole number.
pub(super) fn push_integer(out: &mut Vec<u8>, value: u64) {
    let mut buffer = [0; lexical_core::BUFFER_SIZE];
    out.extend_from_slice(lexical_core::write(value, &mut buffer));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_line_end_counts() {
        let mut lines = Lines::new(b"a\nb\r\nc\rd\n\ne");
        let all: Vec<_> = lines.by_ref().collect();
        assert_eq!(all, [b"a".as_slice(), b"b", b"c", b"d", b"", b"e"]);
        assert_eq!(lines.number(), 6);
    }

    #[test]
    fn numbers_in_all_dialects_are_read() {
        for (word, value) in [("1", 1.0), ("+.5", 0.5), ("5.", 5.0), ("-1e-03", -1e-3), ("1E+2", 100.0)] {
            assert_eq!(number(word.as_bytes()), Some(value), "{word}");
        }
        for word in ["", "+", "1,5", "1.#IND", "0x10", "--1", "1e"] {
            assert_eq!(number(word.as_bytes()), None, "{word}");
        }
        assert!(number(b"nan").is_some_and(f64::is_nan));
    }

    #[test]
    fn written_numbers_read_back_bit_for_bit() {
        for value in [0.1, -0.0, 1e300, 5e-324, 1.0, 123_456_789.123, f64::MAX] {
            let mut text = Vec::new();
            push_number(&mut text, value);
            assert_eq!(number(&text).map(f64::to_bits), Some(value.to_bits()), "{}", String::from_utf8_lossy(&text));
        }
    }
}
