//! Guides: each is linked in the index, and every link between pages leads somewhere.

use super::tree::SourceFile;
use std::path::{Component, Path, PathBuf};

/// The folder of the guides.
const FOLDER: &str = "docs/";

/// The index of the guides.
pub const INDEX: &str = "docs/README.md";

/// Guides that the index leaves out, and a front page that does not lead to the index; `pages` are all pages of the project.
pub fn unlinked(pages: &[SourceFile]) -> Vec<String> {
    let linked = |from: &str| {
        let page = pages.iter().find(|page| page.path == from);
        page.map(|page| links(&page.text).iter().map(|link| place(from, link)).collect::<Vec<_>>()).unwrap_or_default()
    };
    let (index, front) = (linked(INDEX), linked("README.md"));
    let mut found = Vec::new();
    for page in pages {
        let is_guide = page.path.strip_prefix(FOLDER).is_some_and(|name| !name.contains('/')) && page.path != INDEX;
        if is_guide && !index.contains(&page.path) {
            found.push(format!("{INDEX} does not link {}; add it there, or remove the page", page.path));
        }
    }
    if !front.contains(&INDEX.to_owned()) {
        found.push(format!("README.md does not link {INDEX}; lead its reader to the guides"));
    }
    found
}

/// Links of a page that lead to no file or heading; `exists` tells whether there is a file or folder at a path from the root, and
/// `pages` are all pages of the project.
pub fn dead(page: &SourceFile, pages: &[SourceFile], exists: &dyn Fn(&str) -> bool) -> Vec<String> {
    let mut found = Vec::new();
    for link in links(&page.text) {
        let (file, heading) = link.split_once('#').map_or((link.as_str(), None), |(file, to)| (file, Some(to)));
        let path = if file.is_empty() { page.path.clone() } else { place(&page.path, file) };
        let target = pages.iter().find(|page| page.path == path);
        if !exists(&path) {
            found.push(format!("{} links {link}, where nothing is; mend the link", page.path));
        } else if let (Some(heading), Some(target)) = (heading, target)
            && !anchors(&target.text).any(|anchor| anchor == heading)
        {
            found.push(format!("{} links {link}, a heading that {path} has not; mend the link", page.path));
        }
    }
    found
}

/// Rows of the kernel's notation that name a file which is not there, or an item that none of their files has; `sources` are all
/// sources of the project.
pub fn stale(notation: &SourceFile, sources: &[SourceFile]) -> Vec<String> {
    let folder = notation.path.rsplit_once('/').map_or("", |(folder, _)| folder);
    let named = |cell: &str| cell.split('`').skip(1).step_by(2).map(str::to_owned).collect::<Vec<_>>();
    let mut found = Vec::new();
    for line in notation.text.lines().filter(|line| line.starts_with('|')) {
        let line = line.replace("\\|", " ");
        let cells: Vec<&str> = line.trim_matches('|').split('|').collect();
        let [.., types, files] = cells[..] else { continue };
        let mut texts = Vec::new();
        for file in named(files) {
            let path = format!("{folder}/src/{file}");
            let is_own = |at: &str| at == path || path.ends_with('/') && at.starts_with(&path);
            let own: Vec<&SourceFile> = sources.iter().filter(|source| is_own(&source.path)).collect();
            if own.is_empty() {
                found.push(format!("{} names {file}, which is not there; name the file it became", notation.path));
            }
            texts.extend(own);
        }
        for item in named(types).iter().filter(|item| item.contains("::") && !texts.is_empty()) {
            let last = item.rsplit("::").next().unwrap_or_default();
            let is_word = |text: &str| text.split(|c: char| !c.is_alphanumeric() && c != '_').any(|word| word == last);
            let is_file = |path: &str| path.ends_with(&format!("/{last}.rs"));
            if !texts.iter().any(|source| is_word(&source.text) || is_file(&source.path)) {
                found.push(format!("{} names {item}, which none of its files has; name what it became", notation.path));
            }
        }
    }
    found
}

/// The targets of the links and pictures of a page that lead to files of the project.
fn links(text: &str) -> Vec<String> {
    let mut found = Vec::new();
    let mut in_block = false;
    for line in text.lines() {
        if line.trim_start().starts_with("```") {
            in_block = !in_block;
        }
        if in_block {
            continue;
        }
        for rest in line.split("](").skip(1) {
            let target = rest.split(')').next().unwrap_or_default();
            if !target.contains("://") && !target.starts_with("mailto:") {
                found.push(target.to_owned());
            }
        }
    }
    found
}

/// The path from the root of what a page links.
fn place(page: &str, link: &str) -> String {
    let file = link.split('#').next().unwrap_or_default();
    let folder = Path::new(page).parent().unwrap_or(Path::new(""));
    let mut path = PathBuf::new();
    for part in folder.join(file).components() {
        match part {
            Component::ParentDir => drop(path.pop()),
            Component::Normal(name) => path.push(name),
            _ => {}
        }
    }
    path.to_string_lossy().replace('\\', "/")
}

/// The names by which the headings of a page are linked: small letters, hyphens for blanks, no other signs.
fn anchors(text: &str) -> impl Iterator<Item = String> {
    let headings = text.lines().filter(|line| line.starts_with('#')).map(|line| line.trim_start_matches('#').trim());
    headings.map(|heading| {
        let kept = heading.to_lowercase().replace(' ', "-");
        kept.chars().filter(|c| c.is_alphanumeric() || matches!(c, '-' | '_')).collect()
    })
}
