//! What a terminal shows while the service makes a map or a composition.

use crate::{
    Shared,
    fake::{Asked, Fake, Reply},
    messages::{query, query_id},
    queries::{mesh_file, service},
};
use indicatif::TermLike;
use quadmuse_client::{
    args::Cli,
    carry_out,
    ui::{Audience, Ui},
};
use quadmuse_proto::{Making, MakingState, Product, Query, QueryState};
use std::{
    io,
    sync::atomic::{AtomicU32, Ordering},
    time::{Duration, Instant},
};

/// A terminal of 80 columns that keeps all that is ever drawn on it.
#[derive(Clone, Default)]
struct Terminal(Shared);

impl std::fmt::Debug for Terminal {
    fn fmt(&self, to: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        to.write_str("Terminal")
    }
}

impl TermLike for Terminal {
    fn width(&self) -> u16 {
        80
    }
    fn move_cursor_up(&self, _: usize) -> io::Result<()> {
        Ok(())
    }
    fn move_cursor_down(&self, _: usize) -> io::Result<()> {
        Ok(())
    }
    fn move_cursor_right(&self, _: usize) -> io::Result<()> {
        Ok(())
    }
    fn move_cursor_left(&self, _: usize) -> io::Result<()> {
        Ok(())
    }
    fn write_line(&self, text: &str) -> io::Result<()> {
        self.write_str(&format!("{text}\n"))
    }
    fn write_str(&self, text: &str) -> io::Result<()> {
        io::Write::write_all(&mut self.0.clone(), text.as_bytes())
    }
    fn clear_line(&self) -> io::Result<()> {
        Ok(())
    }
    fn flush(&self) -> io::Result<()> {
        Ok(())
    }
}

/// A service that is a while at each map and composition: until it was asked so often how far that is.
fn slow(asked: &Asked, often: u32, polls: &AtomicU32, open: &AtomicU32) -> Reply {
    let making = |product| Making {
        id: "1".into(),
        product,
        query: query_id(),
        state: MakingState::Running,
        progress: 0.625,
        stage: if product == Product::Composition { "sewing the seams" } else { "laying the example" }.into(),
        created: String::new(),
        problem: None,
    };
    if asked.line == format!("GET /v1/queries/{}", query_id()) && open.load(Ordering::SeqCst) > 0 {
        polls.fetch_add(1, Ordering::SeqCst);
        let making = [Product::Map, Product::Composition, Product::Retopo].map(making).to_vec();
        return Reply::json(200, &Query { making, ..query(QueryState::Done, 1) });
    }
    if asked.line.starts_with("POST") && ["/maps", "/compositions", "/retopos"].iter().any(|of| asked.line.contains(of))
    {
        open.fetch_add(1, Ordering::SeqCst);
        let begun = Instant::now();
        while polls.load(Ordering::SeqCst) < often && begun.elapsed() < Duration::from_secs(20) {
            std::thread::sleep(Duration::from_millis(5));
        }
        polls.store(0, Ordering::SeqCst);
        open.store(0, Ordering::SeqCst);
    }
    service(asked, 1)
}

/// What a terminal saw of a command, with bars or without; how it ended, and how often it was asked how far it is.
async fn seen(line: &str, bars: bool) -> (String, u8, usize) {
    let (polls, open) = (AtomicU32::new(0), AtomicU32::new(0));
    let often = if bars { 2 } else { 0 };
    let server = Fake::start(move |asked| slow(asked, often, &polls, &open));
    let state = tempfile::tempdir().expect("a folder");
    let words = ["quadmuse", "--server", &server.url].into_iter().chain(line.split_whitespace()).map(Into::into);
    let cli = Cli { state: Some(state.path().into()), ..Cli::read(words).expect(line) };
    let terminal = Terminal::default();
    let plain = Ui::new(Audience::People, None, io::sink(), io::sink());
    let mut ui = if bars { plain.with_bars(terminal.clone()) } else { plain };
    let end = carry_out(cli, &mut ui).await;
    let asked = server.lines().into_iter().filter(|line| *line == format!("GET /v1/queries/{}", query_id())).count();
    (terminal.0.text(), end.map_or_else(|error| error.exit_code(), |()| 0), asked)
}

#[tokio::test]
async fn a_terminal_shows_the_percent_of_maps_and_compositions() {
    let (mesh, folder) = (mesh_file(), tempfile::tempdir().expect("a folder"));
    let out = folder.path().join("out.obj");
    let (mesh, out) = (mesh.path().display(), out.display());
    for (line, what) in [
        (format!("retopo {mesh} --force -o {out}"), "laying the example"),
        (format!("compose {} --force -o {out}", query_id()), "sewing the seams"),
    ] {
        let (drawn, code, _) = seen(&line, true).await;
        assert_eq!(code, 0, "{line}: {drawn}");
        assert!(drawn.contains(what) && drawn.contains(" 62 %"), "{line}: {drawn}");
    }
}

#[tokio::test]
async fn where_nobody_sees_bars_the_service_is_not_asked_how_far_it_is() {
    let (mesh, folder) = (mesh_file(), tempfile::tempdir().expect("a folder"));
    let line = format!("retopo {} -o {}", mesh.path().display(), folder.path().join("out.obj").display());
    let (drawn, code, asked) = seen(&line, false).await;
    // Once: when its ranking is over.
    assert_eq!((drawn.as_str(), code, asked), ("", 0, 1));
}
