//! The small languages of the command line: segments, tags, examples, constraints.

mod named;

pub use named::{Landmarks, LandmarksSpec, NamedSpec};

use quadmuse_proto::{ExampleId, Landmark, NewConstraint, Place, Segmentation, Verdict, example::TAG_LENGTH_MAX};
use std::{fmt, path::PathBuf, str::FromStr};

/// A text of the command line that cannot be understood.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected {expected}, found `{found}`")]
pub struct SpecError {
    /// What would do.
    pub expected: &'static str,
    /// What was given.
    pub found: String,
}

fn refuse<T>(expected: &'static str, found: &str) -> Result<T, SpecError> {
    Err(SpecError { expected, found: found.into() })
}

/// How an upload is cut into segments.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SegmentsSpec {
    /// By a rule of the service.
    Rule(Segmentation),
    /// By the labels in a file: one integer a face, one a line.
    Labels(PathBuf),
}

impl FromStr for SegmentsSpec {
    type Err = SpecError;

    fn from_str(text: &str) -> Result<Self, SpecError> {
        if let Ok(rule) = text.parse() {
            return Ok(Self::Rule(rule));
        }
        // A rule of the service is a bare word: what looks like a misspelt one should not be taken for a file.
        let is_path = text.contains(['/', '\\', '.']);
        if is_path {
            Ok(Self::Labels(text.into()))
        } else {
            refuse("auto, whole, groups, or a file like ./labels.txt", text)
        }
    }
}

/// The least that a result has to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Require {
    /// More than half of its area has an example's quads, and it is not broken.
    Inspired,
    /// Its verdict is fair or better, and an example was used.
    Fair,
    /// Its verdict is good, and an example was used.
    Good,
}

/// Share of a result's area that has to be an example's for it to be called inspired.
pub const INSPIRED_MIN: f64 = 0.5;

impl Require {
    /// The word of the command line.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Inspired => "inspired",
            Self::Fair => "fair",
            Self::Good => "good",
        }
    }

    /// Tells whether a result is at least this.
    pub fn is_met(self, verdict: Verdict, inspired: f64) -> bool {
        match self {
            Self::Inspired => verdict < Verdict::Broken && inspired > INSPIRED_MIN,
            Self::Fair => verdict <= Verdict::Fair && inspired > 0.0,
            Self::Good => verdict == Verdict::Good && inspired > 0.0,
        }
    }
}

impl FromStr for Require {
    type Err = SpecError;

    fn from_str(text: &str) -> Result<Self, SpecError> {
        let all = [Self::Inspired, Self::Fair, Self::Good];
        let found = all.into_iter().find(|require| require.as_str() == text);
        found.map_or_else(|| refuse("inspired, fair or good", text), Ok)
    }
}

/// A change of an example's tags.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum TagEdit {
    /// `+TAG`.
    Add(String),
    /// `-TAG`.
    Remove(String),
}

impl TagEdit {
    /// The tags after the edits, sorted, each once.
    pub fn apply(edits: &[Self], tags: &[String]) -> Vec<String> {
        let mut tags = tags.to_vec();
        for edit in edits {
            match edit {
                Self::Add(tag) => tags.push(tag.clone()),
                Self::Remove(tag) => tags.retain(|t| t != tag),
            }
        }
        tags.sort();
        tags.dedup();
        tags
    }
}

impl FromStr for TagEdit {
    type Err = SpecError;

    fn from_str(text: &str) -> Result<Self, SpecError> {
        let expected = "+TAG or -TAG";
        let (make, tag): (fn(String) -> Self, _) = match text.split_at_checked(1) {
            Some(("+", tag)) => (Self::Add, tag),
            Some(("-", tag)) if !tag.starts_with('-') => (Self::Remove, tag),
            _ => return refuse(expected, text),
        };
        if tag.is_empty() || tag.len() > TAG_LENGTH_MAX { refuse(expected, text) } else { Ok(make(tag.into())) }
    }
}

/// Names a thing where an id is asked for: by its id, the beginning of one, an example's name or its beginning, or `@last`.
/// [`names`](crate::names) tells which thing it is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Name(pub String);

impl FromStr for Name {
    type Err = SpecError;

    fn from_str(text: &str) -> Result<Self, SpecError> {
        if text.trim().is_empty() { refuse("an id or a name", text) } else { Ok(Self(text.into())) }
    }
}

impl fmt::Display for Name {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// `EXAMPLE` or `EXAMPLE:SEGMENT`; on the command line with a [`Name`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ExampleRef<N = ExampleId> {
    /// The example.
    pub example: N,
    /// Its segment; the one that ranks best if absent.
    pub segment: Option<u32>,
}

impl FromStr for ExampleRef<Name> {
    type Err = SpecError;

    fn from_str(text: &str) -> Result<Self, SpecError> {
        // A name may have colons of its own; what follows the last is a segment where it is a number.
        let split = text.rsplit_once(':').and_then(|(name, segment)| Some((name, segment.parse::<u32>().ok()?)));
        let (name, segment) = split.map_or((text, None), |(name, segment)| (name, Some(segment)));
        match name.parse() {
            Ok(example) => Ok(Self { example, segment }),
            Err(_) => refuse("an example, or EXAMPLE:SEGMENT", text),
        }
    }
}

/// A segment of a query, by its number or by its name. [`names`](crate::names) tells which segment has a name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SegmentRef {
    /// Its number, from 0.
    Number(u32),
    /// Its name, or the beginning of it.
    Named(String),
}

impl FromStr for SegmentRef {
    type Err = SpecError;

    fn from_str(text: &str) -> Result<Self, SpecError> {
        match text.parse() {
            Ok(number) => Ok(Self::Number(number)),
            Err(_) if text.trim().is_empty() => refuse("the number or the name of a segment", text),
            Err(_) => Ok(Self::Named(text.into())),
        }
    }
}

/// `SEGMENT=NAME`: what a segment of a query is to be called; without a name it loses the one it has.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SegmentNameSpec {
    /// The segment.
    pub segment: SegmentRef,
    /// Its name; empty for none.
    pub name: String,
}

impl FromStr for SegmentNameSpec {
    type Err = SpecError;

    fn from_str(text: &str) -> Result<Self, SpecError> {
        let expected = "SEGMENT=NAME, a segment and what it is to be called";
        let Some((segment, name)) = text.split_once('=') else { return refuse(expected, text) };
        match segment.parse() {
            Ok(segment) => Ok(Self { segment, name: name.trim().into() }),
            Err(_) => refuse(expected, text),
        }
    }
}

/// `SEGMENT=EXAMPLE`: which example a segment of the query takes; on the command line with a [`Name`] and a [`SegmentRef`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UsePart<N = ExampleId, S = u32> {
    /// The query's segment.
    pub segment: S,
    /// The example laid on it.
    pub example: ExampleRef<N>,
}

impl FromStr for UsePart<Name, SegmentRef> {
    type Err = SpecError;

    fn from_str(text: &str) -> Result<Self, SpecError> {
        let expected = "SEGMENT=EXAMPLE, a segment and an example";
        let Some((segment, example)) = text.split_once('=') else { return refuse(expected, text) };
        match (segment.parse(), example.parse()) {
            (Ok(segment), Ok(example)) => Ok(Self { segment, example }),
            _ => refuse(expected, text),
        }
    }
}

/// A constraint to set: `[ID:]ON_EXAMPLE=ON_INPUT` or JSON.
///
/// Each end is `x,y,z` (a point in the mesh's units), `uU,vV` (of the parameter domain) or `fFACE/w,w,w` (a face and
/// a weight for each of its corners). With an id, an end may be left empty: it stays where it is.
#[derive(Clone, Debug, PartialEq)]
pub struct ConstraintSpec(pub NewConstraint);

impl FromStr for ConstraintSpec {
    type Err = SpecError;

    fn from_str(text: &str) -> Result<Self, SpecError> {
        let expected = "ON_EXAMPLE=ON_INPUT with ends like 1,2,3 or u0.25,v0.5 or f7/0.5,0.25,0.25, ID: before it where the map has that constraint, or a constraint as JSON";
        if text.trim_start().starts_with('{') {
            return serde_json::from_str(text).map(Self).or_else(|_| refuse(expected, text));
        }
        let Some((left, right)) = text.split_once('=') else { return refuse(expected, text) };
        let (id, left) = match left.split_once(':') {
            Some((id, left)) if !id.is_empty() => (Some(id.to_owned()), left),
            Some(_) => return refuse(expected, text),
            None => (None, left),
        };
        let (Some(on_example), Some(on_input)) = (end(left), end(right)) else { return refuse(expected, text) };
        let missing = usize::from(on_example.is_none()) + usize::from(on_input.is_none());
        if missing > usize::from(id.is_some()) {
            return refuse(expected, text);
        }
        Ok(Self(NewConstraint { id, on_example, on_input }))
    }
}

/// A landmark: `ON_EXAMPLE=ON_INPUT`, ends as those of a [`ConstraintSpec`].
#[derive(Clone, Debug, PartialEq)]
pub struct LandmarkSpec(pub Landmark);

impl FromStr for LandmarkSpec {
    type Err = SpecError;

    fn from_str(text: &str) -> Result<Self, SpecError> {
        let expected = "a point of the example and one of the scan, like 1,2,3=4,5,6";
        let ends = text.split_once('=').and_then(|(left, right)| Some((end(left)??, end(right)??)));
        let Some((on_example, on_input)) = ends else { return refuse(expected, text) };
        Ok(Self(Landmark { on_example, on_input, name: None }))
    }
}

/// One end: `Some(None)` if it is left empty, `None` if it can't be understood.
fn end(text: &str) -> Option<Option<Place>> {
    let text = text.trim();
    if text.is_empty() {
        return Some(None);
    }
    let place = if let Some(rest) = text.strip_prefix('u') {
        let (u, v) = rest.split_once(",v")?;
        Place::Domain { u: number(u)?, v: number(v)? }
    } else if let Some(rest) = text.strip_prefix('f') {
        let (face, weights) = rest.split_once('/')?;
        let barycentric = numbers(weights)?;
        Place::OnFace { face: face.parse().ok()?, barycentric: (barycentric.len() >= 3).then_some(barycentric)? }
    } else {
        Place::Point(numbers(text)?.try_into().ok()?)
    };
    Some(Some(place))
}

fn numbers(text: &str) -> Option<Vec<f64>> {
    text.split(',').map(number).collect()
}

fn number(text: &str) -> Option<f64> {
    text.trim().parse().ok().filter(|value: &f64| value.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    const ID: &str = "01ARZ3NDEKTSV4RRFFQ69G5FAV";

    fn constraint(text: &str) -> Result<NewConstraint, SpecError> {
        text.parse::<ConstraintSpec>().map(|spec| spec.0)
    }

    #[test]
    fn a_constraint_is_read_in_each_form() {
        let both = constraint("1,-2,3.5=u0.25,v0.5").expect("parses");
        assert_eq!(both.id, None);
        assert_eq!(both.on_example, Some(Place::Point([1.0, -2.0, 3.5])));
        assert_eq!(both.on_input, Some(Place::Domain { u: 0.25, v: 0.5 }));

        let moved = constraint("f3:=f7/0.5,0.25,0.25").expect("parses");
        assert_eq!((moved.id.as_deref(), moved.on_example), (Some("f3"), None));
        assert_eq!(moved.on_input, Some(Place::OnFace { face: 7, barycentric: vec![0.5, 0.25, 0.25] }));

        let json = constraint(r#"{"on_example": [0, 0, 1], "on_input": {"u": 0.1, "v": 1}}"#).expect("parses");
        assert_eq!(json.on_input, Some(Place::Domain { u: 0.1, v: 1.0 }));
    }

    #[test]
    fn a_constraint_that_says_too_little_is_refused() {
        for text in [
            "",
            "1,2,3",
            "=",
            "1,2,3=",
            "f3:=",
            ":1,2,3=4,5,6",
            "1,2=3,4,5",
            "1,2,nan=3,4,5",
            "f1/1=1,2,3",
            "u1=1,2,3",
            "{}x",
        ] {
            assert!(constraint(text).is_err(), "{text}");
        }
    }

    #[test]
    fn a_landmark_needs_both_ends() {
        let found = "1,-2,3.5=4,5,6".parse::<LandmarkSpec>().expect("parses").0;
        assert_eq!((found.on_example, found.on_input), (Place::Point([1.0, -2.0, 3.5]), Place::Point([4.0, 5.0, 6.0])));
        for text in ["", "1,2,3", "1,2,3=", "=1,2,3", "1,2=3,4,5", "a:1,2,3=4,5,6"] {
            assert!(text.parse::<LandmarkSpec>().is_err(), "{text}");
        }
    }

    #[test]
    fn tags_are_added_and_taken_off_in_order() {
        let tags = ["b".to_owned(), "wip".to_owned()];
        let edits: Vec<TagEdit> =
            ["-wip", "+a", "+b", "+c", "-c"].iter().map(|t| t.parse().expect("an edit")).collect();
        assert_eq!(TagEdit::apply(&edits, &tags), ["a", "b"]);
        for text in ["", "+", "-", "hero", "--json", "é"] {
            assert!(text.parse::<TagEdit>().is_err(), "{text}");
        }
    }

    #[test]
    fn a_misspelt_rule_is_not_taken_for_a_file() {
        assert_eq!("groups".parse(), Ok(SegmentsSpec::Rule(Segmentation::Groups)));
        assert_eq!("./labels".parse(), Ok(SegmentsSpec::Labels("./labels".into())));
        assert!("group".parse::<SegmentsSpec>().is_err());
    }

    #[test]
    fn what_is_required_is_met_by_that_and_better() {
        for (word, verdict, inspired, is_met) in [
            ("inspired", Verdict::Poor, 0.51, true),
            ("inspired", Verdict::Good, 0.5, false),
            ("inspired", Verdict::Broken, 1.0, false),
            ("fair", Verdict::Good, 0.0, false),
            ("fair", Verdict::Fair, 0.1, true),
            ("fair", Verdict::Poor, 1.0, false),
            ("good", Verdict::Good, 1.0, true),
            ("good", Verdict::Fair, 1.0, false),
        ] {
            let require: Require = word.parse().expect("a word");
            assert_eq!(require.is_met(verdict, inspired), is_met, "{word}: {verdict:?}, {inspired}");
        }
        assert!("poor".parse::<Require>().is_err());
    }

    #[test]
    fn an_example_may_name_its_segment() {
        let with: UsePart<Name, SegmentRef> = format!("3={ID}:2").parse().expect("parses");
        assert_eq!((with.segment, with.example.segment), (SegmentRef::Number(3), Some(2)));
        let part: UsePart<Name, SegmentRef> = format!("left arm={ID}").parse().expect("parses");
        assert_eq!(part.segment, SegmentRef::Named("left arm".into()));
        let without: ExampleRef<Name> = ID.parse().expect("parses");
        assert_eq!(without.segment, None);
        let named: ExampleRef<Name> = "head: old:1".parse().expect("parses");
        assert_eq!((named.example.0.as_str(), named.segment), ("head: old", Some(1)));
        for text in [format!("={ID}"), "3=".into(), "3=:2".into(), ID.into()] {
            assert!(text.parse::<UsePart<Name, SegmentRef>>().is_err(), "{text}");
        }
    }

    #[test]
    fn a_part_is_given_a_name_or_loses_it() {
        let spec = |text: &str| text.parse::<SegmentNameSpec>();
        let number =
            |segment, name: &str| Ok(SegmentNameSpec { segment: SegmentRef::Number(segment), name: name.into() });
        assert_eq!((spec("2=left arm "), spec("0=")), (number(2, "left arm"), number(0, "")));
        assert_eq!(spec("arm=a=b").expect("parses").name, "a=b");
        assert!(["", "arm", "=arm", " =arm"].into_iter().all(|text| spec(text).is_err()));
    }
}
