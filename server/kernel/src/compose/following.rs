//! A stitched mesh follows its input: it comes to rest, is drawn out to what it passes over, and subdivided
//! until it lies close. *Ours, not the paper's.*

use super::check::check;
use super::crease;
use super::fit::Fit;
use super::net::Net;
use super::reach::draw_out;
use super::resting::{Laid, Marks, Whose};
use super::site::{Site, Use, on_surface};
use super::square;
use super::stitching::{KEPT_MISS_MAX, MISS_MAX, Stitching};
use super::straddle::{Held, straddle};
use super::subdivide::subdivide;
use super::{Closeness, Report};
use crate::mesh::{PolyMesh, Vec3};

/// Most quads that the whole is subdivided to, and times at most.
const WHOLE_QUADS_MAX: usize = 48_000;
const REFINED_MAX: usize = 3;
/// Share of the distance that may be left for it to be worth four times the quads.
const REFINED_GAIN: f64 = 0.7;
/// Rounds in which what is stitched comes to rest; half of them what was drawn out or subdivided.
const REST_ROUNDS: u32 = 60;
/// Distance that a point of the input may have for the result not to be drawn out to it, as a share of the diagonal.
pub(super) const PASSED_MAX: f64 = 0.006;
/// Share of the mean distance from the input that may be left for drawing out to be worth while.
const DRAWN_GAIN: f64 = 0.97;
/// The same for faces on both sides.
const STRADDLED_GAIN: f64 = 0.98;
/// By how much the mean deviation from right angles may grow for sharp lines to be met, in degrees: with the distance from
/// the input at most this share of what it was without, and with this.
const CREASED_WORSE_DEG: [(f64, f64); 2] = [(0.97, 4.0), (1.02, 1.0)];
/// Rounds in which what is between lines comes to rest.
const CREASED_ROUNDS: u32 = 30;

/// A stitched mesh near its input.
pub(super) struct Near {
    /// The mesh.
    pub(super) laid: Laid,
    /// Of each segment whose layout stands there.
    whose: Vec<Whose>,
    /// Whether it missed the input by more than it may before it was drawn out.
    pub(super) is_missed: bool,
}

impl Stitching<'_> {
    /// At rest, and drawn out to what it passes over if it is to follow the input.
    pub(super) fn near(&self, mesh: PolyMesh, sites: &[Site<'_>]) -> Near {
        let whose: Vec<Whose> = sites.iter().map(Whose::of).collect();
        let fit = self.measured.fit(&mesh);
        let laid = self.rested(Laid { mesh, fit, tips: Vec::new(), on_line: Vec::new() }, &whose, REST_ROUNDS);
        if self.options.closeness != Closeness::Followed || self.is_late() {
            return Near { laid, whose, is_missed: false };
        }
        let is_missed = laid.fit.worst() > self.allowed(sites);
        Near { laid: self.nearer(laid, &whose), whose, is_missed }
    }

    /// By how much what stands on the segments may miss the input.
    fn allowed(&self, sites: &[Site<'_>]) -> f64 {
        let share = match sites {
            _ if sites.iter().any(Site::is_kept) => f64::INFINITY,
            [site] if site.stands == Use::Part => KEPT_MISS_MAX,
            _ => MISS_MAX,
        };
        share * self.scale.diagonal
    }

    /// Subdivided until it follows the input, if that is asked for and it misses it.
    pub(super) fn followed(&self, near: Near, report: &mut Report) -> PolyMesh {
        let (mut now, whose) = (near.laid, &near.whose[..]);
        if self.options.closeness == Closeness::Followed && !self.is_late() {
            while near.is_missed
                && !self.is_late()
                && now.fit.worst() > MISS_MAX * self.scale.diagonal
                && report.refined < REFINED_MAX
                && 4 * now.mesh.faces.len() <= WHOLE_QUADS_MAX
            {
                let Some(finer) = self.finer(&now) else { break };
                report.refined += 1;
                now = self.nearer(finer, whose);
            }
            if report.refined > 0 {
                now = self.rested(now, whose, REST_ROUNDS / 2);
                now = self.straddled(now, whose);
            }
            now = self.at_rest_on_both_sides(now, whose);
        }
        report.fit = now.fit;
        now.mesh
    }

    /// Drawn out, and with its faces on both sides.
    fn nearer(&self, now: Laid, whose: &[Whose]) -> Laid {
        let drawn = self.drawn(&now, whose);
        self.straddled(drawn.unwrap_or(now), whose)
    }

    /// Subdivided once; `None` where that does not bring it nearer to the input.
    fn finer(&self, now: &Laid) -> Option<Laid> {
        let net = Net::from_mesh(&now.mesh);
        let mut fine = on_surface(subdivide(&net), 0, &self.target);
        // What is put on the input may be folded flat there.
        self.open_flat_faces(&mut fine);
        let (mesh, fit) = self.judged(fine.into_mesh().0, REFINED_GAIN * now.fit.worst())?;
        Some(Laid { mesh, fit, tips: now.tips.clone(), on_line: Vec::new() })
    }

    /// With its faces on both sides of the input, if that brings it nearer, and with edges on the input's sharp lines, if
    /// that is hardly worse.
    fn straddled(&self, now: Laid, whose: &[Whose]) -> Laid {
        let creased = self.creased(&now, whose);
        let (mesh, fit) = self.on_both_sides(now.mesh, now.fit, Held::Boundary);
        let plain = Laid { mesh, fit, tips: now.tips, on_line: Vec::new() };
        let Some((net, on_line)) = creased else { return plain };
        let Some((mesh, fit)) = self.judged(net.into_mesh().0, f64::INFINITY) else { return plain };
        let (mesh, fit) = self.on_both_sides(mesh, fit, Held::BoundaryAnd(&on_line));
        let angle = |mesh: &PolyMesh| square::mean_deviation_deg(&Net::from_mesh(mesh));
        let worse_deg = angle(&mesh) - angle(&plain.mesh);
        let is_good =
            CREASED_WORSE_DEG.iter().any(|&(share, deg)| fit.worst() <= share * plain.fit.worst() && worse_deg <= deg);
        if is_good { Laid { mesh, fit, on_line, ..plain } } else { plain }
    }

    fn on_both_sides(&self, mesh: PolyMesh, fit: Fit, held: Held<'_>) -> (PolyMesh, Fit) {
        let mut net = Net::from_mesh(&mesh);
        straddle(&mut net, self.measured.points(), &self.target, held);
        self.judged(net.into_mesh().0, STRADDLED_GAIN * fit.worst()).unwrap_or((mesh, fit))
    }

    /// With edges on the input's sharp lines, and which vertices lie there; `None` where there are none.
    fn creased(&self, now: &Laid, whose: &[Whose]) -> Option<(Net, Vec<bool>)> {
        let mut net = Net::from_mesh(&now.mesh);
        let is_kept = |p: Vec3| self.segment_at(p).and_then(|s| whose.get(s)) == Some(&Whose::Kept);
        let stays: Vec<bool> = net.positions.iter().map(|&p| whose.contains(&Whose::Kept) && is_kept(p)).collect();
        let snapped =
            crease::snap(&mut net, self.surface(), self.sharp_edges(), &self.target, &|v: u32| stays[v as usize]);
        if snapped.met <= 0.0 {
            return None;
        }
        self.rest(&mut net, whose, Marks { stays: &snapped.on_line, tips: &now.tips }, CREASED_ROUNDS);
        Some((net, snapped.on_line))
    }

    /// Drawn out to what it passes over; `None` where that does not bring it nearer to the input.
    fn drawn(&self, now: &Laid, whose: &[Whose]) -> Option<Laid> {
        let mut net = Net::from_mesh(&now.mesh);
        let tips = draw_out(&mut net, self.measured.points(), &self.target, PASSED_MAX * self.scale.diagonal);
        if !tips.contains(&true) {
            return None;
        }
        let (mesh, fit) = self.judged(net.into_mesh().0, DRAWN_GAIN * now.fit.worst())?;
        Some(self.rested(Laid { mesh, fit, tips, on_line: Vec::new() }, whose, REST_ROUNDS / 2))
    }

    /// A mesh that holds, with its distances, if the worse of them is at most so much.
    fn judged(&self, mesh: PolyMesh, most: f64) -> Option<(PolyMesh, Fit)> {
        check(&mesh, self.shape).ok()?;
        let fit = self.measured.fit(&mesh);
        (fit.worst() <= most).then_some((mesh, fit))
    }
}
