//! The flags of `annotate`.

use crate::spec::{Name, NamedSpec};
use clap::{ArgGroup, Args};
use std::path::PathBuf;

/// These options change something: at least one of them is needed.
const CHANGES: [&str; 7] = ["name", "author", "licence", "notes", "landmarks", "landmark", "forget"];

/// `annotate`.
#[derive(Debug, Args)]
#[command(group(ArgGroup::new("change").required(true).multiple(true).args(CHANGES)))]
pub struct AnnotateArgs {
    /// The example
    #[arg(value_name = "ID")]
    pub id: Name,
    /// A new name
    #[arg(long, value_name = "NAME")]
    pub name: Option<String>,
    /// Names who made the example; empty for nobody
    #[arg(long, value_name = "NAME")]
    pub author: Option<String>,
    /// The licence it is under; empty for none
    #[arg(long, value_name = "TEXT", alias = "license")]
    pub licence: Option<String>,
    /// Says what else there is to know of the example; empty for nothing
    #[arg(long, value_name = "TEXT")]
    pub notes: Option<String>,
    /// A file of named landmarks, in place of those it has: JSON like `{"nose_tip": [x, y, z], "chin": 1234}`, where a number is
    /// that of a vertex, from 0. `{}` takes all of them off
    #[arg(long, value_name = "FILE")]
    pub landmarks: Option<PathBuf>,
    /// A named landmark beside those it has, or in place of the one of that name: a point, or `v` and the number of a vertex;
    /// may repeat
    #[arg(long, value_name = "NAME=X,Y,Z")]
    pub landmark: Vec<NamedSpec>,
    /// The name of a landmark to take off; may repeat
    #[arg(long, value_name = "NAME")]
    pub forget: Vec<String>,
}
