//! How dense what stands on the segments is to be, settled before anything is stitched.
//!
//! With h₀ the edge of a whole of regular layouts and h_s = √(A_s/F_s) that of the part on segment s: a part with
//! h_s < 0.3h₀ that is much finer than the others gives way to a regular layout, as else its neighbours would be
//! subdivided to meet it; parts are subdivided while the whole misses the input, each of which that helps; then
//! those with h_s > 3h₀, as long as the whole stays within bounds; at last those with far fewer edges on a seam than
//! the part beyond it, if that costs few quads. What misses its segment by far, and is not helped, gives way. Parts are
//! judged with their faces fitted to the surface ([`fit_surface`]), as the result will have them.
//! *Ours, not the paper's.*

use super::fit::MeasuredSurface;
use super::fit_surface::{FixedVertices, fit_surface};
use super::layout::Arc;
use super::site::{LayoutKind, ReplacementReason, Site};
use super::stitching::{KEPT_MISS_MAX, MISS_MAX, Stitching, border_edge};
use super::{Closeness, REGULAR_QUADS};
use std::collections::BTreeMap;

/// Edges of a regular layout lie within this factor of those of a whole of [`REGULAR_QUADS`].
const EDGE_RANGE: [f64; 2] = [1.0, 1.3];
/// Times that a part is subdivided for its density.
const TIMES_MAX: usize = 2;
/// Share of its miss that may be left for subdividing a part to help.
const HELPS: f64 = 0.7;
/// Share of what may be missed on average that regular layouts are taken to miss.
const REGULAR_MISS: f64 = 0.3;
/// A part that misses its segment by more than this share of the diagonal, and is not helped, gives way.
const MISSED_MAX: f64 = 0.005;
/// A part with edges shorter than this share of a whole's, and of the mean of all parts, is out of proportion.
const TOO_DENSE: f64 = 0.3;
/// A part with edges longer than this many of a whole's is subdivided, while the whole has at most so many times the
/// quads of one of regular layouts.
const TOO_COARSE: f64 = 3.0;
const WHOLE_MAX: f64 = 1.5;
/// A part with this many times fewer edges on a seam than the part beside it is subdivided.
const RATIO_MAX: f64 = 3.0;
/// Quads more for each edge fewer of that difference, at most: each makes a vertex extraordinary where it is bridged.
const QUADS_PER_EDGE: usize = 40;

/// A segment on which a part stands that may be subdivided.
struct RefinedPart {
    measured: MeasuredSurface,
    /// Mean distance between the part and the segment.
    miss: f64,
    /// Whether subdividing has not helped.
    is_stuck: bool,
}

fn may_refine(site: &Site<'_>) -> bool {
    site.stands == LayoutKind::Part && !site.is_kept() && site.times < TIMES_MAX && !site.has_most_quads()
}

impl Stitching<'_> {
    /// Subdivides parts, and gives up those out of proportion.
    pub(super) fn settle_density(&self, sites: &mut [Site<'_>]) {
        let areas: Vec<f64> = sites.iter().map(|site| site.surface(self.surface()).total_area()).collect();
        if self.options.closeness == Closeness::Followed {
            self.give_up_too_dense(sites, &areas);
            self.refine_where_it_helps(sites, &areas);
            self.refine_coarse(sites, &areas);
        }
        while let Some(s) = self.coarsest_beside_finer(sites) {
            sites[s].refine(&self.target);
        }
        let edges = self.edges_beside(sites);
        sites.iter_mut().zip(edges).for_each(|(site, edge)| site.wish.edge = edge);
    }

    /// The edge of a whole of regular layouts.
    pub(super) fn whole_edge(&self) -> f64 {
        (self.scale.area / REGULAR_QUADS).sqrt() * self.options.edge_scale
    }

    /// For each segment the length of the edges of a regular layout: the mean of those on the boundaries of the parts
    /// beside it, within bounds.
    fn edges_beside(&self, sites: &[Site<'_>]) -> Vec<f64> {
        let overall = self.whole_edge();
        let border = |site: &Site<'_>| if site.stands == LayoutKind::Part { border_edge(&site.net) } else { None };
        let border: Vec<Option<f64>> = sites.iter().map(border).collect();
        (0..sites.len() as u32)
            .map(|segment| {
                let other = |arc: &Arc| match arc.sides[..] {
                    [[a, ..], [b, ..]] if a == segment => border[b as usize],
                    [[a, ..], [b, ..]] if b == segment => border[a as usize],
                    _ => None,
                };
                let beside: Vec<f64> = self.layout.arcs.iter().filter_map(other).collect();
                let mean = beside.iter().sum::<f64>() / beside.len() as f64;
                if beside.is_empty() { overall } else { mean.clamp(EDGE_RANGE[0] * overall, EDGE_RANGE[1] * overall) }
            })
            .collect()
    }

    fn give_up_too_dense(&self, sites: &mut [Site<'_>], areas: &[f64]) {
        let edge = |s: usize| (areas[s] / sites[s].net.faces().count().max(1) as f64).sqrt();
        let parts = || (0..sites.len()).filter(|&s| sites[s].stands == LayoutKind::Part);
        let area: f64 = parts().map(|s| areas[s]).sum();
        let mean = (parts().map(|s| areas[s] * edge(s).max(f64::MIN_POSITIVE).ln()).sum::<f64>() / area).exp();
        let least = TOO_DENSE * mean.min(self.whole_edge());
        let dense: Vec<usize> = parts().filter(|&s| !sites[s].is_kept() && edge(s) < least).collect();
        // Where all stands alone nothing is in proportion or out of it.
        if sites.len() > 1 {
            for s in dense {
                sites[s].give_up(self.surface(), ReplacementReason::TooDense);
            }
        }
    }

    /// While the whole misses by more than is allowed on average over the area, that part is subdivided next whose faces
    /// miss most: Σ A_s m_s > m Σ A_s, and A_s m_s/F_s is the largest.
    fn refine_where_it_helps(&self, sites: &mut [Site<'_>], areas: &[f64]) {
        let most = if matches!(sites, [_]) { KEPT_MISS_MAX } else { MISS_MAX } * self.scale.diagonal;
        let mut grounds: Vec<Option<RefinedPart>> = sites
            .iter()
            .map(|site| {
                let is_asked = site.stands == LayoutKind::Part && !site.is_kept();
                let measured = is_asked.then(|| MeasuredSurface::new(&site.surface(self.surface())))?;
                let miss = self.missed(site, &measured);
                Some(RefinedPart { measured, miss, is_stuck: false })
            })
            .collect();
        let regular: f64 =
            sites.iter().zip(areas).filter(|(site, _)| site.stands == LayoutKind::Regular).map(|s| s.1).sum();
        let others = (REGULAR_MISS * most * regular, regular);
        loop {
            let asked = grounds.iter().zip(areas).filter_map(|(ground, area)| Some((ground.as_ref()?.miss, area)));
            let (missed, area) = asked.fold(others, |(m, a), (miss, area)| (m + area * miss, a + area));
            if missed <= most * area {
                break;
            }
            let worth = |s: usize| {
                let of_it = grounds[s].as_ref().filter(|g| !g.is_stuck && g.miss > most && may_refine(&sites[s]))?;
                Some((areas[s] * of_it.miss / sites[s].net.faces().count().max(1) as f64, s))
            };
            let next = (0..sites.len()).filter_map(worth).max_by(|a, b| a.0.total_cmp(&b.0));
            let Some(next) = next.map(|n| n.1) else { break };
            sites[next].refine(&self.target);
            let Some(ground) = &mut grounds[next] else { break };
            let miss = self.missed(&sites[next], &ground.measured);
            ground.is_stuck = miss > HELPS * ground.miss;
            ground.miss = miss;
        }
        let passes = |g: &Option<RefinedPart>| g.as_ref().is_some_and(|g| g.miss > MISSED_MAX * self.scale.diagonal);
        if sites.len() > 1 {
            for (site, _) in sites.iter_mut().zip(&grounds).filter(|(_, ground)| passes(ground)) {
                site.give_up(self.surface(), ReplacementReason::Missing);
            }
        }
    }

    fn missed(&self, site: &Site<'_>, measured: &MeasuredSurface) -> f64 {
        let mut net = site.net.clone();
        fit_surface(&mut net, measured.points(), (self.surface(), &self.target), FixedVertices::Nothing);
        measured.fit(&net.into_mesh().0).worst()
    }

    /// Subdivides the parts with the longest edges, where there are several parts.
    fn refine_coarse(&self, sites: &mut [Site<'_>], areas: &[f64]) {
        let whole = self.whole_edge();
        while sites.len() > 1 {
            let faces = |s: usize| sites[s].net.faces().count();
            let quads = |s: usize| match sites[s].stands {
                LayoutKind::Regular => areas[s] / (whole * whole),
                LayoutKind::Part | LayoutKind::Own => faces(s) as f64,
            };
            let total: f64 = (0..sites.len()).map(quads).sum();
            let fits = |s: &usize| {
                may_refine(&sites[*s])
                    && total + 3.0 * faces(*s) as f64 <= WHOLE_MAX * REGULAR_QUADS / self.options.edge_scale.powi(2)
            };
            let edge = |s: usize| (areas[s] / faces(s).max(1) as f64).sqrt();
            let coarse = (0..sites.len()).filter(fits).map(|s| (edge(s), s)).filter(|e| e.0 > TOO_COARSE * whole);
            let Some((_, next)) = coarse.max_by(|a, b| a.0.total_cmp(&b.0)) else { break };
            sites[next].refine(&self.target);
        }
    }

    /// The part that has the fewest edges on its seam with another part for those of the other, if they are too few.
    fn coarsest_beside_finer(&self, sites: &[Site<'_>]) -> Option<usize> {
        let found = self.given_rims(sites).ok()?;
        let edges = |&[s, l, r]: &[u32; 3]| found[s as usize].get(l as usize).map(|rim| rim.run_edges(r as usize));
        // All arcs between two parts together: on a short one an edge more or less is nothing.
        let mut seams: BTreeMap<(u32, u32), (usize, usize)> = BTreeMap::new();
        for arc in &self.layout.arcs {
            let [x, y] = &arc.sides[..] else { continue };
            let (Some(n), Some(m)) = (edges(x), edges(y)) else { continue };
            let ((s, n), (t, m)) = if x[0] < y[0] { ((x[0], n), (y[0], m)) } else { ((y[0], m), (x[0], n)) };
            let seam = seams.entry((s, t)).or_default();
            *seam = (seam.0 + n, seam.1 + m);
        }
        let ratio = |((s, t), (n, m)): ((u32, u32), (usize, usize))| {
            let (coarse, few, many) = if n < m { (s as usize, n, m) } else { (t as usize, m, n) };
            let site = &sites[coarse];
            let pays = 3 * site.net.faces().count() <= QUADS_PER_EDGE * (many - few);
            let ratio = many as f64 / few.max(1) as f64;
            (ratio > RATIO_MAX && pays && may_refine(site)).then_some((ratio, coarse))
        };
        seams.into_iter().filter_map(ratio).max_by(|a, b| a.0.total_cmp(&b.0)).map(|worst| worst.1)
    }
}
