//! Whether an input can be cut as an example is, and how well the parts lie where they belong.
//!
//! `transfer [--kind KIND]… [--name PART] [--example NAME_PART]`: a row a pair with a known truth (bodies, poses and
//! animals unless told otherwise): the example is laid on the input whole, cut one part a protrusion, between its faces,
//! and the input is cut alike. An overlap is a share of the area on which the input's part is the truth's; of one part, of
//! the larger of the two. With `--example` the example of the pairs whose name holds that word is laid on the inputs of
//! the others: no truth is known, only whether they can be cut alike.

use quadmuse_compare::ground_truth::case::Case;
use quadmuse_compare::ground_truth::lay::positions;
use quadmuse_compare::ground_truth::loaded::Loaded;
use quadmuse_compare::parts::stability::{moved, parts_overlap, transferred};
use quadmuse_kernel::map::parted::alike;
use quadmuse_kernel::segment::{PartCount, Segmented, segment};
use quadmuse_tests::real_input::{Extent, pairs};
use std::process::ExitCode;

/// Kinds that are whole shapes with limbs.
const KINDS: [&str; 3] = ["animal", "body", "pose"];

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            eprintln!("{why}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<(), String> {
    let Some(shared) = quadmuse_tests::shared::folder_or_say("the transfer of parts") else { return Ok(()) };
    let (mut kinds, mut name, mut other) = (Vec::new(), String::new(), None);
    let mut words = std::env::args().skip(1);
    while let (Some(word), Some(value)) = (words.next(), words.next()) {
        match word.as_str() {
            "--kind" => kinds.push(value),
            "--example" => other = Some(value),
            _ => name = value,
        }
    }
    if kinds.is_empty() {
        kinds = KINDS.map(str::to_owned).to_vec();
    }
    let all = pairs::pairs(&shared, Extent::All).map_err(|e| e.to_string())?;
    let wanted: Vec<&pairs::Pair> =
        all.iter().filter(|p| kinds.contains(&p.kind) && p.name().contains(&name)).collect();
    if let Some(other) = other {
        let example = all.iter().find(|p| p.name().contains(&other)).ok_or("expected the name of an example")?;
        return across(example, &wanted);
    }
    println!("| kind | pair | parts | overlap | least of a part (its share of the area, %) |");
    println!("|---|---|---|---|---|");
    let (mut sum, mut cut, mut least) = (0.0, 0, f64::INFINITY);
    for pair in &wanted {
        match row(pair) {
            Ok((parts, overlap, [worst, share])) => {
                println!(
                    "| {} | {} | {parts} | {overlap:.3} | {worst:.3} ({:.2}) |",
                    pair.kind,
                    pair.name(),
                    100.0 * share
                );
                (sum, cut, least) = (sum + overlap, cut + 1, worst.min(least));
            }
            Err(why) => println!("| {} | {} | refused: {why} |", pair.kind, pair.name()),
        }
    }
    println!(
        "\n{cut} of {} cut alike, mean overlap {:.3}, least {least:.3}",
        wanted.len(),
        sum / f64::from(cut.max(1))
    );
    Ok(())
}

/// An example cut one part a protrusion, between its faces.
fn cut(example: &Loaded) -> Result<Segmented, String> {
    let mesh = &example.prepared.mesh;
    let free = segment(mesh, PartCount::Protrusions).map_err(|e| e.to_string())?;
    free.between_polygons(mesh).map_err(|e| e.to_string())
}

/// Parts, their overlap, and of the part with the least its overlap and its share of the area.
fn row(pair: &pairs::Pair) -> Result<(usize, f64, [f64; 2]), String> {
    let case = Case::read(pair, None)?;
    let (own, whole) = (cut(&case.example)?, &case.example.patch);
    let positions = positions(&case.example, &case.input)?;
    let made = alike(&own, whole, &positions, &case.input.prepared.mesh).map_err(|e| e.to_string())?;
    let none = || "expected meshes that fit together".to_owned();
    let truth = moved(&whole.mesh, &case.example.in_order_of(&case.truth)).ok_or_else(none)?;
    let belongs: Vec<u32> =
        whole.triangle_of.iter().map(|&t| own.part_of.get(t as usize).copied().unwrap_or(0)).collect();
    let parts = parts_overlap(&truth, &belongs, &transferred(&truth, &made));
    let overlap = parts.iter().map(|p| p.shared).sum();
    let worst = parts.iter().map(|p| [p.overlap(), p.area]).min_by(|a, b| a[0].total_cmp(&b[0]));
    Ok((own.parts.len(), overlap, worst.ok_or_else(none)?))
}

/// One example on inputs of other kinds.
fn across(pair: &pairs::Pair, inputs: &[&pairs::Pair]) -> Result<(), String> {
    let example = Loaded::read(&pair.example)?;
    let own = cut(&example)?;
    for other in inputs {
        let input = Loaded::read(&other.input)?;
        let made = positions(&example, &input)
            .and_then(|p| alike(&own, &example.patch, &p, &input.prepared.mesh).map_err(|e| e.to_string()));
        match made {
            Ok(made) => println!("| {} | {} parts |", other.name(), made.parts.len()),
            Err(why) => println!("| {} | refused: {why} |", other.name()),
        }
    }
    Ok(())
}
