//! The coarse ranking: the best of a corpus of any size at 32², exactly as if every segment had been looked at.
//!
//! For each hypothesis h (a flip, and rival poles of the query) cost_h = min_t E_h(t) / (var A + var B); the one with
//! the least cost is taken, mirrors multiplied by [`MIRROR_MARGIN`] beforehand and left out where the example is its own
//! mirror image; its cost gives E′. A sweep bounds E′ of each segment from both sides; whoever could be among the best
//! `kept` by its lower bound is computed in f64. So the order of the best doesn't depend on the sweep's rounding.
//! *Source:* paper §5.2, Eq. 8; METHOD §5, §6. *Ours, not the paper's:* that the coarsest level is ranked by translations
//! alone, before any feature moves.

use crate::rank::{SegmentShape, score};
use crate::register::Flip;
use crate::register::entry::MIRROR_MARGIN;
use crate::register::query::{Query, Unfolded};
use crate::register::spectra::{Block, LANES, Narrow, PEAK_ERROR, Row, Spectrum};
use crate::topology::Topology;
use std::sync::Arc;

/// Below this sum of variances two pictures are flat, and only their means tell them apart.
const VARIANCE_MIN: f64 = 1e-12;
/// More than the relative error of what is computed in f64 around a sweep, and of narrowing a bound to f32.
const SLACK: f64 = 1e-6;

/// A query, prepared for sweeps.
#[derive(Clone, Debug)]
pub struct CoarseQuery {
    topology: Topology,
    sides: Vec<QueryUnfolding>,
    arch: pulp::Arch,
}

/// The query unfolded with some poles, its rows as they are or reversed.
#[derive(Clone, Debug)]
struct QueryUnfolding {
    pole: usize,
    flip_v: bool,
    shape: SegmentShape,
    spectrum: Spectrum,
    narrow: Narrow,
}

/// The facts that are known of an example beside its row.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RowFacts {
    /// Its modulus and how it bends.
    pub shape: SegmentShape,
    /// Mean of √λ.
    pub mean: f64,
    /// Variance of √λ.
    pub variance: f64,
    /// Whether it is its own mirror image.
    pub symmetric: bool,
}

impl RowFacts {
    /// Of a row.
    pub fn of(row: &Row, shape: SegmentShape) -> Self {
        Self { shape, mean: f64::from(row.mean), variance: row.variance, symmetric: row.symmetric }
    }
}

/// E′ lies between these.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Never above E′.
    pub low: f32,
    /// Never below E′.
    pub high: f32,
}

impl Bounds {
    /// Of one that isn't ranked.
    pub const NONE: Self = Self { low: f32::INFINITY, high: f32::INFINITY };
}

/// The best translation of an example.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Translation {
    /// E′.
    pub score: f64,
    /// E.
    pub energy: f64,
    /// E / (var √λ₁ + var √λ₂).
    pub cost: f64,
    /// How the example is mirrored.
    pub flip: Flip,
    /// By how many pixels of 32 it is moved along u.
    pub shift: usize,
    /// Which of the query's candidates for its poles.
    pub pole: usize,
}

/// One hypothesis, with the bounds of its score.
#[derive(Clone, Copy)]
struct BoundedHypothesis {
    handicapped: [f64; 2],
    score: [f64; 2],
}

impl CoarseQuery {
    /// Prepares a query that bends so for examples of a topology, with all poles worth trying and the parts of it that could
    /// match.
    pub fn new(query: &Query, topology: Topology, bending: Option<f32>) -> Self {
        let spectrum = |unfolded: &Arc<Unfolded>| {
            // How a part bends isn't known.
            let bending = bending.filter(|_| unfolded.is_whole());
            let shape = SegmentShape { modulus: unfolded.encoding.modulus, bending };
            Some((Spectrum::new(unfolded.images.first()?)?, shape))
        };
        Self::from_spectra(topology, query.candidates_for(topology).iter().filter_map(spectrum).collect())
    }

    /// Prepares a query of these spectra and shapes, one for each choice of poles.
    pub fn from_spectra(topology: Topology, spectra: Vec<(Spectrum, SegmentShape)>) -> Self {
        let flips: &[Flip] = match topology {
            Topology::Disc => &[Flip { u: false, v: false }],
            _ => &[Flip { u: false, v: false }, Flip { u: false, v: true }],
        };
        let side = |pole: usize, spectrum: &Spectrum, shape: SegmentShape, flip: Flip| {
            let spectrum = spectrum.turned(flip);
            QueryUnfolding { pole, flip_v: flip.v, shape, narrow: spectrum.narrow(), spectrum }
        };
        let all = spectra.iter().enumerate();
        let sides = all.flat_map(|(pole, (s, shape))| flips.iter().map(move |&flip| side(pole, s, *shape, flip)));
        Self { topology, sides: sides.collect(), arch: pulp::Arch::new() }
    }

    /// What [`CoarseQuery::from_spectra`] makes the same query of.
    pub fn spectra(&self) -> impl Iterator<Item = (&Spectrum, SegmentShape)> {
        self.sides.iter().filter(|side| !side.flip_v).map(|side| (&side.spectrum, side.shape))
    }

    /// What the query is.
    pub fn topology(&self) -> Topology {
        self.topology
    }

    /// Bounds of E′ for the pictures of a block; lanes without facts are none.
    pub fn sweep(&self, block: &Block, facts: &[Option<RowFacts>], relevance: &[f64]) -> [Bounds; LANES] {
        let peaks: Vec<[[f32; LANES]; 2]> = self.sides.iter().map(|s| block.peaks(&s.narrow, self.arch)).collect();
        let mut bounds = [Bounds::NONE; LANES];
        let mut hypotheses = Vec::with_capacity(2 * self.sides.len());
        for (lane, ((bound, facts), relevance)) in bounds.iter_mut().zip(facts).zip(relevance).enumerate() {
            let Some(facts) = facts else { continue };
            hypotheses.clear();
            for (side, peaks) in self.sides.iter().zip(&peaks) {
                let factor = score(1.0, facts.shape, side.shape, *relevance);
                for flip_u in [false, true] {
                    let flip = Flip { u: flip_u, v: side.flip_v };
                    if flip.is_mirror() && facts.symmetric {
                        continue;
                    }
                    let peak = f64::from(peaks[usize::from(flip_u)][lane]);
                    hypotheses.push(side.bounded(facts, peak, flip, factor));
                }
            }
            *bound = combined(&hypotheses);
        }
        bounds
    }

    /// The best translation of an example, in f64; `None` for a query without a picture.
    pub fn translation(&self, row: &Row, shape: SegmentShape, relevance: f64) -> Option<Translation> {
        let facts = RowFacts::of(row, shape);
        let mut best: Option<(f64, Translation)> = None;
        for side in &self.sides {
            let peaks = row.peaks(&side.spectrum);
            for (flip_u, peak) in [false, true].into_iter().zip(peaks) {
                let flip = Flip { u: flip_u, v: side.flip_v };
                if flip.is_mirror() && facts.symmetric {
                    continue;
                }
                let (energy, variance) = side.energy(&facts, peak.value);
                let cost = cost(energy, variance);
                let handicapped = cost * handicap(flip);
                if best.as_ref().is_none_or(|(least, _)| handicapped < *least) {
                    let score = score(cost, shape, side.shape, relevance);
                    let shift = peak.shift;
                    best = Some((handicapped, Translation { score, energy, cost, flip, shift, pole: side.pole }));
                }
            }
        }
        best.map(|(_, translation)| translation)
    }
}

fn handicap(flip: Flip) -> f64 {
    if flip.is_mirror() { MIRROR_MARGIN } else { 1.0 }
}

fn cost(energy: f64, variance: f64) -> f64 {
    energy / variance.max(VARIANCE_MIN)
}

impl QueryUnfolding {
    /// E and var A + var B.
    fn energy(&self, facts: &RowFacts, peak: f64) -> (f64, f64) {
        let variance = facts.variance + self.spectrum.variance;
        let gap = facts.mean - self.spectrum.mean;
        ((gap * gap + variance - 2.0 * peak).max(0.0), variance)
    }

    /// `factor` is what E′ has beside the cost.
    fn bounded(&self, facts: &RowFacts, peak: f64, flip: Flip, factor: f64) -> BoundedHypothesis {
        let (energy, variance) = self.energy(facts, peak);
        let error = PEAK_ERROR * variance + SLACK * energy;
        let costs = [(energy - error).max(0.0), energy + error].map(|e| cost(e, variance));
        BoundedHypothesis { handicapped: costs.map(|c| c * handicap(flip)), score: costs.map(|c| c * factor) }
    }
}

/// E′ is that of one of the hypotheses that could be the best.
fn combined(hypotheses: &[BoundedHypothesis]) -> Bounds {
    let least = hypotheses.iter().map(|h| h.handicapped[1]).fold(f64::INFINITY, f64::min);
    let could = hypotheses.iter().filter(|h| h.handicapped[0] <= least);
    let (low, high) = could.fold((f64::INFINITY, 0.0f64), |(low, high), h| (low.min(h.score[0]), high.max(h.score[1])));
    Bounds { low: (low * (1.0 - SLACK)) as f32, high: (high * (1.0 + SLACK)) as f32 }
}

/// The places of all that could be among the best `kept`, ascending.
pub fn could_be_kept(bounds: &[Bounds], kept: usize) -> Vec<usize> {
    let mut highs: Vec<f32> = bounds.iter().map(|b| b.high).filter(|high| high.is_finite()).collect();
    if kept == 0 || highs.is_empty() {
        return Vec::new();
    }
    let at = kept.min(highs.len()) - 1;
    let limit = *highs.select_nth_unstable_by(at, f32::total_cmp).1;
    (0..bounds.len()).filter(|&k| bounds[k].low <= limit).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encode::Picture;
    use crate::register::image::Image;
    use crate::register::spectra::tests::{kept, picture};
    use crate::register::spectra::{SIDE, VALUES};
    use crate::register::translation_energies;

    struct Segment {
        row: Row,
        shape: SegmentShape,
        relevance: f64,
    }

    fn segment(picture: &Picture, topology: Topology, k: u64) -> Segment {
        let row = Row::new(&Image::new(picture, Flip::default(), false), topology).expect("of 32²");
        let bending = (!k.is_multiple_of(4)).then_some(2.0 + (k % 5) as f32);
        Segment {
            row,
            shape: SegmentShape { modulus: 0.2 + 0.05 * (k % 7) as f64, bending },
            relevance: (k % 6) as f64,
        }
    }

    /// E′ straight from the definition: every pixel of every shift of every flip against every candidate of the query.
    fn exhaustive(queries: &[(Image, SegmentShape)], topology: Topology, s: &Segment) -> f64 {
        let mut best = (f64::INFINITY, f64::INFINITY);
        for (query, shape) in queries {
            for &flip in Flip::all(topology) {
                if flip.is_mirror() && s.row.symmetric {
                    continue;
                }
                let example = kept(&s.row, flip);
                let energies = translation_energies(&example, query);
                let energy = energies.into_iter().fold(f64::INFINITY, f64::min);
                let cost = energy / (example.variance + query.variance).max(VARIANCE_MIN);
                let handicapped = if flip.is_mirror() { cost * MIRROR_MARGIN } else { cost };
                if handicapped < best.0 {
                    best = (handicapped, score(cost, s.shape, *shape, s.relevance));
                }
            }
        }
        best.1
    }

    fn ranked(query: &CoarseQuery, corpus: &[Segment], most: usize) -> Vec<(usize, f64)> {
        let mut bounds = Vec::new();
        for lanes in corpus.chunks(LANES) {
            let (mut block, mut facts, mut relevance) = (Block::default(), [None; LANES], [0.0; LANES]);
            for (lane, s) in lanes.iter().enumerate() {
                block.put(lane, &s.row);
                (facts[lane], relevance[lane]) = (Some(RowFacts::of(&s.row, s.shape)), s.relevance);
            }
            bounds.extend(query.sweep(&block, &facts, &relevance));
        }
        let exact = |k: usize| (k, query.translation(&corpus[k].row, corpus[k].shape, corpus[k].relevance));
        let could = could_be_kept(&bounds, most).into_iter().map(exact);
        let mut all: Vec<(usize, f64)> = could.map(|(k, t)| (k, t.expect("a picture").score)).collect();
        for &(k, score) in &all {
            let (low, high) = (f64::from(bounds[k].low), f64::from(bounds[k].high));
            assert!((low..=high).contains(&score), "{k}: {score} not in {low}..{high}");
        }
        all.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
        all.truncate(most);
        all
    }

    fn compare(pictures: &[Picture], topology: Topology) {
        let corpus: Vec<Segment> = (0u64..).zip(pictures).map(|(k, p)| segment(p, topology, k)).collect();
        let shape = |modulus| SegmentShape { modulus, bending: Some(3.5) };
        let queries: Vec<(Image, SegmentShape)> =
            [(3, 0.3), (1003, 0.42)].map(|(s, m)| (Image::new(&picture(s), Flip::default(), false), shape(m))).into();
        let spectra = queries.iter().map(|(image, m)| (Spectrum::new(image).expect("of 32²"), *m)).collect();
        let query = CoarseQuery::from_spectra(topology, spectra);
        let mut plain: Vec<f64> = corpus.iter().map(|s| exhaustive(&queries, topology, s)).collect();
        let ranked = ranked(&query, &corpus, 12);
        for &(k, score) in &ranked {
            assert!((score - plain[k]).abs() < 1e-5 * plain[k].max(0.1), "{k}: {score} and {}", plain[k]);
        }
        let kept: Vec<f64> = ranked.iter().map(|(k, _)| plain[*k]).collect();
        plain.sort_by(f64::total_cmp);
        for (one, other) in kept.iter().zip(&plain) {
            assert!((one - other).abs() < 1e-5 * other.max(0.1), "{one} in place of {other}");
        }
    }

    #[test]
    fn the_ranking_is_the_exhaustive_one_on_random_pictures() {
        let pictures: Vec<Picture> = (1..90).map(picture).collect();
        compare(&pictures, Topology::Disc);
        compare(&pictures[..40], Topology::Annulus);
    }

    #[test]
    fn the_ranking_is_the_exhaustive_one_on_flat_shifted_mirrored_and_equal_pictures() {
        let mut pictures = vec![picture(0); 5];
        for by in 0..SIDE {
            for mirrored in [false, true] {
                let from = picture(3 + (by as u64 % 2) * 1000);
                let at = |k: usize| {
                    let x = (k % SIDE + by) % SIDE;
                    from.values[k / SIDE * SIDE + if mirrored { SIDE - 1 - x } else { x }]
                };
                pictures.push(Picture { side: SIDE, values: (0..VALUES).map(at).collect() });
            }
        }
        pictures.extend(std::iter::repeat_n(picture(5), 9));
        compare(&pictures, Topology::Disc);
        compare(&pictures, Topology::Sphere);
    }

    #[test]
    fn equal_pictures_have_equal_scores_whatever_their_lane() {
        let corpus: Vec<Segment> = (0..40).map(|_| segment(&picture(8), Topology::Disc, 2)).collect();
        let query = Spectrum::new(&Image::new(&picture(2), Flip::default(), false)).expect("of 32²");
        let query =
            CoarseQuery::from_spectra(Topology::Disc, vec![(query, SegmentShape { modulus: 0.4, bending: None })]);
        let ranked = ranked(&query, &corpus, 10);
        assert!(ranked.iter().all(|r| r.1.to_bits() == ranked[0].1.to_bits()));
        assert_eq!(ranked.iter().map(|r| r.0).collect::<Vec<_>>(), (0..10).collect::<Vec<_>>());
    }

    #[test]
    fn what_is_not_ranked_is_never_kept() {
        let some = |low, high| Bounds { low, high };
        let bounds = [some(0.3, 0.4), Bounds::NONE, some(0.1, 0.2), some(0.35, 0.5), some(0.39, 0.6)];
        assert_eq!(could_be_kept(&bounds, 2), [0, 2, 3, 4]);
        assert_eq!(could_be_kept(&bounds, 1), [2]);
        assert_eq!(could_be_kept(&bounds, 9), [0, 2, 3, 4]);
        assert_eq!(could_be_kept(&[Bounds::NONE], 3), Vec::<usize>::new());
    }
}
