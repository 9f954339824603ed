//! Free-boundary registration: an example's mesh is laid on a scan of a like thing, from a rough start, wherever either of
//! them ends.
//!
//! A similarity from the start (robust; what piles up on the input's rim has no say); then either the example as a whole
//! comes to rest ([`Manner::Whole`]: iterated closest points, both ways) or it bends after the start
//! ([`Manner::Following`], for limbs); then it bends onto the input from the scale 0.3 √area (following: 0.035) down to
//! 0.018; then each vertex goes to the closest point. Units: the example's area is 1.
//! *Sources:* the stages name theirs. *Ours, not the papers':* the start's rim, both ways, the two manners and the relief
//! that chooses between them.

mod align;
mod between;
mod effort;
mod elastic;
mod evidence;
mod held;
mod input_surface;
mod matches;
mod nearness;
mod place;
mod poses;
mod rest;
mod similarity;
mod span;
mod stretch;
mod symmetry;
mod tree;

pub use effort::Thoroughness;
pub use evidence::Evidence;
pub use held::{AxisPoint, VertexLandmark};
pub use poses::{Likeness, PosedSurface, poses, poses_on};
pub use similarity::Similarity;
pub use span::spanned;
pub use stretch::{BareArea, BareTip};
pub use symmetry::Symmetry;

use crate::mesh::Vec3;
use crate::mesh::bvh::{Bvh, Closest};
use crate::mesh::tri::TriMesh;
use crate::numerics::Pattern;
use crate::numerics::stop::Stop;
use align::RigidPoints;
use between::AddedVertices;
use elastic::{Body, ScaleView};
use evidence::JudgedMap;
use held::{FramedLandmark, HELD_AS_WHOLE};
use input_surface::{FramedSamples, InputProperties, InputSurface, Samples};
use matches::Partners;
use rest::{Nodes, Pose, Rest};
use std::cell::OnceCell;
use std::sync::{Arc, OnceLock};

/// How the example comes from the start to the input.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Manner {
    /// As a whole: for what has no limbs; forgives a start that is off by 40°, 40 % or a quarter of the size.
    Whole,
    /// Bending after the start, which is nearly right: for what has limbs.
    Following,
    /// Both, and the one whose relief agrees better is taken.
    Either,
}

/// What the registration weighs.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// How the example leaves the start.
    pub manner: Manner,
    /// Nodes at coarse, middle and fine scales.
    pub nodes: [usize; 3],
    /// Samples of the input at coarse and at fine scales.
    pub samples: [usize; 2],
    /// Samples of the input that look for the example.
    pub sent: usize,
    /// Rounds of the similarity stage at most.
    pub rounds: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self { manner: Manner::Whole, nodes: [500, 1200, 6000], samples: [6000, 24_000], sent: 2500, rounds: 50 }
    }
}

/// An example that has come to rest on the input.
#[derive(Clone, Debug)]
pub struct Settled {
    /// Of each vertex the closest point of the input, with triangle and weights.
    pub places: Vec<Closest>,
    /// The same points.
    pub positions: Vec<Vec3>,
    /// Vertices that have no place: the input ends before them.
    pub lost: Vec<bool>,
    /// Vertices that came to rest off the input: it has nothing there, and their places say little.
    pub off: Vec<bool>,
    /// What speaks for the map.
    pub evidence: Evidence,
    /// The manner that was taken; never [`Manner::Either`].
    pub manner: Manner,
}

/// An example that was laid roughly: enough to go on from there.
#[derive(Clone, Debug)]
pub struct LaidRoughly {
    setting: Arc<Setting>,
    pose: Pose,
    level: usize,
    /// The scale from which it bends on.
    from: f64,
    manner: Manner,
}

/// An example that rests on the input as a whole.
pub struct Aligned {
    setting: Arc<Setting>,
    /// In the setting's frame.
    found: Similarity,
}

/// The pose of an example that has bent halfway from where it rests as a whole: enough to tell which of several starts
/// are worth more.
pub struct HalfwayPose {
    pose: Pose,
    /// The evidence that speaks for it so far.
    pub evidence: Evidence,
}

/// Scales r in √area, rounds at each, and which of the node sets bends.
const SCALES: [(f64, usize, usize); 9] = [
    (0.3, 4, 0),
    (0.2, 2, 0),
    (0.14, 2, 0),
    (0.1, 2, 0),
    (0.07, 2, 1),
    (0.05, 2, 1),
    (0.035, 2, 2),
    (0.025, 2, 2),
    (0.018, 2, 2),
];
/// Scales at which the example follows the start, three rounds each, and the scale from which it bends thereafter.
const FOLLOWING: [(f64, usize); 6] = [(0.3, 0), (0.2, 0), (0.14, 0), (0.1, 0), (0.07, 1), (0.05, 1)];
const FOLLOWING_ROUNDS: usize = 3;
const FOLLOWED_FROM: f64 = 0.036;
/// The scale to which a start is laid roughly, and one that is below it.
const ROUGH: f64 = 0.05;
const BELOW_ROUGH: f64 = 0.049;
/// The last scale before starts are told from each other, and one that is below it: until there bending is cheap, and what agrees
/// less there agrees less in the end (tests/records).
const HALFWAY: f64 = 0.1;
const BELOW_HALFWAY: f64 = 0.09;
/// Wholes that rest less apart than this, in their own √area, rest at one place. *Untuned.*
const ONE: f64 = 0.05;
/// Scales below this see the fine samples.
const FINE_BELOW: f64 = 0.06;
/// Start vertices so near to the input's rim, in √area of the input, do not count, unless too few would be left.
const PILED: f64 = 0.02;
const COUNTED_MIN: f64 = 0.05;
/// From so many landmarks on they carry the example.
const LANDMARKS_CARRY: usize = 3;
/// Scale and rounds in which the example bends after its landmarks alone.
const LEADING: (f64, usize) = (0.3, 6);
/// Scales at which tips lead the example; the finest at which they do, and the scale from which it bends thereafter: where axes lead its
/// limbs, too, and where tips are alone. Bent from a coarser scale, an arm that was led around its elbow is straight again.
const LED: [f64; 5] = [0.3, 0.2, 0.14, 0.1, 0.07];
const LED_ALONG: (f64, f64) = (0.07, 0.075);
const LED_BY_TIPS: (f64, f64) = (0.14, 0.21);
/// Rounds and σ (in medians) of the robust similarity.
const ROBUST_ROUNDS: usize = 10;
const ROBUST_SIGMA: f64 = 1.5;

/// An example and an input, prepared once for many starts.
#[derive(Clone, Debug)]
pub struct Settler<'a> {
    options: Options,
    between: AddedVertices,
    rest: Rest,
    nodes: [Nodes; 3],
    /// Of the systems of each set of nodes, analysed when it first bends.
    patterns: [OnceLock<Option<Pattern>>; 3],
    rigid: RigidPoints,
    ground: InputSurface<'a>,
    input: Arc<PreparedInput>,
    landmarks: Vec<VertexLandmark>,
}

/// An input made ready once for all examples that are laid on it, and their mirror images.
#[derive(Debug)]
pub struct PreparedInput {
    known: Arc<InputProperties>,
    coarse: Samples,
    fine: Samples,
    sent: Samples,
    tree: Arc<Bvh>,
}

impl PreparedInput {
    /// Prepares; `None` where the input has no area.
    pub fn new(input: &TriMesh, options: &Options) -> Option<Self> {
        Self::with_tree(input, Arc::new(Bvh::new(input)), options)
    }

    /// The same with the tree of the input.
    pub fn with_tree(input: &TriMesh, tree: Arc<Bvh>, options: &Options) -> Option<Self> {
        let ground = InputSurface::new(input);
        let (coarse, fine) = (ground.samples(options.samples[0]), ground.samples(options.samples[1]));
        let known = Arc::clone(ground.known());
        let is_there = ground.area > 0.0 && ground.area.is_finite();
        is_there.then(|| Self { known, coarse, fine, sent: ground.spread(options.sent), tree })
    }
}

/// One start: weights of its vertices, and everything in the example's frame.
#[derive(Clone, Debug)]
struct Setting {
    frame: Similarity,
    weights: Vec<f64>,
    coarse: FramedSamples,
    sent: Samples,
    /// The input's area.
    area: f64,
    held: Vec<FramedLandmark>,
}

/// Lays an example on an input from a start, one position a vertex of the example. `mirror` is −1 where the map
/// mirrors: the example is then mirrored at rest, so that the registration itself never mirrors. `None` when stopped,
/// or where either has no area or the start has no extent.
pub fn settle(
    example: &TriMesh,
    input: &TriMesh,
    start: &[Vec3],
    mirror: f64,
    options: &Options,
    stop: Stop<'_>,
) -> Option<Settled> {
    Settler::new(example, input, mirror, options)?.settle(start, stop)
}

impl Aligned {
    /// From the example's own coordinates (mirrored at x = its centre where the map mirrors: see [`Settler::rest_position`]) to the
    /// input's.
    pub fn similarity(&self) -> Similarity {
        self.setting.frame.after(&self.found)
    }
}

impl<'a> Settler<'a> {
    /// Prepares; `None` where either has no area.
    pub fn new(example: &TriMesh, input: &'a TriMesh, mirror: f64, options: &Options) -> Option<Self> {
        Self::on(example, (input, Arc::new(PreparedInput::new(input, options)?)), mirror, options)
    }

    /// Prepares the example alone, for an input that is ready by the same options; `None` where it has no area.
    pub fn on(
        example: &TriMesh,
        (mesh, input): (&'a TriMesh, Arc<PreparedInput>),
        mirror: f64,
        options: &Options,
    ) -> Option<Self> {
        let (refined, between) = AddedVertices::of(example);
        let rest = Rest::new(&refined, mirror)?;
        let nodes = options.nodes.map(|count| rest.nodes(count));
        let rigid = RigidPoints::new(&rest, &nodes[1]);
        let ground = InputSurface::of(mesh, &input.known);
        let patterns = Default::default();
        Some(Self { options: *options, between, rest, nodes, patterns, rigid, ground, input, landmarks: Vec::new() })
    }

    /// The example's vertex at rest, from which [`Aligned::similarity`] leads to the input: centred, of unit area.
    pub fn rest_position(&self, v: usize) -> Option<Vec3> {
        self.rest.positions.get(v).copied()
    }

    /// The same, with landmarks held on their places.
    pub fn holding(self, landmarks: &[VertexLandmark]) -> Self {
        Self { landmarks: landmarks.to_vec(), ..self }
    }

    /// By how much landmarks are missed when they carry the example as a whole, in parts of their spread; `None` where they are one
    /// point.
    pub fn missed(&self, landmarks: &[VertexLandmark]) -> Option<f64> {
        held::carried(&self.rest, &self.ground, landmarks).map(|found| found.1)
    }

    /// Where the vertices lie when the landmarks carry the example as a whole, and by how much these are missed, in parts of
    /// their spread; `None` where they are fewer than three, or one point.
    pub fn carried(&self) -> Option<(Vec<Vec3>, f64)> {
        let landmarks = (self.landmarks.len() >= LANDMARKS_CARRY).then_some(&self.landmarks)?;
        let (found, missed) = held::carried(&self.rest, &self.ground, landmarks)?;
        Some((self.rest.positions[..self.between.own].iter().map(|x| found.apply(x)).collect(), missed))
    }

    /// The similarity stage alone.
    pub fn align(&self, start: &[Vec3], stop: Stop<'_>) -> Option<Aligned> {
        let setting = Arc::new(self.setting(&self.between.all(start))?);
        let found = self.aligned(&setting, stop)?;
        Some(Aligned { setting, found })
    }

    /// Tells whether the example rests at one place: its vertices lie less apart in the mean than [`ONE`] of its size.
    pub fn are_one(&self, a: &Aligned, b: &Aligned) -> bool {
        let (a, b) = (a.similarity(), b.similarity());
        let nodes = &self.nodes[0].vertices;
        let apart =
            |v: &u32| (a.apply(&self.rest.positions[*v as usize]) - b.apply(&self.rest.positions[*v as usize])).norm();
        nodes.iter().map(apart).sum::<f64>() <= ONE * a.scale.min(b.scale) * nodes.len() as f64
    }

    /// Bends the example halfway.
    pub fn halfway(&self, from: &Aligned, stop: Stop<'_>) -> Option<HalfwayPose> {
        let (mut pose, mut level) = (self.carried_by(&from.setting, &from.found, stop)?, 0);
        self.bent(&from.setting, (&mut pose, &mut level), [HALFWAY, f64::INFINITY], stop)?;
        let evidence = self.judged(&from.setting, &pose, level, Manner::Whole).evidence;
        Some(HalfwayPose { pose, evidence })
    }

    /// Lays roughly what has bent halfway.
    pub fn rough_from(
        &self,
        (from, halfway): (&Aligned, &HalfwayPose),
        stop: Stop<'_>,
    ) -> Option<(Settled, LaidRoughly)> {
        let scales = [ROUGH, BELOW_HALFWAY];
        self.bend(Arc::clone(&from.setting), (halfway.pose.clone(), 0), scales, Manner::Whole, stop)
    }

    /// Settles what was laid roughly.
    pub fn fine_from(&self, rough: &LaidRoughly, stop: Stop<'_>) -> Option<(Settled, LaidRoughly)> {
        let from = (rough.pose.clone(), rough.level);
        self.bend(Arc::clone(&rough.setting), from, [0.0, rough.from], rough.manner, stop)
    }

    /// [`Evidence::relief`] of the start as it is.
    pub fn relief(&self, start: &[Vec3]) -> Option<f64> {
        let start = &*self.between.all(start);
        let setting = self.setting(start)?;
        let positions: Vec<Vec3> = start.iter().map(|x| setting.frame.undo(x)).collect();
        let places = self.input.tree.closest_to_all(start);
        let nodes = &self.nodes[1];
        let judged = JudgedMap {
            rest: &self.rest,
            ground: &self.ground,
            frame: &setting.frame,
            nodes,
            pose: &Pose::of(&self.rest, nodes),
            positions: &positions,
            places: &places,
            lost: &vec![false; start.len()],
        };
        Some(judged.relief(nodes, &setting.coarse.samples, 1.0))
    }

    /// Lays the example on the input; see [`settle`].
    pub fn settle(&self, start: &[Vec3], stop: Stop<'_>) -> Option<Settled> {
        self.settle_to(start, (self.options.manner, 0.0), stop).map(|found| found.0)
    }

    /// Lays the example roughly, in a third of the time: enough to compare starts.
    pub fn rough(&self, start: &[Vec3], manner: Manner, stop: Stop<'_>) -> Option<(Settled, LaidRoughly)> {
        self.settle_to(start, (manner, ROUGH), stop)
    }

    fn settle_to(
        &self,
        start: &[Vec3],
        (manner, finest): (Manner, f64),
        stop: Stop<'_>,
    ) -> Option<(Settled, LaidRoughly)> {
        let start = &*self.between.all(start);
        let setting = Arc::new(self.setting(start)?);
        let whole = || self.whole(Arc::clone(&setting), finest, stop);
        let following = || self.following(Arc::clone(&setting), start, finest, stop);
        match manner {
            Manner::Whole => whole(),
            Manner::Following => following(),
            Manner::Either => {
                let (whole, following) = (whole(), following());
                let relief = |laid: &Option<(Settled, LaidRoughly)>| {
                    laid.as_ref().map_or(f64::NEG_INFINITY, |laid| laid.0.evidence.relief)
                };
                if relief(&following) > relief(&whole) { following } else { whole }
            }
        }
    }

    fn whole(&self, setting: Arc<Setting>, finest: f64, stop: Stop<'_>) -> Option<(Settled, LaidRoughly)> {
        let found = self.aligned(&setting, stop)?;
        let pose = self.carried_by(&setting, &found, stop)?;
        self.bend(setting, (pose, 0), [finest, f64::INFINITY], Manner::Whole, stop)
    }

    /// The pose as a whole; where landmarks carry it, bent after these.
    fn carried_by(&self, setting: &Setting, found: &Similarity, stop: Stop<'_>) -> Option<Pose> {
        let mut pose = Pose::of(&self.rest, &self.nodes[0]);
        pose.places.iter_mut().for_each(|x| *x = found.apply(x));
        pose.maps.iter_mut().for_each(|m| *m = found.rotation * found.scale);
        if setting.held.len() >= LANDMARKS_CARRY {
            self.body(0)?.lead(&mut pose, &setting.held, LEADING, stop)?;
        }
        Some(pose)
    }

    /// The example as a whole on the input.
    fn aligned(&self, setting: &Setting, stop: Stop<'_>) -> Option<Similarity> {
        let count = setting.held.len().max(1) as f64;
        let pair = |held: &FramedLandmark| (held.at(&self.rest.positions), held.to, HELD_AS_WHOLE / count);
        let held: Vec<(Vec3, Vec3, f64)> = setting.held.iter().map(pair).collect();
        let (seen, sent, share) = (&setting.coarse, &setting.sent, self.share(setting));
        self.rigid.align(seen, (sent, share), &held, self.options.rounds, stop)
    }

    /// Lays the example on the input, roughly, after the landmarks and the axes of its limbs, which lead it there and then let go of it:
    /// for tips that may have been matched wrongly.
    pub fn led_roughly(
        &self,
        landmarks: &[VertexLandmark],
        axes: &[AxisPoint],
        stop: Stop<'_>,
    ) -> Option<(Settled, LaidRoughly)> {
        let (found, _) = held::carried(&self.rest, &self.ground, landmarks)?;
        let start: Vec<Vec3> = self.rest.positions.iter().map(|x| found.apply(x)).collect();
        let setting = Arc::new(self.setting(&start)?);
        let (finest, from) = if axes.is_empty() { LED_BY_TIPS } else { LED_ALONG };
        let axes = axes.iter().map(|point| point.seen_from(&setting.frame));
        let held: Vec<FramedLandmark> = landmarks.iter().map(|l| l.seen_from(&setting.frame)).chain(axes).collect();
        let mut pose = Pose::of(&self.rest, &self.nodes[0]);
        let body = self.body(0)?;
        for r in LED.into_iter().filter(|r| *r >= finest) {
            body.lead(&mut pose, &held, (r, FOLLOWING_ROUNDS), stop)?;
        }
        self.bend(setting, (pose, 0), [ROUGH, from], Manner::Following, stop)
    }

    /// Lays the example roughly after a start that is nearly right, its tips held on those that they match.
    pub fn held_roughly(
        &self,
        start: &[Vec3],
        tips: &[VertexLandmark],
        stop: Stop<'_>,
    ) -> Option<(Settled, LaidRoughly)> {
        let start = &*self.between.all(start);
        let mut setting = self.setting(start)?;
        setting.held = tips.iter().map(|tip| tip.seen_from(&setting.frame)).collect();
        self.following(Arc::new(setting), start, ROUGH, stop)
    }

    fn following(
        &self,
        setting: Arc<Setting>,
        start: &[Vec3],
        finest: f64,
        stop: Stop<'_>,
    ) -> Option<(Settled, LaidRoughly)> {
        let places: Vec<Vec3> = start.iter().map(|x| setting.frame.undo(x)).collect();
        let mut pose = Pose::of(&self.rest, &self.nodes[0]);
        let mut body = self.body(0)?;
        let mut level = 0;
        for (r, wanted) in FOLLOWING {
            self.change(&mut pose, &mut body, &mut level, wanted)?;
            body.follow(&mut pose, (&places, &setting.weights), &setting.held, (r, FOLLOWING_ROUNDS), stop)?;
        }
        let scales = [finest, FOLLOWED_FROM.max(finest)];
        let (settled, rough) = self.bend(setting, (pose.clone(), level), scales, Manner::Following, stop)?;
        // Finely it bends from where it follows the start, not from where it was bent to be compared.
        Some((settled, LaidRoughly { pose, level, from: FOLLOWED_FROM, ..rough }))
    }

    fn body(&self, level: usize) -> Option<Body<'_>> {
        let nodes = &self.nodes[level];
        let pattern = self.patterns[level].get_or_init(|| elastic::pattern(nodes)).clone()?;
        Some(Body::new(&self.rest, (nodes, pattern), &self.nodes[(level + 1).min(2)]))
    }

    /// Hands the pose over to other nodes.
    fn change<'s>(&'s self, pose: &mut Pose, body: &mut Body<'s>, level: &mut usize, wanted: usize) -> Option<()> {
        if *level != wanted {
            let all = pose.deformed(&self.rest, &self.nodes[*level]);
            *pose = pose.on(&self.nodes[*level], &self.nodes[wanted], &all);
            (*body, *level) = (self.body(wanted)?, wanted);
        }
        Some(())
    }

    /// Bends a pose, on nodes of a level, from one scale down to another and finds the places.
    fn bend(
        &self,
        setting: Arc<Setting>,
        (mut pose, mut level): (Pose, usize),
        scales: [f64; 2],
        manner: Manner,
        stop: Stop<'_>,
    ) -> Option<(Settled, LaidRoughly)> {
        self.bent(&setting, (&mut pose, &mut level), scales, stop)?;
        let settled = self.judged(&setting, &pose, level, manner);
        Some((settled, LaidRoughly { setting, pose, level, from: BELOW_ROUGH, manner }))
    }

    /// Bends a pose, on nodes of a level, at the scales from one down to another.
    fn bent<'s>(
        &'s self,
        setting: &Setting,
        (pose, level): (&mut Pose, &mut usize),
        [finest, from]: [f64; 2],
        stop: Stop<'_>,
    ) -> Option<()> {
        let fine = OnceCell::new();
        let see_finely = || FramedSamples::new(self.input.fine.seen_from(&setting.frame));
        let mut body: Body<'s> = self.body(*level)?;
        let mut partners = Partners::default();
        for (r, rounds, wanted) in SCALES.into_iter().filter(|s| (finest..=from).contains(&s.0)) {
            self.change(pose, &mut body, level, wanted)?;
            let seen = if r < FINE_BELOW { fine.get_or_init(see_finely) } else { &setting.coarse };
            let view = ScaleView { seen, sent: &setting.sent, share: self.share(setting), held: &setting.held };
            body.bend(pose, (view, &mut partners), (r, rounds), stop)?;
        }
        Some(())
    }

    /// Finds the places of a pose, and what speaks for it.
    fn judged(&self, setting: &Setting, pose: &Pose, level: usize, manner: Manner) -> Settled {
        let nodes = &self.nodes[level];
        let settled = pose.deformed(&self.rest, nodes);
        let beyond: Vec<Vec3> = settled.iter().map(|x| setting.frame.apply(x)).collect();
        let (mut places, lost) =
            place::places(&self.ground, &self.input.tree, &beyond, &self.rest.edge_lengths(&beyond));
        let mut lost = place::with_hidden(&self.rest, (&self.ground, setting.frame.scale), &beyond, &places, lost);
        let mut off = place::off(&self.rest, setting.frame.scale, &places);
        let judged = JudgedMap {
            rest: &self.rest,
            ground: &self.ground,
            frame: &setting.frame,
            nodes,
            pose,
            positions: &settled,
            places: &places,
            lost: &lost,
        };
        let evidence = judged.evidence(&self.nodes[1], &setting.coarse.samples);
        let own = self.between.own;
        places.truncate(own);
        lost.truncate(own);
        off.truncate(own);
        let positions = places.iter().map(|p| p.point).collect();
        Settled { places, positions, lost, off, evidence, manner }
    }

    /// Area, in the frame, that a sample sent stands for.
    fn share(&self, setting: &Setting) -> f64 {
        setting.area / setting.sent.points.len().max(1) as f64
    }

    /// The robust similarity from the start, and the input as seen from there.
    fn setting(&self, start: &[Vec3]) -> Option<Setting> {
        if start.len() != self.rest.positions.len() || start.iter().any(|x| !x.iter().all(|c| c.is_finite())) {
            return None;
        }
        let weights = self.counted(start);
        let frame = self.robust(start, &weights)?;
        let area = self.ground.area / (frame.scale * frame.scale);
        let coarse = FramedSamples::new(self.input.coarse.seen_from(&frame));
        let sent = self.input.sent.seen_from(&frame);
        let held = self.landmarks.iter().map(|l| l.seen_from(&frame)).collect();
        Some(Setting { frame, weights, coarse, sent, area, held })
    }

    /// 0 for start vertices that pile up on the input's rim, else 1.
    fn counted(&self, start: &[Vec3]) -> Vec<f64> {
        let near = PILED * PILED * self.ground.area;
        let free = |x: &Vec3| self.ground.along_rim.nearest(&[x.x, x.y, x.z]).is_none_or(|(_, squared)| squared > near);
        let weights: Vec<f64> = start.iter().map(|x| f64::from(u8::from(free(x)))).collect();
        let left: f64 = weights.iter().zip(&self.rest.areas).map(|(w, a)| w * a).sum();
        if left < COUNTED_MIN { vec![1.0; start.len()] } else { weights }
    }

    /// min Σ a ρ(|s R e + t − x|), ρ Cauchy's, by reweighting.
    fn robust(&self, start: &[Vec3], weights: &[f64]) -> Option<Similarity> {
        let base: Vec<f64> = self.rest.areas.iter().zip(weights).map(|(a, w)| a * w).collect();
        let mut now = base.clone();
        let mut found = None;
        for _ in 0..ROBUST_ROUNDS {
            let pairs = self.rest.positions.iter().zip(start).zip(&now).map(|((e, x), w)| (*e, *x, *w));
            let fit = Similarity::fit(pairs)?;
            let distances: Vec<f64> =
                self.rest.positions.iter().zip(start).map(|(e, x)| (fit.apply(e) - x).norm() / fit.scale).collect();
            let sigma = matches::sigma(&distances, &self.rest.areas, 0.0) / matches::SIGMA * ROBUST_SIGMA + 1e-9;
            now.iter_mut()
                .zip(base.iter().zip(&distances))
                .for_each(|(w, (b, d))| *w = b / (1.0 + (d / sigma).powi(2)).powi(2));
            found = Some(fit);
        }
        found
    }
}

#[cfg(test)]
mod tests;
