//! What is known of an example: its ground state (what the user supplied) and a summary of its segments.

use std::collections::HashSet;
use std::fmt;

use quadmuse_proto::id::ExampleId;
use serde::{Deserialize, Serialize};

use crate::error::StoreError;

/// Longest name, in bytes.
pub const NAME_BYTES_MAX: usize = 512;
/// Most tags of an example.
pub const TAGS_MAX: usize = 64;
/// Longest tag, in bytes.
pub const TAG_BYTES_MAX: usize = 128;
/// Most segments of an example.
pub const SEGMENTS_MAX: usize = 4096;
/// Most repairs that are kept word by word.
pub const REPAIRS_MAX: usize = 256;
/// Longest description of a repair, in bytes.
pub const REPAIR_BYTES_MAX: usize = 1024;
/// Longest name of a file format, in bytes.
pub const FORMAT_BYTES_MAX: usize = 32;
/// Greatest relevance.
pub const RELEVANCE_MAX: f32 = 5.0;

/// Longest author and longest licence, in bytes.
const CREDIT_BYTES_MAX: usize = 512;
/// Longest notes, in bytes.
pub const NOTES_BYTES_MAX: usize = 8192;
/// Most named landmarks of an example.
pub const LANDMARKS_MAX: usize = 256;
/// Longest name of a landmark, in bytes.
const LANDMARK_NAME_BYTES_MAX: usize = 128;

/// BLAKE3 of some content, 32 bytes; as text 64 hexadecimal digits.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct ContentHash([u8; 32]);

impl ContentHash {
    /// The hash of `bytes`.
    pub fn of(bytes: &[u8]) -> Self {
        Self(*blake3::hash(bytes).as_bytes())
    }

    /// The hash with these bytes.
    pub const fn from_bytes(bytes: [u8; 32]) -> Self {
        Self(bytes)
    }

    /// The hash as bytes.
    pub const fn as_bytes(&self) -> &[u8; 32] {
        &self.0
    }

    /// Reads 64 lower-case hexadecimal digits.
    pub fn from_hex(text: &str) -> Option<Self> {
        let hash = blake3::Hash::from_hex(text).ok()?;
        let canonical = !text.bytes().any(|byte| byte.is_ascii_uppercase());
        canonical.then_some(Self(*hash.as_bytes()))
    }
}

impl fmt::Display for ContentHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&blake3::Hash::from_bytes(self.0).to_hex())
    }
}

impl fmt::Debug for ContentHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

/// The kind of surface a segment is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Topology {
    /// One boundary loop.
    Disc,
    /// Two boundary loops, genus 0.
    Annulus,
    /// Closed, genus 0.
    Sphere,
    /// Closed, genus 1.
    Torus,
}

/// How the mesh was cut into segments, as kept.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Segmentation {
    /// The service chose.
    Auto,
    /// One segment: the whole mesh.
    Whole,
    /// The file's own groups.
    Groups,
    /// The user's labels, one integer a face ([`crate::Store::labels`] reads them).
    Labels {
        /// The object that holds them.
        object: ContentHash,
        /// How many there are.
        faces: u32,
    },
    /// Segment 0 is the whole mesh; the others are the parts of it that the service found when it was added
    /// ([`crate::Store::labels`] reads the part of each face, from 1, and 0 for none).
    Parted {
        /// The object that holds the part of each face.
        object: ContentHash,
        /// How many faces there are.
        faces: u32,
    },
}

/// How the mesh is to be cut into segments, as handed in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NewSegmentation<'a> {
    /// The service chooses.
    Auto,
    /// One segment: the whole mesh.
    Whole,
    /// The file's own groups.
    Groups,
    /// The user's labels, one a face.
    Labels(&'a [u32]),
    /// Whole and by its parts: the part of each face, from 1, and 0 for none. Which parts were found makes no other example.
    Parted(&'a [u32]),
}

/// The hash that makes an example the same as another: of the mesh and of the options that matter.
pub fn identity(
    mesh: ContentHash,
    segmentation: NewSegmentation<'_>,
    poles: impl IntoIterator<Item = Option<u32>>,
) -> ContentHash {
    let mut hasher = blake3::Hasher::new_derive_key("quadmuse example identity 1");
    hasher.update(mesh.as_bytes());
    match segmentation {
        NewSegmentation::Auto => hasher.update(b"auto"),
        NewSegmentation::Whole => hasher.update(b"whole"),
        NewSegmentation::Groups => hasher.update(b"groups"),
        NewSegmentation::Labels(labels) => {
            hasher.update(b"labels").update(ContentHash::of(&label_bytes(labels)).as_bytes())
        }
        // Another release may find other parts: the mesh added again is the same example all the same.
        NewSegmentation::Parted(_) => hasher.update(b"parted"),
    };
    for (segment, pole) in (0u32..).zip(poles) {
        if let Some(pole) = pole {
            hasher.update(&segment.to_le_bytes()).update(&pole.to_le_bytes());
        }
    }
    ContentHash::from_bytes(*hasher.finalize().as_bytes())
}

/// Labels as their object holds them.
pub(crate) fn label_bytes(labels: &[u32]) -> Vec<u8> {
    labels.iter().flat_map(|label| label.to_le_bytes()).collect()
}

/// One segment in a few numbers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SegmentSummary {
    /// Its kind.
    pub topology: Topology,
    /// Its vertices.
    pub vertices: u32,
    /// Its polygons.
    pub faces: u32,
    /// Its modulus m (conformal shape of the unfolding; see the kernel's `unfold`).
    pub modulus: f64,
    /// Its share of the mesh's area, 0–1.
    pub area_share: f64,
    /// The pole the user chose, as a vertex of the mesh; `None`: the service chose.
    pub pole_override: Option<u32>,
}

/// An example of the corpus.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ExampleRecord {
    /// Its id.
    pub id: ExampleId,
    /// Counts its annotations; 1 when added.
    pub revision: u32,
    /// Its name, for people.
    pub name: String,
    /// Its tags, sorted, each once.
    pub tags: Vec<String>,
    /// How good the artists find it, 0–5.
    pub relevance: f32,
    /// The format of the mesh as uploaded (`obj`, `ply`, …).
    pub format: String,
    /// Hash of the mesh as uploaded: the name of its object, and the tie-break of rankings.
    pub content_hash: ContentHash,
    /// Hash of the mesh and of the options that matter: the same identity is the same example.
    pub identity: ContentHash,
    /// Length of the mesh as uploaded, in bytes.
    pub bytes: u64,
    /// When it was added, in milliseconds since 1970.
    pub created_unix_ms: u64,
    /// How it was cut.
    pub segmentation: Segmentation,
    /// Its segments.
    pub segments: Vec<SegmentSummary>,
    /// Vertices of the mesh.
    pub vertices: u32,
    /// Polygons of the mesh.
    pub faces: u32,
    /// What was repaired when it was read.
    pub repairs: Vec<String>,
    /// Who made it; from schema 4 on, as all below.
    #[serde(default)]
    pub author: String,
    /// The licence it is under.
    #[serde(default)]
    pub licence: String,
    /// What else is said of it.
    #[serde(default)]
    pub notes: String,
    /// Points of its surface that have a name.
    #[serde(default)]
    pub landmarks: Vec<LandmarkRecord>,
}

/// A point of an example's surface that has a name.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LandmarkRecord {
    /// Its name; no other of the example has it.
    pub name: String,
    /// The point, in the mesh's units.
    pub point: [f64; 3],
    /// The vertex it is, if it is one.
    pub vertex: Option<u32>,
}

impl Segmentation {
    /// The object that holds a label for each face, if there is one.
    pub fn labels(&self) -> Option<ContentHash> {
        match *self {
            Self::Labels { object, .. } | Self::Parted { object, .. } => Some(object),
            Self::Auto | Self::Whole | Self::Groups => None,
        }
    }
}

impl ExampleRecord {
    /// The objects its ground state lies in.
    pub fn objects(&self) -> impl Iterator<Item = ContentHash> + '_ {
        std::iter::once(self.content_hash).chain(self.segmentation.labels())
    }
}

/// An annotation: what is `None` stays.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Patch {
    /// A new name.
    pub name: Option<String>,
    /// New tags, all of them.
    pub tags: Option<Vec<String>>,
    /// A new relevance, 0–5.
    pub relevance: Option<f32>,
    /// The revision that this was made for; `None`: whichever there is.
    pub from_revision: Option<u32>,
    /// A new author.
    pub author: Option<String>,
    /// A new licence.
    pub licence: Option<String>,
    /// New notes.
    pub notes: Option<String>,
    /// New landmarks, all of them.
    pub landmarks: Option<Vec<LandmarkRecord>>,
}

impl Patch {
    /// The record after this annotation.
    ///
    /// # Errors
    /// [`StoreError::Conflict`] if it was made for another revision, [`StoreError::Invalid`] outside the limits.
    pub fn apply(&self, record: &ExampleRecord) -> Result<ExampleRecord, StoreError> {
        if let Some(expected) = self.from_revision.filter(|expected| *expected != record.revision) {
            return Err(StoreError::Conflict { id: record.id, expected, found: record.revision });
        }
        let mut next = record.clone();
        if let Some(name) = &self.name {
            next.name.clone_from(name);
        }
        if let Some(tags) = &self.tags {
            next.tags.clone_from(tags);
        }
        if let Some(relevance) = self.relevance {
            next.relevance = relevance;
        }
        let texts =
            [(&self.author, &mut next.author), (&self.licence, &mut next.licence), (&self.notes, &mut next.notes)];
        for (new, text) in texts {
            if let Some(new) = new {
                text.clone_from(new);
            }
        }
        if let Some(landmarks) = &self.landmarks {
            next.landmarks.clone_from(landmarks);
        }
        next.revision = record.revision.saturating_add(1);
        normalise(&mut next);
        validate(&next)?;
        Ok(next)
    }
}

/// Sorts the tags and cuts what is only there for people.
pub(crate) fn normalise(record: &mut ExampleRecord) {
    record.tags.sort();
    record.tags.dedup();
    record.repairs.truncate(REPAIRS_MAX);
    for repair in &mut record.repairs {
        let end = repair.floor_char_boundary(REPAIR_BYTES_MAX);
        repair.truncate(end);
    }
}

/// Checks a record against the limits of this module.
///
/// # Errors
/// [`StoreError::Invalid`].
pub fn validate(record: &ExampleRecord) -> Result<(), StoreError> {
    at_most("the name", "bytes", record.name.len(), NAME_BYTES_MAX)?;
    at_most("the tags", "of them", record.tags.len(), TAGS_MAX)?;
    for tag in &record.tags {
        at_most("a tag", "bytes", tag.len(), TAG_BYTES_MAX)?;
        if tag.trim().is_empty() {
            return Err(invalid("a tag", "with at least one visible character".into(), "an empty one".into()));
        }
    }
    if !(0.0..=RELEVANCE_MAX).contains(&record.relevance) {
        return Err(invalid("the relevance", format!("from 0 to {RELEVANCE_MAX}"), record.relevance.to_string()));
    }
    at_most("the author", "bytes", record.author.len(), CREDIT_BYTES_MAX)?;
    at_most("the licence", "bytes", record.licence.len(), CREDIT_BYTES_MAX)?;
    at_most("the notes", "bytes", record.notes.len(), NOTES_BYTES_MAX)?;
    validate_landmarks(&record.landmarks)?;
    at_most("the format", "bytes", record.format.len(), FORMAT_BYTES_MAX)?;
    at_most("the segments", "of them", record.segments.len(), SEGMENTS_MAX)?;
    let finite = |segment: &SegmentSummary| segment.modulus.is_finite() && segment.area_share.is_finite();
    if !record.segments.iter().all(finite) {
        return Err(invalid("a segment's modulus and area share", "to be finite".into(), "another number".into()));
    }
    Ok(())
}

fn validate_landmarks(landmarks: &[LandmarkRecord]) -> Result<(), StoreError> {
    at_most("the landmarks", "of them", landmarks.len(), LANDMARKS_MAX)?;
    let mut names = HashSet::new();
    for landmark in landmarks {
        at_most("a landmark's name", "bytes", landmark.name.len(), LANDMARK_NAME_BYTES_MAX)?;
        if landmark.name.is_empty() || !names.insert(landmark.name.as_str()) {
            return Err(invalid("a landmark's name", "that no other has".into(), format!("`{}`", landmark.name)));
        }
        if !landmark.point.iter().all(|x| x.is_finite()) {
            return Err(invalid("a landmark's point", "to be finite".into(), "another number".into()));
        }
    }
    Ok(())
}

pub(crate) fn invalid(field: &'static str, expected: String, found: String) -> StoreError {
    StoreError::Invalid { field, expected, found }
}

pub(crate) fn at_most(field: &'static str, unit: &str, found: usize, most: usize) -> Result<(), StoreError> {
    if found <= most { Ok(()) } else { Err(invalid(field, format!("at most {most} {unit}"), found.to_string())) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hash_has_one_spelling() {
        let hash = ContentHash::of(b"mesh");
        assert_eq!(ContentHash::from_hex(&hash.to_string()), Some(hash));
        assert_eq!(ContentHash::from_hex(&hash.to_string().to_uppercase()), None);
        assert_eq!(ContentHash::from_hex("../../etc/passwd"), None);
    }
}
