//! The polygon mesh as a file holds it: nothing is merged, reordered or dropped.
//!
//! The mapped mesh is this mesh with other positions, so vertex order, faces, UVs, groups and materials of the
//! upload come back untouched.

use super::Vec3;
use super::tri::NONE;

/// A polygon mesh with the layers a studio needs back.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PolyMesh {
    /// Vertex positions, in the file's order and units.
    pub positions: Vec<Vec3>,
    /// Polygons as vertex indices.
    pub faces: Polygons,
    /// UVs, normals, groups, materials, colours, creases.
    pub attributes: Attributes,
}

/// Polygons in compressed rows: the corners of face `f` are `corners[starts[f]..starts[f + 1]]`.
#[derive(Clone, Debug, PartialEq)]
pub struct Polygons {
    starts: Vec<u32>,
    corners: Vec<u32>,
}

impl Default for Polygons {
    fn default() -> Self {
        Self { starts: vec![0], corners: Vec::new() }
    }
}

impl Polygons {
    /// Number of faces.
    pub fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// Whether there is no face.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Appends a face.
    pub fn push(&mut self, corners: &[u32]) {
        self.corners.extend_from_slice(corners);
        self.starts.push(self.corners.len() as u32);
    }

    /// Corners of face `f`, as vertex indices.
    pub fn face(&self, f: usize) -> &[u32] {
        &self.corners[self.starts[f] as usize..self.starts[f + 1] as usize]
    }

    /// Index of the first corner of face `f` in [`Self::corners`].
    pub fn start(&self, f: usize) -> usize {
        self.starts[f] as usize
    }

    /// All corners, face after face.
    pub fn corners(&self) -> &[u32] {
        &self.corners
    }

    /// The faces in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &[u32]> + Clone {
        (0..self.len()).map(|f| self.face(f))
    }
}

impl<'a> FromIterator<&'a [u32]> for Polygons {
    fn from_iter<I: IntoIterator<Item = &'a [u32]>>(faces: I) -> Self {
        let mut polygons = Self::default();
        faces.into_iter().for_each(|face| polygons.push(face));
        polygons
    }
}

/// Layers beside positions and faces. An absent layer is `None`, never empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Attributes {
    /// Texture coordinates a corner.
    pub uvs: Option<CornerLayer<[f64; 2]>>,
    /// Normals a corner.
    pub normals: Option<CornerLayer<[f64; 3]>>,
    /// RGBA a vertex, 0–1.
    pub colors: Option<Vec<[f32; 4]>>,
    /// Groups (OBJ `g`, else `o`) a face.
    pub groups: Option<FaceLabels>,
    /// Materials (OBJ `usemtl`) a face.
    pub materials: Option<FaceLabels>,
    /// Segment numbers a face (PLY face property `segment`).
    pub segments: Option<Vec<i64>>,
    /// Semi-sharp edges.
    pub creases: Vec<Crease>,
}

/// A value pool and, for each corner, an index into it (or [`NONE`]).
#[derive(Clone, Debug, PartialEq)]
pub struct CornerLayer<T> {
    /// The values, in the file's order.
    pub values: Vec<T>,
    /// One index a corner, in the order of [`Polygons::corners`]; [`NONE`] where the corner has none.
    pub corners: Vec<u32>,
}

/// Names and, for each face, the index of its name (or [`NONE`]).
#[derive(Clone, Debug, PartialEq)]
pub struct FaceLabels {
    /// The names, in order of first use.
    pub names: Vec<String>,
    /// One index into `names` a face; [`NONE`] where the face has none.
    pub of_face: Vec<u32>,
}

impl FaceLabels {
    /// The name of face `f`, if it has one.
    pub fn name(&self, f: usize) -> Option<&str> {
        let label = *self.of_face.get(f)?;
        (label != NONE).then(|| self.names.get(label as usize)).flatten().map(String::as_str)
    }
}

/// A semi-sharp edge between two vertices.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crease {
    /// The edge's vertices.
    pub vertices: [u32; 2],
    /// Sharpness as in OpenSubdiv: 0 smooth, 10 or more infinitely sharp.
    pub sharpness: f32,
}

/// The sides of a polygon, each as it runs.
pub(crate) fn sides(face: &[u32]) -> impl Iterator<Item = [u32; 2]> + '_ {
    face.iter().enumerate().map(|(k, &a)| [a, face[(k + 1) % face.len()]])
}
