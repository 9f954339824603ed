//! Points that have names: on the command line, and in files.

use super::{SpecError, end, refuse};
use crate::{error::ClientError, file};
use quadmuse_proto::{Landmark, NamedPoint, Place};
use serde::Deserialize;
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    str::FromStr,
};

/// Where the landmarks of a map come from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LandmarksSpec {
    /// The example's own, by the names that `--names` gives points of the scan.
    ByName,
    /// A file of pairs, or of names.
    File(PathBuf),
}

impl FromStr for LandmarksSpec {
    type Err = SpecError;

    fn from_str(text: &str) -> Result<Self, SpecError> {
        Ok(if text == "names" { Self::ByName } else { Self::File(text.into()) })
    }
}

/// `NAME=PLACE`: a point by its name. The place is one of a [`super::ConstraintSpec`], or `v` and the number of a vertex.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedSpec(pub NamedPoint);

impl FromStr for NamedSpec {
    type Err = SpecError;

    fn from_str(text: &str) -> Result<Self, SpecError> {
        let expected = "a name and its place, like nose_tip=1,2,3 or nose_tip=v1234";
        let Some((name, place)) = text.split_once('=').filter(|(name, _)| !name.trim().is_empty()) else {
            return refuse(expected, text);
        };
        let place = match place.trim().strip_prefix('v').map(str::parse) {
            Some(Ok(vertex)) => Some(Place::OnVertex { vertex }),
            Some(Err(_)) => None,
            None => end(place).flatten(),
        };
        match place.and_then(|place| named(name.trim().to_owned(), place)) {
            Some(point) => Ok(Self(point)),
            None => refuse(expected, text),
        }
    }
}

/// A landmark of an example, which is a vertex or a point.
fn named(name: String, place: Place) -> Option<NamedPoint> {
    match place {
        Place::Point(point) => Some(NamedPoint { name, vertex: None, point: Some(point) }),
        Place::OnVertex { vertex } => Some(NamedPoint { name, vertex: Some(vertex), point: None }),
        Place::OnFace { .. } | Place::Domain { .. } => None,
    }
}

/// A place as a file has it: also as the bare number of a vertex.
#[derive(Deserialize)]
#[serde(untagged)]
enum Written {
    Vertex(u32),
    Place(Place),
}

/// The three forms that a file of landmarks may have.
#[derive(Deserialize)]
#[serde(untagged)]
enum Content {
    Pairs(Vec<Landmark>),
    /// As `show --json` has them.
    List(Vec<NamedPoint>),
    ByName(BTreeMap<String, Written>),
}

/// The landmarks of a file.
#[derive(Clone, Debug, PartialEq)]
pub enum Landmarks {
    /// Points of an example with those of a scan.
    Pairs(Vec<Landmark>),
    /// Places by name.
    Named(Vec<(String, Place)>),
}

impl Landmarks {
    /// Reads a file.
    ///
    /// # Errors
    /// It can't be read, or holds no landmarks.
    pub fn read(path: &Path) -> Result<Self, ClientError> {
        let invalid = |detail: String| ClientError::LandmarksInvalid { file: path.into(), detail };
        match serde_json::from_slice(&file::read(path)?).map_err(|error| invalid(error.to_string()))? {
            Content::Pairs(pairs) => Ok(Self::Pairs(pairs)),
            Content::List(list) => {
                let place = |point: NamedPoint| match (point.vertex, point.point) {
                    (Some(vertex), _) => Ok((point.name, Place::OnVertex { vertex })),
                    (None, Some(at)) => Ok((point.name, Place::Point(at))),
                    (None, None) => Err(invalid(format!("`{}` without a place", point.name))),
                };
                Ok(Self::Named(list.into_iter().map(place).collect::<Result<_, _>>()?))
            }
            Content::ByName(all) => {
                let place = |(name, written)| match written {
                    Written::Vertex(vertex) => (name, Place::OnVertex { vertex }),
                    Written::Place(place) => (name, place),
                };
                Ok(Self::Named(all.into_iter().map(place).collect()))
            }
        }
    }

    /// Reads a file that has to name its points.
    ///
    /// # Errors
    /// As [`Landmarks::read`], and where the file holds pairs.
    pub fn read_named(path: &Path) -> Result<Vec<(String, Place)>, ClientError> {
        match Self::read(path)? {
            Self::Named(named) => Ok(named),
            // An empty list is a list of either.
            Self::Pairs(pairs) if pairs.is_empty() => Ok(Vec::new()),
            Self::Pairs(_) => {
                let detail = "pairs of points, where names are wanted: {\"nose_tip\": [x, y, z], …}".to_owned();
                Err(ClientError::LandmarksInvalid { file: path.into(), detail })
            }
        }
    }

    /// Reads the landmarks of an example.
    ///
    /// # Errors
    /// As [`Landmarks::read_named`], and where a place is neither a point nor a vertex.
    pub fn read_of_example(path: &Path) -> Result<Vec<NamedPoint>, ClientError> {
        let point = |(name, place): (String, Place)| {
            let detail = format!("`{name}` at a place that is neither a point nor a vertex");
            named(name, place).ok_or_else(|| ClientError::LandmarksInvalid { file: path.into(), detail })
        };
        Self::read_named(path)?.into_iter().map(point).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Landmarks, ClientError> {
        let file = tempfile::NamedTempFile::new().expect("a file");
        std::fs::write(file.path(), text).expect("writes");
        Landmarks::read(file.path())
    }

    #[test]
    fn a_file_holds_pairs_or_names_each_in_the_ways_people_write_them() {
        let pairs = read(r#"[{"on_example": [0, 0, 1], "on_input": [1, 2, 3], "name": "nose"}]"#).expect("pairs");
        assert!(matches!(&pairs, Landmarks::Pairs(pairs) if pairs[0].name.as_deref() == Some("nose")));
        let chin = ("chin".to_owned(), Place::OnVertex { vertex: 7 });
        let nose = ("nose".to_owned(), Place::Point([1.0, 2.0, 3.5]));
        for text in [
            r#"{"nose": [1, 2, 3.5], "chin": 7}"#,
            r#"{"nose": [1, 2, 3.5], "chin": {"vertex": 7}}"#,
            r#"[{"name": "chin", "vertex": 7, "point": [0, 0, 0]}, {"name": "nose", "point": [1, 2, 3.5]}]"#,
        ] {
            assert_eq!(read(text).expect(text), Landmarks::Named(vec![chin.clone(), nose.clone()]), "{text}");
        }
        for text in ["", "3", r#"{"nose": [1, 2]}"#, r#"{"nose": "left"}"#, r#"[{"name": "chin"}]"#] {
            assert!(read(text).is_err(), "{text}");
        }
    }

    #[test]
    fn a_name_and_its_place_are_read() {
        let spec = |text: &str| text.parse::<NamedSpec>().map(|spec| spec.0);
        let nose = NamedPoint { name: "nose tip".into(), vertex: None, point: Some([1.0, -2.0, 3.0]) };
        assert_eq!(spec("nose tip=1,-2,3"), Ok(nose));
        assert_eq!(spec("chin=v12").expect("a vertex").vertex, Some(12));
        for text in ["", "chin", "=1,2,3", "chin=", "chin=v", "chin=v-1", "chin=1,2", "chin=u0.1,v0.2"] {
            assert!(spec(text).is_err(), "{text}");
        }
    }
}
