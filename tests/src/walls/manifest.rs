//! Walls between crates: who may depend on whom, read from the manifests.

use super::tree::SourceFile;

/// What a crate may, or may not, depend on.
#[derive(Clone, Copy, Debug)]
pub struct CrateWall {
    /// Its manifest's path.
    pub manifest: &'static str,
    /// The crates of this project that it may depend on.
    pub ours: &'static [&'static str],
    /// Crates from outside that it must not depend on.
    pub never: &'static [&'static str],
}

/// The walls, as ARCHITECTURE.md tells them.
pub const CRATE_WALLS: [CrateWall; 8] = [
    CrateWall {
        manifest: "server/kernel/Cargo.toml",
        ours: &[],
        never: &[
            "async-std",
            "axum",
            "chrono",
            "futures",
            "hyper",
            "rand",
            "reqwest",
            "rmp-serde",
            "serde",
            "serde_bytes",
            "serde_json",
            "sled",
            "time",
            "tokio",
            "tracing",
        ],
    },
    CrateWall { manifest: "proto/Cargo.toml", ours: &[], never: &["axum", "hyper", "reqwest", "sled", "tokio"] },
    CrateWall { manifest: "server/samples/Cargo.toml", ours: &["quadmuse-kernel"], never: &["axum", "sled", "tokio"] },
    CrateWall {
        manifest: "server/store/Cargo.toml",
        ours: &["quadmuse-kernel", "quadmuse-proto", "quadmuse-migrations"],
        never: &["axum", "hyper", "tokio"],
    },
    CrateWall {
        manifest: "server/cluster/Cargo.toml",
        ours: &["quadmuse-proto", "quadmuse-store"],
        never: &["axum", "hyper", "sled"],
    },
    CrateWall { manifest: "migrations/Cargo.toml", ours: &[], never: &["axum", "hyper", "tokio"] },
    CrateWall { manifest: "client/Cargo.toml", ours: &["quadmuse-proto"], never: &["axum", "sled"] },
    CrateWall {
        manifest: "server/Cargo.toml",
        ours: &[
            "quadmuse-cluster",
            "quadmuse-kernel",
            "quadmuse-migrations",
            "quadmuse-proto",
            "quadmuse-samples",
            "quadmuse-store",
        ],
        never: &["sled", "reqwest"],
    },
];

/// The only manifests that may name sled, besides the table of shared versions in the root.
pub const SLED_MANIFESTS: [&str; 3] = ["Cargo.toml", "server/store/Cargo.toml", "migrations/Cargo.toml"];

/// The only manifests that may name the client of the engine that servers share.
pub const ENGINE_MANIFESTS: [&str; 2] = ["Cargo.toml", "server/cluster/Cargo.toml"];

/// The dependencies that a manifest names, of every kind but those of the tests (`dev-dependencies`).
pub fn dependencies(manifest: &str) -> Vec<String> {
    let mut names = Vec::new();
    let mut in_table = false;
    for line in manifest.lines().map(str::trim) {
        if let Some(header) = line.strip_prefix('[') {
            let header = header.trim_end_matches(']');
            let path: Vec<&str> = header.split('.').collect();
            let is_table = |name: &&str| matches!(*name, "dependencies" | "build-dependencies");
            in_table = path.last().is_some_and(is_table);
            if let [.., table, name] = path.as_slice()
                && is_table(table)
            {
                names.push(name.trim_matches('"').to_owned());
            }
        } else if in_table && !line.is_empty() && !line.starts_with('#') {
            let name = line.split(['=', '.', ' ']).next().unwrap_or_default();
            names.push(name.trim_matches('"').to_owned());
        }
    }
    names
}

/// What a manifest does against its wall.
pub fn complaints(wall: &CrateWall, manifest: &str) -> Vec<String> {
    let path = wall.manifest;
    let mut found = Vec::new();
    for name in dependencies(manifest) {
        if name.starts_with("quadmuse-") && !wall.ours.contains(&name.as_str()) {
            found.push(format!("{path} depends on {name}; of this project it may know {:?} only", wall.ours));
        }
        if wall.never.contains(&name.as_str()) {
            found.push(format!(
                "{path} depends on {name}; that stays on the other side of the wall (see ARCHITECTURE.md)"
            ));
        }
    }
    found
}

/// What any manifest may do wrong, wherever it stands.
pub fn complaints_anywhere(path: &str, manifest: &str) -> Vec<String> {
    let mut found = Vec::new();
    let names_sled = dependencies(manifest).iter().any(|name| name == "sled");
    if names_sled && !SLED_MANIFESTS.contains(&path) {
        found.push(format!("{path} depends on sled; only the store and the migrations may, go through quadmuse-store"));
    }
    let names_engine = dependencies(manifest).iter().any(|name| name == "async-nats");
    if names_engine && !ENGINE_MANIFESTS.contains(&path) {
        found.push(format!("{path} depends on async-nats; only the cluster may, go through quadmuse-cluster"));
    }
    let is_workspace = manifest.contains("[workspace]");
    let lints: String = manifest.split_whitespace().collect();
    if !is_workspace && !lints.contains("[lints]workspace=true") {
        found.push(format!("{path} leaves out the shared lints; add `[lints]` with `workspace = true`"));
    }
    found
}

/// The programs of which a manifest says that they hold no tests (`test = false`).
pub fn programs_without_tests(manifest: &str) -> Vec<&str> {
    let mut names = Vec::new();
    let mut last = None;
    for line in manifest.lines().filter(|line| !line.starts_with('#')) {
        if let Some((_, rest)) = line.split_once("name = \"") {
            last = rest.split('"').next();
        }
        if line.contains("test = false") {
            names.extend(last);
        }
    }
    names
}

/// The tests that nobody would run: those of programs of which their manifest says that they hold none.
pub fn tests_never_run(path: &str, manifest: &str, sources: &[SourceFile]) -> Vec<String> {
    let folder = path.trim_end_matches("Cargo.toml");
    let of = |name: &str| [format!("{folder}src/bin/{name}.rs"), format!("{folder}src/main.rs")];
    let mut found = Vec::new();
    for name in programs_without_tests(manifest) {
        match of(name).iter().find_map(|path| sources.iter().find(|source| source.path == *path)) {
            None => found.push(format!("{path} names the program {name}; its source is not where cargo looks for it")),
            Some(source) if source.text.lines().any(|line| matches!(line.trim(), "#[cfg(test)]" | "#[test]")) => {
                found.push(format!("{} holds tests that are never run; take `test = false` out of {path}", source.path))
            }
            Some(_) => {}
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_way_to_write_a_dependency_is_read() {
        let manifest = "[package]\nname = \"x\"\n[dependencies]\n# none\na = \"1\"\nb.workspace = true\n\"c\" = { path = \"..\" }\n\
                        [dependencies.d]\nversion = \"1\"\n[target.'cfg(unix)'.dependencies]\ne = \"1\"\n\
                        [build-dependencies]\nf = \"1\"\n[dev-dependencies]\ng = \"1\"\n[features]\nh = []\n";
        assert_eq!(dependencies(manifest), ["a", "b", "c", "d", "e", "f"]);
    }
}
