//! `open`: the page that shows a query.

use crate::{api::Api, error::ClientError, names, spec::Name, state::State, ui::Ui};
use quadmuse_proto::QueryId;
use serde::Serialize;
use std::{
    env,
    ffi::OsString,
    process::{Command, Stdio},
};

/// The JSON output of `open`.
#[derive(Serialize)]
struct Opened {
    query: QueryId,
    url: String,
}

pub(super) async fn open(name: &Name, api: &Api, state: &State, ui: &mut Ui) -> Result<(), ClientError> {
    // A page of a query that is gone would be an empty one.
    let query = api.query(names::query(name, api, state).await?).await?.id;
    let url = api.page(query);
    ui.text(&url)?;
    // A script wants the address; whoever sits at a terminal wants the page.
    if ui.is_dialogue()
        && let Some(words) = opener(env::consts::OS, |name| env::var_os(name))
        && let Err(error) = start(&words, &url)
    {
        ui.note(&format!("{} can't be started ({error}); open the address yourself", words[0].to_string_lossy()));
    }
    ui.value(&Opened { query, url })
}

fn start(words: &[OsString], url: &str) -> std::io::Result<()> {
    let Some((program, flags)) = words.split_first() else { return Ok(()) };
    let mut command = Command::new(program);
    command.args(flags).arg(url).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    command.spawn().map(|_| ())
}

/// The program that opens an address, and its flags; `None` where there is no screen to show it on.
fn opener(system: &str, variable: impl Fn(&str) -> Option<OsString>) -> Option<Vec<OsString>> {
    let set = |name| variable(name).filter(|value| !value.is_empty());
    if let Some(browser) = set("BROWSER") {
        return Some(vec![browser]);
    }
    match system {
        "macos" => Some(vec!["open".into()]),
        "windows" => Some(vec!["explorer".into()]),
        _ => set("WAYLAND_DISPLAY").or_else(|| set("DISPLAY")).map(|_| vec!["xdg-open".into()]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_is_opened_where_there_is_a_screen() {
        let on = |system: &str, variables: &[(&str, &str)]| {
            let words = opener(system, |name| variables.iter().find(|v| v.0 == name).map(|v| v.1.into()));
            words.map(|words| words[0].to_string_lossy().into_owned())
        };
        assert_eq!(on("linux", &[]), None);
        assert_eq!(on("linux", &[("DISPLAY", "")]), None, "an empty variable counts as none");
        assert_eq!(on("linux", &[("DISPLAY", ":0")]).as_deref(), Some("xdg-open"));
        assert_eq!(on("linux", &[("BROWSER", "firefox")]).as_deref(), Some("firefox"));
        assert_eq!(on("macos", &[]).as_deref(), Some("open"));
    }
}
