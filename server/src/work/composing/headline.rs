//! The headline of a composition: its verdict, how much of it is an example's, and why.

use super::super::engine::Appraisal;
use quadmuse_proto::{Covers, Verdict};

/// A map that makes up less of a composition than this does not decide what it is called.
const SHARE_COUNTED: f64 = 0.03;
/// Below this share of examples a composition is fair at best: most of it is nobody's layout.
const INSPIRED_GOOD: f64 = 0.5;
/// Where more of a composition's area looks away from the scan it is crumpled to the eye. Of the results of 40 scans those that look
/// smooth have up to 6.5 %, those with crumpled ears, wings or limbs 8.9 to 15.8 % (tests/records).
const CRUMPLED_MIN: f64 = 0.08;
/// Where parts of the scan are left bare because they could not be joined, a composition that covers less of it than this is poor:
/// a head without its horns is no layout of the head. *Untuned.*
const COVERED_MIN: f64 = 0.8;
/// Where more of a composition's area is the scan's own triangles as quads it is poor: that is nobody's layout. *Untuned.*
pub(super) const OWN_MAX: f64 = 0.02;
/// Reasons that a composition takes over from one map.
const REASONS_EACH: usize = 2;

/// The map that was brought for a segment.
#[derive(Clone, Debug)]
pub(super) struct BroughtMap {
    pub(super) verdict: Verdict,
    pub(super) reasons: Vec<String>,
    /// Share of it that is the example's.
    pub(super) inspired: f64,
    /// Share of the example that lies on the input.
    pub(super) covers_example: f64,
}

/// What stands at the top of a composition.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Headline {
    pub(super) verdict: Verdict,
    pub(super) inspired: f64,
    pub(super) reasons: Vec<String>,
    pub(super) covers: Covers,
}

impl Headline {
    /// Says what is left bare where maps stand side by side in place of a stitched mesh. `has_bare_parts`: the scan's smaller parts
    /// are; what else is, the maps tell.
    pub(super) fn tell_side_by_side(&mut self, has_bare_parts: bool) {
        let percent = 100.0 * (1.0 - self.covers.input);
        let is_much = self.covers.input < COVERED_MIN;
        if is_much {
            self.verdict = self.verdict.max(Verdict::Poor);
        }
        if !has_bare_parts {
            return;
        }
        self.verdict = self.verdict.max(Verdict::Fair);
        let reason = format!(
            "the smaller parts of the scan are left bare, {percent:.0} % of it: with them the mesh was broken or crumpled, or \
             lost the example"
        );
        self.reasons.insert(if is_much { 0 } else { self.reasons.len() }, reason);
    }
}

/// Of what was brought for each segment, and what came of it.
pub(super) fn headline(brought: &[Option<BroughtMap>], appraisal: &Appraisal) -> Headline {
    let used = || {
        let all = (0u32..).zip(brought.iter().zip(&appraisal.examples));
        all.filter_map(|(segment, (laid, share))| Some((segment, laid.as_ref()?, *share))).filter(|part| part.2 > 0.0)
    };
    let whole: f64 = used().map(|part| part.2).sum();
    let inspired = used().map(|(_, laid, share)| share * laid.inspired).sum::<f64>().clamp(0.0, 1.0).abs();
    let mean = used().map(|(_, laid, share)| share * laid.covers_example).sum::<f64>() / whole.max(f64::MIN_POSITIVE);
    let covers = Covers { example: if whole > 0.0 { mean } else { 0.0 }, input: appraisal.covered };
    let (mut verdict, mut reasons) = (Verdict::Good, appraisal.flaws.clone());
    if !reasons.is_empty() {
        verdict = Verdict::Broken;
    }
    if inspired <= 0.0 {
        reasons.push(without_example(brought).into());
        return Headline { verdict: verdict.max(Verdict::Poor), inspired, reasons, covers };
    }
    let counts = |share: f64| share >= SHARE_COUNTED * whole;
    for (segment, laid, _) in used().filter(|part| counts(part.2) && part.1.verdict > Verdict::Good) {
        verdict = verdict.max(laid.verdict.min(Verdict::Poor));
        let of = if brought.len() > 1 { format!("segment {segment}: ") } else { String::new() };
        reasons.extend(laid.reasons.iter().take(REASONS_EACH).map(|reason| format!("{of}{reason}")));
    }
    if is_crumpled(appraisal) && verdict < Verdict::Broken {
        // Where it is the rest that is, nothing speaks against the examples.
        let is_by_examples = appraisal.turned_of_examples > CRUMPLED_MIN;
        verdict = verdict.max(if is_by_examples { Verdict::Poor } else { Verdict::Fair });
        let percent = 100.0 * appraisal.turned;
        reasons.insert(0, format!("{percent:.0} % of its area is crumpled: quads stand off the scan's surface"));
    }
    if appraisal.own > OWN_MAX && verdict < Verdict::Broken {
        verdict = Verdict::Poor;
        let percent = 100.0 * appraisal.own;
        reasons.insert(
            0,
            format!("{percent:.0} % of it is the scan's own triangles as quads: nothing else could be joined there"),
        );
    }
    if inspired < INSPIRED_GOOD {
        verdict = verdict.max(Verdict::Fair);
        reasons.push(format!("examples make up {:.0} % of it; the rest is regular layouts", 100.0 * inspired));
    }
    Headline { verdict, inspired, reasons, covers }
}

/// Tells whether so much of a composition looks away from the scan that it is crumpled to the eye.
pub(super) fn is_crumpled(appraisal: &Appraisal) -> bool {
    appraisal.turned > CRUMPLED_MIN
}

/// Why no example was used.
fn without_example(brought: &[Option<BroughtMap>]) -> &'static str {
    let mut maps = brought.iter().flatten();
    match (maps.clone().next(), maps.all(|laid| laid.verdict.is_poor())) {
        (None, _) => "no example was used: none of the corpus lies well on it, so it is a regular layout",
        (_, true) => "no example was used: those that rank best fit poorly, so it is a regular layout",
        (_, false) => {
            "no example was used: what was laid could not be joined, was broken, or made up too little, so it is a regular layout"
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn laid(verdict: Verdict) -> Option<BroughtMap> {
        let reasons = if verdict == Verdict::Good { Vec::new() } else { vec!["its ears differ".to_owned()] };
        Some(BroughtMap { verdict, reasons, inspired: 1.0, covers_example: 0.8 })
    }

    fn of(examples: &[f64]) -> Appraisal {
        Appraisal { examples: examples.to_vec(), covered: 0.99, ..Appraisal::default() }
    }

    #[test]
    fn the_worst_map_of_a_share_worth_telling_decides() {
        let brought = [laid(Verdict::Good), laid(Verdict::Fair), None];
        let made = headline(&brought, &of(&[0.6, 0.2, 0.0]));
        assert_eq!((made.verdict, &made.reasons[..]), (Verdict::Fair, &["segment 1: its ears differ".to_owned()][..]));
        assert!((made.inspired - 0.8).abs() < 1e-12 && (made.covers.example - 0.8).abs() < 1e-12, "{made:?}");
        // The same map on a sliver.
        let made = headline(&brought, &of(&[0.6, 0.01, 0.0]));
        assert_eq!((made.verdict, made.reasons.len()), (Verdict::Good, 0));
    }

    #[test]
    fn what_is_mostly_regular_is_fair_and_what_has_no_example_poor() {
        let brought = [laid(Verdict::Good), None];
        let made = headline(&brought, &of(&[0.3, 0.0]));
        assert_eq!((made.verdict, made.inspired), (Verdict::Fair, 0.3));
        assert!(made.reasons[0].contains("30 %"), "{made:?}");
        for (brought, why) in [
            ([None, None], "none of the corpus"),
            ([laid(Verdict::Poor), None], "fit poorly"),
            ([laid(Verdict::Good), None], "could not be joined"),
        ] {
            let made = headline(&brought, &of(&[0.0, 0.0]));
            assert_eq!((made.verdict, made.inspired), (Verdict::Poor, 0.0));
            assert!(made.reasons[0].starts_with("no example was used: ") && made.reasons[0].contains(why), "{made:?}");
        }
    }

    #[test]
    fn what_is_crumpled_is_poor_whatever_its_maps_are() {
        let crumpled = |turned: f64, turned_of_examples: f64| {
            headline(&[laid(Verdict::Good)], &Appraisal { turned, turned_of_examples, ..of(&[1.0]) })
        };
        assert_eq!(crumpled(0.05, 0.05).verdict, Verdict::Good);
        assert_eq!(crumpled(0.12, 0.02).verdict, Verdict::Fair, "antlers beside a deer");
        let made = crumpled(0.12, 0.12);
        assert_eq!((made.verdict, made.inspired), (Verdict::Poor, 1.0));
        assert!(made.reasons[0].starts_with("12 % of its area is crumpled"), "{made:?}");
    }

    #[test]
    fn what_is_the_scans_own_triangles_is_poor() {
        let cut = |own: f64| headline(&[laid(Verdict::Good)], &Appraisal { own, ..of(&[0.9]) });
        assert_eq!(cut(0.01).verdict, Verdict::Good);
        let made = cut(0.08);
        assert_eq!(made.verdict, Verdict::Poor);
        assert!(made.reasons[0].starts_with("8 % of it is the scan's own triangles"), "{made:?}");
    }

    #[test]
    fn what_leaves_much_of_the_scan_bare_is_poor_and_says_so_first() {
        let bare = |covered: f64| {
            let appraisal = Appraisal { covered, ..of(&[1.0]) };
            let mut made = headline(&[laid(Verdict::Fair)], &appraisal);
            made.tell_side_by_side(true);
            made
        };
        let (much, little) = (bare(0.7), bare(0.95));
        assert_eq!((much.verdict, little.verdict), (Verdict::Poor, Verdict::Fair));
        assert!(much.reasons[0].contains("are left bare, 30 % of it") && little.reasons[1].contains("5 %"), "{much:?}");
        let mut beside = headline(&[laid(Verdict::Fair)], &Appraisal { covered: 0.7, ..of(&[1.0]) });
        let reasons = beside.reasons.clone();
        beside.tell_side_by_side(false);
        assert_eq!((beside.verdict, beside.reasons), (Verdict::Poor, reasons), "its map says what is bare");
    }

    #[test]
    fn a_mesh_that_is_no_use_is_broken_whatever_its_maps_are() {
        let flaws = vec!["edges cross".to_owned()];
        let made = headline(&[laid(Verdict::Good)], &Appraisal { flaws: flaws.clone(), ..of(&[1.0]) });
        assert_eq!((made.verdict, made.reasons, made.inspired), (Verdict::Broken, flaws, 1.0));
        // A map that was broken by itself may have been mended as it was stitched.
        assert_eq!(headline(&[laid(Verdict::Broken)], &of(&[1.0])).verdict, Verdict::Poor);
    }
}
