//! Brings a stitched mesh close to its input: optimises it, moves vertices to regions that it does not cover, subdivides it
//! until it lies close, and lays anew what was crumpled by that. *Ours, not the paper's.*

use super::check::check;
use super::cover::cover;
use super::crease;
use super::fit::Fit;
use super::fit_surface::{FixedVertices, fit_surface};
use super::net::Net;
use super::placement::{Draft, LayoutOrigin, Marks};
use super::reembed::reembed;
use super::site::{LayoutKind, Site, on_surface};
use super::square;
use super::stitching::{KEPT_MISS_MAX, MISS_MAX, Stitching};
use super::subdivide::subdivide;
use super::{Closeness, Report};
use crate::mesh::{PolyMesh, Vec3};
use crate::numerics::side_by_side;
use crate::numerics::stage::Stage;

/// Most quads that the whole is subdivided to, and times at most.
pub(super) const WHOLE_QUADS_MAX: usize = 48_000;
const REFINED_MAX: usize = 3;
/// Share of the distance that may be left for it to be worth four times the quads.
const REFINED_GAIN: f64 = 0.7;
/// Rounds of optimisation of a stitched mesh; half of them after it was moved to cover the input, or subdivided.
const OPTIMISE_ROUNDS: u32 = 60;
/// Distance up to which a point of the input counts as covered, as a share of the diagonal.
pub(super) const UNCOVERED_MAX: f64 = 0.006;
/// Share of the mean distance from the input that may be left for covering to be worth while.
const COVER_GAIN: f64 = 0.97;
/// The same for fitting faces to the surface.
const FIT_SURFACE_GAIN: f64 = 0.98;
/// By how much the mean deviation from right angles may grow for sharp lines to be met, in degrees: with the distance from
/// the input at most this share of what it was without, and with this.
const CREASED_WORSE_DEG: [(f64, f64); 2] = [(0.97, 4.0), (1.02, 1.0)];
/// Rounds of optimisation between sharp lines.
const CREASED_ROUNDS: u32 = 30;

/// A stitched mesh that was moved near its input, with what is known of its segments.
pub(super) struct NearMesh {
    /// The mesh.
    pub(super) laid: Draft,
    /// Where each segment's layout comes from.
    origins: Vec<LayoutOrigin>,
    /// Whether it missed the input by more than it may before it was moved to cover it.
    pub(super) is_missed: bool,
}

impl Stitching<'_> {
    /// What is stitched, [near](Self::near) its input.
    pub(super) fn stitched_near(&self, mesh: PolyMesh, sites: &[Site<'_>]) -> NearMesh {
        self.near(mesh, sites.iter().map(LayoutOrigin::of).collect(), self.allowed(sites))
    }

    /// The mesh optimised, and moved to cover the input if it is to follow it; `allowed` is by how much it may miss it.
    pub(super) fn near(&self, mesh: PolyMesh, origins: Vec<LayoutOrigin>, allowed: f64) -> NearMesh {
        let fit = self.measured.fit(&mesh);
        let laid =
            self.optimised(Draft { mesh, fit, tips: Vec::new(), on_line: Vec::new() }, &origins, OPTIMISE_ROUNDS);
        if self.options.closeness != Closeness::Followed || self.is_late() {
            return NearMesh { laid, origins, is_missed: false };
        }
        let is_missed = laid.fit.worst() > allowed;
        NearMesh { laid: self.nearer(laid, &origins), origins, is_missed }
    }

    /// By how much what stands on the segments may miss the input.
    fn allowed(&self, sites: &[Site<'_>]) -> f64 {
        let share = match sites {
            _ if sites.iter().any(Site::is_kept) => f64::INFINITY,
            [site] if site.stands == LayoutKind::Part => KEPT_MISS_MAX,
            _ => MISS_MAX,
        };
        share * self.scale.diagonal
    }

    /// Subdivided until it follows the input, if that is asked for and it misses it.
    pub(super) fn followed(&self, near: NearMesh, report: &mut Report) -> PolyMesh {
        let (mut now, origins) = (near.laid, &near.origins[..]);
        if self.options.closeness == Closeness::Followed && !self.is_late() {
            while near.is_missed
                && !self.is_late()
                && now.fit.worst() > MISS_MAX * self.scale.diagonal
                && report.refined < REFINED_MAX
                && 4 * now.mesh.faces.len() <= WHOLE_QUADS_MAX
            {
                let Some(finer) = self.finer(&now) else { break };
                report.refined += 1;
                now = self.nearer(finer, origins);
            }
            if report.refined > 0 {
                now = self.optimised(now, origins, OPTIMISE_ROUNDS / 2);
                now = self.fitted_to_surface(now, origins);
            }
            now = self.optimised_on_both_sides(now, origins);
            now = self.reembedded(now, origins);
        }
        report.fit = now.fit;
        now.mesh
    }

    /// The mesh moved to cover the input, with its faces fitted to the surface.
    fn nearer(&self, now: Draft, origins: &[LayoutOrigin]) -> Draft {
        let covering = self.covering(&now, origins);
        self.fitted_to_surface(covering.unwrap_or(now), origins)
    }

    /// Subdivided once; `None` where that does not bring it nearer to the input.
    fn finer(&self, now: &Draft) -> Option<Draft> {
        let net = Net::from_mesh(&now.mesh);
        let mut fine = on_surface(subdivide(&net), 0, &self.target);
        // What is put on the input may be folded flat there.
        self.open_flat_faces(&mut fine);
        let (mesh, fit) = self.judged(fine.into_mesh().0, REFINED_GAIN * now.fit.worst())?;
        Some(Draft { mesh, fit, tips: now.tips.clone(), on_line: Vec::new() })
    }

    /// With its faces on both sides of the input, if that brings it nearer, and with edges on the input's sharp lines, if
    /// that is hardly worse.
    fn fitted_to_surface(&self, now: Draft, origins: &[LayoutOrigin]) -> Draft {
        let (plain, creased) = side_by_side(
            || self.on_both_sides(now.mesh.clone(), now.fit),
            || {
                let (net, on_line) = self.creased(&now, origins)?;
                let (mesh, fit) = self.judged(net.into_mesh().0, f64::INFINITY)?;
                Some((self.on_both_sides(mesh, fit), on_line))
            },
        );
        let plain = Draft { mesh: plain.0, fit: plain.1, tips: now.tips, on_line: Vec::new() };
        let Some(((mesh, fit), on_line)) = creased else { return plain };
        let angle = |mesh: &PolyMesh| square::mean_deviation_deg(&Net::from_mesh(mesh));
        let worse_deg = angle(&mesh) - angle(&plain.mesh);
        let is_good =
            CREASED_WORSE_DEG.iter().any(|&(share, deg)| fit.worst() <= share * plain.fit.worst() && worse_deg <= deg);
        if is_good { Draft { mesh, fit, on_line, ..plain } } else { plain }
    }

    fn on_both_sides(&self, mesh: PolyMesh, fit: Fit) -> (PolyMesh, Fit) {
        if !Stage::FitSurface.is_on() {
            return (mesh, fit);
        }
        let mut net = Net::from_mesh(&mesh);
        fit_surface(&mut net, self.measured.points(), (self.surface(), &self.target), FixedVertices::Boundary);
        self.judged(net.into_mesh().0, FIT_SURFACE_GAIN * fit.worst()).unwrap_or((mesh, fit))
    }

    /// With edges on the input's sharp lines, and which vertices lie there; `None` where there are none.
    fn creased(&self, now: &Draft, origins: &[LayoutOrigin]) -> Option<(Net, Vec<bool>)> {
        if !Stage::Crease.is_on() {
            return None;
        }
        let mut net = Net::from_mesh(&now.mesh);
        let stays: Vec<bool> = net.positions.iter().map(|&p| self.is_kept(p, origins)).collect();
        let snapped =
            crease::snap(&mut net, self.surface(), self.sharp_edges(), &self.target, &|v: u32| stays[v as usize]);
        if snapped.met <= 0.0 {
            return None;
        }
        self.optimise(&mut net, origins, Marks { stays: &snapped.on_line, tips: &now.tips }, CREASED_ROUNDS);
        Some((net, snapped.on_line))
    }

    /// The mesh moved to regions that it does not cover; `None` where that does not bring it nearer to the input.
    fn covering(&self, now: &Draft, origins: &[LayoutOrigin]) -> Option<Draft> {
        if !Stage::Cover.is_on() {
            return None;
        }
        let mut net = Net::from_mesh(&now.mesh);
        let tips = cover(&mut net, self.measured.points(), &self.target, UNCOVERED_MAX * self.scale.diagonal);
        if !tips.contains(&true) {
            return None;
        }
        // The neighbours of what was moved were put on the nearest places of the input.
        self.reembed(&mut net, origins);
        let (mesh, fit) = self.judged(net.into_mesh().0, COVER_GAIN * now.fit.worst())?;
        Some(self.optimised(Draft { mesh, fit, tips, on_line: Vec::new() }, origins, OPTIMISE_ROUNDS / 2))
    }

    /// Tells whether a layout that is kept lies nearest to a point.
    fn is_kept(&self, p: Vec3, origins: &[LayoutOrigin]) -> bool {
        let is_kept = |s: usize| origins.get(s) == Some(&LayoutOrigin::Kept);
        origins.contains(&LayoutOrigin::Kept) && self.segment_at(p).is_some_and(is_kept)
    }

    fn reembed(&self, net: &mut Net, origins: &[LayoutOrigin]) {
        if self.is_late() || !Stage::Reembed.is_on() {
            return;
        }
        let passed = UNCOVERED_MAX * self.scale.diagonal;
        let stays = |p: Vec3| self.is_kept(p, origins);
        reembed(net, self.measured.points(), (self.surface(), &self.target), passed, &stays);
    }

    /// The mesh with its crumpled regions laid anew.
    fn reembedded(&self, now: Draft, origins: &[LayoutOrigin]) -> Draft {
        let mut net = Net::from_mesh(&now.mesh);
        self.reembed(&mut net, origins);
        match self.judged(net.into_mesh().0, f64::INFINITY) {
            Some((mesh, fit)) => Draft { mesh, fit, ..now },
            None => now,
        }
    }

    /// A mesh that holds, with its distances, if the worse of them is at most so much.
    fn judged(&self, mesh: PolyMesh, most: f64) -> Option<(PolyMesh, Fit)> {
        check(&mesh, self.shape).ok()?;
        let fit = self.measured.fit(&mesh);
        (fit.worst() <= most).then_some((mesh, fit))
    }
}
