//! What a reader accepts before it gives up.

/// Upper bounds for a mesh file. Readers check them before they allocate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Bytes of the file.
    pub bytes_max: usize,
    /// Vertices, and values of any other pool (UVs, normals).
    pub vertices_max: usize,
    /// Faces.
    pub faces_max: usize,
    /// Corners of all faces together.
    pub corners_max: usize,
    /// Corners of one face.
    pub degree_max: usize,
    /// Depth of nested JSON values.
    pub nesting_max: usize,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            bytes_max: 2 << 30,
            vertices_max: 20_000_000,
            faces_max: 20_000_000,
            corners_max: 80_000_000,
            degree_max: 65_536,
            nesting_max: 64,
        }
    }
}
