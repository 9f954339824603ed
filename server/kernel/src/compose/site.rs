//! Tells what stands on a segment: a mapped example, a regular layout, or the segment's own triangles as quads; and what
//! takes its place where it doesn't fit its neighbours.
//!
//! An example is subdivided first, then a regular layout is taken, at first as dense as the neighbours, then finer, at
//! last the segment's own triangles. The other segments keep what they have. *Ours, not the paper's.*

use super::layout::Curve;
use super::net::Net;
use super::own::own_quads;
use super::plan::{EDGES_MAX, Places, Wish};
use super::rim::{self, Rim};
use super::smooth::Target;
use super::subdivide::subdivide;
use super::template::border::{Border, End, Unwound};
use super::template::levels::Levels;
use super::template::rectangle::Harmonics;
use super::template::{Ends, GivenVertices, LayoutSurface, regular, wanted_share};
use super::{Input, Piece};
use crate::encode::index::PlanarIndex;
use crate::mesh::Vec3;
use crate::mesh::tri::TriMesh;
use crate::topology::{submesh, whole};
use crate::unfold::{Chart, UnfoldOptions, unfold};
use std::borrow::Cow;
use std::sync::OnceLock;

/// Most quads that a part is subdivided to.
const PART_QUADS_MAX: usize = 12_000;
/// Times an example, and the segment's own mesh, may be subdivided to fit.
const SUBDIVISIONS_MAX: usize = 2;
/// Times a regular layout may become finer, by how much each time, and edges on an arc more.
const FINER_MAX: usize = 2;
const FINER: f64 = 0.7;
const EDGES_MORE: usize = 3;
/// Edges of a regular layout on an arc, at least.
const EDGES_MIN: usize = 2;

/// The kind of layout that stands on a segment.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum LayoutKind {
    /// A mapped example.
    Part,
    /// A regular layout.
    Regular,
    /// The segment's own triangles as quads.
    Own,
}

/// An estimate of what is gained, and paid in quads, if the layout on a segment is made finer.
#[derive(Clone, Copy, Debug)]
pub struct RefinementGain {
    /// Quads more.
    pub quads: f64,
    /// Share of its distance from the segment that goes: it is that of a chord, h²κ/8.
    pub less: f64,
}

/// The reason why what was brought for a segment does not stand on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReplacementReason {
    /// It could not be joined to its neighbours.
    NotJoined,
    /// It is far denser than everything else.
    TooDense,
    /// It passes its segment by far.
    Missing,
}

/// A segment's chart, with what is made of it once.
#[derive(Debug)]
struct SegmentChart<'a> {
    chart: Cow<'a, Chart>,
    index: Cow<'a, PlanarIndex>,
    levels: Levels,
    target: Target,
    border: Border,
    harmonics: OnceLock<Option<Harmonics>>,
}

impl SegmentChart<'_> {
    fn harmonics(&self) -> Option<&Harmonics> {
        self.harmonics.get_or_init(|| Harmonics::new(&self.chart)).as_ref()
    }

    /// Leaves it at rings.
    fn without_rectangles(&mut self) {
        self.harmonics = OnceLock::from(None);
    }
}

/// A segment with what stands on it.
#[derive(Debug)]
pub struct Site<'a> {
    /// Which kind it is.
    pub stands: LayoutKind,
    /// Times it was subdivided, or made finer, since it is of this kind.
    pub times: usize,
    /// Times the example was subdivided.
    pub subdivided: usize,
    /// Why what was brought was given up.
    pub given_up: Option<ReplacementReason>,
    /// The part, where it is no regular layout.
    pub net: Net,
    /// What a regular layout is to have.
    pub wish: Wish,
    piece: Piece<'a>,
    triangles: Vec<u32>,
    charted: Option<SegmentChart<'a>>,
    laid: Option<RegularLayout>,
}

/// A regular layout, with what it was made for: most stay as they are when another segment gives way.
#[derive(Debug)]
struct RegularLayout {
    wish: Wish,
    places: Vec<Vec<Places>>,
    made: Option<(Net, Vec<Rim>)>,
}

impl<'a> Site<'a> {
    /// A segment with what was brought for it; `net` is a mapped example turned as the segment.
    pub fn new(input: Input<'_>, segment: usize, piece: Piece<'a>, net: Net, edge: f64) -> Self {
        let triangles =
            (0..input.owner.len() as u32).filter(|&t| input.owner[t as usize] as usize == segment).collect();
        let wish = Wish { edge, edges_min: EDGES_MIN, edges_max: EDGES_MAX };
        let stands = match piece {
            Piece::Mapped(_) | Piece::Kept(_) => LayoutKind::Part,
            Piece::Regular(..) | Piece::Nothing => LayoutKind::Regular,
        };
        let mut site = Self {
            stands,
            times: 0,
            subdivided: 0,
            given_up: None,
            net,
            wish,
            piece,
            triangles,
            charted: None,
            laid: None,
        };
        if stands == LayoutKind::Regular && !site.chart(input.surface) {
            site.take_own(input.surface);
        }
        site
    }

    /// Leaves a regular layout at rings: the search for the best rectangle takes as long on a scrap as on a large segment.
    pub fn keep_plain(&mut self) {
        if let Some(charted) = &mut self.charted {
            charted.without_rectangles();
        }
    }

    /// Whether an example stands on it that is to keep its density.
    pub fn is_kept(&self) -> bool {
        self.stands == LayoutKind::Part && matches!(self.piece, Piece::Kept(_))
    }

    /// What it would be, made finer once more to follow the input; `None` where it may not be.
    pub fn finer(&self) -> Option<RefinementGain> {
        let less = match self.stands {
            LayoutKind::Part | LayoutKind::Own => 0.75,
            LayoutKind::Regular => 1.0 - FINER * FINER,
        };
        (self.may_be_finer() && !self.is_kept()).then(|| RefinementGain { quads: self.quads_more(), less })
    }

    /// Tells whether it may be made finer to fit its neighbours. An example that is to keep its density and has many faces may not:
    /// scraps of the input beside it stand on their own triangles instead.
    pub fn may_be_finer(&self) -> bool {
        let times_max = match self.stands {
            LayoutKind::Part | LayoutKind::Own => SUBDIVISIONS_MAX,
            LayoutKind::Regular => FINER_MAX,
        };
        self.times < times_max && !(self.is_kept() && self.has_most_quads())
    }

    /// Tells whether a part would have more than [`PART_QUADS_MAX`] quads if it was subdivided.
    pub fn has_most_quads(&self) -> bool {
        4 * self.net.faces().count() > PART_QUADS_MAX
    }

    /// Quads more that it has when it is made finer, about.
    pub fn quads_more(&self) -> f64 {
        match (self.stands, &self.charted) {
            (LayoutKind::Regular, Some(charted)) => {
                (1.0 / (FINER * FINER) - 1.0) * charted.chart.mesh.total_area() / self.wish.edge.powi(2)
            }
            _ => 3.0 * self.net.faces().count() as f64,
        }
    }

    /// Its surface alone.
    pub fn surface(&self, whole: &TriMesh) -> TriMesh {
        submesh(whole, &self.triangles).0
    }

    /// Takes what comes next; false if there is nothing.
    pub fn give_way(&mut self, surface: &TriMesh, target: &Target) -> bool {
        if self.may_be_finer() {
            self.refine(target);
            return true;
        }
        self.give_up(surface, ReplacementReason::NotJoined)
    }

    /// Gives up at once what stands on it, for a reason.
    pub fn give_up(&mut self, surface: &TriMesh, why: ReplacementReason) -> bool {
        let stands = self.stands;
        if stands == LayoutKind::Part {
            self.given_up = Some(why);
        }
        match stands {
            LayoutKind::Own => return false,
            LayoutKind::Part if self.chart(surface) => (self.stands, self.times) = (LayoutKind::Regular, 0),
            LayoutKind::Part | LayoutKind::Regular => self.take_own(surface),
        }
        true
    }

    /// Subdivided, or a finer layout.
    pub fn refine(&mut self, target: &Target) {
        self.times += 1;
        match self.stands {
            LayoutKind::Regular => {
                self.wish.edge *= FINER;
                self.wish.edges_min += EDGES_MORE;
            }
            LayoutKind::Part | LayoutKind::Own => {
                self.subdivided += usize::from(self.stands == LayoutKind::Part);
                self.net = on_surface(subdivide(&self.net), self.net.positions.len(), target);
            }
        }
    }

    /// Asks for fewer edges on the true boundary where these make a layout of far more quads than are wanted: a jagged boundary is
    /// longer than quads of that size can follow. False where it has not far more, or that was asked for already.
    pub fn coarsen(&mut self, made: &Net, places: &[Vec<Places>]) -> bool {
        let Some(charted) = &self.charted else { return false };
        let share = wanted_share(made, charted.chart.mesh.total_area(), self.wish.edge);
        if share >= 1.0 || self.wish.edges_max < EDGES_MAX {
            return false;
        }
        let longest = places.iter().flatten().map(Vec::len).max().unwrap_or(EDGES_MAX);
        self.wish.edges_max = ((longest as f64 * share.sqrt()) as usize).clamp(self.wish.edges_min, EDGES_MAX - 1);
        true
    }

    fn take_own(&mut self, whole: &TriMesh) {
        self.net = own_quads(&self.surface(whole));
        (self.stands, self.times) = (LayoutKind::Own, 0);
    }

    /// Sees to it that there is a chart; false if the segment can't be unfolded.
    fn chart(&mut self, surface: &TriMesh) -> bool {
        if self.charted.is_some() {
            return true;
        }
        let (chart, index) = match self.piece {
            Piece::Regular(chart, index) => (Cow::Borrowed(chart), Cow::Borrowed(index)),
            Piece::Mapped(_) | Piece::Kept(_) | Piece::Nothing => {
                let Ok(patch) = whole(&self.surface(surface)) else { return false };
                let Ok(chart) = unfold(&patch, &UnfoldOptions::default()) else { return false };
                let index = PlanarIndex::new(&chart);
                (Cow::Owned(chart), Cow::Owned(index))
            }
        };
        let (levels, target) = (Levels::new(&chart), Target::new(&chart.mesh));
        let border = Border::new(&chart);
        let harmonics = OnceLock::new();
        self.charted = Some(SegmentChart { chart, index, levels, target, border, harmonics });
        true
    }

    /// The regular layout whose boundary vertices stand at given places, with its boundary laid on the curves; `None`
    /// where the chart's boundary is not the segment's.
    pub fn lay_out(&mut self, curves: &[Curve], places: &[Vec<Places>]) -> Option<(Net, Vec<Rim>)> {
        let known = self.laid.as_ref().filter(|laid| laid.wish == self.wish && laid.places == places);
        if let Some(laid) = known {
            return laid.made.clone();
        }
        let made = self.laid_anew(curves, places);
        self.laid = Some(RegularLayout { wish: self.wish, places: places.to_vec(), made: made.clone() });
        made
    }

    fn laid_anew(&self, curves: &[Curve], places: &[Vec<Places>]) -> Option<(Net, Vec<Rim>)> {
        let charted = self.charted.as_ref()?;
        let ground = LayoutSurface {
            chart: &charted.chart,
            index: &charted.index,
            levels: &charted.levels,
            target: &charted.target,
            harmonics: charted.harmonics(),
        };
        let mut rims: Vec<Rim> = Vec::new();
        let mut loop_at: [Option<usize>; 2] = [None, None];
        let mut ends: Ends = [None, None];
        for (l, (curve, runs)) in curves.iter().zip(places).enumerate() {
            let rim = rim_of(curve, runs);
            let Unwound { end, mut u, mut along } = charted.border.unwound(curve, &rim.at)?;
            let mut points: Vec<Vec3> = rim.at.iter().map(|&s| curve.point(s)).collect();
            let k = usize::from(end == End::Top);
            if end == End::Top {
                // There u runs against the curve.
                u.iter_mut().for_each(|u| *u = -*u);
                u.reverse();
                along.reverse();
                points.reverse();
            }
            if ends[k].replace(GivenVertices { u, along, points }).is_some() {
                return None;
            }
            loop_at[k] = Some(l);
            rims.push(rim);
        }
        let mut made = regular(ground, self.wish.edge, ends);
        for k in 0..2 {
            let Some(l) = loop_at[k] else { continue };
            let mut ring = std::mem::take(&mut made.ends[k]);
            if k == 1 {
                ring.reverse();
            }
            if ring.len() != rims[l].at.len() {
                return None;
            }
            rims[l].vertices = ring;
        }
        let is_whole = made.net.loops().is_some_and(|loops| loops.len() == curves.len());
        is_whole.then_some((made.net, rims))
    }
}

/// Which way a part's faces are turned.
pub fn way(net: &Net, curves: &[Curve]) -> Option<rim::LoopDirection> {
    let loops = net.loops()?;
    let curve_of = rim::pair_loops(net, &loops, curves)?;
    Some(rim::way(net, loops.first()?, curves.get(*curve_of.first()?)?))
}

/// A boundary loop of vertices at given places, yet without their numbers.
fn rim_of(curve: &Curve, runs: &[Places]) -> Rim {
    let mut rim = Rim { vertices: Vec::new(), at: Vec::new(), starts: Vec::new() };
    for (run, places) in curve.runs.iter().zip(runs) {
        let is_closed = run.junction == u32::MAX;
        if !is_closed {
            rim.starts.push(rim.at.len());
        }
        let count = places.len() - usize::from(!is_closed && !places.is_empty());
        rim.at.extend(places[..count].iter().map(|s| run.start + s));
    }
    rim
}

/// A subdivided net with its new vertices, those from `old` on, on the input.
pub fn on_surface(mut fine: Net, old: usize, target: &Target) -> Net {
    for v in old..fine.positions.len() {
        let p = fine.positions[v];
        fine.positions[v] = target.onto_surface(p);
    }
    fine
}
