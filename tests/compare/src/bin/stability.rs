//! Whether the same shape gets the same parts: mirrored, in another pose or another individual, and remeshed.
//!
//! `stability [--kind KIND]… [--name PART]`: a row a pair with a known truth. Of each pair the example is cut, its mirror
//! image, the truth (the example's own faces in the input's shape), and the input (that shape remeshed, rotated, scaled,
//! some with noise, some mirrored); overlaps are shares of the area whose parts agree.

use quadmuse_compare::parts::file::surface;
use quadmuse_compare::parts::stability::{mirrored, moved, overlap, transferred};
use quadmuse_kernel::mesh::TriMesh;
use quadmuse_kernel::segment::{PartCount, Segmented, segment};
use quadmuse_tests::real_input::{Extent, pairs};
use std::process::ExitCode;

fn main() -> ExitCode {
    let Some(shared) = quadmuse_tests::shared::folder_or_say("the stability of parts") else {
        return ExitCode::SUCCESS;
    };
    let (mut kinds, mut name) = (Vec::new(), String::new());
    let mut words = std::env::args().skip(1);
    while let (Some(word), Some(value)) = (words.next(), words.next()) {
        match word.as_str() {
            "--kind" => kinds.push(value),
            _ => name = value,
        }
    }
    let mut pairs = match pairs::pairs(&shared, Extent::All) {
        Ok(pairs) => pairs,
        Err(why) => {
            eprintln!("{why}");
            return ExitCode::FAILURE;
        }
    };
    pairs.retain(|p| (kinds.is_empty() || kinds.contains(&p.kind)) && p.name().contains(&name));
    println!("| kind | pair | parts: example, mirrored, truth, input | mirrored | posed | remeshed |");
    println!("|---|---|---|---|---|---|");
    let mut sums = [(0.0, 0u32); 3];
    for pair in &pairs {
        match row(pair) {
            Ok((counts, overlaps)) => {
                let cells = overlaps.map(|o| format!("{o:.3}")).join(" | ");
                println!("| {} | {} | {} | {cells} |", pair.kind, pair.name(), counts.map(|c| c.to_string()).join(" "));
                sums.iter_mut().zip(overlaps).for_each(|(s, o)| *s = (s.0 + o, s.1 + u32::from(o >= 0.9)));
            }
            Err(why) => println!("| {} | {} | {why} |", pair.kind, pair.name()),
        }
    }
    let n = pairs.len().max(1) as f64;
    println!("\nmean {}", sums.map(|s| format!("{:.3} ({} of {} at least 0.9)", s.0 / n, s.1, pairs.len())).join(", "));
    ExitCode::SUCCESS
}

fn row(pair: &pairs::Pair) -> Result<([usize; 4], [f64; 3]), String> {
    let (example, truth, input) = (surface(&pair.example)?, surface(&pair.truth)?, surface(&pair.input)?);
    let none = || "expected meshes that fit together".to_owned();
    // The truth has the example's faces: kept as the example's triangles, whatever its own diagonals.
    let truth = moved(&example, &truth.positions).ok_or_else(none)?;
    let mirror = mirrored(&example).ok_or_else(none)?;
    let cuts = [cut(&example)?, cut(&mirror)?, cut(&truth)?, cut(&input)?];
    let own = transferred(&example, &cuts[0]);
    let posed = transferred(&truth, &cuts[2]);
    let overlaps = [
        overlap(&example, &own, &transferred(&mirror, &cuts[1])),
        overlap(&example, &own, &posed),
        overlap(&truth, &posed, &transferred(&truth, &cuts[3])),
    ];
    Ok((cuts.map(|c| c.parts.len()), overlaps))
}

fn cut(surface: &TriMesh) -> Result<Segmented, String> {
    segment(surface, PartCount::Protrusions).map_err(|e| e.to_string())
}
