//! What [`prepare`](super::prepare) changed so that a mesh can be computed with.

use std::fmt;

/// One kind of repair, how often it was made, and where first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Repair {
    /// What was done.
    pub kind: RepairKind,
    /// How often.
    pub count: u64,
    /// The first vertex or face (see [`RepairKind`]) that it concerns, from 0.
    pub first: u32,
}

/// What was done. The upload itself is never changed; repairs concern the mesh that is computed with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum RepairKind {
    /// Vertices that no face uses are left out (also those with unusable coordinates).
    IsolatedVertices,
    /// Faces that name a corner twice in a row, or run to a corner and back, lost those corners.
    RepeatedCorners,
    /// Faces with fewer than three different corners are left out.
    CollapsedFaces,
    /// Faces that repeat another are left out.
    DuplicateFaces,
    /// Edges of more than two faces: two go on into each other, and so may others; what is left over ends there.
    SharedEdges,
    /// Faces of small sheets that stood on the surface at such edges are left out.
    StandingFaces,
    /// Edges at which a surface with one side is cut, so that it has two.
    CutEdges,
    /// Vertices with equal positions along open boundaries are joined.
    WeldedVertices,
    /// Vertices with nearly equal positions along open boundaries are joined.
    NearlyWeldedVertices,
    /// Faces that were wound against their neighbours are turned.
    TurnedFaces,
    /// Faces of closed components whose normals pointed inwards are turned.
    InsideOutFaces,
    /// Vertices at which separate fans of faces touch are doubled.
    PinchedVertices,
    /// Faces whose every diagonal was an edge already are cut from a new vertex at their centre.
    CentredFaces,
    /// Vertices at the ends of edges without length are joined.
    CollapsedEdges,
    /// Triangles without area are kept, as leaving them out would open holes.
    FlatTriangles,
    /// Views of one thing, sheets that lie over each other, are fused into one surface.
    FusedViews,
}

impl fmt::Display for Repair {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (one, many, first) = self.kind.words();
        let what = if self.count == 1 { one } else { many };
        write!(f, "{} {what} ({first} {}, counted from 1)", self.count, u64::from(self.first) + 1)
    }
}

impl RepairKind {
    /// Singular, plural, and what `first` counts.
    fn words(self) -> (&'static str, &'static str, &'static str) {
        const VERTEX: &str = "first: vertex";
        const FACE: &str = "first: face";
        match self {
            Self::IsolatedVertices => ("vertex without a face left out", "vertices without a face left out", VERTEX),
            Self::RepeatedCorners => ("face relieved of repeated corners", "faces relieved of repeated corners", FACE),
            Self::CollapsedFaces => {
                ("face with fewer than 3 corners left out", "faces with fewer than 3 corners left out", FACE)
            }
            Self::DuplicateFaces => ("duplicate face left out", "duplicate faces left out", FACE),
            Self::SharedEdges => {
                ("edge of more than two faces set apart", "edges of more than two faces set apart", VERTEX)
            }
            Self::StandingFaces => (
                "face of a small sheet that stood on the surface left out",
                "faces of small sheets that stood on the surface left out",
                FACE,
            ),
            Self::CutEdges => (
                "edge cut where the surface passes into its own back",
                "edges cut where the surface passes into its own back",
                VERTEX,
            ),
            Self::WeldedVertices => {
                ("duplicate vertex joined along a seam", "duplicate vertices joined along seams", VERTEX)
            }
            Self::NearlyWeldedVertices => {
                ("nearly equal vertex joined along a seam", "nearly equal vertices joined along seams", VERTEX)
            }
            Self::TurnedFaces => {
                ("face turned to agree with its neighbours", "faces turned to agree with their neighbours", FACE)
            }
            Self::InsideOutFaces => {
                ("face of a closed surface turned outwards", "faces of closed surfaces turned outwards", FACE)
            }
            Self::PinchedVertices => (
                "vertex doubled where the surface touches itself",
                "vertices doubled where the surface touches itself",
                VERTEX,
            ),
            Self::CentredFaces => ("face cut from its centre", "faces cut from their centres", FACE),
            Self::CollapsedEdges => ("edge without length collapsed", "edges without length collapsed", VERTEX),
            Self::FlatTriangles => ("triangle without area kept", "triangles without area kept", FACE),
            Self::FusedViews => ("view fused", "views that lie over each other fused into one surface", FACE),
        }
    }
}

/// Repairs while they are made: one entry a kind.
#[derive(Default)]
pub(super) struct Repairs(Vec<Repair>);

impl Repairs {
    /// Notes one repair.
    pub(super) fn note(&mut self, kind: RepairKind, first: u32) {
        self.note_many(kind, 1, first);
    }

    /// Notes `count` repairs, the first of them at `first`.
    pub(super) fn note_many(&mut self, kind: RepairKind, count: u64, first: u32) {
        match self.0.iter_mut().find(|repair| repair.kind == kind) {
            _ if count == 0 => {}
            Some(repair) => {
                repair.count += count;
                repair.first = repair.first.min(first);
            }
            None => self.0.push(Repair { kind, count, first }),
        }
    }

    /// The repairs, by kind.
    pub(super) fn finish(mut self) -> Vec<Repair> {
        self.0.sort_by_key(|repair| repair.kind);
        self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn repairs_of_a_kind_are_one_sentence() {
        let mut repairs = Repairs::default();
        repairs.note(RepairKind::TurnedFaces, 7);
        repairs.note(RepairKind::IsolatedVertices, 0);
        repairs.note_many(RepairKind::TurnedFaces, 2, 3);
        repairs.note_many(RepairKind::PinchedVertices, 0, 9);
        let sentences: Vec<_> = repairs.finish().iter().map(Repair::to_string).collect();
        assert_eq!(
            sentences,
            [
                "1 vertex without a face left out (first: vertex 1, counted from 1)",
                "3 faces turned to agree with their neighbours (first: face 4, counted from 1)"
            ]
        );
    }
}
