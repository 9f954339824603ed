//! A stitched mesh follows its input: its quads are made squarer, it is drawn out to what it passes over, and subdivided
//! until it lies close. *Ours, not the paper's.*

use super::check::check;
use super::crease;
use super::fit::Fit;
use super::net::Net;
use super::reach::draw_out;
use super::site::on_surface;
use super::square;
use super::stitching::{MISS_MAX, Stitching};
use super::straddle::{Held, straddle};
use super::subdivide::subdivide;
use super::{Closeness, Report};
use crate::mesh::{PolyMesh, Vec3};

/// Most quads that the whole is subdivided to, and times at most.
const WHOLE_QUADS_MAX: usize = 48_000;
const REFINED_MAX: usize = 3;
/// Share of the distance that may be left for it to be worth while.
const REFINED_GAIN: f64 = 0.95;
/// Rounds of making quads squarer, and by what factor the distance from the input may grow for it.
const SQUARE_ROUNDS: u32 = 40;
const SQUARE_LOSS: f64 = 1.15;
/// Distance that a point of the input may have for the result not to be drawn out to it, as a share of the diagonal.
const PASSED_MAX: f64 = 0.006;
/// Share of the mean distance from the input that may be left for drawing out to be worth while.
const DRAWN_GAIN: f64 = 0.97;
/// The same for faces on both sides.
const STRADDLED_GAIN: f64 = 0.98;
/// By how much the mean deviation from right angles may grow for sharp lines to be met, in degrees: with the distance from
/// the input at most this share of what it was without, and with this.
const CREASED_WORSE_DEG: [(f64, f64); 2] = [(0.97, 2.0), (1.02, 0.5)];
/// Rounds of making quads squarer between lines, and times.
const CREASED_ROUNDS: u32 = 6;
const CREASED_TIMES: usize = 4;

impl Stitching<'_> {
    /// With sheared quads squarer, unless that takes the result away from the input; `fit` is the mesh's, and what is
    /// returned beside the result is the result's.
    fn squared(&self, mesh: PolyMesh, fit: Fit, rounds: u32) -> (PolyMesh, Fit) {
        let mut net = Net::from_mesh(&mesh);
        let before = square::mean_deviation_deg(&net);
        square::square_up(&mut net, &self.target, rounds);
        let deviation = square::mean_deviation_deg(&net);
        let (squarer, _) = net.into_mesh();
        let is_better = deviation < before && check(&squarer, self.shape).is_ok();
        if !is_better {
            return (mesh, fit);
        }
        let after = self.measured.fit(&squarer);
        let most = (SQUARE_LOSS * fit.worst()).max(MISS_MAX * self.scale.diagonal);
        if after.worst() <= most { (squarer, after) } else { (mesh, fit) }
    }

    /// Drawn out and subdivided until it follows the input, if that is asked for and it misses it by more than `allowed`, a
    /// share of the diagonal; `kept` tells of each segment whether its part keeps its place.
    pub(super) fn followed(&self, mesh: PolyMesh, allowed: f64, kept: &[bool], report: &mut Report) -> PolyMesh {
        let fit = self.measured.fit(&mesh);
        let (mut mesh, mut fit) = self.squared(mesh, fit, SQUARE_ROUNDS);
        let most = MISS_MAX * self.scale.diagonal;
        let is_followed = self.options.closeness == Closeness::Followed && fit.worst() > allowed * self.scale.diagonal;
        if self.options.closeness == Closeness::Followed
            && let Some(drawn) = self.drawn(&mesh, fit)
        {
            (mesh, fit) = drawn;
        }
        (mesh, fit) = self.straddled(mesh, fit, kept);
        while is_followed
            && fit.worst() > most
            && report.refined < REFINED_MAX
            && 4 * mesh.faces.len() <= WHOLE_QUADS_MAX
        {
            let Some(finer) = self.finer(&mesh, fit) else { break };
            (mesh, fit) = finer;
            report.refined += 1;
            if let Some(drawn) = self.drawn(&mesh, fit) {
                (mesh, fit) = drawn;
            }
            (mesh, fit) = self.straddled(mesh, fit, kept);
        }
        if report.refined > 0 {
            (mesh, fit) = self.squared(mesh, fit, SQUARE_ROUNDS / 4);
            (mesh, fit) = self.straddled(mesh, fit, kept);
        }
        report.fit = fit;
        mesh
    }

    /// Subdivided once; `None` where that does not bring it nearer to the input.
    fn finer(&self, mesh: &PolyMesh, fit: Fit) -> Option<(PolyMesh, Fit)> {
        let net = Net::from_mesh(mesh);
        let mut fine = on_surface(subdivide(&net), 0, &self.target);
        // What is put on the input may be folded flat there.
        self.open_flat_faces(&mut fine);
        self.judged(fine.into_mesh().0, REFINED_GAIN * fit.worst())
    }

    /// With its faces on both sides of the input, if that brings it nearer, and with edges on the input's sharp lines, if
    /// that is hardly worse.
    fn straddled(&self, mesh: PolyMesh, fit: Fit, kept: &[bool]) -> (PolyMesh, Fit) {
        if self.options.closeness != Closeness::Followed {
            return (mesh, fit);
        }
        let creased = self.creased(&mesh, kept);
        let plain = self.on_both_sides(mesh, fit, Held::Boundary);
        let Some((net, on_line)) = creased else { return plain };
        let Some((mesh, fit)) = self.judged(net.into_mesh().0, f64::INFINITY) else { return plain };
        let creased = self.on_both_sides(mesh, fit, Held::BoundaryAnd(&on_line));
        let angle = |mesh: &PolyMesh| square::mean_deviation_deg(&Net::from_mesh(mesh));
        let worse_deg = angle(&creased.0) - angle(&plain.0);
        let is_good = CREASED_WORSE_DEG
            .iter()
            .any(|&(share, deg)| creased.1.worst() <= share * plain.1.worst() && worse_deg <= deg);
        if is_good { creased } else { plain }
    }

    fn on_both_sides(&self, mesh: PolyMesh, fit: Fit, held: Held<'_>) -> (PolyMesh, Fit) {
        let mut net = Net::from_mesh(&mesh);
        straddle(&mut net, self.measured.points(), &self.target, held);
        self.judged(net.into_mesh().0, STRADDLED_GAIN * fit.worst()).unwrap_or((mesh, fit))
    }

    /// With edges on the input's sharp lines, and which vertices lie there; `None` where there are none.
    fn creased(&self, mesh: &PolyMesh, kept: &[bool]) -> Option<(Net, Vec<bool>)> {
        let mut net = Net::from_mesh(mesh);
        let is_kept = |p: Vec3| self.segment_at(p).and_then(|s| kept.get(s)) == Some(&true);
        let stays: Vec<bool> = mesh.positions.iter().map(|&p| kept.contains(&true) && is_kept(p)).collect();
        let stays = |v: u32| stays[v as usize];
        let snapped = crease::snap(&mut net, self.surface(), self.sharp_edges(), &self.target, &stays);
        if snapped.met <= 0.0 {
            return None;
        }
        for _ in 0..CREASED_TIMES {
            let old = net.positions.clone();
            let before = square::mean_deviation_deg(&net);
            square::square_up(&mut net, &self.target, CREASED_ROUNDS);
            for (v, p) in old.iter().enumerate().filter(|(v, _)| snapped.on_line[*v] || stays(*v as u32)) {
                net.positions[v] = *p;
            }
            let is_better =
                square::mean_deviation_deg(&net) < before && check(&net.clone().into_mesh().0, self.shape).is_ok();
            if !is_better {
                net.positions = old;
                break;
            }
        }
        Some((net, snapped.on_line))
    }

    /// Drawn out to what it passes over; `None` where that does not bring it nearer to the input.
    fn drawn(&self, mesh: &PolyMesh, fit: Fit) -> Option<(PolyMesh, Fit)> {
        let mut net = Net::from_mesh(mesh);
        if draw_out(&mut net, self.measured.points(), &self.target, PASSED_MAX * self.scale.diagonal) == 0 {
            return None;
        }
        let (drawn, fit) = self.judged(net.into_mesh().0, DRAWN_GAIN * fit.worst())?;
        Some(self.squared(drawn, fit, SQUARE_ROUNDS / 2))
    }

    /// A mesh that holds, with its distances, if the worse of them is at most so much.
    fn judged(&self, mesh: PolyMesh, most: f64) -> Option<(PolyMesh, Fit)> {
        check(&mesh, self.shape).ok()?;
        let fit = self.measured.fit(&mesh);
        (fit.worst() <= most).then_some((mesh, fit))
    }
}
