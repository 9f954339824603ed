//! The command line is read as the interface has it.

use super::*;
use clap::CommandFactory;

const ID: &str = "01ARZ3NDEKTSV4RRFFQ69G5FAV";

fn parse(line: &str) -> Result<Cli, clap::Error> {
    Cli::read(line.replace("ID", ID).split_whitespace().map(OsString::from))
}

#[test]
fn the_commands_are_consistent() {
    Cli::command().debug_assert();
}

#[test]
fn every_verb_of_the_interface_is_there() {
    for line in [
        "quadmuse add a.obj b.ply --tag head --tag hero --relevance 4 --segments whole",
        "quadmuse add a.obj --parts 8",
        "quadmuse add a.obj --whole-only --components refuse",
        "quadmuse retopo a.obj -o b.obj --parts auto",
        "quadmuse query a.obj --components refuse",
        "quadmuse retopo a.obj -o b.obj --like ID",
        "quadmuse retopo a.obj -o b.obj --quads 5000",
        "quadmuse compose ID -o b.obj --tolerance 0.1",
        "quadmuse map ID -o b.obj --tolerance 0.1%",
        "quadmuse constrain ID ID --undo f2 -o out.obj",
        "quadmuse constrain ID ID --set f1:1,2,3=4,5,6 --on-fold resolve -o out.obj",
        "quadmuse list --tag head --topology disc",
        "quadmuse show ID",
        "quadmuse remove ID ID",
        "quadmuse rate ID 4.5",
        "quadmuse tag ID +hero -wip",
        "quadmuse query a.ply --top 4 --tag head --resolution 128 --deadline 2.5 --segments groups --no-follow",
        "quadmuse ranking ID --segment 1 --follow",
        "quadmuse map ID -o out.obj",
        "quadmuse map ID ID --segment 2 -o out.ply",
        "quadmuse constrain ID ID --set 1,2,3=4,5,6 --remove f3 -o out.glb",
        "quadmuse map ID -o out.obj --require inspired",
        "quadmuse compose ID -o out.obj --require fair",
        "quadmuse retopo scan.ply -o out.obj --require good",
        "quadmuse compose ID --use 0=ID --use 1=ID:2 -o out.off",
        "quadmuse compose ID --use arm=ID -o out.off",
        "quadmuse map ID --segment arm -o out.obj",
        "quadmuse name @last",
        "quadmuse name ID 0=arm leg=",
        "quadmuse retopo scan.ply -o out.obj --top 8 --use 0=ID --smoothing 3",
        "quadmuse annotate ID --author Ada --licence CC0-1.0 --notes neutral --landmarks points.json",
        "quadmuse annotate ID --landmark nose=v12 --landmark chin=1,-2,3 --forget brow --name head",
        "quadmuse map ID ID --landmarks names --names points.json -o out.obj",
        "quadmuse map ID ID --landmarks points.json -o out.obj",
        "quadmuse query - --top 2",
        "quadmuse retopo - -o -",
        "quadmuse map ID -o - --format ply --picture out.png --force",
        "quadmuse remove --tag wip --yes",
        "quadmuse add a.obj.gz --verbose --name nose",
        "quadmuse batch scans -o out --require fair --format ply --pictures --tag head",
        "quadmuse batch scans -o out --quads 5000 --use 0=ID --density 1",
        "quadmuse batch scans -o out --tolerance 0.1% --like ID",
        "quadmuse open @last",
        "quadmuse completions zsh",
        "quadmuse man retopo",
        "quadmuse man --dir out",
        "quadmuse --server http://x:1 --token t --json list",
        "quadmuse list --json --server http://x:1",
    ] {
        assert!(parse(line).is_ok(), "{line}: {}", parse(line).expect_err("just seen"));
    }
}

#[test]
fn wrong_usage_is_refused_with_exit_code_2() {
    for line in [
        "quadmuse",
        "quadmuse add",
        "quadmuse add a.obj --relevance 6",
        "quadmuse add a.obj --relevance -1",
        "quadmuse show",
        "quadmuse query a.obj --resolution 100",
        "quadmuse query a.obj --deadline nan",
        "quadmuse query a.obj --top 0",
        "quadmuse map ID",
        "quadmuse map ID -o out.docx",
        "quadmuse constrain ID ID -o out.obj",
        "quadmuse constrain ID ID --set 1,2=3,4,5 -o out.obj",
        "quadmuse constrain ID ID --on-fold resolve -o out.obj",
        "quadmuse constrain ID ID --remove f1 --on-fold bend -o out.obj",
        "quadmuse annotate ID",
        "quadmuse annotate ID --landmark nose",
        "quadmuse map ID --names points.json -o out.obj",
        "quadmuse query a.obj --components all",
        "quadmuse query a.obj --like ID --parts auto",
        "quadmuse add a.obj --whole-only --parts 3",
        "quadmuse add a.obj --whole-only --segments groups",
        "quadmuse query a.obj --whole-only",
        "quadmuse map ID -o out.obj --require poor",
        "quadmuse compose ID --use ID -o out.obj",
        "quadmuse tag ID hero",
        "quadmuse list --topology klein",
        "quadmuse remove",
        "quadmuse remove ID --tag wip",
        "quadmuse map ID -o out.obj --picture out.jpg",
        "quadmuse map ID -o out.obj --format fbx",
        "quadmuse map ID -o out.obj --quads 5",
        "quadmuse map ID -o out.obj --tolerance 0",
        "quadmuse retopo a.obj -o out.obj --quads 100 --tolerance 1",
        "quadmuse batch scans",
        "quadmuse batch scans -o out --quads 100 --tolerance 1",
        "quadmuse completions tcsh",
    ] {
        let error = parse(line).expect_err(line);
        assert_eq!(error.exit_code(), i32::from(crate::error::EXIT_USAGE), "{line}");
    }
}

#[test]
fn a_tag_may_be_taken_off_although_it_looks_like_a_flag() {
    for line in [
        "quadmuse tag ID -wip +hero",
        "quadmuse tag ID -wip --json +hero --server http://x",
        "quadmuse --server tag tag ID -- -wip +hero",
    ] {
        let Command::Tag { edits, .. } = parse(line).expect(line).command else { panic!("{line}: another command") };
        assert_eq!(edits, [TagEdit::Remove("wip".into()), TagEdit::Add("hero".into())]);
    }
    assert!(parse("quadmuse tag ID -wip --json").expect("parses").json);
}

#[test]
fn the_address_is_the_local_one_unless_told() {
    assert_eq!(parse("quadmuse list").expect("parses").server, SERVER_DEFAULT);
}
