//! What a composition came to, a sentence each: the notes that go with it.

use crate::compose::{Report, Way};

/// Mean distance from the input, in % of the diagonal of its bounding box, from which on a note says so.
pub(crate) const MISS_NOTED_PCT: f64 = 0.25;

/// Notes on what was brought for segments, beside meshes as they were mapped.
#[derive(Clone, Debug, Default)]
pub(crate) struct SegmentNotes {
    /// Segments whose best map nobody chose and is poor.
    pub(crate) poor: Vec<usize>,
    /// Segments without a map.
    pub(crate) regular: Vec<usize>,
    /// Segments whose layout could not be made as coarse as asked, and the times it could.
    pub(crate) too_fine: Vec<(usize, i32)>,
}

/// What was brought, as far as there is something to say.
pub(crate) fn brought(of: &SegmentNotes) -> Vec<String> {
    let mut notes = Vec::new();
    if let Some((segments, is_one)) = segments(&of.poor) {
        notes.push(match is_one {
            true => format!("{segments} is a regular layout: its best map is poor; name a map to have it all the same"),
            false => {
                format!("{segments} are regular layouts: their best maps are poor; name a map to have it all the same")
            }
        });
    }
    if let Some((segments, is_one)) = segments(&of.regular) {
        notes.push(format!("{segments} {}", if is_one { "is a regular layout" } else { "are regular layouts" }));
    }
    if !of.too_fine.is_empty() {
        let which: Vec<String> = of.too_fine.iter().map(|(s, n)| format!("{s} ({n} times)")).collect();
        notes.push(format!("layouts could be coarsened less often than asked on these segments: {}", which.join(", ")));
    }
    notes
}

/// `segment 3`, or `segments 0, 1 and 5`, and whether it is one; `None` if there is none.
fn segments(of: &[usize]) -> Option<(String, bool)> {
    let (last, before) = of.split_last()?;
    Some(match before {
        [] => (format!("segment {last}"), true),
        _ => (format!("segments {} and {last}", list(before)), false),
    })
}

fn list(of: &[usize]) -> String {
    of.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")
}

/// What was done to make it one mesh.
pub(crate) fn made(report: &Report, quads: usize) -> Vec<String> {
    let mut notes = Vec::new();
    let times = report.subdivided.iter().enumerate().filter(|(_, n)| **n > 0);
    let which: Vec<String> = times.map(|(s, n)| format!("{s} ({n} times)")).collect();
    if !which.is_empty() && report.way != Way::InputSubdivided {
        notes.push(format!(
            "to fit their neighbours and the surface these segments' parts were subdivided: {}",
            which.join(", ")
        ));
    }
    let given_up = [
        (&report.replaced, "parts that could not be joined were given up for regular layouts"),
        (&report.too_dense, "parts far denser than all others were given up for regular layouts"),
        (&report.missing, "parts that pass the surface by far were given up for regular layouts"),
    ];
    for (segments, why) in given_up.into_iter().filter(|(segments, _)| !segments.is_empty()) {
        notes.push(format!("{why}: {}", list(segments)));
    }
    if !report.own.is_empty() && report.way != Way::InputSubdivided {
        notes.push(format!("of these segments the input's own triangles were made quads: {}", list(&report.own)));
    }
    match report.closed {
        0 => {}
        1 => notes.push("a hole that is smaller than the quads was closed".into()),
        count => notes.push(format!("{count} holes that are smaller than the quads were closed")),
    }
    match report.way {
        Way::AllSubdivided => notes.push("everything was subdivided once to be rid of triangles".into()),
        Way::InputSubdivided => notes.push("no part was used: the input's own triangles were made quads".into()),
        Way::Direct | Way::PartsSubdivided | Way::PartsReplaced => {}
    }
    if report.refined > 0 {
        notes.push(format!("to follow the input everything was subdivided {} times, to {quads} quads", report.refined));
    }
    let miss = 100.0 * report.fit.worst();
    if miss > MISS_NOTED_PCT {
        notes.push(format!(
            "the result misses the input by {miss:.2} % of its diagonal on average; ask for a higher density"
        ));
    }
    notes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn segments_of_a_kind_share_a_sentence() {
        let of = SegmentNotes { poor: vec![0, 1, 2, 5], regular: vec![3], too_fine: vec![(4, 0), (6, 1)] };
        assert_eq!(
            brought(&of),
            [
                "segments 0, 1, 2 and 5 are regular layouts: their best maps are poor; name a map to have it all the same",
                "segment 3 is a regular layout",
                "layouts could be coarsened less often than asked on these segments: 4 (0 times), 6 (1 times)",
            ]
        );
        let of = SegmentNotes { poor: vec![7], regular: vec![1, 2], ..SegmentNotes::default() };
        assert_eq!(
            brought(&of),
            [
                "segment 7 is a regular layout: its best map is poor; name a map to have it all the same",
                "segments 1 and 2 are regular layouts",
            ]
        );
        assert!(brought(&SegmentNotes::default()).is_empty());
    }

    #[test]
    fn parts_that_gave_way_are_told_by_the_reason() {
        let report = Report { replaced: vec![1, 4], missing: vec![2], ..Report::default() };
        assert_eq!(
            made(&report, 100),
            [
                "parts that could not be joined were given up for regular layouts: 1, 4",
                "parts that pass the surface by far were given up for regular layouts: 2",
            ]
        );
    }
}
