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

/// Bytes that reading and preparing take at most, a triangle: measured 430 for a soup of 980,000 triangles (all of whose
/// vertices are joined), 180 for the same mesh with shared vertices.
const BYTES_PER_TRIANGLE: usize = 500;

impl Limits {
    /// Limits that keep reading and preparing one mesh within `memory_bytes`, and never above the default ones.
    pub fn within_memory(memory_bytes: usize) -> Self {
        let (triangles, most) = (memory_bytes / BYTES_PER_TRIANGLE, Self::default());
        Self {
            // The file itself is in memory while it is read.
            bytes_max: most.bytes_max.min(memory_bytes / 4),
            vertices_max: most.vertices_max.min(triangles.saturating_mul(3)),
            faces_max: most.faces_max.min(triangles),
            corners_max: most.corners_max.min(triangles.saturating_mul(3)),
            ..most
        }
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn less_memory_admits_less_and_much_admits_the_default() {
        let small = Limits::within_memory(1 << 30);
        assert!(small.faces_max > 2_000_000 && small.faces_max < 3_000_000);
        assert!(small.bytes_max < 1 << 30 && small.degree_max == Limits::default().degree_max);
        assert_eq!(Limits::within_memory(usize::MAX), Limits::default());
    }
}
