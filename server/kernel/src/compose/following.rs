//! A stitched mesh follows its input: its quads are made squarer, it is drawn out to what it passes over, and subdivided
//! until it lies close. *Ours, not the paper's.*

use super::check::check;
use super::fit::Fit;
use super::net::Net;
use super::reach::draw_out;
use super::site::on_surface;
use super::square;
use super::stitching::{MISS_MAX, Stitching};
use super::straddle::{Held, straddle};
use super::subdivide::subdivide;
use super::{Closeness, Report};
use crate::mesh::PolyMesh;

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
    /// share of the diagonal.
    pub(super) fn followed(&self, mesh: PolyMesh, allowed: f64, report: &mut Report) -> PolyMesh {
        let fit = self.measured.fit(&mesh);
        let (mut mesh, mut fit) = self.squared(mesh, fit, SQUARE_ROUNDS);
        let most = MISS_MAX * self.scale.diagonal;
        let is_followed = self.options.closeness == Closeness::Followed && fit.worst() > allowed * self.scale.diagonal;
        if self.options.closeness == Closeness::Followed
            && let Some(drawn) = self.drawn(&mesh, fit)
        {
            (mesh, fit) = drawn;
        }
        (mesh, fit) = self.straddled(mesh, fit);
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
            (mesh, fit) = self.straddled(mesh, fit);
        }
        if report.refined > 0 {
            (mesh, fit) = self.squared(mesh, fit, SQUARE_ROUNDS / 4);
            (mesh, fit) = self.straddled(mesh, fit);
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

    /// With its faces on both sides of the input, if that brings it nearer.
    fn straddled(&self, mesh: PolyMesh, fit: Fit) -> (PolyMesh, Fit) {
        if self.options.closeness != Closeness::Followed {
            return (mesh, fit);
        }
        let mut net = Net::from_mesh(&mesh);
        straddle(&mut net, self.measured.points(), &self.target, Held::Boundary);
        self.judged(net.into_mesh().0, STRADDLED_GAIN * fit.worst()).unwrap_or((mesh, fit))
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
