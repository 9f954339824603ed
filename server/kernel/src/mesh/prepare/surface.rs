//! Polygons with their connectivity, while they are repaired.
//!
//! Halfedge `c` runs from corner `c` to the next corner of its row.

use crate::mesh::error::MeshError;
use crate::mesh::repair::{RepairKind, Repairs};
use crate::mesh::{NONE, PolyMesh, Polygons, Vec3};
use crate::numerics::stop;

/// Rows of corners with their twins. A row is what is left of a face of the upload.
pub(super) struct CornerRows {
    pub(super) rows: Polygons,
    /// Face of the upload, a row.
    pub(super) face_of: Vec<u32>,
    /// Row, a corner.
    pub(super) row_of: Vec<u32>,
    /// Opposite halfedge, a corner; [`NONE`] on the boundary. They may run the same way until the rows are turned.
    pub(super) twins: Vec<u32>,
}

impl CornerRows {
    /// The faces without repeated corners; what has no three corners left is left out.
    pub(super) fn cleaned(poly: &PolyMesh, repairs: &mut Repairs) -> Self {
        let (mut rows, mut face_of, mut row) = (Polygons::default(), Vec::new(), Vec::new());
        for (f, face) in poly.faces.iter().enumerate() {
            stop::pass(face.len());
            let kept = reduce(face, &mut row);
            if kept.len() < 3 {
                repairs.note(RepairKind::CollapsedFaces, f as u32);
                continue;
            }
            if kept.len() < face.len() {
                repairs.note(RepairKind::RepeatedCorners, f as u32);
            }
            rows.push(kept);
            face_of.push(f as u32);
        }
        Self::new(rows, face_of)
    }

    fn new(rows: Polygons, face_of: Vec<u32>) -> Self {
        let row_of = (0..rows.len()).flat_map(|r| std::iter::repeat_n(r as u32, rows.face(r).len())).collect();
        let twins = vec![NONE; rows.corners().len()];
        Self { rows, face_of, row_of, twins }
    }

    /// Only the rows that are to be kept.
    pub(super) fn retain(self, keep: &[bool]) -> Self {
        let kept = || (0..keep.len()).filter(|r| keep[*r]);
        Self::new(kept().map(|r| self.rows.face(r)).collect(), kept().map(|r| self.face_of[r]).collect())
    }

    /// Number of corners (and of halfedges).
    pub(super) fn corner_count(&self) -> u32 {
        self.rows.corners().len() as u32
    }

    /// The next corner of the row.
    #[inline]
    pub(super) fn next(&self, c: u32) -> u32 {
        let row = self.row_of[c as usize] as usize;
        if c as usize + 1 == self.rows.start(row) + self.rows.face(row).len() {
            self.rows.start(row) as u32
        } else {
            c + 1
        }
    }

    /// Vertex of the upload at which halfedge `c` starts.
    #[inline]
    pub(super) fn tail(&self, c: u32) -> u32 {
        self.rows.corners()[c as usize]
    }

    /// Vertex of the upload at which halfedge `c` ends.
    #[inline]
    pub(super) fn head(&self, c: u32) -> u32 {
        self.tail(self.next(c))
    }

    /// Pairs the halfedges that run between the same vertices. Those of edges with more than two, up to `most`, are left open, and
    /// returned, a row an edge.
    ///
    /// # Errors
    /// [`MeshError::EdgeShared`] at the lowest edge with more faces.
    pub(super) fn pair(&mut self, most: usize, positions: &[Vec3]) -> Result<Vec<Vec<u32>>, MeshError> {
        const FACES_NAMED: usize = 6;
        let keyed = self.keyed_edges();
        let mut shared = Vec::new();
        for run in keyed.chunk_by(|x, y| x.0 == y.0) {
            match run {
                [_] => {}
                [(_, c), (_, d)] => {
                    self.twins[*c as usize] = *d;
                    self.twins[*d as usize] = *c;
                }
                [_, ..] if run.len() <= most => shared.push(run.iter().map(|(_, c)| *c).collect()),
                [(key, _), ..] => {
                    let vertices = [(*key >> 32) as u32, *key as u32];
                    let named = run.iter().take(FACES_NAMED);
                    return Err(MeshError::EdgeShared {
                        vertices,
                        positions: vertices.map(|v| positions[v as usize]),
                        faces: named.map(|(_, c)| self.face_of[self.row_of[*c as usize] as usize]).collect(),
                        count: run.len(),
                    });
                }
                [] => {}
            }
        }
        Ok(shared)
    }

    /// All halfedges under the key of their edge, sorted.
    pub(super) fn keyed_edges(&self) -> Vec<(u64, u32)> {
        let mut keyed: Vec<_> = (0..self.corner_count()).map(|c| (edge_key(self.tail(c), self.head(c)), c)).collect();
        stop::pass(keyed.len());
        keyed.sort_unstable();
        stop::pass(keyed.len());
        keyed
    }

    /// Reverses the rows that are to be turned; twins stay twins.
    pub(super) fn turn(&mut self, turned: &[bool]) {
        let moved = |c: u32, surface: &Self| {
            let row = surface.row_of[c as usize] as usize;
            if !turned[row] {
                return c;
            }
            let (start, len) = (surface.rows.start(row) as u32, surface.rows.face(row).len() as u32);
            2 * start + len - 1 - surface.next(c)
        };
        let mut twins = vec![NONE; self.twins.len()];
        for c in 0..self.corner_count() {
            let twin = self.twins[c as usize];
            if twin != NONE {
                twins[moved(c, self) as usize] = moved(twin, self);
            }
        }
        self.twins = twins;
        let mut row = Vec::new();
        self.rows = (0..turned.len()).fold(Polygons::default(), |mut rows, r| {
            row.clear();
            row.extend_from_slice(self.rows.face(r));
            if turned[r] {
                row.reverse();
            }
            rows.push(&row);
            rows
        });
    }
}

/// The key of the edge between two vertices, whichever way it runs.
#[inline]
pub(super) fn edge_key(a: u32, b: u32) -> u64 {
    (u64::from(a.min(b)) << 32) | u64::from(a.max(b))
}

/// A face without corners that repeat the one before and without runs to a corner and back (`a b a`).
fn reduce<'r>(face: &[u32], row: &'r mut Vec<u32>) -> &'r [u32] {
    row.clear();
    for &v in face {
        match row.as_slice() {
            [.., last] if *last == v => {}
            [.., before, _] if *before == v => drop(row.pop()),
            _ => row.push(v),
        }
    }
    let mut ring = row.as_slice();
    loop {
        ring = match ring {
            [first, middle @ .., last] if first == last => &ring[..middle.len() + 1],
            [first, .., before, _] if first == before => &ring[..ring.len() - 2],
            [_, second, .., last] if second == last => &ring[1..ring.len() - 1],
            _ => return ring,
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn repeats_and_spikes_vanish_wherever_the_face_starts() {
        let reduced = |face: &[u32]| reduce(face, &mut Vec::new()).to_vec();
        assert_eq!(reduced(&[1, 2, 3]), [1, 2, 3]);
        assert_eq!(reduced(&[1, 1, 2, 3, 3, 1]), [1, 2, 3]);
        assert_eq!(reduced(&[1, 2, 9, 2, 3]), [1, 2, 3]);
        assert_eq!(reduced(&[2, 3, 1, 2, 9]), [2, 3, 1]);
        assert_eq!(reduced(&[9, 2, 3, 1, 2]), [2, 3, 1]);
        assert!(reduced(&[1, 2, 1, 2]).len() < 3);
        assert!(reduced(&[1, 2, 3, 2]).len() < 3);
        assert!(reduced(&[7; 9]).len() < 3);
    }

    #[test]
    fn turning_a_row_keeps_its_neighbours() {
        let faces: Polygons = [[0, 1, 2, 3].as_slice(), &[1, 2, 4]].into_iter().collect();
        let poly = PolyMesh { positions: vec![Vec3::zeros(); 5], faces, ..PolyMesh::default() };
        let mut surface = CornerRows::cleaned(&poly, &mut Repairs::default());
        surface.pair(2, &poly.positions).expect("manifold");
        surface.turn(&[false, true]);
        assert_eq!(surface.rows.face(1), [4, 2, 1]);
        for c in 0..surface.corner_count() {
            let twin = surface.twins[c as usize];
            if twin != NONE {
                assert_eq!(surface.twins[twin as usize], c);
                assert_eq!((surface.tail(c), surface.head(c)), (surface.head(twin), surface.tail(twin)));
            }
        }
        assert_eq!(surface.twins.iter().filter(|t| **t != NONE).count(), 2);
    }
}
