//! A component of an input on which nothing stands that was brought is laid out as a whole, along a field of crosses: its
//! segments play no part.
//!
//! The layout of [`field`](super::field) is made a mesh of quads by the same surgery and the same local changes as what is
//! stitched, and has to hold by the same theorems; else its edges are made shorter once, and at last the segments take
//! templates. Where it misses the input it is laid anew with shorter edges, since its distance is that of chords, h²κ/8.
//! *Ours, not the paper's.*

use super::check::{check_structure, extraordinary};
use super::field::field_layout;
use super::following::Near;
use super::net::Net;
use super::placement::LayoutOrigin;
use super::resolve::resolve;
use super::simplify_valence::ValenceSimplifier;
use super::stitching::{MISS_MAX, Stitching};
use super::{Closeness, REGULAR_QUADS, Report};
use crate::mesh::PolyMesh;
use crate::numerics::stage::Stage;

/// By how much edges are made shorter where a layout does not hold: *untuned*.
const SHORTER: f64 = 0.8;
/// Least factor by which edges are made shorter to follow the input: four times the quads, as a subdivision has.
const SHORTEST: f64 = 0.5;
/// Share of the distance that is allowed down to which shorter edges are meant to come: as for segments made finer.
const EXPECTED: f64 = 0.9;
/// Fewer quads than this are no layout of a surface: a template has more of its form. *Untuned.*
const QUADS_MIN: usize = 24;

impl Stitching<'_> {
    /// The layout along a field; `None` where there is none that holds.
    pub(super) fn along_field(&self, report: &mut Report) -> Option<PolyMesh> {
        if !Stage::Field.is_on() || self.is_late() {
            return None;
        }
        let h = (self.scale.area / REGULAR_QUADS).sqrt() * self.options.edge_scale;
        let mut laid = self.field_near(h).map(|near| (h, near));
        if laid.is_none() {
            laid = self.field_near(h * SHORTER).map(|near| (h * SHORTER, near));
        }
        let (h, mut near) = laid?;
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
    fn field_near(&self, h: f64) -> Option<Near> {
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
