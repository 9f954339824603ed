//! Vertices between those of an example, where these lie far apart: a dog of 300 quads has too few points to tell where it lies.
//! *Ours, not a paper's.*

use crate::mesh::Vec3;
use crate::mesh::tri::TriMesh;
use crate::unfold::refine;
use std::borrow::Cow;

/// No edge is longer, in √area of the example: what lies on the example is not farther from its vertices than what is bare.
const LONGEST: f64 = super::stretch::BARE;
/// Rounds of halving at most: edges that are longer still belong to few faces.
const ROUNDS: usize = 6;

/// Vertices that were added to the example, by the ends of the edges that they halve.
#[derive(Clone, Debug)]
pub(super) struct AddedVertices {
    /// Vertices of the example's own, which come first.
    pub(super) own: usize,
    ends: Vec<[u32; 2]>,
}

impl AddedVertices {
    /// Halves the edges that are too long, until none is.
    pub(super) fn of(example: &TriMesh) -> (Cow<'_, TriMesh>, Self) {
        let mut mesh = Cow::Borrowed(example);
        let longest = LONGEST * example.total_area().sqrt();
        let mut ends = Vec::new();
        for _ in 0..ROUNDS {
            let length =
                |h: u32| (mesh.positions[mesh.tail(h) as usize] - mesh.positions[mesh.head(h) as usize]).norm();
            let is_long: Vec<bool> = (0..mesh.twins.len() as u32).map(|h| length(h) > longest).collect();
            if !is_long.contains(&true) {
                break;
            }
            let (halved, more) = refine::split_edges_telling(&mesh, &is_long);
            ends.extend(more);
            mesh = Cow::Owned(halved);
        }
        (mesh, Self { own: example.positions.len(), ends })
    }

    /// Places of all vertices, where the example's own lie at `places`.
    pub(super) fn all<'p>(&self, places: &'p [Vec3]) -> Cow<'p, [Vec3]> {
        if self.ends.is_empty() || places.len() != self.own {
            return Cow::Borrowed(places);
        }
        let mut all = places.to_vec();
        for [a, b] in &self.ends {
            all.push(0.5 * (all[*a as usize] + all[*b as usize]));
        }
        Cow::Owned(all)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::tests::grid;

    #[test]
    fn edges_are_halved_until_none_is_long_and_places_follow() {
        let mesh = grid(4, 9, false, false);
        let (all, between) = AddedVertices::of(&mesh);
        let long = |h: u32| (all.positions[all.tail(h) as usize] - all.positions[all.head(h) as usize]).norm();
        let longest = (0..all.twins.len() as u32).map(long).fold(0.0, f64::max);
        assert!(longest <= LONGEST * mesh.total_area().sqrt(), "{longest}");
        assert!(all.positions[..between.own] == mesh.positions && all.positions.len() > mesh.positions.len());
        let moved: Vec<Vec3> = mesh.positions.iter().map(|p| 2.0 * p).collect();
        let off =
            between.all(&moved).iter().zip(&all.positions).map(|(at, p)| (at - 2.0 * p).norm()).fold(0.0, f64::max);
        assert!(off < 1e-12, "{off}");
        assert_eq!(between.all(&all.positions).len(), all.positions.len());
    }

    #[test]
    fn what_is_fine_stays_as_it_is() {
        let mesh = grid(60, 60, false, false);
        let (all, between) = AddedVertices::of(&mesh);
        assert!(matches!(all, Cow::Borrowed(_)) && between.ends.is_empty());
    }
}
