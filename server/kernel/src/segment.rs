//! Segmentation: a surface of any genus, with any boundaries and components, cut into parts that are primitives.
//!
//! Every part is a disc or an annulus, save components that are spheres or tori and were left whole. Cuts run freely
//! through triangles: the triangles that a cut crosses are split, and keep the number of the triangle and of the polygon
//! that they were cut from, so that a polygon across a cut can be put together again.
//! *Source:* paper §4.1 and §6 (phantom edges); the paper's own cuts were made by hand (its reference \[26\]).
//! *Ours, not the paper's:* everything that finds the cuts; see the parts.

mod around;
mod boundary_tour;
mod centrality;
mod cut;
mod distance;
mod handles;
mod mended;
mod merge;
mod necks;
mod opened;
mod order;
mod parts;
mod refined;
mod region;
mod seams;
mod smooth;
mod split;
mod tree;
mod views;
mod waist;

use std::collections::BTreeMap;
use std::sync::Arc;

pub use handles::without_small as without_small_handles;

use crate::mesh::Vec3;
use crate::mesh::tri::TriMesh;
use crate::topology::{self, Patch, Topology, TopologyError};
use parts::Count;
use refined::Refined;
use region::Region;
use smooth::Strength;

pub use around::{segment_around, segment_beyond};
pub use seams::{Seam, SeamShape};
pub use views::fused;

/// A surface cut into parts.
///
/// The parts' [`Patch::vertex_of`] and [`Patch::triangle_of`] point into [`Self::mesh`], and so do all other numbers
/// here. `mesh` without the cuts is the surface that was given: its first vertices are the surface's, in their order; the
/// rest lie on the surface's edges or in its triangles.
#[derive(Clone, Debug)]
pub struct Segmented {
    /// The surface, refined so that every cut runs along edges. An edge that does not lie on one of the surface's
    /// polygon edges is phantom.
    pub mesh: Arc<TriMesh>,
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
    /// Handles that were cut along a loop, both sides of which are among the holes.
    pub handles_opened: u32,
    /// True where it was cut at its waist, into two parts: openings that the cut leaves in them are among their holes.
    pub is_waist: bool,
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
    /// Two, where a short cut parts a scan, as a figure from its base; else [`Self::AsNeeded`].
    AtWaist,
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
    let refined = finely(surface)?;
    let labels = labels(&refined.mesh, count);
    let (refined, labels) = smoothly_cut(refined, labels);
    Ok(Segmented::assemble(surface, refined, &labels, Order::Largest))
}

/// Cuts a surface where a label on it changes: `label_at` gives the label of a point of the surface. Parts are in order
/// of label, pieces beside the largest of a label go to its neighbours, and borders are smoothed as strongly as leaves
/// every part a primitive and is accepted by `accept`.
///
/// # Errors
/// [`TopologyError::Empty`]; [`TopologyError::Segment`] naming the first part that is no primitive; what `accept` says of
/// the borders as they are where it accepts none.
pub fn segment_by<E: From<TopologyError>>(
    surface: &TriMesh,
    label_at: &dyn Fn(Vec3) -> u32,
    accept: &dyn Fn(&Segmented) -> Result<(), E>,
) -> Result<Segmented, E> {
    let refined = finely(surface)?;
    let mesh = &refined.mesh;
    let middle = |t: &[u32; 3]| t.iter().map(|&v| mesh.positions[v as usize]).sum::<Vec3>() / 3.0;
    let mut labels: Vec<u32> = mesh.triangles.iter().map(|t| label_at(middle(t))).collect();
    merge::absorb_small_components(mesh, &mut labels);
    for strength in STRENGTHS {
        let (cut, labels) = cut::cut(&refined, &smooth::smooth(mesh, &labels, strength));
        if all_primitives(&cut, &labels).is_ok() {
            let made = Segmented::assemble(surface, cut, &labels, Order::Labels);
            if accept(&made).is_ok() {
                return Ok(made);
            }
        }
    }
    all_primitives(&refined, &labels)?;
    let made = Segmented::assemble(surface, refined, &labels, Order::Labels);
    accept(&made)?;
    Ok(made)
}

/// Cuts a surface along the curve on which `field`, one value a vertex, is 0. The part where it is positive comes first;
/// pieces beside the largest of either go to the other.
///
/// # Errors
/// [`TopologyError::Empty`].
pub fn segment_above(surface: &TriMesh, field: &[f64]) -> Result<Segmented, TopologyError> {
    let (cut, mut labels) = cut_at_zero(surface, field)?;
    merge::absorb_small_components(&cut.mesh, &mut labels);
    Ok(Segmented::assemble(surface, cut, &labels, Order::Labels))
}

/// The refinement in which the curve on which `field` is 0 runs along edges, and the label of each of its triangles: 0 where the
/// field is positive, else 1.
fn cut_at_zero(surface: &TriMesh, field: &[f64]) -> Result<(Refined, Vec<u32>), TopologyError> {
    if surface.triangles.is_empty() {
        return Err(TopologyError::Empty);
    }
    let scale = field.iter().fold(f64::MIN_POSITIVE, |most, x| most.max(x.abs()));
    let shares = |x: &f64| vec![(0, 0.5 + 0.5 * x / scale), (1, 0.5 - 0.5 * x / scale)];
    Ok(cut::cut(&Refined::of(surface), &field.iter().map(shares).collect::<Vec<_>>()))
}

/// Cuts a surface between its triangles, each of which has a label; the parts are in order of labels. Pieces beside the largest
/// of a label go to their neighbours.
pub fn segment_labels(surface: &TriMesh, mut label_of: Vec<u32>) -> Segmented {
    merge::absorb_small_components(surface, &mut label_of);
    Segmented::assemble(surface, Refined::of(surface), &label_of, Order::Labels)
}

/// An error that names the first label whose triangles are no primitive.
fn all_primitives(refined: &Refined, labels: &[u32]) -> Result<(), TopologyError> {
    for (segment, set) in members(labels).iter().enumerate() {
        if let Err(source) = topology::classify(&topology::submesh(&refined.mesh, set).0) {
            let label = set.first().map_or(0, |&t| i64::from(labels[t as usize]));
            return Err(TopologyError::Segment { segment, label, source: Box::new(source) });
        }
    }
    Ok(())
}

/// The order of parts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Order {
    /// The largest first.
    Largest,
    /// By label.
    Labels,
}

/// A surface with triangles small enough to be cut well.
fn finely(surface: &TriMesh) -> Result<Refined, TopologyError> {
    if surface.triangles.is_empty() {
        return Err(TopologyError::Empty);
    }
    let mut refined = Refined::of(surface);
    let edge = (surface.total_area() / TRIANGLES_MIN as f64 * 4.0 / 3f64.sqrt()).sqrt();
    refined.split_long_edges(EDGE_MAX * edge, 3 * surface.triangles.len() + 8 * TRIANGLES_MIN);
    Ok(refined)
}

/// A label for each triangle: its part.
fn labels(mesh: &TriMesh, count: PartCount) -> Vec<u32> {
    let components = topology::pieces(mesh);
    let regions: Vec<Region> = components.into_iter().map(|c| Region::new(mesh, c)).collect();
    let wanted = match count {
        PartCount::About(n) => Some(shares_of(n, &regions)),
        PartCount::AsNeeded | PartCount::AtWaist | PartCount::Protrusions => None,
    };
    let mut label_of = vec![0; mesh.triangles.len()];
    let mut first = 0;
    for (k, region) in regions.iter().enumerate() {
        let share = wanted.as_ref().map_or(Count::Natural, |w| Count::Wanted(w[k]));
        let may_stay = matches!(count, PartCount::AsNeeded | PartCount::AtWaist) || share == Count::Wanted(1);
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
        if all_primitives(&cut, &cut_labels).is_ok() {
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
    /// Puts the parts in order.
    fn assemble(surface: &TriMesh, mut refined: Refined, labels: &[u32], order: Order) -> Self {
        refined.flag_phantoms(surface);
        let mesh = refined.mesh;
        let area = |s: &Vec<u32>| s.iter().map(|&t| mesh.area(t as usize)).sum::<f64>();
        let mut sets: Vec<(f64, Vec<u32>)> = members(labels).into_iter().map(|s| (area(&s), s)).collect();
        if order == Order::Largest {
            sets.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        }
        let mut part_of = vec![0; mesh.triangles.len()];
        let mut parts = Vec::new();
        for (number, (_, triangle_of)) in sets.into_iter().enumerate() {
            triangle_of.iter().for_each(|&t| part_of[t as usize] = number as u32);
            let (part, vertex_of) = topology::submesh(&mesh, &triangle_of);
            let topology = topology::classify(&part).unwrap_or(Topology::Disc);
            parts.push(Patch {
                topology,
                mesh: Arc::new(part),
                vertex_of,
                triangle_of,
                holes: Vec::new(),
                left_out: 0,
            });
        }
        let seams = seams::between(&mesh, &part_of);
        let surface_vertices = surface.positions.len();
        Self {
            mesh: Arc::new(mesh),
            surface_vertices,
            part_of,
            source_of: refined.source_of,
            parts,
            seams,
            handles_opened: 0,
            is_waist: false,
        }
    }

    /// One part, the whole surface, in which there may be a gap.
    ///
    /// # Errors
    /// [`TopologyError`] for a surface that is no primitive.
    pub fn whole(surface: &TriMesh) -> Result<Self, TopologyError> {
        let part = topology::gapped(surface)?;
        Ok(Self::uncut(surface, vec![part]))
    }

    /// One part, the whole surface or what is left of it without small components and small holes.
    ///
    /// # Errors
    /// See [`topology::primitive`].
    pub fn primitive(surface: &TriMesh, policy: topology::Components) -> Result<Self, TopologyError> {
        let part = topology::primitive(surface, policy)?;
        Ok(Self::uncut(surface, vec![part]))
    }

    /// One part, what is left of a scan whose holes are filled, and of whose ends all but two are ([`topology::with_two_ends`]).
    ///
    /// # Errors
    /// See [`topology::with_two_ends`].
    pub fn with_two_ends(surface: &TriMesh) -> Result<Self, TopologyError> {
        Ok(Self::uncut(surface, vec![topology::with_two_ends(surface, topology::Components::SmallLeftOut)?]))
    }

    /// The same, where a scan of one part that is open at no more than a pinhole is closed ([`topology::closed`]).
    #[must_use]
    pub fn closed(mut self) -> Self {
        if let [_] = self.parts[..] {
            self.parts = self.parts.into_iter().map(topology::closed).collect();
        }
        self
    }

    /// One part a piece of a scan that fell into several, each a primitive once its small holes are filled, small components left
    /// out; `None` for any other surface.
    pub fn mended(surface: &TriMesh) -> Option<Self> {
        mended::pieces(surface)
    }

    /// The parts of the largest pieces, `most` at most; the other pieces are small components. As it was, where these would be much of it.
    #[must_use]
    pub fn of_largest_pieces(self, most: usize) -> Self {
        mended::of_largest_pieces(self, most)
    }

    /// One part, the largest component of a scan, cut along a loop around each of its few handles; `None` for any other surface.
    pub fn opened(surface: &TriMesh) -> Option<Self> {
        opened::opened(surface)
    }

    /// Two parts, the largest component of a surface cut at its waist; `None` where it has none.
    pub fn at_waist(surface: &TriMesh) -> Option<Self> {
        waist::waist(surface)
    }

    /// One part a label, in order of label; `labels` holds one a polygon, so every cut runs along polygon edges.
    ///
    /// # Errors
    /// See [`topology::by_labels`].
    pub fn by_labels(surface: &TriMesh, labels: &[i64]) -> Result<Self, TopologyError> {
        let parts = topology::by_labels(surface, labels)?;
        Ok(Self::uncut(surface, parts))
    }

    /// The same parts with borders between polygons: each polygon goes to the part that has most of it.
    ///
    /// # Errors
    /// See [`topology::by_labels`]: on a coarse mesh a part may lose its shape.
    pub fn between_polygons(&self, surface: &TriMesh) -> Result<Self, TopologyError> {
        let polygons = surface.polygon_of.iter().max().map_or(0, |&f| f as usize + 1);
        let mut areas = vec![BTreeMap::new(); polygons];
        for (t, &part) in self.part_of.iter().enumerate() {
            if let Some(areas) = areas.get_mut(self.mesh.polygon_of[t] as usize) {
                *areas.entry(part).or_insert(0.0) += self.mesh.area(t);
            }
        }
        let most = |areas: &BTreeMap<u32, f64>| {
            areas.iter().max_by(|a, b| a.1.total_cmp(b.1).then(b.0.cmp(a.0))).map_or(0, |a| *a.0)
        };
        let of_polygon: Vec<u32> = areas.iter().map(most).collect();
        let mut of_triangle: Vec<u32> = surface.polygon_of.iter().map(|&f| of_polygon[f as usize]).collect();
        merge::absorb_small_components(surface, &mut of_triangle);
        let mut labels = vec![0; polygons];
        for (&f, &label) in surface.polygon_of.iter().zip(&of_triangle) {
            labels[f as usize] = i64::from(label);
        }
        Self::by_labels(surface, &labels)
    }

    /// Parts that are cut along edges of the surface as it is.
    fn uncut(surface: &TriMesh, parts: Vec<Patch>) -> Self {
        let mut part_of = vec![0; surface.triangles.len()];
        for (number, part) in parts.iter().enumerate() {
            part.triangle_of.iter().for_each(|&t| part_of[t as usize] = number as u32);
        }
        let source_of = (0..surface.triangles.len() as u32).collect();
        let seams = seams::between(surface, &part_of);
        let (mesh, surface_vertices) = (Arc::new(surface.clone()), surface.positions.len());
        Self { mesh, surface_vertices, part_of, source_of, parts, seams, handles_opened: 0, is_waist: false }
    }

    /// The same with one mesh in place of equals: the surface's where nothing was refined, and that for a part that is all of it.
    #[must_use]
    pub fn sharing(mut self, surface: &Arc<TriMesh>) -> Self {
        if self.mesh == *surface {
            self.mesh = Arc::clone(surface);
        }
        for part in self.parts.iter_mut().filter(|part| part.mesh == self.mesh) {
            part.mesh = Arc::clone(&self.mesh);
        }
        self
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

    /// Two tori joined where each has lost a square: genus 2.
    fn double_torus() -> TriMesh {
        let one = grid(24, 16, true, true);
        let n = one.positions.len() as u32;
        let mut positions = one.positions.clone();
        positions.extend(one.positions.iter().map(|p| Vec3::new(6.4 - p.x, -p.y, p.z)));
        // The squares that are left out have corners a, b, c, d; those of the second are the first's, turned over.
        let [a, b, c, d] = [0, 1, 25, 24];
        let glued = |v: u32| match v {
            _ if v == n + a => b,
            _ if v == n + b => a,
            _ if v == n + c => d,
            _ if v == n + d => c,
            _ => v,
        };
        let kept = one.triangles.iter().skip(2);
        let second = kept.clone().map(|t| t.map(|v| glued(v + n)));
        let triangles: Vec<[u32; 3]> = kept.copied().chain(second).collect();
        let joined = TriMesh::from_triangles(positions, triangles).expect("manifold");
        let all: Vec<u32> = (0..joined.triangles.len() as u32).collect();
        // Without the vertices that gluing left over.
        topology::submesh(&joined, &all).0
    }

    #[test]
    fn a_surface_of_genus_two_becomes_discs_and_annuli() {
        let mesh = double_torus();
        assert_eq!(topology::invariants(&mesh).genus, 2);
        let cut = segment(&mesh, PartCount::AsNeeded).expect("cut");
        assert!(cut.parts.len() >= 3);
        for part in &cut.parts {
            assert_eq!(topology::classify(&part.mesh), Ok(part.topology));
        }
        let total: f64 = cut.parts.iter().map(|p| p.mesh.total_area()).sum();
        assert!((total - mesh.total_area()).abs() < 1e-9 * total);
        assert_eq!(cut.mesh.positions[..mesh.positions.len()], mesh.positions);
    }

    #[test]
    fn a_primitive_stays_whole_unless_parts_are_asked_for() {
        let torus = grid(24, 12, true, true);
        assert_eq!(segment(&torus, PartCount::AsNeeded).expect("whole").parts.len(), 1);
        let four = segment(&torus, PartCount::About(4)).expect("cut");
        assert_eq!(four.parts.len(), 4);
        assert!(four.parts.iter().all(|p| matches!(p.topology, Topology::Disc | Topology::Annulus)));
    }

    /// A slab of n × n square holes: a closed surface with n² handles.
    fn pierced(n: u32) -> TriMesh {
        let side = 2 * n + 1;
        let is_hole = |i: u32, j: u32| i % 2 == 1 && j % 2 == 1 && i < side - 1 && j < side - 1;
        let at = |i: u32, j: u32, k: u32| (k * (side + 1) + j) * (side + 1) + i;
        let mut quads = Vec::new();
        for (i, j) in (0..side).flat_map(|j| (0..side).map(move |i| (i, j))).filter(|&(i, j)| !is_hole(i, j)) {
            quads.push([at(i, j, 1), at(i + 1, j, 1), at(i + 1, j + 1, 1), at(i, j + 1, 1)]);
            quads.push([at(i, j, 0), at(i, j + 1, 0), at(i + 1, j + 1, 0), at(i + 1, j, 0)]);
            // A wall towards each side where there is nothing.
            let (x, y) = (i64::from(i), i64::from(j));
            let open = |i: i64, j: i64| {
                let inside = (0..i64::from(side)).contains(&i) && (0..i64::from(side)).contains(&j);
                !inside || is_hole(i as u32, j as u32)
            };
            let mut wall = |a: (u32, u32), b: (u32, u32)| {
                quads.push([at(a.0, a.1, 0), at(b.0, b.1, 0), at(b.0, b.1, 1), at(a.0, a.1, 1)]);
            };
            if open(x, y - 1) {
                wall((i, j), (i + 1, j));
            }
            if open(x + 1, y) {
                wall((i + 1, j), (i + 1, j + 1));
            }
            if open(x, y + 1) {
                wall((i + 1, j + 1), (i, j + 1));
            }
            if open(x - 1, y) {
                wall((i, j + 1), (i, j));
            }
        }
        let point = |v: u32| {
            let (i, j, k) = (v % (side + 1), v / (side + 1) % (side + 1), v / (side + 1).pow(2));
            Vec3::new(f64::from(i), f64::from(j), f64::from(k))
        };
        let positions = (0..2 * (side + 1).pow(2)).map(point).collect();
        let triangles = quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
        let slab = TriMesh::from_triangles(positions, triangles).expect("manifold");
        let all: Vec<u32> = (0..slab.triangles.len() as u32).collect();
        topology::submesh(&slab, &all).0
    }

    #[test]
    fn very_many_handles_are_cut_too() {
        let slab = pierced(5);
        assert_eq!(topology::invariants(&slab).genus, 25);
        let cut = segment(&slab, PartCount::AsNeeded).expect("cut");
        assert!(cut.parts.iter().all(|part| topology::classify(&part.mesh) == Ok(part.topology)));
        assert!(cut.parts.iter().all(|part| matches!(part.topology, Topology::Disc | Topology::Annulus)));
    }

    #[test]
    fn a_triangle_soup_is_told_apart_at_once() {
        let count = 40_000;
        let (one, at) = ([Vec3::zeros(), Vec3::x(), Vec3::y()], |k: u32| Vec3::new(0.0, 0.0, f64::from(k)));
        let positions = (0..count).flat_map(|k| one.map(|p| p + at(k))).collect();
        let triangles = (0..count).map(|k| [0, 1, 2].map(|v| 3 * k + v)).collect();
        let soup = TriMesh::from_triangles(positions, triangles).expect("manifold");
        assert!(Segmented::mended(&soup).is_none());
        assert_eq!(segment(&soup, PartCount::AsNeeded).expect("cut").parts.len(), count as usize);
    }

    #[test]
    fn labels_on_points_become_parts_in_their_order() {
        let any = |_: &Segmented| Ok::<(), TopologyError>(());
        let ring = grid(24, 20, true, false);
        let cut = segment_by(&ring, &|x| u32::from(x.z < 1.0), &any).expect("two rings");
        assert_eq!(cut.parts.iter().map(|p| p.topology).collect::<Vec<_>>(), [Topology::Annulus; 2]);
        let share = cut.parts[1].mesh.total_area() / ring.total_area();
        assert!((share - 1.0 / 3.0).abs() < 0.02, "{share}");
        let error = segment_by(&grid(24, 16, true, true), &|x| u32::from(x.x > 0.0 && x.y > 0.0 && x.z > 0.9), &any);
        assert!(matches!(error, Err(TopologyError::Segment { segment: 0, .. })), "a torus with a hole is named");
    }

    #[test]
    fn borders_are_smoothed_less_where_smooth_ones_are_not_accepted() {
        let ring = grid(48, 40, true, false);
        // A narrow tooth, which smoothing takes away.
        let tooth = |x: Vec3| x.y.abs() < 0.15 && x.x > 0.0 && x.z < 2.0;
        let label = |x: Vec3| u32::from(x.z < 1.0 || tooth(x));
        let reach = |cut: &Segmented| {
            let part = &cut.parts[1].mesh;
            part.positions.iter().map(|p| p.z).fold(0.0, f64::max)
        };
        let smooth = segment_by(&ring, &label, &|_| Ok::<(), TopologyError>(())).expect("two rings");
        let reaching = |cut: &Segmented| if reach(cut) > 1.9 { Ok(()) } else { Err(TopologyError::Empty) };
        let less = segment_by(&ring, &label, &reaching).expect("two rings with the tooth");
        assert!(reach(&smooth) < 1.87 && reach(&less) > 1.9, "{} {}", reach(&smooth), reach(&less));
        let never = |_: &Segmented| Err(TopologyError::Empty);
        assert!(matches!(segment_by(&ring, &label, &never), Err(TopologyError::Empty)));
    }

    #[test]
    fn between_polygons_no_polygon_is_cut() {
        let torus = grid(24, 12, true, true);
        let cut = segment(&torus, PartCount::About(3)).and_then(|free| free.between_polygons(&torus)).expect("cut");
        assert_eq!(*cut.mesh, torus);
        assert_eq!(cut.parts.len(), 3);
    }

    #[test]
    fn labels_along_polygon_edges_refine_nothing() {
        let mesh = grid(8, 6, true, false);
        let labels: Vec<i64> = (0..mesh.triangles.len() as i64).map(|t| t / 32).collect();
        let cut = Segmented::by_labels(&mesh, &labels).expect("three rings");
        assert_eq!(*cut.mesh, mesh);
        assert_eq!(cut.parts.len(), 3);
        assert_eq!(cut.neighbours(1), [0, 2]);
        assert_eq!(cut.neighbours(2), [1]);
    }
}
