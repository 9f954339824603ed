//! The best of several rough places of an example on an input: each is laid roughly, and the best settles.
//!
//! How well the relief of the example agrees with that of the input where it lies, less what the map bends and how far normals
//! disagree, is the arbiter ([`Evidence::confidence`]): of right maps it is high, of wrong ones low, whatever the shapes.

use super::limbs::{TipDistances, axis_points};
use super::ways::{MatchedTips, TipPairing, likely, twins};
use crate::mesh::Vec3;
use crate::mesh::bvh::{Bvh, Closest};
use crate::mesh::tri::{NONE, TriMesh};
use crate::numerics::stage::Stage;
use crate::numerics::stop::Stop;
use crate::numerics::{in_halves, side_by_side};
use crate::settle::{
    Aligned, AxisPoint, BareArea, Evidence, HalfwayPose, LaidRoughly, Manner, Options, PreparedInput, Settled, Settler,
    Similarity, Symmetry, VertexLandmark,
};
use std::borrow::Cow;
use std::sync::{Arc, OnceLock};

/// From this relief on a map is convincing, and no other place is tried. *Untuned:* right maps have .72 to .98 and wrong ones
/// up to .5 (tests/records).
pub const CONVINCING: f64 = 0.8;
/// Where all of the example lies on all of the input, [`Evidence::confidence`] is convincing from here on: a place on a part of
/// either would leave something over, or bend. *Untuned:* what is called good.
const CONVINCING_WHOLE: f64 = 0.45;
/// Shares from which on it is all.
const WHOLE: f64 = 0.97;
/// A start of less relief is not followed: it is wrong. *Untuned.*
const FOLLOWED: f64 = 0.1;
/// A start that lays tips so near to their matches in the mean, in √area of the input, is of that match. *Untuned:* right starts have up
/// to .03, wrong ones .3 and more.
const AGREES: f64 = 0.1;
/// A mirrored place must be so much surer than one that is not: bodies and heads are nearly their own mirror image.
const MIRROR_MARGIN: f64 = 0.1;
/// A place that tips led to is less sure by so many times as far as they end from their matches in the mean, in √area of the input: if
/// they match, it is wrong, and if they don't, it is there by luck. *Untuned.*
const APART_COUNTS: f64 = 2.0;
/// One closed surface on another is less sure by so many times the share of the input that it leaves bare: stiffly laid it bends little as
/// long as limbs are bare. With twice as much an eagle lies back to front (tests/records/wholes-2026-11-28.md).
const BARE_COUNTS: f64 = 1.0;
/// From this worth on a place that is laid roughly is likely right, and limbs need no axes to lead them. *Untuned.*
const LIES_WELL: f64 = 0.35;
/// Places that are less sure than the best by no more than this settle too, so many at most.
const NEAR: f64 = 0.15;
const FINALISTS: usize = 3;
/// A map that is stretched to tips leaves at most this share of what was bare (*untuned*), and is less sure by no more than this: with
/// .06 a frog's toes, and three animals of other species, stay short (tests/records/stretch-2026-11-27.md).
const REACHED: f64 = 0.9;
const REACHING_MARGIN: f64 = 0.1;
/// It is stretched so often: a tip that was beside another is bare when that is reached. *Untuned.*
const STRETCHES: usize = 2;
/// A pose that is less sure than the best by more than this when it has bent halfway is not surer in the end (tests/records).
const NEAR_HALFWAY: f64 = 0.06;
/// Places whose vertices are less apart in the mean, in √area of the input, are one.
const SAME: f64 = 0.03;

/// What is weighed where places are only compared: half of the default. *Untuned.*
const ROUGH_NODES: [usize; 3] = [300, 700, 700];
const ROUGH_SAMPLES: [usize; 2] = [3000, 3000];
const ROUGH_SENT: usize = 1200;

fn rough_options() -> Options {
    Options { nodes: ROUGH_NODES, samples: ROUGH_SAMPLES, sent: ROUGH_SENT, ..Options::default() }
}

/// A rough place of an example.
#[derive(Clone, Debug)]
pub struct Start {
    /// Where each vertex goes.
    pub positions: Vec<Vec3>,
    /// Whether it lies mirrored.
    pub mirrored: bool,
    /// How far tips that led it there are from their matches in the mean, in √area of the input.
    pub apart: f64,
}

/// How an example lies on an input.
#[derive(Clone, Debug)]
pub struct Placement {
    /// Of each vertex the place on the input.
    pub places: Vec<Closest>,
    /// Vertices that the input ends before.
    pub lost: Vec<bool>,
    /// Vertices that came to rest off the input.
    pub off: Vec<bool>,
    /// Whether it lies mirrored.
    pub mirrored: bool,
    /// How far the tips that led it there end from their matches in the mean, in √area of the input.
    pub apart: f64,
    /// What speaks for it.
    pub evidence: Evidence,
}

impl Placement {
    fn of(Settled { places, lost, off, evidence, .. }: Settled, (mirrored, apart): (bool, f64)) -> Self {
        Self { places, lost, off, mirrored, apart, evidence }
    }
}

impl Start {
    /// An example in a pose.
    pub fn posed(example: &TriMesh, pose: &Similarity) -> Self {
        Self { positions: example.positions.iter().map(|x| pose.apply(x)).collect(), mirrored: false, apart: 0.0 }
    }
}

/// A place at which an example was tried, laid roughly: how it lies, where its vertices are, and from where it goes on.
#[derive(Debug)]
pub struct TriedPlace {
    placement: Placement,
    positions: Vec<Vec3>,
    laid: LaidRoughly,
    /// The start, where it was laid as a whole.
    start: Option<Vec<Vec3>>,
}

impl TriedPlace {
    fn of((settled, laid): (Settled, LaidRoughly), mirrored: bool) -> Self {
        let positions = settled.positions.clone();
        Self { placement: Placement::of(settled, (mirrored, 0.0)), positions, laid, start: None }
    }

    /// The same, led by tips that end so far from their matches in the mean, in √area of the input.
    fn with_tips(mut self, apart: f64) -> Self {
        self.placement.apart = apart;
        self
    }
}

/// Searches for the best place of an example on an input; both are prepared for many starts.
pub struct PlaceSearch<'a> {
    /// The example's mirror image in itself, found when it is asked for.
    symmetry: OnceLock<Option<Symmetry>>,
    plain: Settler<'a>,
    mirrored: Settler<'a>,
    /// Example and input with distances from their tips.
    tipped: [TipDistances<'a>; 2],
    /// What has been laid roughly.
    laid: Vec<TriedPlace>,
    /// The input's area.
    area: f64,
    /// True where both are closed, and neither ends anywhere.
    are_closed: bool,
}

impl<'a> PlaceSearch<'a> {
    /// Prepares; `None` where either has no area.
    pub fn new(example: &'a TriMesh, input: &'a TriMesh) -> Option<Self> {
        Self::with_tree(example, input, Arc::new(Bvh::new(input)))
    }

    /// Prepares for places that are only compared: [`PlaceSearch::settle_best`] would settle what few samples show. The input is
    /// [ready](Self::ready_roughly).
    pub fn roughly(example: &'a TriMesh, input: (&'a TriMesh, Arc<PreparedInput>)) -> Option<Self> {
        Self::on(example, input, &rough_options())
    }

    /// An input ready for places that are only compared; `None` where it has no area.
    pub fn ready_roughly(input: &TriMesh) -> Option<PreparedInput> {
        PreparedInput::new(input, &rough_options())
    }

    /// Prepares, with the tree of the input; `None` where either has no area.
    pub fn with_tree(example: &'a TriMesh, input: &'a TriMesh, tree: Arc<Bvh>) -> Option<Self> {
        let options = Options::default();
        Self::on(example, (input, Arc::new(PreparedInput::with_tree(input, tree, &options)?)), &options)
    }

    fn on(example: &'a TriMesh, (input, ready): (&'a TriMesh, Arc<PreparedInput>), options: &Options) -> Option<Self> {
        let settler = |mirror| Settler::on(example, (input, Arc::clone(&ready)), mirror, options);
        let (plain, mirrored) = side_by_side(|| settler(1.0), || settler(-1.0));
        let (symmetry, area) = (OnceLock::new(), input.total_area());
        let tipped = [example, input].map(TipDistances::new);
        let are_closed = [example, input].iter().all(|mesh| !mesh.twins.contains(&NONE));
        Some(Self { symmetry, plain: plain?, mirrored: mirrored?, tipped, laid: Vec::new(), area, are_closed })
    }

    /// The same, with landmarks held on their places.
    pub fn holding(self, landmarks: &[VertexLandmark]) -> Self {
        let (plain, mirrored) = (self.plain.holding(landmarks), self.mirrored.holding(landmarks));
        Self { plain, mirrored, ..self }
    }

    /// Where the landmarks carry the example; `None` where they are fewer than three, or one point.
    pub fn carried(&self) -> Option<Start> {
        let (plain, missed) = self.plain.carried()?;
        let (mirrored, missed_mirrored) = self.mirrored.carried()?;
        let is_mirrored = missed_mirrored < missed;
        Some(Start { positions: if is_mirrored { mirrored } else { plain }, mirrored: is_mirrored, apart: 0.0 })
    }

    /// The best so far.
    pub fn best(&self) -> Option<&Placement> {
        self.surest().map(|laid| &laid.placement)
    }

    /// Where the best so far began, if it was laid as a whole.
    pub fn best_start(&self) -> Option<Start> {
        let best = self.surest()?;
        Some(Start { positions: best.start.clone()?, mirrored: best.placement.mirrored, apart: 0.0 })
    }

    fn surest(&self) -> Option<&TriedPlace> {
        self.laid.iter().max_by(|a, b| self.worth(&a.placement).total_cmp(&self.worth(&b.placement)))
    }

    /// The best of all, settled; `None` when stopped. The best few settle where they are near: roughly laid, what is nearly its own
    /// mirror image, or faces backwards, can't be told from it. What is not alike by its evidence is not stretched to tips that it
    /// leaves bare: it is wrong, and stays so. Nothing is kept of what was laid roughly.
    pub fn settle_best(&mut self, is_alike: impl Fn(&Evidence) -> bool, stop: Stop<'_>) -> Option<Placement> {
        let near = self.worth(self.best()?) - NEAR;
        let mut finalists: Vec<TriedPlace> = std::mem::take(&mut self.laid);
        finalists.retain(|laid| self.worth(&laid.placement) >= near);
        finalists.sort_by(|a, b| self.worth(&b.placement).total_cmp(&self.worth(&a.placement)));
        finalists.truncate(FINALISTS);
        let settled = |TriedPlace { placement: Placement { mirrored, apart, .. }, laid, .. }: &TriedPlace| {
            let (settled, laid) = self.settler(*mirrored).fine_from(laid, stop)?;
            Some((Placement::of(settled, (*mirrored, *apart)), laid))
        };
        let all = in_halves(&finalists, settled).into_iter().collect::<Option<Vec<(Placement, LaidRoughly)>>>();
        let (best, laid) = all?
            .into_iter()
            .reduce(|best, made| if self.worth(&made.0) > self.worth(&best.0) { made } else { best })?;
        let is_stretched = Stage::Stretch.is_on() && is_alike(&best.evidence);
        if is_stretched { self.reaching(best, laid, stop) } else { Some(best) }
    }

    /// Stretches what has settled to tips of the input that it leaves bare, where it then leaves less bare and is about as sure: to all
    /// at once, or else to one after another. What speaks for its place is what spoke for it before: limbs that are longer bend more,
    /// and are no less right. `None` when stopped.
    fn reaching(&self, mut best: Placement, mut laid: LaidRoughly, stop: Stop<'_>) -> Option<Placement> {
        let settler = self.settler(best.mirrored);
        let Evidence { relief, local_relief, bend, normal_disagreement, .. } = best.evidence;
        let least = self.worth(&best) - REACHING_MARGIN;
        let mut bare = settler.bare(&laid);
        for _ in 0..STRETCHES {
            let BareArea { share: before, tips } = bare.clone();
            let all = (tips.len() > 1).then_some(tips.as_slice());
            for tips in all.into_iter().chain(tips.chunks(1)) {
                let (settled, made) = settler.stretched(&laid, tips, stop)?;
                let (placement, left) = (Placement::of(settled, (best.mirrored, best.apart)), settler.bare(&made));
                if left.share < REACHED * bare.share && self.worth(&placement) >= least {
                    (best, laid, bare) = (placement, made, left);
                    if tips.len() > 1 {
                        break;
                    }
                }
            }
            if bare.share >= before {
                break;
            }
        }
        best.evidence = Evidence { relief, local_relief, bend, normal_disagreement, ..best.evidence };
        Some(best)
    }

    /// Whether the best so far needs no other.
    pub fn is_convincing(&self) -> bool {
        self.best().is_some_and(|best| {
            let e = &best.evidence;
            let is_whole = e.lost <= 1.0 - WHOLE && e.covered >= WHOLE;
            e.relief >= CONVINCING || is_whole && e.confidence() >= CONVINCING_WHOLE
        })
    }

    /// The example's mirror image in itself; `None` where it is not symmetric.
    fn symmetry(&self) -> Option<&Symmetry> {
        if !Stage::Symmetry.is_on() {
            return None;
        }
        self.symmetry.get_or_init(|| Symmetry::of(self.tipped[0].mesh)).as_ref()
    }

    /// A start, unmirrored where the example is symmetric: it lies there as well, with all its vertices on the right side.
    fn unmirrored<'s>(&self, start: &'s Start) -> Cow<'s, Start> {
        match self.symmetry().filter(|_| start.mirrored) {
            Some(symmetry) => {
                Cow::Owned(Start { positions: symmetry.swapped(&start.positions), mirrored: false, apart: start.apart })
            }
            None => Cow::Borrowed(start),
        }
    }

    /// Settles a start as a whole, and bending after it where it is nearly right. A mirrored one is tried unmirrored too.
    pub fn tries(&mut self, start: &Start, stop: Stop<'_>) {
        let tried = self.tried(start, stop);
        self.take(tried);
    }

    /// Finds what [`Self::tries`] would keep; [`Self::take`] keeps it.
    pub fn tried(&self, start: &Start, stop: Stop<'_>) -> Vec<TriedPlace> {
        let start = &*self.unmirrored(start);
        let is_followed = self.relief(start).is_some_and(|relief| relief > FOLLOWED);
        let whole = || self.settled(start, start.mirrored, Manner::Whole, stop);
        let following = || self.settled(start, start.mirrored, Manner::Following, stop);
        let (whole, following) = if is_followed { side_by_side(whole, following) } else { (whole(), None) };
        let of_start = |place: TriedPlace| place.with_tips(start.apart);
        let mut found: Vec<TriedPlace> = whole.into_iter().chain(following).map(of_start).collect();
        if start.mirrored {
            // What is nearly its own mirror image lies about there unmirrored, too.
            if let Some(plain) = self.settled(start, false, Manner::Whole, stop) {
                let next = Start { positions: plain.positions.clone(), mirrored: false, apart: 0.0 };
                let following = self.settled(&next, false, Manner::Following, stop);
                found.extend([plain].into_iter().chain(following));
            }
        }
        found
    }

    /// Keeps what was tried.
    pub fn take(&mut self, tried: impl IntoIterator<Item = TriedPlace>) {
        tried.into_iter().for_each(|place| self.keep(place));
    }

    /// Settles the likeliest of some unmirrored poses as wholes: all where they rest, those that rest at one place once; of these the
    /// ones that agree best when they have bent halfway.
    pub fn tries_poses(&mut self, poses: &[Start], stop: Stop<'_>) {
        let settler = &self.plain;
        let mut apart: Vec<(&Start, Aligned)> = Vec::new();
        let aligned = in_halves(poses, |pose| settler.align(&pose.positions, stop));
        for (pose, aligned) in poses.iter().zip(aligned).filter_map(|(pose, aligned)| Some((pose, aligned?))) {
            if !apart.iter().any(|(_, known)| settler.are_one(known, &aligned)) {
                apart.push((pose, aligned));
            }
        }
        let halfway = in_halves(&apart, |(_, aligned)| settler.halfway(aligned, stop));
        let sure = |halfway: &HalfwayPose| halfway.evidence.place_confidence();
        let best = halfway.iter().flatten().map(sure).fold(f64::NEG_INFINITY, f64::max);
        let near: Vec<(&(&Start, Aligned), &HalfwayPose)> = (apart.iter().zip(halfway.iter()))
            .filter_map(|(start, halfway)| Some((start, halfway.as_ref()?)))
            .filter(|(_, halfway)| sure(halfway) >= best - NEAR_HALFWAY)
            .collect();
        let found = in_halves(&near, |((pose, aligned), halfway)| {
            let start = Some(pose.positions.clone());
            Some(TriedPlace { start, ..TriedPlace::of(settler.rough_from((aligned, halfway), stop)?, false) })
        });
        self.take(found.into_iter().flatten());
    }

    /// The same; but what only one of the two has (a crown, shoulders) may draw a pose off its place: where one agrees better than
    /// all that was laid, it is followed as it stands, too.
    pub fn tries_poses_as_they_stand(&mut self, poses: &[Start], stop: Stop<'_>) {
        self.tries_poses(poses, stop);
        for pose in poses {
            if self.is_convincing() {
                return;
            }
            let best = self.best().map_or(FOLLOWED, |best| best.evidence.relief.max(FOLLOWED));
            if self.relief(pose).is_some_and(|relief| relief > best) {
                let following = self.settled(pose, false, Manner::Following, stop);
                self.take(following);
            }
        }
    }

    /// Lays the example after tips that are matched, by one way after the other until one is convincing; where one is not, after a
    /// start, too. Where none that the pictures speak for is, their [twins] follow.
    pub fn tries_tips(&mut self, matches: &[MatchedTips], start: Option<&Start>, stop: Stop<'_>) {
        let start = start.map(|start| self.unmirrored(start));
        let likely = self.likely(matches);
        self.tries_ways(&likely, start.as_deref(), stop);
        if !self.is_convincing() {
            let twins = self
                .symmetry()
                .map(|symmetry| twins(matches, symmetry, self.tipped[0].mesh, &likely))
                .unwrap_or_default();
            self.tries_ways(&twins, start.as_deref(), stop);
        }
    }

    /// Lays the example by some ways, side by side, and keeps what comes of them until one is convincing.
    fn tries_ways(&mut self, ways: &[TipPairing], start: Option<&Start>, stop: Stop<'_>) {
        let tried = in_halves(ways, |TipPairing { landmarks, mirrored }| {
            let held = start.and_then(|start| self.held(landmarks, start, stop));
            [self.led(landmarks, &[], *mirrored, stop), held]
        });
        for [led, held] in tried {
            self.take(led);
            if !self.is_convincing() {
                self.take(held);
            }
            if self.is_convincing() {
                return;
            }
        }
    }

    /// Where nothing lies well, lays the example after the axes of its limbs, too, as tips that are matched tell of them.
    pub fn tries_axes(&mut self, matches: &[MatchedTips], stop: Stop<'_>) {
        if !Stage::Limbs.is_on() || self.lies_well() {
            return;
        }
        let tried = in_halves(&self.likely(matches), |TipPairing { landmarks, mirrored }| {
            let [example, input] = &self.tipped;
            let axes = axis_points(example, input, landmarks);
            // Of few limbs with axes too little is told of the rest.
            if axes.len() < landmarks.len() {
                return None;
            }
            self.led(landmarks, &axes, *mirrored, stop)
        });
        for place in tried.into_iter().flatten() {
            self.keep(place);
            if self.lies_well() {
                return;
            }
        }
    }

    /// Tells whether the best so far is likely right.
    pub fn lies_well(&self) -> bool {
        self.best().is_some_and(|best| self.worth(best) >= LIES_WELL)
    }

    /// The ways that the pictures speak for. What is not symmetric may be the mirror image of what matches mirrored, or lie on its back:
    /// tips decide.
    fn likely(&self, matches: &[MatchedTips]) -> Vec<TipPairing> {
        if let Some(symmetry) = self.symmetry() {
            return likely(matches, symmetry);
        }
        let oriented = |tips: &MatchedTips| {
            let [plain, mirrored] = self.missed(&tips.landmarks)?;
            Some(TipPairing { landmarks: tips.landmarks.clone(), mirrored: mirrored < plain })
        };
        matches.iter().filter_map(oriented).collect()
    }

    /// By how much landmarks are missed by the similarity that carries them best, unmirrored and mirrored.
    fn missed(&self, landmarks: &[VertexLandmark]) -> Option<[f64; 2]> {
        Some([self.plain.missed(landmarks)?, self.mirrored.missed(landmarks)?])
    }

    /// Lays the example after a start that lays tips near their matches, with the tips held there: a limb that is near another slides
    /// along it otherwise.
    fn held(&self, tips: &[VertexLandmark], start: &Start, stop: Stop<'_>) -> Option<TriedPlace> {
        if self.apart(tips, &start.positions) > AGREES {
            return None;
        }
        let found = self.settler(start.mirrored).held_roughly(&start.positions, tips, stop)?;
        Some(TriedPlace::of(found, start.mirrored))
    }

    /// Lays the example after tips that are matched, and after axes of its limbs, if there are any.
    fn led(&self, tips: &[VertexLandmark], axes: &[AxisPoint], mirrored: bool, stop: Stop<'_>) -> Option<TriedPlace> {
        let found = TriedPlace::of(self.settler(mirrored).led_roughly(tips, axes, stop)?, mirrored);
        let apart = self.apart(tips, &found.positions);
        Some(found.with_tips(apart))
    }

    /// How far an example whose vertices have these positions has its tips from their matches in the mean, in √area of the input.
    fn apart(&self, tips: &[VertexLandmark], positions: &[Vec3]) -> f64 {
        let apart = tips.iter().map(|tip| tip.distance(positions)).sum::<f64>();
        apart / (self.area.sqrt() * tips.len() as f64)
    }

    /// Lays a start roughly.
    fn settled(&self, start: &Start, mirrored: bool, manner: Manner, stop: Stop<'_>) -> Option<TriedPlace> {
        let found = TriedPlace::of(self.settler(mirrored).rough(&start.positions, manner, stop)?, mirrored);
        Some(TriedPlace { start: (manner == Manner::Whole).then(|| start.positions.clone()), ..found })
    }

    fn settler(&self, mirrored: bool) -> &Settler<'a> {
        if mirrored { &self.mirrored } else { &self.plain }
    }

    /// Keeps a place; of places that are one, the surer.
    fn keep(&mut self, tried: TriedPlace) {
        let reach = SAME * self.area.sqrt() * tried.positions.len() as f64;
        let same = |known: &TriedPlace| {
            let apart = known.positions.iter().zip(&tried.positions).map(|(a, b)| (a - b).norm()).sum::<f64>();
            known.placement.mirrored == tried.placement.mirrored && apart <= reach
        };
        match self.laid.iter().position(same) {
            Some(k) if self.worth(&tried.placement) <= self.worth(&self.laid[k].placement) => {}
            Some(k) => self.laid[k] = tried,
            None => self.laid.push(tried),
        }
    }

    /// How sure a place is, against others.
    fn worth(&self, of: &Placement) -> f64 {
        let sure = of.evidence.place_confidence();
        let sure = if sure.is_nan() { -1.0 } else { sure };
        let bare = if self.are_closed { BARE_COUNTS * (1.0 - of.evidence.covered) } else { 0.0 };
        sure - bare - APART_COUNTS * of.apart - if of.mirrored { MIRROR_MARGIN } else { 0.0 }
    }

    /// How well an unsettled start agrees.
    pub fn relief(&self, start: &Start) -> Option<f64> {
        self.settler(start.mirrored).relief(&start.positions)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::tests::grid;

    /// A bumpy sheet, like nothing mirrored; `sign` −1 mirrors it.
    fn sheet(n: u32, sign: f64) -> TriMesh {
        let flat = grid(n, n, false, false);
        let bump = |p: &Vec3| 0.2 * (5.0 * p.x + 0.4).sin() * (3.9 * p.y).cos() + 0.1 * (7.1 * p.y + 2.0 * p.x).sin();
        let positions = flat.positions.iter().map(|p| Vec3::new(sign * p.x, p.y, bump(p))).collect();
        let turn = |t: &[u32; 3]| if sign < 0.0 { [t[0], t[2], t[1]] } else { *t };
        TriMesh::from_triangles(positions, flat.triangles.iter().map(turn).collect()).expect("a sheet")
    }

    #[test]
    fn what_is_alike_is_stretched_to_tips_and_what_is_not_stays() {
        // A sheet of side 2 with a limb.
        let limb = |n: u32, height: f64| {
            let mut mesh = sheet(n, 1.0);
            for p in &mut mesh.positions {
                let away = (2.0 * p.x - 1.0).hypot(2.0 * p.y - 1.0) / 0.3;
                *p = Vec3::new(2.0 * p.x, 2.0 * p.y, p.z + height * (1.0 - away.powi(2)).max(0.0).powi(2));
            }
            mesh
        };
        let (example, input) = (limb(40, 0.5), limb(90, 1.2));
        let [stretched, left] = [true, false].map(|is_alike| {
            let mut search = PlaceSearch::new(&example, &input).expect("areas");
            search.tries(&Start { positions: example.positions.clone(), mirrored: false, apart: 0.0 }, &|| false);
            let best = search.settle_best(|_| is_alike, &|| false).expect("settled");
            best.places.iter().map(|place| place.point.z).fold(0.0, f64::max)
        });
        assert!(stretched > 1.0 && left < 0.8, "{stretched} {left}");
    }

    #[test]
    fn tips_are_held_where_a_start_lays_them_near() {
        let (example, input) = (sheet(24, 1.0), sheet(60, 1.0));
        let tree = Bvh::new(&input);
        let tip = |v: &usize| VertexLandmark {
            corners: [(*v as u32, 1.0), (*v as u32, 0.0), (*v as u32, 0.0)],
            to: tree.closest(example.positions[*v]),
        };
        let n = example.positions.len();
        let tips: Vec<VertexLandmark> = [30, n / 2 + 7, n - 40, n - 27].iter().map(tip).collect();
        let moved = |by: f64| Start {
            positions: example.positions.iter().map(|p| p + Vec3::new(by, 0.0, 0.0)).collect(),
            mirrored: false,
            apart: 0.0,
        };
        for (by, is_held) in [(0.02, true), (0.3, false)] {
            let mut search = PlaceSearch::new(&example, &input).expect("areas");
            let held = search.held(&tips, &moved(by), &|| false);
            search.take(held);
            assert_eq!(search.best().is_some(), is_held, "{by}");
            let Some(best) = search.settle_best(|_| true, &|| false) else { continue };
            let off = tips.iter().map(|tip| {
                let v = tip.corners[0].0 as usize;
                (best.places[v].point - example.positions[v]).norm()
            });
            assert!(off.fold(0.0, f64::max) < 0.02, "{by}");
        }
    }

    #[test]
    fn of_poses_that_rest_at_one_place_and_of_worse_ones_one_is_laid() {
        let (example, input) = (sheet(24, 1.0), sheet(60, 1.0));
        let moved = |by: f64, sign: f64| {
            let place = |p: &Vec3| Vec3::new(p.x + by, sign * p.y, sign * p.z);
            Start { positions: example.positions.iter().map(place).collect(), mirrored: false, apart: 0.0 }
        };
        let mut search = PlaceSearch::new(&example, &input).expect("areas");
        search.tries_poses(&[moved(0.0, -1.0), moved(0.02, 1.0), moved(-0.02, 1.0)], &|| false);
        assert_eq!(search.laid.len(), 1);
        assert!(search.is_convincing());
        let start = search.best_start().expect("laid as a whole");
        assert_eq!(start.positions, moved(0.02, 1.0).positions);
    }

    #[test]
    fn tips_decide_whether_an_example_lies_mirrored() {
        let example = sheet(24, 1.0);
        for sign in [1.0, -1.0] {
            let input = sheet(60, sign);
            let tree = Bvh::new(&input);
            let place = |p: &Vec3| Vec3::new(sign * p.x, p.y, p.z);
            let tip = |v: &usize| VertexLandmark {
                corners: [(*v as u32, 1.0), (*v as u32, 0.0), (*v as u32, 0.0)],
                to: tree.closest(place(&example.positions[*v])),
            };
            let n = example.positions.len();
            let tips: Vec<VertexLandmark> = [30, n / 2 + 7, n - 40, n - 27].iter().map(tip).collect();
            let mut search = PlaceSearch::new(&example, &input).expect("areas");
            search.tries_tips(&[MatchedTips { landmarks: tips.clone(), mirrored: false }], None, &|| false);
            assert!(search.is_convincing());
            let best = search.settle_best(|_| true, &|| false).expect("settled");
            assert_eq!(best.mirrored, sign < 0.0);
            let off = best.places.iter().zip(&example.positions).map(|(at, p)| (at.point - place(p)).norm());
            assert!(off.sum::<f64>() / (n as f64) < 0.01);
        }
    }
}
