//! Wavefront OBJ: polygons with UVs, normals, vertex colours, groups, materials and creases, as studios exchange them.
//!
//! What comes back is what went in: [`write`](write::write) after [`read`](read::read) keeps faces, order, UVs, groups and
//! materials. Curves, points, lines, smoothing groups and library references are not kept.

mod read;
mod write;

pub(super) use read::read;
pub(super) use write::write;

#[cfg(test)]
mod tests;
