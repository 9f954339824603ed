//! A polygon mesh that can be changed: faces with their corners, and the faces at each vertex.
//!
//! The stitching works on it; no edge or twin is stored, since every operation is local and vertices have few faces.
//! Two faces are neighbours when one runs a → b where the other runs b → a. *Source:* paper §6 (the structure).
//! *Ours, not the paper's:* polygons are kept whole, instead of triangles with phantom edges between them.

use crate::mesh::tri::TriMesh;
use crate::mesh::{PolyMesh, Vec3};
use crate::numerics::stop;

/// A polygon mesh under change. Removed faces have no corners and keep their number.
#[derive(Clone, Debug, Default)]
pub struct Net {
    /// Vertex positions.
    pub positions: Vec<Vec3>,
    faces: Vec<Vec<u32>>,
    around: Vec<Vec<u32>>,
}

/// One step on the way around a vertex.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// An edge, by the vertex at its other end.
    Edge(u32),
    /// A face.
    Face(u32),
    /// The outside, where the vertex lies on a boundary.
    Gap,
}

/// Polygons cut into triangles, each a fan from its first corner; no twins.
#[derive(Clone, Debug, Default)]
pub struct Fans {
    /// The triangles.
    pub mesh: TriMesh,
    /// The face of each.
    pub face: Vec<u32>,
}

impl Fans {
    /// Of faces with their numbers.
    pub fn of<'a>(positions: &[Vec3], faces: impl Iterator<Item = (u32, &'a [u32])>) -> Self {
        let (triangles, face) = faces.flat_map(|(f, c)| (2..c.len()).map(move |k| ([c[0], c[k - 1], c[k]], f))).unzip();
        Self { mesh: TriMesh { positions: positions.to_vec(), triangles, ..TriMesh::default() }, face }
    }
}

impl Net {
    /// A net of given faces.
    pub fn new(positions: Vec<Vec3>, faces: Vec<Vec<u32>>) -> Self {
        let mut net = Self { around: vec![Vec::new(); positions.len()], positions, faces: Vec::new() };
        for face in faces {
            net.add_face(face);
        }
        net
    }

    /// A net of a polygon mesh.
    pub fn from_mesh(mesh: &PolyMesh) -> Self {
        Self::new(mesh.positions.clone(), mesh.faces.iter().map(<[u32]>::to_vec).collect())
    }

    /// Numbers given to faces so far, those removed included.
    pub fn face_slots(&self) -> usize {
        self.faces.len()
    }

    /// Corners of a face; none if it was removed.
    pub fn face(&self, f: u32) -> &[u32] {
        &self.faces[f as usize]
    }

    /// The faces that are there, with their numbers.
    pub fn faces(&self) -> impl Iterator<Item = (u32, &[u32])> {
        self.faces.iter().enumerate().filter(|(_, c)| !c.is_empty()).map(|(f, c)| (f as u32, c.as_slice()))
    }

    /// The faces cut into triangles.
    pub fn fans(&self) -> Fans {
        Fans::of(&self.positions, self.faces())
    }

    /// The faces at a vertex, in no order.
    pub fn at(&self, v: u32) -> &[u32] {
        &self.around[v as usize]
    }

    /// Adds a vertex.
    pub fn add_vertex(&mut self, position: Vec3) -> u32 {
        self.positions.push(position);
        self.around.push(Vec::new());
        (self.positions.len() - 1) as u32
    }

    /// Adds a face.
    pub fn add_face(&mut self, corners: Vec<u32>) -> u32 {
        let f = self.faces.len() as u32;
        self.enter(f, &corners);
        self.faces.push(corners);
        f
    }

    /// Removes a face.
    pub fn remove_face(&mut self, f: u32) {
        self.set_face(f, Vec::new());
    }

    /// Gives a face other corners.
    pub fn set_face(&mut self, f: u32, corners: Vec<u32>) {
        let old = std::mem::take(&mut self.faces[f as usize]);
        for v in old {
            self.around[v as usize].retain(|&g| g != f);
        }
        self.enter(f, &corners);
        self.faces[f as usize] = corners;
    }

    fn enter(&mut self, f: u32, corners: &[u32]) {
        for &v in corners {
            let around = &mut self.around[v as usize];
            if !around.contains(&f) {
                around.push(f);
            }
        }
    }

    /// The corners before and after a vertex in a face.
    pub fn beside(&self, f: u32, v: u32) -> Option<[u32; 2]> {
        let corners = self.face(f);
        let k = corners.iter().position(|&c| c == v)?;
        let n = corners.len();
        Some([corners[(k + n - 1) % n], corners[(k + 1) % n]])
    }

    /// The face that runs a → b.
    pub fn face_along(&self, a: u32, b: u32) -> Option<u32> {
        self.at(a).iter().copied().find(|&f| self.beside(f, a).is_some_and(|[_, next]| next == b))
    }

    /// Whether a face has an edge between two vertices.
    pub fn joined(&self, a: u32, b: u32) -> bool {
        self.face_along(a, b).is_some() || self.face_along(b, a).is_some()
    }

    /// All around a vertex, counter-clockwise: edge, face, edge, face …, with the gap last at a boundary. Empty for a
    /// vertex without faces; `None` if its faces form no single fan.
    pub fn fan(&self, v: u32) -> Option<Vec<Step>> {
        stop::poll();
        let wedges: Vec<(u32, [u32; 2])> =
            self.at(v).iter().filter_map(|&f| self.beside(f, v).map(|ends| (f, ends))).collect();
        let Some(&first) = wedges.first() else { return Some(Vec::new()) };
        // A wedge runs counter-clockwise from its next corner to its previous one. An open fan starts where no wedge ends.
        let start = wedges.iter().find(|(_, [_, next])| !wedges.iter().any(|(_, [prev, _])| prev == next));
        let (mut face, [mut end, begin]) = *start.unwrap_or(&first);
        let mut steps = vec![Step::Edge(begin), Step::Face(face)];
        for _ in 1..wedges.len() {
            let mut following = wedges.iter().filter(|(_, [_, next])| *next == end);
            let &(f, [prev, _]) = following.next()?;
            if following.next().is_some() || f == face {
                return None;
            }
            steps.extend([Step::Edge(end), Step::Face(f)]);
            (face, end) = (f, prev);
        }
        match (start.is_some(), end == begin) {
            (false, true) => Some(steps),
            (true, false) => {
                steps.extend([Step::Edge(end), Step::Gap]);
                Some(steps)
            }
            _ => None,
        }
    }

    /// Vertices that an edge joins to `v`, sorted.
    pub fn neighbours(&self, v: u32) -> Vec<u32> {
        let mut all: Vec<u32> = self.at(v).iter().filter_map(|&f| self.beside(f, v)).flatten().collect();
        all.sort_unstable();
        all.dedup();
        all
    }

    /// The vertices given, then ring by ring those that up to `reach` edges join to them, each ring sorted.
    pub fn rings(&self, from: &[u32], reach: usize) -> Vec<Vec<u32>> {
        let mut seen = vec![false; self.positions.len()];
        from.iter().for_each(|&v| seen[v as usize] = true);
        let mut rings = vec![from.to_vec()];
        for k in 0..reach {
            let mut next: Vec<u32> = rings[k].iter().flat_map(|&v| self.neighbours(v)).collect();
            next.retain(|&v| !std::mem::replace(&mut seen[v as usize], true));
            next.sort_unstable();
            rings.push(next);
        }
        rings
    }

    /// Whether a vertex lies on a boundary: one of its edges has a face on one side only.
    pub fn on_boundary(&self, v: u32) -> bool {
        self.at(v).iter().filter_map(|&f| self.beside(f, v)).any(|[prev, next]| {
            self.face_along(prev, v).is_none()
                || self.face_along(v, prev).is_none()
                || self.face_along(next, v).is_none()
        })
    }

    /// The boundary loops, each as its vertices with the surface on the left, from its lowest vertex; sorted. Loops
    /// that meet in a vertex can't be told apart: `None`.
    pub fn loops(&self) -> Option<Vec<Vec<u32>>> {
        let mut next = vec![u32::MAX; self.positions.len()];
        for (_, corners) in self.faces() {
            for k in 0..corners.len() {
                let (a, b) = (corners[k], corners[(k + 1) % corners.len()]);
                if self.face_along(b, a).is_none() {
                    if next[a as usize] != u32::MAX {
                        return None;
                    }
                    next[a as usize] = b;
                }
            }
        }
        let mut loops = Vec::new();
        for start in 0..next.len() as u32 {
            let mut ring = Vec::new();
            let mut v = start;
            while next[v as usize] != u32::MAX {
                ring.push(v);
                v = std::mem::replace(&mut next[v as usize], u32::MAX);
            }
            if !ring.is_empty() {
                if v != start {
                    return None;
                }
                loops.push(ring);
            }
        }
        Some(loops)
    }

    /// The polygon mesh, without removed faces and unused vertices; and for each vertex that stays its number here.
    pub fn into_mesh(self) -> (PolyMesh, Vec<u32>) {
        stop::ask();
        let kept: Vec<u32> =
            (0..self.positions.len() as u32).filter(|&v| !self.around[v as usize].is_empty()).collect();
        let mut number = vec![u32::MAX; self.positions.len()];
        for (n, &v) in kept.iter().enumerate() {
            number[v as usize] = n as u32;
        }
        let positions = kept.iter().map(|&v| self.positions[v as usize]).collect();
        let mut mesh = PolyMesh { positions, ..PolyMesh::default() };
        let mut corners = Vec::new();
        for face in self.faces.iter().filter(|f| !f.is_empty()) {
            corners.clear();
            corners.extend(face.iter().map(|&v| number[v as usize]));
            mesh.faces.push(&corners);
        }
        (mesh, kept)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A flat grid of n × m quads.
    pub(crate) fn sheet(n: u32, m: u32) -> Net {
        let at = |i: u32, j: u32| j * (n + 1) + i;
        let positions =
            (0..=m).flat_map(|j| (0..=n).map(move |i| Vec3::new(f64::from(i), f64::from(j), 0.0))).collect();
        let cells = (0..m).flat_map(|j| (0..n).map(move |i| (i, j)));
        let quad = |(i, j)| vec![at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        Net::new(positions, cells.map(quad).collect())
    }

    #[test]
    fn a_fan_goes_around_counter_clockwise_and_ends_in_the_gap() {
        let net = sheet(2, 2);
        let inner = net.fan(4).expect("manifold");
        let edges: Vec<u32> =
            inner.iter().filter_map(|s| if let Step::Edge(w) = s { Some(*w) } else { None }).collect();
        assert_eq!(edges.len(), 4);
        let k = edges.iter().position(|&w| w == 5).expect("east");
        assert_eq!([1, 2, 3].map(|j| edges[(k + j) % 4]), [7, 3, 1]);
        let corner = net.fan(0).expect("manifold");
        assert_eq!(corner, [Step::Edge(1), Step::Face(0), Step::Edge(3), Step::Gap]);
    }

    #[test]
    fn rings_go_out_edge_by_edge_and_end_where_the_net_does() {
        assert_eq!(sheet(2, 2).rings(&[0], 3), [vec![0], vec![1, 3], vec![2, 4, 6], vec![5, 7]]);
        assert_eq!(sheet(1, 1).rings(&[3, 0], 2), [vec![3, 0], vec![1, 2], vec![]]);
    }

    #[test]
    fn two_fans_at_a_vertex_are_told() {
        let net = Net::new(vec![Vec3::zeros(); 7], vec![vec![0, 1, 2, 3], vec![0, 4, 5, 6]]);
        assert_eq!(net.fan(0), None);
    }

    #[test]
    fn the_loop_of_a_sheet_keeps_it_on_the_left() {
        assert_eq!(sheet(2, 1).loops(), Some(vec![vec![0, 1, 2, 5, 4, 3]]));
    }
}
