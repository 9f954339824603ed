//! Tips of one surface, with all that they are matched by with the tips of another.
//!
//! A query is matched with many examples, and an example with many queries: these values depend on one surface alone, and are
//! computed once.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::query::{PoleCache, Query};
use crate::encode::{Encoding, encode_to};
use crate::mesh::geodesic::Marcher;
use crate::topology::Topology;
use crate::unfold::Uv;
use crate::unfold::pole::Breadth;

/// Pixels a side of the pictures by which matches are compared.
pub const MATCH_SIDE: usize = 32;
/// Views that are kept, some 10 KiB each.
const VIEWS_MAX: usize = 64;

/// The tips of a surface's protrusions of some breadth.
#[derive(Debug)]
pub struct Tips {
    /// Vertices of the surface, most prominent first.
    pub vertices: Vec<u32>,
    /// Distances between tips along the surface, in √area; of a disc those to the boundary come last.
    pub between: Vec<Vec<f64>>,
    /// u of tip t in the chart with its lower pole at tip p and its upper at q, at p n² + q n + t for n tips.
    pub angles: Vec<f64>,
    views: PoleCache<Option<Arc<TipView>>>,
}

/// A surface unfolded about tips, coarsely.
#[derive(Debug)]
pub struct TipView {
    /// Its encoding, to [`MATCH_SIDE`].
    pub encoding: Encoding,
    uv: BTreeMap<u32, Uv>,
}

impl TipView {
    /// Where a tip lies; `None` for one that is a pole.
    pub fn place(&self, tip: u32) -> Option<Uv> {
        self.uv.get(&tip).copied()
    }
}

impl Tips {
    pub(super) fn new(side: &Query, breadth: Breadth) -> Self {
        let vertices = side.tips(breadth).to_vec();
        let (between, angles) = (distances_between(side, &vertices), angles_between(side, &vertices));
        Self { vertices, between, angles, views: PoleCache::default() }
    }

    /// The surface unfolded about tips; `None` where its poles are fixed. `side` is the one of which these are the tips.
    pub fn view(&self, side: &Query, poles: &[u32]) -> Option<Arc<TipView>> {
        self.views.get_or(poles, VIEWS_MAX, || {
            let chart = side.quick_chart(poles)?;
            let free = self.vertices.iter().filter(|&&tip| chart.poles.iter().all(|pole| pole.vertex != tip));
            let uv = free.map(|&tip| (tip, chart.uv[tip as usize])).collect();
            Some(Arc::new(TipView { encoding: encode_to(&chart, MATCH_SIDE), uv }))
        })
    }
}

fn angles_between(side: &Query, tips: &[u32]) -> Vec<f64> {
    let disc = side.encoding().topology == Topology::Disc;
    let mut all = Vec::with_capacity(tips.len().pow(3));
    for &p in tips {
        for &q in tips {
            let poles = if disc { vec![q] } else { vec![p, q] };
            all.extend(side.angles(&poles, tips).unwrap_or_else(|| vec![0.0; tips.len()]));
        }
    }
    all
}

fn distances_between(side: &Query, tips: &[u32]) -> Vec<Vec<f64>> {
    let mesh = side.unfolder().mesh();
    let marcher = Marcher::new(mesh);
    let scale = mesh.total_area().sqrt();
    let mut rows: Vec<Vec<f64>> = Vec::new();
    for &tip in tips {
        let d = marcher.distances(&[tip]);
        rows.push(tips.iter().map(|&x| d[x as usize] / scale).collect());
    }
    if side.encoding().topology == Topology::Disc {
        let rim: Vec<u32> =
            mesh.boundary_vertices().iter().enumerate().filter(|(_, on)| **on).map(|(v, _)| v as u32).collect();
        let d = marcher.distances(&rim);
        rows.iter_mut().zip(tips).for_each(|(row, &tip)| row.push(d[tip as usize] / scale));
        rows.push(tips.iter().map(|&tip| d[tip as usize] / scale).chain([0.0]).collect());
    }
    rows
}
