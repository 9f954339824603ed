//! Filling the corpus: the primitives among the shared quad meshes, and the examples of the pairs.

use super::{Extent, RunError, pairs::Pair, read, text_in};
use crate::{
    client::Client,
    shared::{column, csv},
};
use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

/// Topologies that are one segment.
pub const PRIMITIVES: [&str; 3] = ["disc", "annulus", "sphere"];

/// Faces of the largest quad mesh of a subset's corpus.
const SUBSET_FACES_MAX: u64 = 1200;
/// Discs of a subset's corpus, besides the examples of the pairs.
const SUBSET_DISCS: usize = 12;

/// The examples in the corpus: file name → id.
pub type Ids = BTreeMap<String, String>;

/// A corpus after its upload.
#[derive(Clone, Debug, Default)]
pub struct Corpus {
    /// The examples by their file's name.
    pub ids: Ids,
    /// Files that were refused, each with the reason.
    pub refused: Vec<(String, String)>,
}

/// The files of a manifest that are primitives, with their topology and faces.
///
/// # Errors
/// The manifest can't be read.
pub fn primitives(folder: &Path) -> Result<Vec<(PathBuf, String, u64)>, RunError> {
    let rows = csv(&read(folder.join("manifest.csv"))?);
    let primitives = rows.iter().filter(|row| PRIMITIVES.contains(&column(row, "topology")));
    Ok(primitives
        .map(|row| {
            let faces = column(row, "faces").parse().unwrap_or_default();
            (folder.join(column(row, "file")), column(row, "topology").to_owned(), faces)
        })
        .collect())
}

/// Uploads the corpus for some pairs.
///
/// # Errors
/// [`RunError`]; that a file is refused is none.
pub fn fill(client: &Client, shared: &Path, pairs: &[Pair], extent: Extent) -> Result<Corpus, RunError> {
    let quads = primitives(&shared.join("meshes/quads"))?;
    let mut files: BTreeSet<PathBuf> = pairs.iter().map(|pair| pair.example.clone()).collect();
    match extent {
        Extent::All => files.extend(quads.into_iter().map(|(path, _, _)| path)),
        Extent::Subset => {
            let is_small = |faces: u64| (100..SUBSET_FACES_MAX).contains(&faces);
            let discs = quads.into_iter().filter(|(_, topology, faces)| topology == "disc" && is_small(*faces));
            files.extend(discs.map(|(path, _, _)| path).take(SUBSET_DISCS));
        }
    }
    let words = ["--json".into(), "add".into()].into_iter().chain(files.into_iter().map(PathBuf::into_os_string));
    let ran = client.run(words)?;
    let values = ran.values().map_err(|found| RunError::Answer { expected: "JSON lines", found })?;
    if values.is_empty() {
        ran.ok()?;
    }
    let mut corpus = Corpus::default();
    for value in values {
        let file = PathBuf::from(text_in(&value, "file")?);
        let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
        match value["id"].as_str() {
            Some(id) => drop(corpus.ids.insert(name, id.to_owned())),
            None => corpus.refused.push((name, text_in(&value, "detail")?)),
        }
    }
    Ok(corpus)
}
