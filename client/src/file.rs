//! Files: meshes in, meshes out. What is written is there as a whole or not at all.

use crate::error::ClientError;
use quadmuse_proto::MeshFormat;
use std::{
    io::Write,
    path::{Path, PathBuf},
    str::FromStr,
};

/// A file to write; its extension has chosen the format.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OutFile {
    /// Where.
    pub path: PathBuf,
    /// In which format.
    pub format: MeshFormat,
}

/// A file name whose extension names no format.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected a file name that ends in .obj, .ply, .off, .stl or .glb")]
pub struct UnknownExtension;

impl FromStr for OutFile {
    type Err = UnknownExtension;

    fn from_str(text: &str) -> Result<Self, UnknownExtension> {
        let format = MeshFormat::from_file_name(text).ok_or(UnknownExtension)?;
        Ok(Self { path: text.into(), format })
    }
}

impl OutFile {
    /// Sees to it that the folder is there, before any work is done for a file that can't be written.
    ///
    /// # Errors
    /// [`ClientError::Unwritable`] if there is no such folder.
    pub fn check(&self) -> Result<(), ClientError> {
        let refuse = |source| ClientError::Unwritable { path: self.path.clone(), source };
        match std::fs::metadata(folder(&self.path)) {
            Ok(found) if found.is_dir() => Ok(()),
            Ok(_) => Err(refuse(std::io::ErrorKind::NotADirectory.into())),
            Err(source) => Err(refuse(source)),
        }
    }

    /// See [`write`].
    ///
    /// # Errors
    /// [`ClientError::Unwritable`].
    pub fn write(&self, bytes: &[u8]) -> Result<(), ClientError> {
        write(&self.path, bytes)
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

/// Reads a file.
///
/// # Errors
/// [`ClientError::Unreadable`].
pub fn read(path: &Path) -> Result<Vec<u8>, ClientError> {
    std::fs::read(path).map_err(|source| ClientError::Unreadable { path: path.into(), source })
}

/// The name that an example takes from its file: the file's name without its extension.
pub fn example_name(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
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
        out.write(b"old").expect("writes");
        out.write(b"new").expect("writes");
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
    }
}
