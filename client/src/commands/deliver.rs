//! Delivers the result of a command: writes the mesh and its picture, and prints its verdict.

use crate::{
    api::{Api, MeshSource, Resized},
    args::{OutArgs, SizeArgs},
    error::ClientError,
    file::{self, OutFile},
    spec::Require,
    table,
    ui::Ui,
};
use quadmuse_proto::{Composition, Map, QueryId, Verdict};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// The JSON output: the message, and the file that was written.
#[derive(Serialize)]
struct Written<'a, T> {
    file: String,
    /// The size that was written, where it is another than the message tells.
    #[serde(skip_serializing_if = "Option::is_none")]
    resized: Option<Resized>,
    #[serde(flatten)]
    message: &'a T,
}

/// A count is met if it is off by no more than this share.
const COUNT_NEAR: f64 = 0.1;

/// Decides whether existing files are replaced.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Overwriting {
    /// Whoever sits at a terminal is asked. A script can't be, and is refused.
    Asks,
    /// They are replaced.
    Silent,
}

/// Where a result goes.
#[derive(Clone)]
pub(super) struct Target {
    out: OutFile,
    kept: Option<PathBuf>,
    picture: Option<PathBuf>,
    overwriting: Overwriting,
    size: SizeArgs,
}

impl Target {
    /// Reads the flags; `kept` is the file for the numbers of the vertices that were kept.
    pub(super) fn of(args: &OutArgs, kept: Option<&Path>) -> Self {
        let overwriting = if args.force { Overwriting::Silent } else { Overwriting::Asks };
        let kept = kept.map(Path::to_owned);
        Self { out: args.file(), kept, picture: args.picture.clone(), overwriting, size: SizeArgs::default() }
    }

    /// The same, with as many quads as are asked for.
    pub(super) fn sized(self, size: &SizeArgs) -> Self {
        Self { size: size.clone(), ..self }
    }

    /// A file, and a picture, about which nobody is asked.
    pub(super) fn silent(out: OutFile, picture: Option<PathBuf>) -> Self {
        Self { out, kept: None, picture, overwriting: Overwriting::Silent, size: SizeArgs::default() }
    }

    /// Sees to it, before the work, that what it makes can be written.
    ///
    /// # Errors
    /// [`ClientError::Unwritable`] where there is no such folder, [`ClientError::Declined`] where the user wants to keep a
    /// file, [`ClientError::Occupied`] where one is there and nobody can be asked.
    pub(super) fn prepare(&self, ui: &mut Ui) -> Result<(), ClientError> {
        self.out.check()?;
        let others = || [&self.kept, &self.picture].into_iter().flatten();
        others().try_for_each(|path| file::check_folder(path))?;
        if self.overwriting == Overwriting::Asks {
            let out = Some(&self.out.path).filter(|_| !self.out.is_standard());
            let all = out.into_iter().chain(others());
            let there: Vec<String> = all.filter(|path| path.is_file()).map(|path| path.display().to_string()).collect();
            may_overwrite(&there, ui)?;
        }
        if self.out.is_standard() {
            ui.leave_out_to_data();
        }
        Ok(())
    }

    /// Downloads a mesh, writes it, and draws it where that is asked for.
    async fn put(
        &self,
        query: QueryId,
        source: MeshSource,
        api: &Api,
        ui: &mut Ui,
    ) -> Result<Option<Resized>, ClientError> {
        let (mesh, resized) = api.mesh(query, source, self.out.format, &self.size).await?;
        self.out.write(&mesh, ui)?;
        if let Some(path) = &self.picture {
            file::write(path, &api.picture(query, source).await?)?;
        }
        if let (Some(most), Some(found)) = (self.size.tolerance, resized)
            && found.within_percent > most
        {
            ui.note(&format!(
                "more quads come no nearer than {:.3} % of the scan's diagonal: what is left is bare, or not the scan's",
                found.within_percent
            ));
        }
        if let (Some(wanted), Some(found)) = (self.size.quads, resized)
            && (found.faces as f64 / f64::from(wanted) - 1.0).abs() > COUNT_NEAR
        {
            ui.note(&format!("{} quads is as near to {wanted} as the layout's rows allow", found.faces));
        }
        Ok(resized)
    }
}

/// Asks whether files may be replaced. Where nobody can be asked they are not.
///
/// # Errors
/// [`ClientError::Declined`], [`ClientError::Occupied`].
pub(super) fn may_overwrite(there: &[String], ui: &mut Ui) -> Result<(), ClientError> {
    let (files, question) = match there {
        [] => return Ok(()),
        [one] => (one.clone(), "is there already; overwrite it?"),
        [first, others @ ..] => (format!("{first} and {} more", others.len()), "are there already; overwrite them?"),
    };
    match ui.ask(&format!("{files} {question}"))? {
        Some(true) => Ok(()),
        Some(false) => Err(ClientError::Declined { done: "written" }),
        None => Err(ClientError::Occupied { files }),
    }
}

/// Tells how good a command's result is, and where it was written.
pub(super) struct Delivered {
    /// The query it was made of.
    pub(super) query: QueryId,
    /// How good it is.
    pub(super) verdict: Verdict,
    /// Share of its area that is an example's, 0–1.
    pub(super) inspired: f64,
    /// Why the verdict is what it is.
    pub(super) reasons: Vec<String>,
    /// Its faces.
    pub(super) faces: u64,
    /// The distance that 95 % of it and of the scan have from each other at most, in % of the scan's diagonal, where a size
    /// was asked for.
    pub(super) within_percent: Option<f64>,
    /// The file, as it is told.
    pub(super) file: String,
}

impl Delivered {
    /// Refuses, once all is written and printed, what is broken or less than is required.
    ///
    /// # Errors
    /// [`ClientError::Broken`], [`ClientError::Below`].
    pub(super) fn is_enough(&self, require: Option<Require>) -> Result<(), ClientError> {
        let file = self.file.clone();
        if self.verdict == Verdict::Broken {
            return Err(ClientError::Broken { file, reasons: self.reasons.join("; ") });
        }
        let missed = require.filter(|require| !require.is_met(self.verdict, self.inspired));
        let Some(require) = missed else { return Ok(()) };
        let percent = format!("{:.0}", 100.0 * self.inspired);
        Err(ClientError::Below { required: require.as_str(), verdict: self.verdict.as_str(), percent, file })
    }
}

/// Downloads the mesh of a map, writes it, and tells how good it is; with the example's name, where it is known.
///
/// # Errors
/// The service refuses or is out of reach, or a file can't be written.
pub(super) async fn write_map(
    map: &Map,
    name: Option<&str>,
    target: &Target,
    api: &Api,
    ui: &mut Ui,
) -> Result<Delivered, ClientError> {
    write_kept(map, target)?;
    let resized = target.put(map.query, MeshSource::Map(map.id), api, ui).await?;
    let faces = resized.map_or(map.faces, |resized| resized.faces);
    let file = target.out.name();
    let text = table::map(map, name, ui.room().paint);
    ui.text(&format!("{text}\nwritten    {file}: {}, {} faces", map.verdict.as_str(), faces))?;
    ui.value(&Written { file: file.clone(), resized, message: map })?;
    let Map { query, verdict, inspired, .. } = *map;
    let within_percent = resized.map(|resized| resized.within_percent);
    Ok(Delivered { query, verdict, inspired, reasons: map.reasons.clone(), faces, within_percent, file })
}

/// Writes the numbers of the example's vertices that a map has, one a line, where they are asked for.
///
/// # Errors
/// [`ClientError::Unwritable`].
pub(super) fn write_kept(map: &Map, target: &Target) -> Result<(), ClientError> {
    let Some(file) = &target.kept else { return Ok(()) };
    let all: Vec<u32> = (0..u32::try_from(map.own_vertices).unwrap_or(u32::MAX)).collect();
    let kept = map.kept.as_ref().unwrap_or(&all);
    let text: String = kept.iter().map(|v| format!("{v}\n")).collect();
    file::write(file, text.as_bytes())
}

/// Downloads the mesh of a composition of `maps`, writes it, and tells how good it is.
///
/// # Errors
/// As [`write_map`].
pub(super) async fn write_composition(
    composition: &Composition,
    maps: &[Map],
    target: &Target,
    api: &Api,
    ui: &mut Ui,
) -> Result<Delivered, ClientError> {
    let resized = target.put(composition.query, MeshSource::Composition(composition.id), api, ui).await?;
    let file = target.out.name();
    let verdicts = table::verdicts(maps, composition.templates.len());
    let Composition { query, verdict, inspired, triangles, .. } = *composition;
    let quads = resized.map_or(composition.quads, |resized| resized.faces);
    let text = table::composition(composition, ui.room().paint);
    ui.text(&format!("{text}\nwritten     {file}: {quads} quads, {verdicts}"))?;
    ui.value(&Written { file: file.clone(), resized, message: composition })?;
    let reasons = composition.reasons.clone();
    // A size that was asked for counts all faces.
    let faces = resized.map_or(quads + triangles, |resized| resized.faces);
    let within_percent = resized.map(|resized| resized.within_percent);
    Ok(Delivered { query, verdict, inspired, reasons, faces, within_percent, file })
}
