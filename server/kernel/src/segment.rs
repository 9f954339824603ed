//! Segmentation: a surface of any genus, with any boundaries and components, cut into parts that are primitives.
//!
//! Every part is a disc or an annulus, save components that are spheres or tori and were left whole. Cuts run freely
//! through triangles: the triangles that a cut crosses are split, and keep the number of the triangle and of the polygon
//! that they were cut from, so that a polygon across a cut can be put together again.
//! *Source:* paper §4.1 and §6 (phantom edges); the paper's own cuts were made by hand (its reference \[26\]).
//! *Ours, not the paper's:* everything that finds the cuts; see the parts.

mod centrality;
mod cut;
mod distance;
mod merge;
mod necks;
mod parts;
mod refined;
mod region;
mod seams;
mod smooth;
mod split;
mod tour;
mod tree;

use crate::mesh::tri::TriMesh;
use crate::topology::{self, Patch, Topology, TopologyError};
use parts::Count;
use refined::Refined;
use region::Region;
use smooth::Strength;

pub use seams::{Seam, SeamShape};

/// A surface cut into parts.
///
/// The parts' [`Patch::vertex_of`] and [`Patch::triangle_of`] point into [`Self::mesh`], and so do all other numbers
/// here. `mesh` without the cuts is the surface that was given: its first vertices are the surface's, in their order; the
/// rest lie on the surface's edges or in its triangles.
#[derive(Clone, Debug)]
pub struct Segmented {
    /// The surface, refined so that every cut runs along edges. An edge that does not lie on one of the surface's
    /// polygon edges is phantom.
    pub mesh: TriMesh,
    /// How many vertices the surface had before it was refined.
    pub surface_vertices: usize,
    /// Part of each triangle of `mesh`.
    pub part_of: Vec<u32>,
    /// Triangle of the given surface in which each triangle of `mesh` lies.
    pub source_of: Vec<u32>,
    /// The parts, each ready to be unfolded.
    pub parts: Vec<Patch>,
    /// Where parts border on each other, in order of their parts.
    pub seams: Vec<Seam>,
}

/// How many parts to cut a surface into.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PartCount {
    /// Components that are primitives stay whole; others are cut as by [`Self::Protrusions`].
    #[default]
    AsNeeded,
    /// One for each protrusion, and what is left into as few as can be.
    Protrusions,
    /// So many in all, if the topology allows; else the fewest that it allows.
    About(usize),
}

/// A surface with fewer triangles is refined before it is cut.
const TRIANGLES_MIN: usize = 12_000;
/// An edge is split if it is this many times longer than those of so many equal triangles.
const EDGE_MAX: f64 = 1.5;
/// How borders are smoothed; the next is tried where one leaves a part that is no primitive.
const STRENGTHS: [Strength; 3] =
    [Strength { rounds: 3, steps: 8 }, Strength { rounds: 2, steps: 5 }, Strength { rounds: 1, steps: 2 }];

/// Cuts a surface of any topology into primitives.
///
/// # Errors
/// [`TopologyError::Empty`].
pub fn segment(surface: &TriMesh, count: PartCount) -> Result<Segmented, TopologyError> {
    if surface.triangles.is_empty() {
        return Err(TopologyError::Empty);
    }
    let mut refined = Refined::of(surface);
    let edge = (surface.total_area() / TRIANGLES_MIN as f64 * 4.0 / 3f64.sqrt()).sqrt();
    refined.split_long_edges(EDGE_MAX * edge, 3 * surface.triangles.len() + 8 * TRIANGLES_MIN);
    let labels = labels(&refined.mesh, count);
    let (refined, labels) = smoothly_cut(refined, labels);
    Ok(Segmented::assemble(surface, refined, &labels))
}

/// A label for each triangle: its part.
fn labels(mesh: &TriMesh, count: PartCount) -> Vec<u32> {
    let components = region::connected(mesh, &vec![0; mesh.triangles.len()]);
    let regions: Vec<Region> = components.into_iter().map(|c| Region::new(mesh, c)).collect();
    let wanted = match count {
        PartCount::About(n) => Some(shares_of(n, &regions)),
        PartCount::AsNeeded | PartCount::Protrusions => None,
    };
    let mut label_of = vec![0; mesh.triangles.len()];
    let mut first = 0;
    for (k, region) in regions.iter().enumerate() {
        let share = wanted.as_ref().map_or(Count::Natural, |w| Count::Wanted(w[k]));
        let may_stay = count == PartCount::AsNeeded || share == Count::Wanted(1);
        let parts = match may_stay && region.primitive().is_some() {
            true => vec![0; region.triangle_of.len()],
            false => parts::parts(&region.mesh, share),
        };
        region.triangle_of.iter().zip(&parts).for_each(|(&t, p)| label_of[t as usize] = first + p);
        first += 1 + parts.iter().max().copied().unwrap_or(0);
    }
    label_of
}

/// Parts of each component when there are to be `n` in all: one each, the others one by one to the largest by area.
fn shares_of(n: usize, regions: &[Region]) -> Vec<usize> {
    let areas: Vec<f64> = regions.iter().map(|r| r.mesh.total_area()).collect();
    let mut shares = vec![1; regions.len()];
    for _ in regions.len()..n {
        let next = (0..areas.len())
            .max_by(|&a, &b| (areas[a] / shares[a] as f64).total_cmp(&(areas[b] / shares[b] as f64)).then(b.cmp(&a)));
        if let Some(next) = next {
            shares[next] += 1;
        }
    }
    shares
}

/// Smooths the borders and cuts along them, as strongly as leaves every part a primitive.
fn smoothly_cut(refined: Refined, labels: Vec<u32>) -> (Refined, Vec<u32>) {
    if labels.iter().all(|l| *l == labels[0]) {
        return (refined, labels);
    }
    for strength in STRENGTHS {
        let shares = smooth::smooth(&refined.mesh, &labels, strength);
        let (cut, cut_labels) = cut::cut(&refined, &shares);
        let sets = members(&cut_labels);
        let fits = |set: &Vec<u32>| topology::classify(&topology::submesh(&cut.mesh, set).0).is_ok();
        if sets.iter().all(fits) {
            return (cut, cut_labels);
        }
    }
    (refined, labels)
}

/// The triangles of each label in use, in order of label.
fn members(labels: &[u32]) -> Vec<Vec<u32>> {
    let count = labels.iter().max().map_or(0, |l| *l as usize + 1);
    let mut sets = vec![Vec::new(); count];
    labels.iter().enumerate().for_each(|(t, l)| sets[*l as usize].push(t as u32));
    sets.retain(|s| !s.is_empty());
    sets
}

impl Segmented {
    /// Puts the parts in order, the largest first.
    fn assemble(surface: &TriMesh, mut refined: Refined, labels: &[u32]) -> Self {
        refined.flag_phantoms(surface);
        let mesh = refined.mesh;
        let area = |s: &Vec<u32>| s.iter().map(|&t| mesh.area(t as usize)).sum::<f64>();
        let mut sets: Vec<(f64, Vec<u32>)> = members(labels).into_iter().map(|s| (area(&s), s)).collect();
        sets.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let mut part_of = vec![0; mesh.triangles.len()];
        let mut parts = Vec::new();
        for (number, (_, triangle_of)) in sets.into_iter().enumerate() {
            triangle_of.iter().for_each(|&t| part_of[t as usize] = number as u32);
            let (part, vertex_of) = topology::submesh(&mesh, &triangle_of);
            let topology = topology::classify(&part).unwrap_or(Topology::Disc);
            parts.push(Patch { topology, mesh: part, vertex_of, triangle_of });
        }
        let seams = seams::between(&mesh, &part_of);
        let surface_vertices = surface.positions.len();
        Self { mesh, surface_vertices, part_of, source_of: refined.source_of, parts, seams }
    }

    /// One part, the whole surface.
    ///
    /// # Errors
    /// [`TopologyError`] for a surface that is no primitive.
    pub fn whole(surface: &TriMesh) -> Result<Self, TopologyError> {
        let part = topology::whole(surface)?;
        Ok(Self::uncut(surface, vec![part]))
    }

    /// One part a label, in order of label; `labels` holds one a polygon, so every cut runs along polygon edges.
    ///
    /// # Errors
    /// See [`topology::by_labels`].
    pub fn by_labels(surface: &TriMesh, labels: &[i64]) -> Result<Self, TopologyError> {
        let parts = topology::by_labels(surface, labels)?;
        Ok(Self::uncut(surface, parts))
    }

    /// Parts that are cut along edges of the surface as it is.
    fn uncut(surface: &TriMesh, parts: Vec<Patch>) -> Self {
        let mut part_of = vec![0; surface.triangles.len()];
        for (number, part) in parts.iter().enumerate() {
            part.triangle_of.iter().for_each(|&t| part_of[t as usize] = number as u32);
        }
        let source_of = (0..surface.triangles.len() as u32).collect();
        let seams = seams::between(surface, &part_of);
        Self { mesh: surface.clone(), surface_vertices: surface.positions.len(), part_of, source_of, parts, seams }
    }

    /// The parts that border on part `part`, in order, each once.
    pub fn neighbours(&self, part: u32) -> Vec<u32> {
        let other = |s: &Seam| match s.parts {
            [a, b] if a == part => Some(b),
            [a, b] if b == part => Some(a),
            _ => None,
        };
        let mut found: Vec<u32> = self.seams.iter().filter_map(other).collect();
        found.sort_unstable();
        found.dedup();
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::tests::grid;

    #[test]
    fn labels_along_polygon_edges_refine_nothing() {
        let mesh = grid(8, 6, true, false);
        let labels: Vec<i64> = (0..mesh.triangles.len() as i64).map(|t| t / 32).collect();
        let cut = Segmented::by_labels(&mesh, &labels).expect("three rings");
        assert_eq!(cut.mesh, mesh);
        assert_eq!(cut.parts.len(), 3);
        assert_eq!(cut.neighbours(1), [0, 2]);
        assert_eq!(cut.neighbours(2), [1]);
    }
}
