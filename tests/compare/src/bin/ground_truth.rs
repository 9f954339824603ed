//! Maps every pair with a known truth by every method, and prints how far off each map is; those cut from the pairs
//! (feet, annuli, closed heads, other heads), and shapes with sharp edges on their own surface, too.
//!
//! `ground_truth [--kind KIND]… [--method METHOD]… [--name PART]`

use quadmuse_compare::ground_truth::derived::{Source, sources};
use quadmuse_compare::ground_truth::lay::lay;
use quadmuse_compare::ground_truth::method::Method;
use quadmuse_compare::ground_truth::table::{Row, by_kind, line};
use quadmuse_tests::real_input::{Extent, pairs};
use std::process::ExitCode;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// What to run.
#[derive(Default)]
struct Wanted {
    kinds: Vec<String>,
    methods: Vec<Method>,
    name: String,
}

fn main() -> ExitCode {
    match wanted().and_then(|wanted| run(&wanted)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            eprintln!("{why}");
            ExitCode::FAILURE
        }
    }
}

fn wanted() -> Result<Wanted, String> {
    let mut wanted = Wanted::default();
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let value = words.next().ok_or_else(|| format!("expected a value after {word}"))?;
        match word.as_str() {
            "--kind" => wanted.kinds.push(value),
            "--name" => wanted.name = value,
            "--method" => {
                let found = Method::ALL.into_iter().find(|m| m.name() == value);
                let names: Vec<&str> = Method::ALL.iter().map(|m| m.name()).collect();
                wanted
                    .methods
                    .push(found.ok_or_else(|| format!("expected one of {}, found {value}", names.join(", ")))?);
            }
            _ => return Err(format!("expected --kind, --method or --name, found {word}")),
        }
    }
    if wanted.methods.is_empty() {
        wanted.methods = Method::ALL.to_vec();
    }
    Ok(wanted)
}

fn run(wanted: &Wanted) -> Result<(), String> {
    let Some(shared) = quadmuse_tests::shared::folder_or_say("the comparison with the truth") else { return Ok(()) };
    let is_wanted = |source: &Source| {
        (wanted.kinds.is_empty() || wanted.kinds.contains(&source.kind)) && source.name.contains(&wanted.name)
    };
    let mut all = sources(&shared, &pairs::pairs(&shared, Extent::All).map_err(|e| e.to_string())?);
    all.retain(is_wanted);
    let jobs: Vec<(&Source, Method)> = all.iter().flat_map(|s| wanted.methods.iter().map(move |&m| (s, m))).collect();
    let (next, rows) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    let work = || {
        while let Some(&(source, method)) = jobs.get(next.fetch_add(1, Ordering::Relaxed)) {
            let outcome = source.read().and_then(|case| lay(&case, method));
            let row = Row { kind: source.kind.clone(), name: source.name.clone(), method, outcome };
            println!("{}", line(&row));
            if let Ok(mut rows) = rows.lock() {
                rows.push(row);
            }
        }
    };
    std::thread::scope(|scope| {
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        (0..threads).for_each(|_| drop(scope.spawn(work)));
    });
    println!("\n{}", by_kind(&rows.into_inner().unwrap_or_default()));
    Ok(())
}
