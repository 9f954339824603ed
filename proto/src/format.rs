//! Mesh formats: their names in `?format=`, their media types and their file extensions.

use crate::segment::UnknownWord;
use serde::{Deserialize, Serialize};
use std::{fmt, str::FromStr};

/// A mesh file format that the service reads and writes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum MeshFormat {
    /// Wavefront OBJ.
    #[default]
    Obj,
    /// Stanford PLY, ascii or binary.
    Ply,
    /// Object File Format.
    Off,
    /// Stereolithography, ascii or binary; triangles only.
    Stl,
    /// Binary glTF; triangles only.
    Glb,
}

impl MeshFormat {
    /// All formats, the one written by default first.
    pub const ALL: [Self; 5] = [Self::Obj, Self::Ply, Self::Off, Self::Stl, Self::Glb];

    /// The name in `?format=`, which is the file extension as well.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Obj => "obj",
            Self::Ply => "ply",
            Self::Off => "off",
            Self::Stl => "stl",
            Self::Glb => "glb",
        }
    }

    /// The media type of a body in this format.
    pub fn media_type(self) -> &'static str {
        match self {
            Self::Obj => "model/obj",
            Self::Ply => "model/ply",
            Self::Off => "model/off",
            Self::Stl => "model/stl",
            Self::Glb => "model/gltf-binary",
        }
    }

    /// The format of a media type (parameters cut off, case ignored); `None` if it names none.
    pub fn from_media_type(text: &str) -> Option<Self> {
        let essence = text.split(';').next().unwrap_or_default().trim();
        Self::ALL.into_iter().find(|format| format.media_type().eq_ignore_ascii_case(essence))
    }

    /// The format that a file name's extension asks for; `None` if it names none.
    pub fn from_file_name(name: &str) -> Option<Self> {
        let (_, extension) = name.rsplit_once('.')?;
        Self::ALL.into_iter().find(|format| format.as_str().eq_ignore_ascii_case(extension))
    }
}

impl FromStr for MeshFormat {
    type Err = UnknownWord;

    fn from_str(text: &str) -> Result<Self, UnknownWord> {
        let expected = "obj, ply, off, stl, glb";
        Self::ALL.into_iter().find(|f| f.as_str() == text).ok_or_else(|| UnknownWord { expected, found: text.into() })
    }
}

impl fmt::Display for MeshFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.as_str())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_format_is_found_by_its_name_media_type_and_extension() {
        for format in MeshFormat::ALL {
            assert_eq!(format.as_str().parse(), Ok(format));
            assert_eq!(serde_json::to_value(format).expect("a word"), format.as_str());
            assert_eq!(MeshFormat::from_media_type(&format!("{}; charset=utf-8", format.media_type())), Some(format));
            assert_eq!(MeshFormat::from_file_name(&format!("a.b.{}", format.as_str().to_uppercase())), Some(format));
        }
        assert_eq!(MeshFormat::from_media_type("text/plain"), None);
        assert_eq!(MeshFormat::from_file_name("obj"), None);
    }
}
