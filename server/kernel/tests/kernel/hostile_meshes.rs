//! Reads and prepares every real mesh there is: broken ones, artists' quads and scans.
//!
//! The meshes lie outside of the project, in `../shared/meshes` or where `QUADMUSE_SHARED` says.

use crate::folder;
use quadmuse_kernel::mesh::{self, Format, Limits, NONE, Prepared, TriMesh};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::mpsc;
use std::time::{Duration, Instant};

/// All mesh files below a folder, sorted.
fn files(folder: &Path) -> Vec<PathBuf> {
    let (mut folders, mut files) = (vec![folder.to_path_buf()], Vec::new());
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).expect("a readable folder") {
            let path = entry.expect("a readable entry").path();
            if path.is_dir() {
                folders.push(path);
            } else if format(&path).is_some() {
                files.push(path);
            }
        }
    }
    files.sort();
    files
}

fn format(path: &Path) -> Option<Format> {
    Format::from_extension(path.extension()?.to_str()?)
}

/// Reads and prepares a file, on a thread of its own and for at most 10 seconds.
fn attempt(path: &Path) -> Result<Prepared, String> {
    let (sender, receiver) = mpsc::channel();
    let (bytes, format) = (std::fs::read(path).expect("a readable file"), format(path));
    let thread = std::thread::spawn(move || {
        let outcome = mesh::read(&bytes, format, &Limits::default()).and_then(|poly| mesh::prepare(&poly));
        sender.send(outcome.map_err(|error| format!("{:?}: {error}", error.code()))).expect("somebody waits");
    });
    match receiver.recv_timeout(Duration::from_secs(10)) {
        Ok(outcome) => outcome,
        Err(mpsc::RecvTimeoutError::Timeout) => panic!("{} takes more than 10 s", path.display()),
        Err(mpsc::RecvTimeoutError::Disconnected) => match thread.join() {
            Err(_) => panic!("{} leads to a panic", path.display()),
            Ok(()) => unreachable!("a thread that ends has sent"),
        },
    }
}

/// Number of components, by flooding across edges.
fn components(mesh: &TriMesh) -> usize {
    let mut seen = vec![false; mesh.triangles.len()];
    let mut count = 0;
    for start in 0..seen.len() {
        if std::mem::replace(&mut seen[start], true) {
            continue;
        }
        count += 1;
        let mut stack = vec![start];
        while let Some(t) = stack.pop() {
            for twin in &mesh.twins[3 * t..3 * t + 3] {
                if *twin != NONE && !std::mem::replace(&mut seen[*twin as usize / 3], true) {
                    stack.push(*twin as usize / 3);
                }
            }
        }
    }
    count
}

fn described(prepared: &Prepared) -> String {
    let mesh = &prepared.mesh;
    let mut text = format!(
        "{} vertices, {} triangles, {} components, {} loops",
        mesh.positions.len(),
        mesh.triangles.len(),
        components(mesh),
        mesh.boundary_loops().len()
    );
    prepared.repairs.iter().for_each(|repair| text += &format!("; {repair}"));
    text
}

/// A table of CSV by column name; quoted fields may hold commas.
fn table(path: &Path) -> Vec<HashMap<String, String>> {
    let text = std::fs::read_to_string(path).expect("a readable manifest");
    let fields = |line: &str| {
        let (mut fields, mut quoted) = (vec![String::new()], false);
        for c in line.chars() {
            match c {
                '"' => quoted = !quoted,
                ',' if !quoted => fields.push(String::new()),
                _ => fields.last_mut().expect("there is one").push(c),
            }
        }
        fields
    };
    let mut lines = text.lines();
    let names = fields(lines.next().unwrap_or_default());
    lines.map(|line| names.iter().cloned().zip(fields(line)).collect()).collect()
}

#[test]
fn every_hostile_file_is_prepared_or_refused_with_a_reason() {
    let Some(folder) = folder("hostile") else { return };
    let files = files(&folder);
    assert!(!files.is_empty());
    for path in files {
        let started = Instant::now();
        let outcome = attempt(&path);
        let name = path.strip_prefix(&folder).expect("below").display().to_string();
        let text = match &outcome {
            Ok(prepared) => {
                assert_eq!(mesh::validate(&prepared.mesh), Ok(()), "{name}");
                format!("ok: {}", described(prepared))
            }
            Err(reason) => {
                assert!(reason.len() > 40 && reason.contains("found") && reason.contains(';'), "{name}: {reason}");
                reason.clone()
            }
        };
        println!("{name:60} {:5} ms  {text}", started.elapsed().as_millis());
    }
}

#[test]
fn every_artists_mesh_has_the_topology_of_the_manifest() {
    let Some(folder) = folder("quads") else { return };
    let rows = table(&folder.join("manifest.csv"));
    assert!(rows.len() > 50);
    for row in rows {
        let name = &row["file"];
        let path = folder.join(name);
        let bytes = std::fs::read(&path).expect("a readable file");
        let poly = mesh::read(&bytes, format(&path), &Limits::default()).expect(name);
        let prepared = mesh::prepare(&poly).expect(name);
        assert_eq!(mesh::validate(&prepared.mesh), Ok(()), "{name}");
        let found = [
            prepared.mesh.positions.len(),
            poly.faces.len(),
            prepared.mesh.boundary_loops().len(),
            components(&prepared.mesh),
        ];
        let expected: [usize; 4] =
            ["vertices", "faces", "boundary_loops", "components"].map(|column| row[column].parse().expect(column));
        assert_eq!(found, expected, "{name}: vertices, faces, loops, components");
        let again = mesh::write(&poly, Format::Obj).expect("writable");
        assert_eq!(mesh::read(&again, Some(Format::Obj), &Limits::default()).expect("readable"), poly, "{name}");
    }
}

#[test]
fn every_scan_is_prepared_or_refused_with_a_reason() {
    let Some(folder) = folder("scans") else { return };
    let mut prepared_count = 0;
    let files = files(&folder);
    for path in &files {
        let started = Instant::now();
        let outcome = attempt(path);
        let text = match &outcome {
            Ok(prepared) => {
                assert_eq!(mesh::validate(&prepared.mesh), Ok(()), "{}", path.display());
                prepared_count += 1;
                format!("ok: {}", described(prepared))
            }
            Err(reason) => reason.clone(),
        };
        println!(
            "{:40} {:5} ms  {text}",
            path.file_name().unwrap_or_default().display(),
            started.elapsed().as_millis()
        );
    }
    assert!(prepared_count * 10 > files.len() * 9, "{prepared_count} of {} scans", files.len());
}
