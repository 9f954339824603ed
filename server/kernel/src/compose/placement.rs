//! Which vertices of a composed mesh may move when it is optimised, and whether the result is kept. *Ours, not the paper's.*

use super::fit::Fit;
use super::fit_surface::{FixedVertices, fit_surface};
use super::net::Net;
use super::optimise::optimise;
use super::site::{LayoutKind, Site};
use super::square::{deviations_at_deg, mean_deviation_deg};
use super::stitching::{MISS_MAX, Stitching};
use crate::mesh::PolyMesh;

/// By what factor the distance from the input may grow for right angles.
const LOSS: f64 = 1.15;
/// Edges from a seam, or from a regular layout, up to which an example's own vertices are free.
const RINGS: usize = 3;
/// Farther away a vertex stays up to this mean deviation from right angles around it, in degrees, and is free from the
/// other on: a layout keeps what its artist made of it.
const STAYS_DEG: f64 = 15.0;
const GOES_DEG: f64 = 35.0;
/// Stiffness of a vertex that was moved to cover a protrusion: without any it would slide back from the tip, and fixed it
/// would keep the quads around it sheared.
const TIP_STIFFNESS: f64 = 0.2;
/// Rounds of a mesh that follows the input.
const ROUNDS: u32 = 60;
/// Most quads that are optimised.
const QUADS_MAX: usize = 30_000;

/// Where the layout of a segment comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LayoutOrigin {
    /// An example that was chosen for it: it stays, but for its seams.
    Kept,
    /// An example that the ranking chose.
    Example,
    /// A regular layout, or the input's own triangles.
    Generated,
}

impl LayoutOrigin {
    /// That of a site.
    pub(super) fn of(site: &Site<'_>) -> Self {
        match site.stands {
            LayoutKind::Part if site.is_kept() => Self::Kept,
            LayoutKind::Part => Self::Example,
            LayoutKind::Regular | LayoutKind::Own => Self::Generated,
        }
    }
}

/// A composed mesh on its way.
#[derive(Clone, Debug)]
pub(super) struct Draft {
    /// The mesh.
    pub(super) mesh: PolyMesh,
    /// How far it lies from the input.
    pub(super) fit: Fit,
    /// Whether each vertex was moved to cover a protrusion; none beyond the end.
    pub(super) tips: Vec<bool>,
    /// Whether each lies on a sharp line of the input.
    pub(super) on_line: Vec<bool>,
}

/// Vertices that are not quite free, by their numbers; those beyond the end are.
#[derive(Clone, Copy, Debug)]
pub(super) struct Marks<'a> {
    /// Which stay.
    pub(super) stays: &'a [bool],
    /// Which were moved to cover a protrusion.
    pub(super) tips: &'a [bool],
}

impl Stitching<'_> {
    /// The stiffness of each vertex, for [`optimise`].
    fn stiffness(&self, net: &Net, origins: &[LayoutOrigin], marks: Marks<'_>) -> Vec<f64> {
        let segments: Vec<Option<usize>> = net.positions.iter().map(|&p| self.segment_at(p)).collect();
        let origin_of =
            |v: u32| segments[v as usize].and_then(|s| origins.get(s)).copied().unwrap_or(LayoutOrigin::Generated);
        let at_seam = |c: &[u32]| {
            c.iter()
                .any(|&v| origin_of(v) == LayoutOrigin::Generated || segments[v as usize] != segments[c[0] as usize])
        };
        let mut seams: Vec<u32> = net.faces().filter(|(_, c)| at_seam(c)).flat_map(|(_, c)| c.to_vec()).collect();
        seams.sort_unstable();
        seams.dedup();
        let mut is_near = vec![false; net.positions.len()];
        net.rings(&seams, RINGS).concat().into_iter().for_each(|v| is_near[v as usize] = true);
        let deviations = deviations_at_deg(net);
        let is_marked = |marks: &[bool], v: u32| marks.get(v as usize) == Some(&true);
        let stiffness = |v: u32| match deviations[v as usize] {
            _ if net.on_boundary(v) || is_marked(marks.stays, v) => f64::INFINITY,
            _ if is_marked(marks.tips, v) => TIP_STIFFNESS,
            _ if is_near[v as usize] => 0.0,
            _ if origin_of(v) == LayoutOrigin::Kept => f64::INFINITY,
            d if d <= STAYS_DEG => f64::INFINITY,
            d => (GOES_DEG - d).max(0.0) / (d - STAYS_DEG),
        };
        (0..net.positions.len() as u32).map(stiffness).collect()
    }

    /// Optimises a net; whether that made its angles better and it is still sound. Else it is as it was.
    pub(super) fn optimise(&self, net: &mut Net, origins: &[LayoutOrigin], marks: Marks<'_>, rounds: u32) -> bool {
        if net.faces().count() > QUADS_MAX {
            return false;
        }
        let (old, before) = (net.positions.clone(), mean_deviation_deg(net));
        let stiffness = self.stiffness(net, origins, marks);
        optimise(net, &self.target, &stiffness, rounds);
        if self.checked(net).1.is_err() {
            self.open_flat_faces(net);
        }
        let is_better = mean_deviation_deg(net) < before && self.checked(net).1.is_ok();
        if !is_better {
            net.positions = old;
        }
        is_better
    }

    /// The mesh optimised along the input, if that makes angles better and keeps near to it.
    pub(super) fn optimised(&self, now: Draft, origins: &[LayoutOrigin], rounds: u32) -> Draft {
        let mut net = Net::from_mesh(&now.mesh);
        if !self.optimise(&mut net, origins, Marks { stays: &[], tips: &now.tips }, rounds) {
            return now;
        }
        let (mesh, _) = net.into_mesh();
        let fit = self.measured.fit(&mesh);
        if fit.worst() <= self.farthest(now.fit) { Draft { mesh, fit, on_line: Vec::new(), ..now } } else { now }
    }

    /// The mesh optimised once more with the vertices on sharp lines held, and its faces fitted to the surface again, if
    /// that makes angles better and keeps near to it.
    pub(super) fn optimised_on_both_sides(&self, now: Draft, origins: &[LayoutOrigin]) -> Draft {
        let mut net = Net::from_mesh(&now.mesh);
        let before = mean_deviation_deg(&net);
        for v in 0..net.positions.len() {
            if now.on_line.get(v) != Some(&true) && !net.on_boundary(v as u32) {
                net.positions[v] = self.target.onto_surface(net.positions[v]);
            }
        }
        if !self.optimise(&mut net, origins, Marks { stays: &now.on_line, tips: &now.tips }, ROUNDS) {
            return now;
        }
        fit_surface(
            &mut net,
            self.measured.points(),
            (self.surface(), &self.target),
            FixedVertices::BoundaryAnd(&now.on_line),
        );
        let (mesh, Ok(())) = self.checked(&net) else { return now };
        let fit = self.measured.fit(&mesh);
        let is_better = mean_deviation_deg(&net) < before && fit.worst() <= self.farthest(now.fit);
        if is_better { Draft { mesh, fit, ..now } } else { now }
    }

    /// How far from the input a mesh may be that has better angles than one that lies so far from it.
    fn farthest(&self, fit: Fit) -> f64 {
        (LOSS * fit.worst()).max(MISS_MAX * self.scale.diagonal)
    }
}

#[cfg(test)]
mod tests {
    use super::super::net::tests::sheet;
    use super::super::{Input, Options, apart};
    use super::*;
    use crate::mesh::Vec3;
    use crate::mesh::tri::TriMesh;
    use crate::topology::tests::grid;

    const SIDE: usize = 20;

    /// A unit sheet of two segments, and which each of its triangles belongs to.
    fn halves() -> (TriMesh, Vec<u32>) {
        let surface = grid(32, 32, false, false);
        let middle = |t: &[u32; 3]| t.iter().map(|&v| surface.positions[v as usize].x).sum::<f64>() / 3.0;
        let owner = surface.triangles.iter().map(|t| u32::from(middle(t) > 0.5)).collect();
        (surface, owner)
    }

    fn stitching<'a>(surface: &'a TriMesh, owner: &'a [u32]) -> Stitching<'a> {
        Stitching::new(Input { surface, owner, count: 2 }, Options::default(), apart::scale(surface), u64::MAX)
    }

    /// A sheet of as many quads a side as told, its inner vertices moved.
    fn moved(by: impl Fn(Vec3) -> Vec3) -> Net {
        let mut net = sheet(SIDE as u32, SIDE as u32);
        for v in 0..net.positions.len() {
            let p = net.positions[v] / SIDE as f64;
            net.positions[v] = if net.on_boundary(v as u32) { p } else { by(p) };
        }
        net
    }

    fn at(x: usize, y: usize) -> usize {
        (SIDE + 1) * y + x
    }

    #[test]
    fn an_artists_inside_and_boundaries_stay_and_seams_and_layouts_of_nobody_go() {
        let (surface, owner) = halves();
        let stitching = stitching(&surface, &owner);
        let net = moved(|p| p);
        let (mut stays, mut tips) = (vec![false; net.positions.len()], vec![false; net.positions.len()]);
        (stays[at(15, 5)], tips[at(15, 6)]) = (true, true);
        let marks = Marks { stays: &stays, tips: &tips };
        let firm = |net: &Net, left| stitching.stiffness(net, &[left, LayoutOrigin::Generated], marks);
        let (held, free) = (f64::INFINITY, 0.0);
        let of = |firm: Vec<f64>| [at(3, 9), at(9, 9), at(15, 9), at(15, 0), at(15, 5), at(15, 6)].map(|v| firm[v]);
        assert_eq!(of(firm(&net, LayoutOrigin::Example)), [held, free, free, held, held, TIP_STIFFNESS]);
        assert_eq!(of(firm(&net, LayoutOrigin::Kept)), [held, free, free, held, held, TIP_STIFFNESS]);
        assert_eq!(of(firm(&net, LayoutOrigin::Generated)), [free, free, free, held, held, TIP_STIFFNESS]);
        // What is sheared inside an example goes the farther the more it is.
        let sheared = |by: f64| {
            let mut net = net.clone();
            (0..=SIDE).for_each(|y| net.positions[at(3, y)].y += by);
            firm(&net, LayoutOrigin::Example)[at(3, 9)]
        };
        let (some, more) = (sheared(0.02), sheared(0.03));
        assert!(some.is_finite() && more < some && sheared(0.06) == 0.0, "{some} {more}");
    }

    #[test]
    fn shear_across_a_seam_goes_and_neither_the_inside_of_a_kept_layout_nor_a_line() {
        let (surface, owner) = halves();
        let stitching = stitching(&surface, &owner);
        let (mesh, _) = moved(|p| p + Vec3::new(0.05 * (9.0 * p.y).sin(), 0.04 * (7.0 * p.x).cos(), 0.0)).into_mesh();
        let angle = |laid: &Draft| mean_deviation_deg(&Net::from_mesh(&laid.mesh));
        let mut on_line = vec![false; mesh.positions.len()];
        (0..=SIDE).for_each(|y| on_line[at(14, y)] = true);
        let now = Draft { fit: stitching.measured.fit(&mesh), mesh, tips: Vec::new(), on_line };
        let free = stitching.optimised(now.clone(), &[LayoutOrigin::Generated; 2], ROUNDS);
        assert!(angle(&free) < 0.1 * angle(&now), "{} to {}", angle(&now), angle(&free));
        let made = stitching.optimised_on_both_sides(now.clone(), &[LayoutOrigin::Kept, LayoutOrigin::Generated]);
        assert!(angle(&made) < 0.9 * angle(&now), "{} to {}", angle(&now), angle(&made));
        let gone = |v: usize| (made.mesh.positions[v] - now.mesh.positions[v]).norm();
        let goes = |x: usize| (1..SIDE).any(|y| gone(at(x, y)) > 1e-9);
        assert_eq!([3, 5, 9, 12, 14, 18].map(goes), [false, false, true, true, false, true]);
    }
}
