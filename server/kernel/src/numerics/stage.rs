//! Stages that can be left out, to measure what each is worth.
//!
//! Nothing is left out unless a program says so when it starts ([`leave_out`]). What is computed with a stage left out is to be
//! measured, not to be kept.

use std::sync::atomic::{AtomicU32, Ordering};

/// A stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Queries are ranked against examples of other topologies.
    Topologies,
    /// Where pictures leave the ranking open, examples are laid roughly.
    Rough,
    /// An example that lies on a part of the query leads others there.
    Leads,
    /// The example settles on the input with its boundary free.
    Settle,
    /// It is tried where tips match.
    Tips,
    /// The axes of limbs lead it, beside their tips.
    Limbs,
    /// A symmetric example is laid unmirrored.
    Symmetry,
    /// It is tried in rigid poses.
    Poses,
    /// A bulky example is posed about some of its points.
    Anchors,
    /// It is stretched to tips of the input that it leaves bare.
    Stretch,
    /// Faces are extruded along protrusions of the input that the example lacks.
    Extrude,
    /// Faces that the input has nothing for are spanned between their neighbours.
    Span,
    /// Faces that leap between sheets of the input are left out.
    Fray,
    /// Folds are mended.
    Mend,
    /// An input without examples is laid out along a field of crosses.
    Field,
    /// Extraordinary vertices beside seams are removed in pairs.
    Valence,
    /// Quads are made squares or rectangles.
    Optimise,
    /// Vertices move to regions that are not covered.
    Cover,
    /// Crumpled regions are laid anew.
    Reembed,
    /// Faces lie on both sides of the surface.
    FitSurface,
    /// Edges lie on sharp lines.
    Crease,
    /// Segments that miss the input are made finer.
    Refine,
}

/// All stages and their names, in the order in which they are passed.
const NAMES: [(Stage, &str); 22] = [
    (Stage::Topologies, "topologies"),
    (Stage::Rough, "rough"),
    (Stage::Leads, "leads"),
    (Stage::Settle, "settle"),
    (Stage::Tips, "tips"),
    (Stage::Limbs, "limbs"),
    (Stage::Symmetry, "symmetry"),
    (Stage::Poses, "poses"),
    (Stage::Anchors, "anchors"),
    (Stage::Stretch, "stretch"),
    (Stage::Extrude, "extrude"),
    (Stage::Span, "span"),
    (Stage::Fray, "fray"),
    (Stage::Mend, "mend"),
    (Stage::Field, "field"),
    (Stage::Valence, "valence"),
    (Stage::Optimise, "optimise"),
    (Stage::Cover, "cover"),
    (Stage::Reembed, "reembed"),
    (Stage::FitSurface, "fit-surface"),
    (Stage::Crease, "crease"),
    (Stage::Refine, "refine"),
];

/// One bit for each stage that is left out.
static LEFT_OUT: AtomicU32 = AtomicU32::new(0);

/// No stage has this name.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected a stage ({}), found {found:?}", NAMES.map(|(_, name)| name).join(", "))]
pub struct UnknownStage {
    /// The name that no stage has.
    pub found: String,
}

impl Stage {
    /// The stage of a name.
    ///
    /// # Errors
    /// [`UnknownStage`].
    pub fn named(name: &str) -> Result<Self, UnknownStage> {
        let found = NAMES.iter().find(|(_, known)| *known == name).map(|(stage, _)| *stage);
        found.ok_or_else(|| UnknownStage { found: name.to_owned() })
    }

    /// Tells whether it is computed: it is, unless it was left out.
    pub fn is_on(self) -> bool {
        LEFT_OUT.load(Ordering::Relaxed) & self.bit() == 0
    }

    const fn bit(self) -> u32 {
        1 << self as u32
    }
}

/// Leaves out stages from now on, for the whole process. To be said before anything is computed.
pub fn leave_out(stages: &[Stage]) {
    LEFT_OUT.store(mask(stages), Ordering::Relaxed);
}

fn mask(stages: &[Stage]) -> u32 {
    stages.iter().fold(0, |mask, stage| mask | stage.bit())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_stage_has_a_name_and_a_bit_of_its_own_and_is_on() {
        let all = NAMES.map(|(stage, _)| stage);
        assert_eq!(mask(&all).count_ones() as usize, all.len());
        for (k, (stage, name)) in NAMES.into_iter().enumerate() {
            assert_eq!((stage as usize, Stage::named(name)), (k, Ok(stage)));
            assert!(stage.is_on());
        }
    }

    #[test]
    fn an_unknown_stage_is_refused_with_the_names_of_all() {
        let message = Stage::named("pose").expect_err("no such stage").to_string();
        assert!(message.contains("poses, anchors") && message.contains("\"pose\""), "{message}");
    }
}
