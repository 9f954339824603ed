//! The walls hold in this tree, and each of them bites.

use quadmuse_tests::walls::{
    guides, habits,
    manifest::{self, CRATE_WALLS},
    modules,
    tree::{SourceFile, files, root},
};

fn sources() -> Vec<SourceFile> {
    let found = files(".rs").expect("the sources can be read");
    assert!(found.iter().any(|file| file.path == "tests/tests/walls.rs"), "this file is not among the sources");
    found
}

fn manifests() -> Vec<SourceFile> {
    files("Cargo.toml").expect("the manifests can be read")
}

fn assert_none(complaints: &[String]) {
    assert!(complaints.is_empty(), "\n{}\n", complaints.join("\n"));
}

#[test]
fn crates_depend_only_on_what_their_wall_allows() {
    let manifests = manifests();
    let text_of = |path: &str| {
        let found = manifests.iter().find(|file| file.path == path);
        &found.unwrap_or_else(|| panic!("{path} is missing; if it moved, move its wall")).text
    };
    assert_none(
        &CRATE_WALLS.iter().flat_map(|wall| manifest::complaints(wall, text_of(wall.manifest))).collect::<Vec<_>>(),
    );
}

#[test]
fn only_one_crate_names_an_engine_and_every_crate_keeps_the_lints() {
    let found =
        manifests().iter().flat_map(|file| manifest::complaints_anywhere(&file.path, &file.text)).collect::<Vec<_>>();
    assert_none(&found);
}

#[test]
fn programs_that_are_not_tested_hold_no_tests() {
    let (manifests, sources) = (manifests(), sources());
    let named: usize = manifests.iter().map(|file| manifest::programs_without_tests(&file.text).len()).sum();
    assert!(named > 0, "no manifest has such programs");
    let found = manifests.iter().flat_map(|file| manifest::tests_never_run(&file.path, &file.text, &sources));
    assert_none(&found.collect::<Vec<_>>());
}

#[test]
fn modules_name_only_what_stands_before_them() {
    let found = sources().iter().flat_map(|file| modules::complaints(&file.path, &file.text)).collect::<Vec<_>>();
    assert_none(&found);
}

#[test]
fn sources_are_short_and_finished() {
    let found = sources().iter().flat_map(|file| habits::complaints(&file.path, &file.text)).collect::<Vec<_>>();
    assert_none(&found);
}

#[test]
fn guides_are_in_their_index_and_links_lead_somewhere() {
    let pages = files(".md").expect("the pages can be read");
    assert_none(&guides::unlinked(&pages));
    let exists = |path: &str| root().join(path).exists();
    assert_none(&pages.iter().flat_map(|page| guides::dead(page, &pages, &exists)).collect::<Vec<_>>());
    let notation = pages.iter().find(|page| page.path == "server/kernel/NOTATION.md").expect("the notation");
    assert_none(&guides::stale(notation, &sources()));
}

#[test]
fn the_wall_of_the_notation_bites() {
    let file = |path: &str, text: &str| SourceFile { path: path.into(), text: text.into() };
    let sources = [file("k/src/a.rs", "pub struct Arc;"), file("k/src/b/c.rs", "fn lines() {}")];
    let row = |types: &str, files: &str| file("k/NOTATION.md", &format!("| x\\|y | what | {types} | {files} |\n"));
    let found = |types: &str, files: &str| guides::stale(&row(types, files), &sources);
    assert_none(&found("`a::Arc`, `f64`", "`a.rs`"));
    assert_none(&found("`b::c`, `b::lines`", "`b/`"));
    let (gone, unknown) = (found("`d::Arc`", "`d.rs`"), found("`a::Ark`", "`a.rs`"));
    assert!(gone.len() == 1 && gone[0].contains("names d.rs, which is not there"), "{gone:?}");
    assert!(unknown.len() == 1 && unknown[0].contains("names a::Ark, which none of its files has"), "{unknown:?}");
}

#[test]
fn the_walls_of_guides_bite() {
    let page = |path: &str, text: &str| SourceFile { path: path.into(), text: text.into() };
    let guide = page("docs/a.md", "# One, two\n[up](../README.md) [here](#one-two)\n```\n[no](link)\n```\n");
    let all = |index: &str, front: &str| [guide.clone(), page("docs/README.md", index), page("README.md", front)];
    assert_none(&guides::unlinked(&all("[a](a.md#one-two)", "[guides](docs/README.md)")));
    let found = guides::unlinked(&all("[b](b.md)", "[a](docs/a.md)"));
    assert_eq!(found.len(), 2, "{found:?}");
    assert!(
        found[0].contains("does not link docs/a.md") && found[1].contains("does not link docs/README.md"),
        "{found:?}"
    );

    let pages = all("", "");
    let exists = |path: &str| pages.iter().any(|page| page.path == path);
    assert_none(&guides::dead(&guide, &pages, &exists));
    for (text, expected) in [
        ("[b](b.md)", "where nothing is"),
        ("![p](../docs/p.png)", "where nothing is"),
        ("[a](docs/a.md#three)", "a heading that docs/a.md has not"),
    ] {
        let path = if text.contains("docs/a") { "README.md" } else { "docs/b.md" };
        let found = guides::dead(&page(path, text), &pages, &exists);
        assert!(found.len() == 1 && found[0].contains(expected), "{text}: {found:?}");
    }
}

/// Each broken sample, and what the complaint about it must say.
#[test]
fn the_walls_between_crates_bite() {
    for (path, line, expected) in [
        (
            "server/kernel/Cargo.toml",
            "quadmuse-proto.workspace = true",
            "server/kernel/Cargo.toml depends on quadmuse-proto",
        ),
        ("server/kernel/Cargo.toml", "serde = \"1\"", "depends on serde"),
        ("server/kernel/Cargo.toml", "tokio = { version = \"1\" }", "depends on tokio"),
        ("server/kernel/Cargo.toml", "sled.workspace = true", "depends on sled"),
        ("proto/Cargo.toml", "quadmuse-kernel.workspace = true", "proto/Cargo.toml depends on quadmuse-kernel"),
        ("server/store/Cargo.toml", "quadmuse-server.workspace = true", "depends on quadmuse-server"),
        ("server/cluster/Cargo.toml", "quadmuse-server.workspace = true", "depends on quadmuse-server"),
        ("server/cluster/Cargo.toml", "axum = \"0.8\"", "depends on axum"),
        ("client/Cargo.toml", "quadmuse-kernel.workspace = true", "client/Cargo.toml depends on quadmuse-kernel"),
        ("migrations/Cargo.toml", "quadmuse-proto.workspace = true", "depends on quadmuse-proto"),
        ("server/Cargo.toml", "quadmuse-client.workspace = true", "depends on quadmuse-client"),
    ] {
        let wall = CRATE_WALLS.iter().find(|wall| wall.manifest == path).expect("a wall");
        let broken = format!("[package]\nname = \"x\"\n\n[dependencies]\n{line}\n");
        let found = manifest::complaints(wall, &broken);
        assert!(found.iter().any(|complaint| complaint.contains(expected)), "{line}: {found:?}");
        assert_none(&manifest::complaints(wall, &broken.replace("[dependencies]", "[dev-dependencies]")));
    }
}

#[test]
fn the_walls_that_hold_anywhere_bite() {
    let lints = "[lints]\nworkspace = true\n";
    let found =
        manifest::complaints_anywhere("client/Cargo.toml", &format!("[dependencies]\nsled = \"0.34\"\n{lints}"));
    assert!(found.len() == 1 && found[0].contains("only the store and the migrations"), "{found:?}");
    let found =
        manifest::complaints_anywhere("server/Cargo.toml", &format!("[dependencies]\nasync-nats = \"1\"\n{lints}"));
    assert!(found.len() == 1 && found[0].contains("only the cluster"), "{found:?}");
    let found = manifest::complaints_anywhere("client/Cargo.toml", "[dependencies]\n");
    assert!(found.len() == 1 && found[0].contains("shared lints"), "{found:?}");
    assert_none(&manifest::complaints_anywhere(
        "server/store/Cargo.toml",
        &format!("[dependencies]\nsled = \"0.34\"\n{lints}"),
    ));
}

#[test]
fn the_wall_of_programs_without_tests_bites() {
    let source = |path: &str, text: &str| SourceFile { path: path.into(), text: text.into() };
    let with_tests = "fn main() {}\n#[cfg(test)]\nmod tests {}\n";
    let sources = [
        source("tests/src/bin/a.rs", with_tests),
        source("tests/src/bin/b.rs", "fn main() {}\n"),
        source("client/src/main.rs", with_tests),
    ];
    let list = "bin = [\n    { name = \"a\", test = false },\n    { name = \"b\", test = false },\n    { name = \"c\", test = false },\n]\n";
    let found = manifest::tests_never_run("tests/Cargo.toml", list, &sources);
    assert_eq!(found.len(), 2, "{found:?}");
    assert!(found[0].starts_with("tests/src/bin/a.rs holds tests") && found[1].contains("program c;"), "{found:?}");
    let table = "[[bin]]\nname = \"quadmuse\"\npath = \"src/main.rs\"\ntest = false\n";
    let found = manifest::tests_never_run("client/Cargo.toml", table, &sources);
    assert!(found.len() == 1 && found[0].starts_with("client/src/main.rs holds tests"), "{found:?}");
    assert_none(&manifest::tests_never_run("client/Cargo.toml", &table.replace("test = false\n", ""), &sources));
}

#[test]
fn the_walls_between_modules_bite() {
    for (path, source, expected) in [
        (
            "server/kernel/src/mesh/obj.rs",
            "use crate::map::Map;\n",
            "server/kernel/src/mesh/obj.rs:1 uses map, which stands after mesh",
        ),
        (
            "server/kernel/src/rank.rs",
            "fn f() {}\nuse crate::{mesh::Poly, measure};\n",
            "server/kernel/src/rank.rs:2 uses measure",
        ),
        (
            "server/kernel/src/unfold/pole.rs",
            "use super::super::encode::E;\n",
            "uses encode, which stands after unfold",
        ),
        ("server/kernel/src/unfold.rs", "fn f() { super::encode::g() }\n", "uses encode, which stands after unfold"),
        ("server/kernel/src/rank.rs", "use std::time::Instant;\n", "names std::time"),
        ("server/kernel/src/rank.rs", "fn f() { println!(\"x\") }\n", "names println"),
        ("server/kernel/src/misc.rs", "fn f() {}\n", "without a place in the kernel's order"),
        ("server/src/work/search.rs", "use axum::Json;\n", "server/src/work/search.rs:1 names axum"),
        ("server/src/work.rs", "use crate::http::error;\n", "names crate::http"),
        ("server/src/http/maps.rs", "use quadmuse_kernel::map;\n", "server/src/http/maps.rs:1 names quadmuse_kernel"),
        (
            "server/store/src/record.rs",
            "use quadmuse_proto::Example;\n",
            "server/store/src/record.rs:1 names quadmuse_proto",
        ),
        (
            "server/cluster/src/corpus.rs",
            "use async_nats::Client;\n",
            "server/cluster/src/corpus.rs:1 names async_nats; only `jetstream`",
        ),
        ("server/cluster/src/cache.rs", "use quadmuse_proto::Example;\n", "names quadmuse_proto"),
        ("server/src/http.rs", "fn f(s: quadmuse_store::Store) {}\n", "names quadmuse_store"),
    ] {
        let found = modules::complaints(path, source);
        assert!(found.iter().any(|complaint| complaint.contains(expected)), "{path}: {found:?}");
        assert_none(
            &modules::complaints(path, &format!("#[cfg(test)]\nmod tests {{\n{source}}}\n"))
                .into_iter()
                .filter(|c| !c.contains("misc"))
                .collect::<Vec<_>>(),
        );
    }
    for (path, source) in [
        ("server/kernel/src/map.rs", "use crate::{mesh::Poly, numerics};\n"),
        ("server/kernel/src/unfold/pole.rs", "use super::encode;\n"),
        ("server/kernel/src/rank.rs", "//! As `crate::measure` does.\nconst A: &str = \"crate::measure\";\n"),
        ("server/store/src/record.rs", "use quadmuse_proto::id::ExampleId;\n"),
        ("server/cluster/src/jetstream/streams.rs", "use async_nats::jetstream::Context;\n"),
        ("server/src/http/error.rs", "use quadmuse_store::StoreError;\n"),
        ("server/src/work/search.rs", "// axum would be wrong here\n"),
        ("server/kernel/src/mesh/obj/tests.rs", "use crate::map::Map;\n"),
    ] {
        assert_none(&modules::complaints(path, source));
    }
}

#[test]
fn the_habits_bite() {
    let long = "//\n".repeat(habits::FILE_LINES_MAX + 1);
    for (path, source, expected) in [
        ("a.rs", long.as_str(), "a.rs has 601 lines"),
        ("a/mod.rs", "", "a/mod.rs is a mod.rs"),
        ("a.rs", "fn f() { todo!() }\n", "a.rs:1 has todo!"),
        ("a.rs", "\nfn f() { unimplemented!(\"x\") }\n", "a.rs:2 has unimplemented!"),
        ("a.rs", "#[test]\n#[ignore = \"slow\"]\nfn f() {}\n", "a.rs:2 has #[ignore"),
        ("a.rs", "#![allow(unsafe_code)]\n", "a.rs:1 has allow(unsafe_code)"),
        ("a.rs", concat!("// FIX", "ME later\n"), "a.rs:1 has FIX"),
    ] {
        let found = habits::complaints(path, source);
        assert!(found.iter().any(|complaint| complaint.contains(expected)), "{expected}: {found:?}");
    }
    assert_none(&habits::complaints("a.rs", "/// Never `todo!()` nor `#[ignore]`.\nconst A: &str = \"dbg!\";\n"));
}
