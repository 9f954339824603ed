//! The mesh file formats and how to tell them apart.

use std::fmt;

/// A mesh file format.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Format {
    /// Wavefront OBJ.
    Obj,
    /// Polygon file format: ascii and both binary encodings.
    Ply,
    /// Stereolithography: ascii and binary.
    Stl,
    /// Object file format of Geomview.
    Off,
    /// glTF 2.0: binary (`.glb`) and JSON with embedded buffers (`.gltf`).
    Glb,
}

/// How many bytes [`Format::sniff`] looks at.
const SNIFFED_BYTES: usize = 4096;

impl Format {
    /// Every format, in the order of the documentation.
    pub const ALL: [Format; 5] = [Format::Obj, Format::Ply, Format::Stl, Format::Off, Format::Glb];

    /// The format of a file extension, with or without its dot, in any case.
    pub fn from_extension(extension: &str) -> Option<Self> {
        match extension.trim_start_matches('.').to_ascii_lowercase().as_str() {
            "obj" => Some(Self::Obj),
            "ply" => Some(Self::Ply),
            "stl" => Some(Self::Stl),
            "off" | "coff" | "noff" | "stoff" | "cnoff" => Some(Self::Off),
            "glb" | "gltf" => Some(Self::Glb),
            _ => None,
        }
    }

    /// The format of a media type; parameters (`; charset=…`) are ignored.
    pub fn from_media_type(media_type: &str) -> Option<Self> {
        let essence = media_type.split(';').next().unwrap_or_default().trim().to_ascii_lowercase();
        match essence.as_str() {
            "model/obj" => Some(Self::Obj),
            "model/ply" => Some(Self::Ply),
            "model/stl" => Some(Self::Stl),
            "model/off" => Some(Self::Off),
            "model/gltf-binary" | "model/gltf+json" => Some(Self::Glb),
            _ => None,
        }
    }

    /// The extension under which the writer's output is saved, without a dot.
    pub fn extension(self) -> &'static str {
        match self {
            Self::Obj => "obj",
            Self::Ply => "ply",
            Self::Stl => "stl",
            Self::Off => "off",
            Self::Glb => "glb",
        }
    }

    /// The media type of the writer's output.
    pub fn media_type(self) -> &'static str {
        match self {
            Self::Obj => "model/obj",
            Self::Ply => "model/ply",
            Self::Stl => "model/stl",
            Self::Off => "model/off",
            Self::Glb => "model/gltf-binary",
        }
    }

    /// Recognises a format from a file's first bytes (for binary STL, also from its length).
    pub fn sniff(bytes: &[u8]) -> Option<Self> {
        let head = &bytes[..bytes.len().min(SNIFFED_BYTES)];
        let head = head.strip_prefix(b"\xef\xbb\xbf").unwrap_or(head);
        if head.starts_with(b"glTF") {
            return Some(Self::Glb);
        }
        if head.starts_with(b"ply") && head.get(3).is_some_and(u8::is_ascii_whitespace) {
            return Some(Self::Ply);
        }
        if has_binary_stl_length(bytes) {
            return Some(Self::Stl);
        }
        let text = head.trim_ascii_start();
        match text.first()? {
            b'{' => return Some(Self::Glb),
            b's' | b'S' if starts_with_word(text, b"solid") => return Some(Self::Stl),
            _ => {}
        }
        let first_line = text.split(|b| matches!(b, b'\n' | b'\r')).find(|line| !is_comment(line))?;
        if is_off_header(first_line) {
            return Some(Self::Off);
        }
        text.split(|b| *b == b'\n').any(is_obj_line).then_some(Self::Obj)
    }
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Obj => "OBJ",
            Self::Ply => "PLY",
            Self::Stl => "STL",
            Self::Off => "OFF",
            Self::Glb => "glTF",
        })
    }
}

/// Whether the length is exactly the one that a binary STL header announces.
fn has_binary_stl_length(bytes: &[u8]) -> bool {
    let Some(Ok(count)) = bytes.get(80..84).map(<[u8; 4]>::try_from) else { return false };
    bytes.len() as u64 == 84 + 50 * u64::from(u32::from_le_bytes(count))
}

fn starts_with_word(text: &[u8], word: &[u8]) -> bool {
    let Some((head, rest)) = text.split_at_checked(word.len()) else { return false };
    head.eq_ignore_ascii_case(word) && rest.first().is_none_or(u8::is_ascii_whitespace)
}

fn is_comment(line: &[u8]) -> bool {
    matches!(line.trim_ascii().first(), None | Some(b'#'))
}

/// Whether a line starts with `OFF` or one of its variants (`COFF`, `STCN4nOFF`, …).
pub(super) fn is_off_header(line: &[u8]) -> bool {
    let word = line.trim_ascii_start().split(u8::is_ascii_whitespace).next().unwrap_or_default();
    word.strip_suffix(b"OFF").is_some_and(|prefix| prefix.len() <= 5 && prefix.iter().all(|b| b"STCN4n".contains(b)))
}

fn is_obj_line(line: &[u8]) -> bool {
    const WORDS: [&[u8]; 9] = [b"v", b"vt", b"vn", b"f", b"o", b"g", b"mtllib", b"usemtl", b"s"];
    WORDS.iter().any(|word| starts_with_word(line.trim_ascii_start(), word) && line.trim_ascii().len() > word.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_lead_back_to_the_format() {
        for format in Format::ALL {
            assert_eq!(Format::from_extension(format.extension()), Some(format));
            assert_eq!(Format::from_media_type(format.media_type()), Some(format));
        }
        assert_eq!(Format::from_extension(".GLTF"), Some(Format::Glb));
        assert_eq!(Format::from_media_type("Model/OBJ; charset=utf-8"), Some(Format::Obj));
        assert_eq!(Format::from_extension("fbx"), None);
        assert_eq!(Format::from_media_type("application/octet-stream"), None);
    }

    #[test]
    fn formats_are_recognised_from_bytes() {
        assert_eq!(Format::sniff(b"# a comment\nmtllib a.mtl\nv 0 0 0\n"), Some(Format::Obj));
        assert_eq!(Format::sniff(b"\xef\xbb\xbfv 0 0 0\r\n"), Some(Format::Obj));
        assert_eq!(Format::sniff(b"ply\r\nformat ascii 1.0\r\n"), Some(Format::Ply));
        assert_eq!(Format::sniff(b"solid x\nfacet normal 0 0 1\n"), Some(Format::Stl));
        assert_eq!(Format::sniff(b"# hello\nSTCNOFF\n3 1 0\n"), Some(Format::Off));
        assert_eq!(Format::sniff(b"OFF 3 1 0\n"), Some(Format::Off));
        assert_eq!(Format::sniff(b"glTF\x02\0\0\0"), Some(Format::Glb));
        assert_eq!(Format::sniff(b"  {\"asset\":{}}"), Some(Format::Glb));
        let mut stl = vec![b'v'; 84];
        stl[80..84].copy_from_slice(&1u32.to_le_bytes());
        stl.resize(134, 0);
        assert_eq!(Format::sniff(&stl), Some(Format::Stl));
    }

    #[test]
    fn noise_is_not_recognised() {
        assert_eq!(Format::sniff(b""), None);
        assert_eq!(Format::sniff(b"hello, world"), None);
        assert_eq!(Format::sniff(&[0xff; 300]), None);
    }
}
