//! The surface of a segmentation as it is composed: small holes are filled, small components left out, as they are for the maps.
//!
//! *Ours, not the paper's.*

use super::Input;
use crate::mesh::tri::{NONE, TriMesh};
use crate::segment::Segmented;
use crate::topology::holes::filled;
use std::borrow::Cow;

/// A surface to be composed on.
#[derive(Clone, Debug)]
pub struct ComposedSurface<'a> {
    mesh: Cow<'a, TriMesh>,
    owner: Vec<u32>,
    count: usize,
}

impl<'a> ComposedSurface<'a> {
    /// That of a segmentation.
    pub fn of(segmented: &'a Segmented) -> Self {
        let mut owner = vec![NONE; segmented.mesh.triangles.len()];
        let (mut holes, mut holders) = (Vec::new(), Vec::new());
        for (segment, part) in segmented.parts.iter().enumerate() {
            part.triangle_of.iter().for_each(|&t| owner[t as usize] = segment as u32);
            for hole in &part.holes {
                holes.push(hole.iter().map(|&h| 3 * part.triangle_of[h as usize / 3] + h % 3).collect::<Vec<u32>>());
                holders.extend(std::iter::repeat_n(segment as u32, hole.len()));
            }
        }
        let mesh = match holes.is_empty() {
            true => Cow::Borrowed(&*segmented.mesh),
            false => Cow::Owned(filled(&segmented.mesh, &holes)),
        };
        // Where they can't be filled, none is.
        if mesh.triangles.len() == owner.len() + holders.len() {
            owner.extend(holders);
        }
        Self { mesh, owner, count: segmented.parts.len() }
    }

    /// The same with other segments, `count` of them: `joined` tells which of them each segment is part of.
    pub fn joined(&self, joined: &[u32], count: usize) -> Self {
        let other = |s: &u32| joined.get(*s as usize).copied().unwrap_or(NONE);
        Self { mesh: self.mesh.clone(), owner: self.owner.iter().map(other).collect(), count }
    }

    /// As an input.
    pub fn input(&self) -> Input<'_> {
        Input { surface: &self.mesh, owner: &self.owner, count: self.count }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compose::{Options, Piece, Way, compose};
    use crate::mesh::Vec3;
    use crate::topology::{Components, tests::grid};

    #[test]
    fn a_sheet_with_small_holes_and_a_small_component_becomes_one_sheet_of_quads() {
        let sheet = grid(24, 24, false, false);
        let first = sheet.positions.len() as u32;
        let speck = [Vec3::new(3.0, 0.0, 0.0), Vec3::new(3.01, 0.0, 0.0), Vec3::new(3.0, 0.01, 0.0)];
        let positions: Vec<Vec3> = sheet.positions.iter().copied().chain(speck).collect();
        let kept = sheet.triangles.iter().zip(0u32..).filter(|(_, t)| ![200, 333, 611].contains(t)).map(|(t, _)| *t);
        let triangles = kept.chain([[first, first + 1, first + 2]]).collect();
        let surface = TriMesh::from_triangles(positions, triangles).expect("a sheet and a speck");
        let segmented = Segmented::primitive(&surface, Components::SmallLeftOut).expect("a disc");
        let ground = ComposedSurface::of(&segmented);
        assert_eq!(ground.input().owner.iter().filter(|s| **s == NONE).count(), 1);
        let made = compose(ground.input(), &[Piece::Nothing], Options::default(), &|| false).expect("a layout");
        assert_eq!((made.report.way, made.report.own.len()), (Way::Direct, 0));
        let net = crate::compose::net::Net::from_mesh(&made.mesh);
        assert_eq!(net.loops().expect("manifold").len(), 1);
        assert!(made.mesh.positions.iter().all(|p| p.x < 2.0));
        assert!(made.report.fit.worst() < 1e-4, "{:?}", made.report.fit);
    }
}
