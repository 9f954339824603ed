//! Why a mesh is refused.
//!
//! Messages say what was expected, what was found and the way out. Vertices and faces are counted from 1 in messages, as
//! OBJ files count them; fields count from 0.

use super::{Format, Vec3};
use std::borrow::Cow;
use std::fmt;

/// Why a mesh cannot be read, prepared or written.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MeshError {
    /// The bytes break the rules of their format.
    #[error("{format}, {place}: expected {expected}, found {found}; {remedy}")]
    Malformed {
        /// Format that was being read.
        format: Format,
        /// Where in the file.
        place: FileLocation,
        /// What the format demands there.
        expected: Cow<'static, str>,
        /// What is there (escaped and cut).
        found: String,
        /// What to do.
        remedy: &'static str,
    },
    /// A face names a vertex, UV or normal that is not there.
    #[error(
        "{format}, {place}: expected {what} that exists (there are {available}), found {found}; export the file again or \
         remove the face"
    )]
    IndexOutOfRange {
        /// Format that was being read.
        format: Format,
        /// Where in the file.
        place: FileLocation,
        /// What is indexed, with its article.
        what: &'static str,
        /// The index as the file counts.
        found: String,
        /// How many there are.
        available: usize,
    },
    /// Text in an encoding that is not UTF-8.
    #[error("expected UTF-8 or ASCII text, found {found}; save the file as UTF-8")]
    Encoding {
        /// The encoding found.
        found: &'static str,
    },
    /// The bytes are not of the format they were sent as.
    #[error(
        "expected {declared}, found what looks like {looks_like}; send it as {} or without a type",
        looks_like.media_type()
    )]
    OtherFormat {
        /// The format that was asked for.
        declared: Format,
        /// The format that the bytes look like.
        looks_like: Format,
    },
    /// A file that refers to other files.
    #[error("expected all buffers inside the file, found a reference to {uri}; embed the buffers or export as .glb")]
    External {
        /// The reference (escaped and cut).
        uri: String,
    },
    /// A file that demands a feature which is not read.
    #[error("expected plain glTF 2.0, found the required extension {name}; export without it")]
    Extension {
        /// Name of the extension (escaped and cut).
        name: String,
    },
    /// A position that a face uses is NaN, infinite or too large to compute with.
    #[error(
        "vertex {} (counted from 1): expected finite coordinates below 1e60, found ({}, {}, {}); correct or remove the vertex",
        vertex + 1, position.x, position.y, position.z
    )]
    NotFinite {
        /// The vertex, from 0.
        vertex: usize,
        /// Its position.
        position: Vec3,
    },
    /// A face of a mesh that was not read from a file names a missing vertex or has too few corners.
    #[error("face {} (counted from 1): expected at least 3 corners between 1 and {vertices}, found {found}; correct the face", face + 1)]
    FaceInvalid {
        /// The face, from 0.
        face: usize,
        /// Number of vertices.
        vertices: usize,
        /// What is wrong with it.
        found: String,
    },
    /// No face at all.
    #[error("expected a surface, found no face (and {vertices} vertices); export faces, not points or curves")]
    NoFaces {
        /// Vertices in the file.
        vertices: usize,
    },
    /// No face has an area, or all vertices lie at one point.
    #[error("expected a surface with an area, found faces without any (bounding box diagonal {diagonal:e}); {remedy}")]
    NoExtent {
        /// Diagonal of the bounding box of the used vertices.
        diagonal: f64,
        /// What to do.
        remedy: &'static str,
    },
    /// An edge with more faces than can be told apart.
    #[error(
        "expected at most two faces at an edge, found {count} (faces {}) at the edge between vertices {} and {} (all \
         counted from 1), which lie at ({}, {}, {}) and ({}, {}, {}); split or delete the faces that meet there",
        Numbers(faces), vertices[0] + 1, vertices[1] + 1,
        positions[0].x, positions[0].y, positions[0].z, positions[1].x, positions[1].y, positions[1].z
    )]
    EdgeShared {
        /// The edge's vertices, from 0.
        vertices: [u32; 2],
        /// Their positions.
        positions: [Vec3; 2],
        /// The first faces at the edge, from 0.
        faces: Vec<u32>,
        /// Number of faces at the edge.
        count: usize,
    },
    /// A face that runs through a vertex twice in a way that cannot be cut into triangles.
    #[error(
        "face {} (counted from 1): expected each vertex once, found vertex {} (counted from 1) several times; split the face",
        face + 1, vertex + 1
    )]
    FaceRepeats {
        /// The face, from 0.
        face: u32,
        /// The vertex, from 0.
        vertex: u32,
    },
    /// A surface with one side only, such as a Möbius strip.
    #[error(
        "expected a surface with two sides, found one that passes into its own back at face {} (counted from 1), across the \
         edge between vertices {} and {} (counted from 1); cut the surface there",
        face + 1, vertices[0] + 1, vertices[1] + 1
    )]
    OneSided {
        /// A face at which the sides contradict, from 0.
        face: u32,
        /// The edge across which they do, from 0.
        vertices: [u32; 2],
    },
    /// More of something than the limits admit.
    #[error("expected at most {limit} {what}, found {found}; send a smaller mesh or raise the limit")]
    TooLarge {
        /// What is counted.
        what: &'static str,
        /// How many there are.
        found: u64,
        /// How many are admitted.
        limit: u64,
    },
    /// The bytes look like none of the formats.
    #[error("expected OBJ, PLY, STL, OFF or glTF, found {found}; name the format or export as one of them")]
    FormatUnknown {
        /// How the bytes start (escaped and cut).
        found: String,
    },
}

/// The groups of reasons that callers tell apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum MeshErrorKind {
    /// The file breaks the rules of its format.
    Unreadable,
    /// There is no surface in it.
    Empty,
    /// More than two faces meet at an edge.
    NotManifold,
    /// It exceeds a limit.
    TooLarge,
    /// It is of no known format.
    FormatUnknown,
    /// It is a surface, but of a kind that is not supported.
    TopologyUnsupported,
}

impl MeshError {
    /// The group that the reason belongs to.
    pub fn code(&self) -> MeshErrorKind {
        match self {
            Self::Malformed { .. }
            | Self::IndexOutOfRange { .. }
            | Self::Encoding { .. }
            | Self::OtherFormat { .. }
            | Self::External { .. }
            | Self::Extension { .. }
            | Self::NotFinite { .. }
            | Self::FaceInvalid { .. } => MeshErrorKind::Unreadable,
            Self::NoFaces { .. } | Self::NoExtent { .. } => MeshErrorKind::Empty,
            Self::EdgeShared { .. } | Self::FaceRepeats { .. } => MeshErrorKind::NotManifold,
            Self::OneSided { .. } => MeshErrorKind::TopologyUnsupported,
            Self::TooLarge { .. } => MeshErrorKind::TooLarge,
            Self::FormatUnknown { .. } => MeshErrorKind::FormatUnknown,
        }
    }
}

/// A location in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileLocation {
    /// A line, counted from 1.
    Line(u64),
    /// A byte offset.
    Byte(u64),
    /// The file as a whole.
    File,
    /// An element of a named kind, counted from 0 and shown counted from 1.
    Element(&'static str, u64),
}

impl fmt::Display for FileLocation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Line(line) => write!(f, "line {line}"),
            Self::Byte(offset) => write!(f, "byte {offset}"),
            Self::File => f.write_str("whole file"),
            Self::Element(kind, number) => write!(f, "{kind} {} (counted from 1)", number + 1),
        }
    }
}

/// Shows indices counted from 1, separated by commas.
struct Numbers<'a>(&'a [u32]);

impl fmt::Display for Numbers<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, n) in self.0.iter().enumerate() {
            write!(f, "{}{}", if i == 0 { "" } else { ", " }, n + 1)?;
        }
        Ok(())
    }
}

/// Bytes of an upload as they may stand in a message: escaped, in backquotes, at most 40 characters.
pub(super) fn quoted(bytes: &[u8]) -> String {
    const SHOWN_CHARS: usize = 40;
    if bytes.is_empty() {
        return "nothing".into();
    }
    let text = String::from_utf8_lossy(&bytes[..bytes.len().min(4 * SHOWN_CHARS)]);
    let shown: String = text.chars().take(SHOWN_CHARS).flat_map(char::escape_debug).collect();
    let more = if text.chars().count() > SHOWN_CHARS || bytes.len() > 4 * SHOWN_CHARS { "…" } else { "" };
    format!("`{shown}{more}`")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_count_from_one_and_name_the_way_out() {
        let error = MeshError::EdgeShared {
            vertices: [0, 4],
            positions: [Vec3::zeros(), Vec3::new(1.0, 0.5, 0.0)],
            faces: vec![0, 1, 8],
            count: 3,
        };
        let text = error.to_string();
        assert!(
            text.contains("faces 1, 2, 9") && text.contains("vertices 1 and 5") && text.contains("split"),
            "{text}"
        );
        assert_eq!(error.code(), MeshErrorKind::NotManifold);
    }

    #[test]
    fn quoted_bytes_are_escaped_and_cut() {
        assert_eq!(quoted(b"a\x00\n"), "`a\\0\\n`");
        assert!(quoted(&[b'x'; 1000]).chars().count() <= 43);
        assert_eq!(quoted(b""), "nothing");
    }
}
