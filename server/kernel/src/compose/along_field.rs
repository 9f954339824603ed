//! A component of an input on which nothing stands that was brought is laid out as a whole, along a field of crosses: its
//! segments play no part.
//!
//! The layout of [`field`](super::field) is made a mesh of quads by the same surgery and the same local changes as what is
//! stitched, and has to hold by the same theorems. Else holes smaller than its quads are closed, which no quads of that size can
//! go around; then its edges are made shorter once, as short as what is thinner than a quad needs; and at last the segments take
//! templates. Where it misses the input it is laid anew with shorter edges, since its distance is that of chords, h²κ/8.
//! *Ours, not the paper's.*

use super::Input;
use super::check::{check_structure, extraordinary};
use super::field::field_layout;
use super::following::{NearMesh, WHOLE_QUADS_MAX};
use super::net::Net;
use super::placement::LayoutOrigin;
use super::resolve::resolve;
use super::simplify_valence::ValenceSimplifier;
use super::stitching::{MISS_MAX, Stitching};
use super::{Closeness, Report};
use crate::mesh::PolyMesh;
use crate::mesh::tri::TriMesh;
use crate::numerics::stage::Stage;
use crate::topology::{holes, primitive};
use std::f64::consts::TAU;

/// By how much edges are made shorter where a layout does not hold: *untuned*.
const SHORTER: f64 = 0.8;
/// Least factor by which edges are made shorter to follow the input: four times the quads, as a subdivision has.
const SHORTEST: f64 = 0.5;
/// Share of the distance that is allowed down to which shorter edges are meant to come: as for segments made finer.
const EXPECTED: f64 = 0.9;
/// A hole with a shorter rim, in edges, may be closed: that of two by two quads is as long. *Untuned.*
const HOLE_EDGES: f64 = 8.0;
/// Edges around what is thinner than a quad, and fewest around anything.
const EDGES_AROUND: f64 = 4.0;
const EDGES_AROUND_MIN: f64 = 3.0;
/// Most quads of a layout whose edges are as short as that: templates on its segments have fewer. *Untuned.*
const THIN_QUADS_MAX: f64 = WHOLE_QUADS_MAX as f64 / 2.0;
/// Fewer quads than this are no layout of a surface: a template has more of its form. *Untuned.*
const QUADS_MIN: usize = 24;

impl Stitching<'_> {
    /// The layout along a field; `None` where there is none that holds.
    pub(super) fn along_field(&self, report: &mut Report) -> Option<PolyMesh> {
        if !Stage::Field.is_on() || self.is_late() {
            return None;
        }
        let h = self.whole_edge();
        let edges = match self.thin_edge(h) {
            // Two quads around a tube would lie flat on each other. An open one is left to templates, which need fewer quads.
            Some(thin) if EDGES_AROUND * thin < EDGES_AROUND_MIN * h => {
                let quads = self.surface().total_area() / (thin * thin);
                let is_worth_it = self.shape.boundary_loops == 0 && quads <= THIN_QUADS_MAX;
                if is_worth_it { vec![thin] } else { Vec::new() }
            }
            thin => vec![h, thin.map_or(h * SHORTER, |thin| thin.min(h * SHORTER))],
        };
        for h in edges {
            if let Some(mesh) = self.along_field_at(h, report) {
                return Some(mesh);
            }
            let Some((surface, owner, closed)) = self.without_small_holes(h) else { continue };
            let input = Input { surface: &surface, owner: &owner, count: self.segments() };
            let without = Stitching::new(input, self.options, self.scale, self.late_at);
            if let Some(mesh) = without.along_field_at(h, report) {
                report.closed = closed;
                return Some(mesh);
            }
        }
        None
    }

    /// The length of edges of which [`EDGES_AROUND`] go around the surface, were it a tube: of its volume V and area A, r = 2V/A.
    /// `None` where it stays open when holes are closed that are small for quads with edges of length `h`, or its own triangles are as
    /// few as such quads.
    fn thin_edge(&self, h: f64) -> Option<f64> {
        let filled = self.without_small_holes(h);
        let surface = filled.as_ref().map_or(self.surface(), |(filled, ..)| filled);
        if !surface.boundary_loops().is_empty() {
            return None;
        }
        let (area, first) = (surface.total_area(), surface.positions.first()?);
        // From a vertex: from an origin that lies far off little would be left of it.
        let cone =
            |t: usize| surface.area_vector(t).dot(&(surface.positions[surface.triangles[t][0] as usize] - first)) / 3.0;
        let volume = (0..surface.triangles.len()).map(cone).sum::<f64>().abs();
        let edge = TAU / EDGES_AROUND * 2.0 * volume / area;
        let quads = area / (edge * edge);
        (quads < 3.0 * surface.triangles.len() as f64).then_some(edge)
    }

    /// The surface with the holes closed that are smaller than quads with edges of length `h`, the segment of each of its triangles,
    /// and how many holes were closed; `None` where there are none.
    fn without_small_holes(&self, h: f64) -> Option<(TriMesh, Vec<u32>, usize)> {
        let surface = self.surface();
        let is_small = |rim: &Vec<u32>| primitive::length(surface, rim) < HOLE_EDGES * h;
        let small: Vec<Vec<u32>> = surface.boundary_loops().into_iter().filter(is_small).collect();
        if small.is_empty() {
            return None;
        }
        let closed = holes::filled(surface, &small);
        let beside = small.iter().flatten().map(|&h| self.owner_of(h / 3));
        let owner: Vec<u32> = (0..surface.triangles.len() as u32).map(|t| self.owner_of(t)).chain(beside).collect();
        // Where they can't be filled the surface is as it was.
        (owner.len() == closed.triangles.len()).then_some((closed, owner, small.len()))
    }

    /// The layout along a field with edges of length `h`, closer where it misses the input; `None` where there is none that holds.
    fn along_field_at(&self, h: f64, report: &mut Report) -> Option<PolyMesh> {
        let mut near = self.field_near(h)?;
        let (miss, most) = (near.laid.fit.worst(), MISS_MAX * self.scale.diagonal);
        if near.is_missed && miss > most && self.options.closeness == Closeness::Followed {
            let factor = (EXPECTED * most / miss).sqrt().max(SHORTEST);
            if let Some(finer) = self.field_near(h * factor).filter(|finer| finer.laid.fit.worst() < miss) {
                near = finer;
            }
        }
        report.extraordinary_before = extraordinary(&near.laid.mesh);
        Some(self.followed(near, report))
    }

    /// The layout with edges of length `h`, optimised and near the input.
    fn field_near(&self, h: f64) -> Option<NearMesh> {
        let mut net = field_layout((self.surface(), self.target.tree()), self.sharp_edges(), h)?;
        resolve(&mut net);
        check_structure(&net.clone().into_mesh().0, self.shape).ok()?;
        let free = vec![true; net.face_slots()];
        let mut simplifier = ValenceSimplifier::new(net.clone(), free, &self.target, Vec::new());
        let is_simpler =
            simplifier.run() > 0 && check_structure(&simplifier.net.clone().into_mesh().0, self.shape).is_ok();
        let mut net = if is_simpler { simplifier.net } else { net };
        for v in 0..net.positions.len() as u32 {
            if !net.at(v).is_empty() {
                let p = net.positions[v as usize];
                let is_border = net.on_boundary(v);
                net.positions[v as usize] =
                    if is_border { self.target.onto_border(p) } else { self.target.onto_surface(p) };
            }
        }
        let mesh = self.opened(net)?;
        (mesh.faces.len() >= QUADS_MIN).then_some(())?;
        let origins = vec![LayoutOrigin::Generated; self.segments()];
        Some(self.near(mesh, origins, MISS_MAX * self.scale.diagonal))
    }

    /// A net with faces that have an area, as a mesh that holds.
    fn opened(&self, mut net: Net) -> Option<PolyMesh> {
        if let (mesh, Ok(())) = self.checked(&net) {
            return Some(mesh);
        }
        self.open_flat_faces(&mut net);
        match self.checked(&net) {
            (mesh, Ok(())) => Some(mesh),
            _ => None,
        }
    }
}
