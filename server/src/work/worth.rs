//! Which segments of a query are worth an example that nobody asked for.
//!
//! A ragged scan falls into a hundred pieces of a few faces. Each would be registered, mapped and charted like any
//! other, which for a file of a few kilobytes took minutes. So of a query of many segments only some are ranked beyond
//! the coarsest level and given maps unasked: those of most faces, as many as the mesh has faces for. A handful of
//! faces has no form that an example could be laid on, and a coarse mesh little to choose between examples by: laying
//! one costs the same as on a scan of a million. Only faces that tell of the form count (`topology/form`): a fan of a
//! million needles is worth as much as a dozen triangles. The others take regular layouts; a map that is asked for is
//! made all the same.

use super::engine::ModelSegment;
pub use quadmuse_kernel::pipeline::{FACES_CHOSEN_MIN, FACES_OF_SCAN_MIN};

/// Segments of which each is worth it.
const FEW: usize = 8;
/// Segments that are worth it, at most.
const MANY: usize = 32;
/// Faces of the mesh for each segment beyond the few.
const FACES_PER_SEGMENT: u64 = 256;
/// Faces of a segment that is given a map, or ranked where there are more than a few.
const FACES_MIN: u64 = 16;
/// Entries of a ranking that are tried for a segment that is a third of the mesh or more.
const TRIES: usize = 3;
/// Where but one of so many faces tells of a form, hardly any does. Of scans and their parts at least one of two does. *Untuned.*
const FACES_PER_FORM: u64 = 16;
/// Faces of a segment on average below which a scan of many segments is ragged, and only those with enough form are worth it.
const RAGGED_BELOW_FACES: u64 = 96;
/// Of more than a few segments one with less of the surface is not worth it, however many faces it has: the rivets of an armour, the
/// joints of a puppet's fingers. *Untuned:* a finger is .004 of a body, an eye .01 of a head.
const SHARE_WORTH: f64 = 0.002;

/// A segment with less of the faces is a small part of its scan.
const SHARE_MIN: f64 = 0.25;

/// Tells whether a segment has less than a quarter of the faces that tell of a scan's form, and is not most of its surface, as one full
/// of holes may be.
pub fn is_small_part(segments: &[ModelSegment], segment: usize) -> bool {
    let all = segments.iter().map(|s| s.form).sum::<u64>();
    segments.get(segment).is_some_and(|own| !own.is_main && (own.form as f64) < SHARE_MIN * all as f64)
}

/// Whether a segment, by its number, is worth it.
pub fn is_worth_an_example(segments: &[ModelSegment], segment: usize) -> bool {
    let Some(&ModelSegment { faces: sent, form: own, share, .. }) = segments.get(segment) else { return false };
    if segments.len() <= FEW {
        // What has no form at all is not worth it however few they are; a few faces as sent are.
        return own >= sent.min(FACES_MIN);
    }
    let faces = segments.iter().map(|s| s.form).sum::<u64>();
    let most = usize::try_from(faces / FACES_PER_SEGMENT).unwrap_or(MANY).clamp(FEW, MANY);
    let is_before = |(at, s): &(usize, &ModelSegment)| s.form > own || (s.form == own && *at < segment);
    let is_ragged = faces < RAGGED_BELOW_FACES * segments.len() as u64;
    let own_min = if is_ragged { FACES_CHOSEN_MIN } else { FACES_MIN };
    own >= own_min && share >= SHARE_WORTH && segments.iter().enumerate().filter(is_before).count() < most
}

/// Tells whether a segment is a third of a scan at least, with enough form to choose an example by. A flat one has but an outline.
pub fn is_much_of_scan(segments: &[ModelSegment], segment: usize) -> bool {
    let all = segments.iter().map(|s| s.form).sum::<u64>();
    let faces = segments.get(segment).filter(|s| !s.is_flat).map_or(0, |s| s.form);
    3 * faces >= all && faces >= FACES_CHOSEN_MIN && all >= FACES_OF_SCAN_MIN
}

/// How many examples of a segment's ranking are laid on it unasked, until one is not poor. Of a part between others only the
/// first is: a regular layout between its neighbours has better angles than an example that fits but fairly. Queries tell it, so
/// that whoever asks for maps one by one asks for as many.
pub fn tries(segments: &[ModelSegment], segment: usize) -> usize {
    match segments.get(segment).map(|s| s.form) {
        Some(faces) if faces >= FACES_MIN && is_worth_an_example(segments, segment) => {
            if is_much_of_scan(segments, segment) { TRIES } else { 1 }
        }
        _ => 0,
    }
}

/// How many of the best of a segment's ranking have their poles sought before anybody chooses among them, of the `top` that are
/// shown. A search costs some forty pictures of all faces, whatever they tell: where hardly any tells of a form, or all lie flat, only
/// the best is finished; another is when it is chosen.
pub fn choices(segments: &[ModelSegment], segment: usize, top: usize) -> usize {
    let is_worth_it = segments.get(segment).is_some_and(|s| !s.is_flat && FACES_PER_FORM * s.form >= s.faces);
    if is_worth_it { top } else { top.min(1) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use quadmuse_proto::Topology;

    fn whole(faces: u64, form: u64) -> ModelSegment {
        ModelSegment { form, ..ModelSegment::of(Topology::Disc, faces) }
    }

    fn worth(faces: &[u64]) -> usize {
        let segment = |&faces: &u64| whole(faces, faces);
        let segments: Vec<ModelSegment> = faces.iter().map(segment).collect();
        (0..segments.len()).filter(|&s| is_worth_an_example(&segments, s)).count()
    }

    #[test]
    fn few_segments_are_all_worth_it_and_of_a_ragged_scan_those_of_most_faces() {
        assert_eq!(worth(&[1; 8]), 8);
        assert_eq!(worth(&[1; 118]), 0);
        assert_eq!(worth(&[18; 118]), 0);
        assert_eq!(worth(&[72; 19]), 0);
        assert_eq!(worth(&[100; 20]), 8);
        assert_eq!(worth(&[1000; 12]), 12);
        assert_eq!(worth(&[1000; 118]), 32);
        let mut mixed = vec![1; 100];
        mixed.extend([900; 10]);
        assert_eq!(worth(&mixed), 10);
    }

    #[test]
    fn of_many_segments_one_with_hardly_any_area_is_not_worth_it() {
        let of = |share| ModelSegment { share, ..whole(264, 264) };
        let worth =
            |segments: &[ModelSegment]| (0..segments.len()).filter(|&s| is_worth_an_example(segments, s)).count();
        assert_eq!((worth(&[of(0.3), of(0.001)]), worth(&[of(0.1); 10]), worth(&[of(0.001); 10])), (2, 10, 0));
    }

    #[test]
    fn examples_are_laid_on_what_has_form_and_tried_where_there_is_something_to_choose_by() {
        let tries = |faces: &[u64]| {
            let segment = |&faces: &u64| whole(faces, faces);
            tries(&faces.iter().map(segment).collect::<Vec<_>>(), 0)
        };
        assert_eq!([tries(&[]), tries(&[1]), tries(&[12]), tries(&[100]), tries(&[50_000])], [0, 0, 0, 1, TRIES]);
        assert_eq!([tries(&[1000, 2001]), tries(&[1, 1000]), tries(&[1000, 2000])], [1, 0, TRIES]);
        assert_eq!([tries(&[511]), tries(&[512]), tries(&[250, 250])], [1, TRIES, 1]);
    }

    #[test]
    fn one_choice_is_finished_where_most_faces_tell_nothing_and_all_of_a_scan_however_coarse() {
        let of = whole;
        let segments = [of(300_000, 700), of(20, 20), of(40_000, 40_000), of(40_000, 2_499)];
        assert_eq!([0, 1, 2, 3].map(|s| choices(&segments, s, 4)), [1, 4, 4, 1]);
        let flat = [ModelSegment { is_flat: true, ..of(40_000, 40_000) }];
        assert_eq!((choices(&flat, 0, 4), tries(&flat, 0), is_much_of_scan(&flat, 0)), (1, 1, false));
    }

    #[test]
    fn faces_that_tell_nothing_of_a_form_count_for_nothing() {
        let of = whole;
        let needles = [of(100_000, 4)];
        assert_eq!((tries(&needles, 0), is_worth_an_example(&needles, 0)), (0, false));
        let strip = [of(100_000, 200)];
        assert_eq!((tries(&strip, 0), is_much_of_scan(&strip, 0)), (1, false));
        assert!(!is_much_of_scan(&[of(100_000, 4), of(2_000, 300)], 1), "few of all that count");
        let parts = [of(100_000, 249), of(751, 751)];
        assert!(is_small_part(&parts, 0) && !is_small_part(&parts, 1) && !is_small_part(&[], 0));
        assert!(!is_small_part(&[ModelSegment { is_main: true, ..parts[0] }, parts[1]], 0));
    }
}
