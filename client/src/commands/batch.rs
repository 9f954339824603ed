//! `batch`: `retopo` for every scan of a folder, one after the other, with a report.

use super::{
    compose::{Wish, make},
    deliver::{Delivered, Target, may_overwrite},
};
use crate::{
    api::Api,
    args::{BatchArgs, QueryArgs},
    error::ClientError,
    file::{self, OutFile, Packing},
    names,
    paint::Paint,
    spec::UsePart,
    state::State,
    table,
    ui::Ui,
};
use quadmuse_proto::{QueryId, Verdict};
use serde::Serialize;
use std::{
    collections::BTreeMap,
    fmt::Write,
    path::{Path, PathBuf},
    time::{Duration, Instant},
};

/// The name of the report, in the folder of the results.
const REPORT: &str = "report.csv";

/// Tells the result for one scan: a row of the report.
#[derive(Serialize)]
struct Line {
    scan: String,
    file: Option<String>,
    verdict: Option<Verdict>,
    /// Faces of the result.
    faces: Option<u64>,
    /// The distance of result and scan, in % of the scan's diagonal, where a size was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    within_percent: Option<f64>,
    /// Share of the result's area whose quads are an example's, 0–1.
    inspired: Option<f64>,
    seconds: f64,
    query: Option<QueryId>,
    reasons: Vec<String>,
    /// Why it failed, or is less than is required.
    error: Option<String>,
}

pub(super) async fn batch(args: &BatchArgs, api: &Api, state: &State, ui: &mut Ui) -> Result<(), ClientError> {
    let scans = scans_in(&args.dir)?;
    let results = names_of_results(&scans, args.format.as_str());
    prepare(args, &results, ui)?;
    // An example that is misspelt is told once, before anything is sent; scans that are yet to be sent have no names.
    let uses = names::uses(&args.lay.uses, &[], api).await?;
    let report = args.out.join(REPORT);
    let width = scans.iter().map(|scan| name_of(scan).chars().count()).max().unwrap_or_default();
    let bar = ui.bar(scans.len() as u64, "scans");
    let (mut lines, mut failed) = (Vec::new(), 0);
    for (scan, name) in scans.iter().zip(&results) {
        let begun = Instant::now();
        let result = one((args, &uses), scan, &args.out.join(name), api, state, &mut ui.silent_below()).await;
        if let Err(error @ (ClientError::Unreachable { .. } | ClientError::BrokenOff { .. })) = result {
            // Without a server every other scan would fail alike.
            bar.finish_and_clear();
            return Err(error);
        }
        let line = line_of(scan, result, args, begun.elapsed());
        failed += usize::from(line.error.is_some());
        bar.suspend(|| {
            ui.value(&line)?;
            ui.text(&line_text(&line, width, ui.room().paint))
        })?;
        bar.inc(1);
        lines.push(line);
        // After each scan: whoever interrupts a long batch has the report of what is done.
        file::write(&report, csv(&lines).as_bytes())?;
    }
    bar.finish_and_clear();
    ui.note(&format!("report: {}", report.display()));
    if failed == 0 { Ok(()) } else { Err(ClientError::SomeFailed { failed, total: scans.len() }) }
}

/// The mesh files of a folder, by name.
fn scans_in(folder: &Path) -> Result<Vec<PathBuf>, ClientError> {
    let unreadable = |source| ClientError::Unreadable { path: folder.into(), source };
    let mut scans = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        if path.is_file() && file::is_mesh(&path) {
            scans.push(path);
        }
    }
    scans.sort();
    if scans.is_empty() { Err(ClientError::NoScans { folder: folder.into() }) } else { Ok(scans) }
}

fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// The names of the results: those of the scans in the format asked for; where two scans would share one, each keeps the
/// whole of its own before it.
fn names_of_results(scans: &[PathBuf], format: &str) -> Vec<String> {
    let mut counts = BTreeMap::new();
    scans.iter().for_each(|scan| *counts.entry(file::example_name(scan)).or_insert(0_u32) += 1);
    let of = |scan: &PathBuf| match file::example_name(scan) {
        stem if counts.get(&stem) == Some(&1) => format!("{stem}.{format}"),
        _ => format!("{}.{format}", name_of(scan)),
    };
    scans.iter().map(of).collect()
}

/// Makes the folder of the results, and asks where some are there already.
fn prepare(args: &BatchArgs, names: &[String], ui: &mut Ui) -> Result<(), ClientError> {
    let unwritable = |source| ClientError::Unwritable { path: args.out.clone(), source };
    std::fs::create_dir_all(&args.out).map_err(unwritable)?;
    let same = |a: &Path, b: &Path| matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b);
    if same(&args.dir, &args.out) {
        return Err(ClientError::SameFolder { folder: args.dir.clone() });
    }
    if args.force {
        return Ok(());
    }
    let meshes = names.iter().map(|name| args.out.join(name));
    let pictures = meshes.clone().filter(|_| args.pictures).map(|mesh| mesh.with_extension("png"));
    let all = meshes.chain(pictures).chain([args.out.join(REPORT)]);
    let there: Vec<String> = all.filter(|path| path.is_file()).map(|path| path.display().to_string()).collect();
    may_overwrite(&there, ui)
}

/// One scan; what is printed of it goes to `ui`.
async fn one(
    (args, uses): (&BatchArgs, &[UsePart]),
    scan: &Path,
    out: &Path,
    api: &Api,
    state: &State,
    ui: &mut Ui,
) -> Result<Delivered, ClientError> {
    let file = OutFile { path: out.into(), format: args.format, packing: Packing::Plain };
    let picture = args.pictures.then(|| out.with_extension("png"));
    let target = Target::silent(file, picture).sized(&args.lay.size);
    let wish = Wish { lay: &args.lay, uses: uses.to_vec(), target };
    let query = QueryArgs { file: scan.into(), rank: args.rank.clone() };
    make(&query, wish, api, state, ui).await
}

fn line_of(scan: &Path, result: Result<Delivered, ClientError>, args: &BatchArgs, took: Duration) -> Line {
    let mut line = Line {
        scan: name_of(scan),
        file: None,
        verdict: None,
        faces: None,
        within_percent: None,
        inspired: None,
        seconds: (took.as_secs_f64() * 1000.0).round() / 1000.0,
        query: None,
        reasons: Vec::new(),
        error: None,
    };
    let done = match result {
        Ok(done) => done,
        Err(error) => return Line { error: Some(error.message()), ..line },
    };
    line.error = done.is_enough(args.lay.require).err().map(|error| error.message());
    let Delivered { query, verdict, inspired, reasons, faces, within_percent, file } = done;
    let (verdict, faces, inspired) = (Some(verdict), Some(faces), Some(inspired));
    Line { file: Some(file), verdict, faces, within_percent, inspired, query: Some(query), reasons, ..line }
}

/// A line for people: `scan.ply   good    3152 faces  100 % inspired  12.30 s`, and where a size was asked for, how near
/// the result is to the scan.
fn line_text(line: &Line, width: usize, paint: Paint) -> String {
    let time = table::time(1000.0 * line.seconds);
    let Line { verdict: Some(verdict), faces: Some(faces), inspired: Some(inspired), .. } = line else {
        let why = line.error.as_deref().unwrap_or_default();
        return format!("{:width$}  {}  {why}", line.scan, paint.failure("failed"));
    };
    let word = paint.verdict(*verdict, &format!("{:6}", verdict.as_str()));
    let percent = format!("{:.0}", 100.0 * inspired);
    let below = if line.error.is_some() && *verdict != Verdict::Broken { "  less than is required" } else { "" };
    let within = line.within_percent.map(|within| format!("  within {within:.3} %")).unwrap_or_default();
    format!("{:width$}  {word}  {faces:>7} faces  {percent:>3} % inspired  {time:>9}{within}{below}", line.scan)
}

/// The report, as RFC 4180 has it: a header, and a line a scan.
fn csv(lines: &[Line]) -> String {
    let mut text = "scan,file,verdict,faces,inspired,seconds,query,reasons,error,within_percent\r\n".to_owned();
    for line in lines {
        let cells = [
            line.scan.clone(),
            line.file.clone().unwrap_or_default(),
            line.verdict.map(|verdict| verdict.as_str().to_owned()).unwrap_or_default(),
            line.faces.map(|faces| faces.to_string()).unwrap_or_default(),
            line.inspired.map(|share| format!("{share:.4}")).unwrap_or_default(),
            format!("{:.3}", line.seconds),
            line.query.map(|query| query.to_string()).unwrap_or_default(),
            line.reasons.join("; "),
            line.error.clone().unwrap_or_default(),
            line.within_percent.map(|within| within.to_string()).unwrap_or_default(),
        ];
        let _ = write!(text, "{}\r\n", cells.map(|cell| quoted(&cell)).join(","));
    }
    text
}

fn quoted(cell: &str) -> String {
    let is_plain = !cell.contains(['"', ',', '\n', '\r']);
    if is_plain { cell.to_owned() } else { format!("\"{}\"", cell.replace('"', "\"\"")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_are_named_after_their_scans_and_none_takes_the_place_of_another() {
        let scans = ["a.ply", "b.obj.gz", "b.stl", "c.d.off"].map(PathBuf::from);
        assert_eq!(names_of_results(&scans, "obj"), ["a.obj", "b.obj.gz.obj", "b.stl.obj", "c.d.obj"]);
    }

    #[test]
    fn a_cell_that_a_table_would_split_is_quoted() {
        assert_eq!(quoted("a, \"b\""), "\"a, \"\"b\"\"\"");
        assert_eq!(quoted("good"), "good");
    }
}
