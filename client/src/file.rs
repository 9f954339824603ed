//! Files: meshes in, meshes out. What is written is there as a whole or not at all.
//!
//! `-` stands for standard input and standard output. A mesh may be compressed by gzip, both ways.

use crate::{error::ClientError, ui::Ui};
use flate2::{Compression, read::MultiGzDecoder, write::GzEncoder};
use quadmuse_proto::MeshFormat;
use std::{
    io::{Read, Write},
    path::{Path, PathBuf},
    str::FromStr,
};

/// The word for standard input, and for standard output.
pub const STANDARD: &str = "-";

/// The extension of what gzip has compressed.
const GZIP_EXTENSION: &str = "gz";

/// Every gzip file begins with these bytes (RFC 1952, 2.3.1).
const GZIP_BEGINS: [u8; 2] = [0x1f, 0x8b];

/// Whether bytes are compressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Packing {
    /// As they are.
    Plain,
    /// By gzip.
    Gzip,
}

/// A file to write; its extension has chosen the format.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OutFile {
    /// Where; `-` is standard output.
    pub path: PathBuf,
    /// In which format.
    pub format: MeshFormat,
    /// Whether it is compressed: where the name ends in `.gz`.
    pub packing: Packing,
}

/// A file name whose extension names no format.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected a file name that ends in .obj, .ply, .off, .stl or .glb, with .gz behind it or without, or -")]
pub struct UnknownExtension;

impl FromStr for OutFile {
    type Err = UnknownExtension;

    fn from_str(text: &str) -> Result<Self, UnknownExtension> {
        if text == STANDARD {
            return Ok(Self { path: text.into(), format: MeshFormat::default(), packing: Packing::Plain });
        }
        let (name, packing) = unpacked_name(text);
        let format = MeshFormat::from_file_name(name).ok_or(UnknownExtension)?;
        Ok(Self { path: text.into(), format, packing })
    }
}

impl OutFile {
    /// Whether it is standard output.
    pub fn is_standard(&self) -> bool {
        self.path.as_os_str() == STANDARD
    }

    /// The name by which it is told.
    pub fn name(&self) -> String {
        if self.is_standard() { "standard output".into() } else { self.path.display().to_string() }
    }

    /// Sees to it that the folder is there, before any work is done for a file that can't be written.
    ///
    /// # Errors
    /// [`ClientError::Unwritable`] if there is no such folder.
    pub fn check(&self) -> Result<(), ClientError> {
        if self.is_standard() { Ok(()) } else { check_folder(&self.path) }
    }

    /// Writes a mesh: to its file, or to the standard output of `ui`. See [`write`].
    ///
    /// # Errors
    /// [`ClientError::Unwritable`], [`ClientError::Output`].
    pub fn write(&self, bytes: &[u8], ui: &mut Ui) -> Result<(), ClientError> {
        let unwritable = |source| ClientError::Unwritable { path: self.path.clone(), source };
        let packed;
        let bytes = match self.packing {
            Packing::Plain => bytes,
            Packing::Gzip => {
                let mut packer = GzEncoder::new(Vec::new(), Compression::default());
                packed = packer.write_all(bytes).and_then(|()| packer.finish()).map_err(unwritable)?;
                &packed
            }
        };
        if self.is_standard() { ui.data(bytes) } else { write(&self.path, bytes) }
    }
}

/// A mesh as its file has it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MeshBytes {
    /// The bytes of the file.
    pub bytes: Vec<u8>,
    /// The format that the file's name tells; the service looks at the bytes where it tells none.
    pub format: Option<MeshFormat>,
    /// Whether the bytes are compressed.
    pub packing: Packing,
}

impl MeshBytes {
    /// Reads a file, or standard input where its name is `-`. Whether it is compressed is told by its bytes.
    ///
    /// # Errors
    /// [`ClientError::Unreadable`].
    pub fn read(path: &Path) -> Result<Self, ClientError> {
        let bytes = read(path)?;
        let name = path.to_string_lossy();
        let packing = if bytes.starts_with(&GZIP_BEGINS) { Packing::Gzip } else { Packing::Plain };
        Ok(Self { bytes, format: MeshFormat::from_file_name(unpacked_name(&name).0), packing })
    }

    /// The mesh itself, for where a compressed one can't travel. `path` is for the message.
    ///
    /// # Errors
    /// [`ClientError::Unreadable`] where gzip can't have made it.
    pub fn unpacked(self, path: &Path) -> Result<Vec<u8>, ClientError> {
        if self.packing == Packing::Plain {
            return Ok(self.bytes);
        }
        let mut bytes = Vec::new();
        let read = MultiGzDecoder::new(self.bytes.as_slice()).read_to_end(&mut bytes);
        read.map_err(|source| ClientError::Unreadable { path: path.into(), source })?;
        Ok(bytes)
    }
}

/// A file's name without the extension of gzip, and whether it had it.
fn unpacked_name(name: &str) -> (&str, Packing) {
    match name.rsplit_once('.') {
        Some((rest, end)) if end.eq_ignore_ascii_case(GZIP_EXTENSION) => (rest, Packing::Gzip),
        _ => (name, Packing::Plain),
    }
}

/// Whether a file's name is that of a mesh.
pub fn is_mesh(path: &Path) -> bool {
    // What the service reads, and not only what it writes.
    let others = ["gltf"];
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let name = unpacked_name(&name).0;
    let end = name.rsplit_once('.').map_or("", |(_, end)| end);
    !name.starts_with('.')
        && (MeshFormat::from_file_name(name).is_some() || others.iter().any(|other| end.eq_ignore_ascii_case(other)))
}

/// Sees to it that the folder of a file is there.
///
/// # Errors
/// [`ClientError::Unwritable`] if it is not.
pub fn check_folder(path: &Path) -> Result<(), ClientError> {
    let refuse = |source| ClientError::Unwritable { path: path.into(), source };
    match std::fs::metadata(folder(path)) {
        Ok(found) if found.is_dir() => Ok(()),
        Ok(_) => Err(refuse(std::io::ErrorKind::NotADirectory.into())),
        Err(source) => Err(refuse(source)),
    }
}

fn folder(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

fn write_whole(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let mut temporary = tempfile::Builder::new();
    temporary.prefix(".quadmuse-");
    #[cfg(unix)]
    {
        // As any new file of the user's: the umask takes off what it wants (a temporary file would be 0600).
        use std::os::unix::fs::PermissionsExt;
        temporary.permissions(std::fs::Permissions::from_mode(0o666));
    }
    let mut file = temporary.tempfile_in(folder(path))?;
    file.write_all(bytes)?;
    file.as_file().sync_all()?;
    file.persist(path)?;
    Ok(())
}

/// Writes a file beside its place, and moves it there when it is whole.
///
/// # Errors
/// [`ClientError::Unwritable`]; then an older file of that name is untouched.
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), ClientError> {
    write_whole(path, bytes).map_err(|source| ClientError::Unwritable { path: path.into(), source })
}

/// Reads a file, or standard input where its name is `-`.
///
/// # Errors
/// [`ClientError::Unreadable`].
pub fn read(path: &Path) -> Result<Vec<u8>, ClientError> {
    let read = if path.as_os_str() == STANDARD {
        let mut bytes = Vec::new();
        std::io::stdin().lock().read_to_end(&mut bytes).map(|_| bytes)
    } else {
        std::fs::read(path)
    };
    read.map_err(|source| ClientError::Unreadable { path: path.into(), source })
}

/// The name that an example takes from its file: the file's name without its extension, and without `.gz`.
pub fn example_name(path: &Path) -> String {
    if path.as_os_str() == STANDARD {
        return "stdin".into();
    }
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let stem = Path::new(unpacked_name(&name).0).file_stem().unwrap_or_default();
    stem.to_string_lossy().into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_extension_chooses_the_format() {
        assert_eq!("a/b.PLY".parse::<OutFile>().expect("known").format, MeshFormat::Ply);
        assert_eq!("a/b.fbx".parse::<OutFile>(), Err(UnknownExtension));
        assert_eq!("obj".parse::<OutFile>(), Err(UnknownExtension));
    }

    #[test]
    fn a_file_is_replaced_as_a_whole_and_nothing_is_left_beside_it() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("out.obj");
        let out: OutFile = path.to_str().expect("text").parse().expect("known");
        out.check().expect("the folder is there");
        out.write(b"old", &mut Ui::silent()).expect("writes");
        out.write(b"new", &mut Ui::silent()).expect("writes");
        assert_eq!(std::fs::read(&path).expect("reads"), b"new");
        assert_eq!(std::fs::read_dir(folder.path()).expect("lists").count(), 1);
    }

    #[test]
    fn a_missing_folder_is_noticed_before_the_work() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("no/out.obj");
        let out: OutFile = path.to_str().expect("text").parse().expect("known");
        assert!(matches!(out.check(), Err(ClientError::Unwritable { .. })));
    }

    #[test]
    fn an_example_is_named_after_its_file() {
        assert_eq!(example_name(Path::new("/a/head.v2.obj")), "head.v2");
        assert_eq!(example_name(Path::new("/a/head.v2.obj.gz")), "head.v2");
    }

    #[test]
    fn what_is_compressed_is_known_by_its_bytes_and_named_without_its_extension() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("head.OBJ.gz");
        let out: OutFile = path.to_str().expect("text").parse().expect("known");
        assert_eq!((out.format, out.packing), (MeshFormat::Obj, Packing::Gzip));
        out.write(b"v 0 0 0\n", &mut Ui::silent()).expect("writes");
        let read = MeshBytes::read(&path).expect("reads");
        assert_eq!((read.format, read.packing), (Some(MeshFormat::Obj), Packing::Gzip));
        assert_ne!(read.bytes, b"v 0 0 0\n");
        assert_eq!(read.unpacked(&path).expect("unpacks"), b"v 0 0 0\n");
        // The name alone makes nothing compressed.
        std::fs::write(&path, "v 1 1 1").expect("writes");
        assert_eq!(MeshBytes::read(&path).expect("reads").packing, Packing::Plain);
        assert_eq!("head.gz".parse::<OutFile>(), Err(UnknownExtension));
    }

    #[test]
    fn meshes_are_told_from_other_files_by_their_names() {
        let all = ["a.obj", "b.PLY.gz", "c.gltf", "d.mtl", "e.gz", ".f.obj", "obj"];
        let found: Vec<&str> = all.into_iter().filter(|name| is_mesh(Path::new(name))).collect();
        assert_eq!(found, ["a.obj", "b.PLY.gz", "c.gltf"]);
    }
}
