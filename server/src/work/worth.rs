//! Which segments of a query are worth an example that nobody asked for.
//!
//! A rag falls into a hundred pieces of a few faces. Each would be registered, mapped and charted like any other, which for a file
//! of a few kilobytes took minutes. So of a query of many segments only some are ranked beyond the coarsest level and given
//! maps unasked: those of most faces, as many as the mesh has faces for. The others take regular layouts; a map that is asked
//! for is made all the same.

use super::engine::ModelSegment;

/// Segments of which each is worth it.
const FEW: usize = 8;
/// Segments that are worth it, at most.
const MANY: usize = 32;
/// Faces of the mesh for each segment beyond the few.
const FACES_PER_SEGMENT: u64 = 256;
/// Faces of a segment, where there are more than a few.
const FACES_MIN: u64 = 16;

/// Whether a segment, by its number, is worth it.
pub fn is_worth_an_example(segments: &[ModelSegment], segment: usize) -> bool {
    let Some(own) = segments.get(segment).map(|s| s.faces) else { return false };
    if segments.len() <= FEW {
        return true;
    }
    let faces = segments.iter().map(|s| s.faces).sum::<u64>();
    let most = usize::try_from(faces / FACES_PER_SEGMENT).unwrap_or(MANY).clamp(FEW, MANY);
    let is_before = |(at, s): &(usize, &ModelSegment)| s.faces > own || (s.faces == own && *at < segment);
    own >= FACES_MIN && segments.iter().enumerate().filter(is_before).count() < most
}

#[cfg(test)]
mod tests {
    use super::*;
    use quadmuse_proto::Topology;

    fn worth(faces: &[u64]) -> usize {
        let segment = |&faces: &u64| ModelSegment { topology: Topology::Disc, faces, holes: 0 };
        let segments: Vec<ModelSegment> = faces.iter().map(segment).collect();
        (0..segments.len()).filter(|&s| is_worth_an_example(&segments, s)).count()
    }

    #[test]
    fn few_segments_are_all_worth_it_and_of_a_rag_those_of_most_faces() {
        assert_eq!(worth(&[1; 8]), 8);
        assert_eq!(worth(&[1; 118]), 0);
        assert_eq!(worth(&[18; 118]), 8);
        assert_eq!(worth(&[1000; 12]), 12);
        assert_eq!(worth(&[1000; 118]), 32);
        let mut mixed = vec![1; 100];
        mixed.extend([900; 10]);
        assert_eq!(worth(&mixed), 10);
    }
}
