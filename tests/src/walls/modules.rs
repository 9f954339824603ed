//! Walls between modules: which may name which, read from the sources.

use super::source::{code_of, lines_naming, without_tests};

/// The kernel's modules in the order in which a mesh passes through them: each uses only those before it.
pub const KERNEL_ORDER: [&str; 14] = [
    "numerics", "mesh", "topology", "segment", "unfold", "encode", "register", "rank", "map", "compose", "measure",
    "settle", "fit", "pipeline",
];

/// What the kernel must not do: it computes, and nothing else.
const KERNEL_NEVER: [&str; 12] = [
    "std::fs",
    "std::net",
    "std::env",
    "std::process",
    "std::time",
    "Instant",
    "SystemTime",
    "println",
    "eprintln",
    "print",
    "thread_rng",
    "async",
];

/// Whether a path is that of tests alone.
pub fn is_test_file(path: &str) -> bool {
    path.starts_with("tests/") || path.contains("/tests/") || path.ends_with("/tests.rs") || path.contains("/benches/")
}

/// What a source does against the walls between modules.
pub fn complaints(path: &str, source: &str) -> Vec<String> {
    if is_test_file(path) {
        return Vec::new();
    }
    let code = without_tests(&code_of(source));
    if let Some(inside) = path.strip_prefix("server/kernel/src/") {
        return kernel(path, inside, &code);
    }
    if path.starts_with("server/store/src/") {
        return store(path, &code);
    }
    if path.starts_with("server/cluster/src/") {
        return cluster(path, &code);
    }
    let Some(inside) = path.strip_prefix("server/src/") else { return Vec::new() };
    match inside.split(['/', '.']).next() {
        Some("work") => never(
            path,
            &code,
            &["axum", "hyper", "tower", "crate::http"],
            "`work` is free of HTTP; answer with a value or an error, and let `http` turn it into a response",
        ),
        Some("http") if inside != "http/error.rs" => never(
            path,
            &code,
            &["quadmuse_kernel", "quadmuse_store"],
            "`http` reaches them through `work` only (`http/error.rs` excepted)",
        ),
        _ => Vec::new(),
    }
}

fn never(path: &str, code: &str, words: &[&str], why: &str) -> Vec<String> {
    let found = words.iter().flat_map(|word| lines_naming(code, word).into_iter().map(move |line| (line, word)));
    found.map(|(line, word)| format!("{path}:{line} names {word}; {why}")).collect()
}

/// What a corpus needs of its engine is said in the corpus's words; one module speaks the engine's.
fn cluster(path: &str, code: &str) -> Vec<String> {
    let mut found = store(path, code);
    if !path.starts_with("server/cluster/src/jetstream") {
        let why = "only `jetstream` speaks to the engine; say what is needed in `engine`";
        found.extend(never(path, code, &["async_nats"], why));
    }
    found
}

/// The store knows ids, and nothing else of the wire.
fn store(path: &str, code: &str) -> Vec<String> {
    let is_id = |rest: &str| rest.starts_with("::id::") || rest.starts_with("::id;");
    let others = code.match_indices("quadmuse_proto").filter(|(at, name)| !is_id(&code[at + name.len()..]));
    let line = |at: usize| code[..at].matches('\n').count() + 1;
    let why = "the store knows `quadmuse_proto::id` and nothing else of the wire; keep a shape of its own";
    others.map(|(at, _)| format!("{path}:{} names quadmuse_proto; {why}", line(at))).collect()
}

fn kernel(path: &str, inside: &str, code: &str) -> Vec<String> {
    let mut found = never(
        path,
        code,
        &KERNEL_NEVER,
        "the kernel has no files, network, clock, printing or tasks; hand in what it needs",
    );
    let module = inside.split(['/', '.']).next().unwrap_or_default();
    if module == "lib" {
        return found;
    }
    let Some(place) = KERNEL_ORDER.iter().position(|name| *name == module) else {
        found.push(format!("{path} belongs to a module without a place in the kernel's order; add it to KERNEL_ORDER"));
        return found;
    };
    let depth = inside.trim_end_matches(".rs").split('/').count();
    for (line, used) in used_modules(code, depth) {
        let used_place = KERNEL_ORDER.iter().position(|name| *name == used);
        if used_place.is_some_and(|used_place| used_place > place) {
            found.push(format!(
                "{path}:{line} uses {used}, which stands after {module}; move what both need to a module before"
            ));
        }
    }
    found
}

/// The modules of the crate that a source names, with the line; the source is `depth` modules below the root.
fn used_modules(code: &str, depth: usize) -> Vec<(usize, String)> {
    let root_by_super = "super::".repeat(depth);
    let mut found = Vec::new();
    for root in ["crate::", root_by_super.as_str()] {
        for (at, _) in code.match_indices(root) {
            let before = &code[..at];
            if before.ends_with("::") || before.ends_with(|c: char| c.is_alphanumeric() || c == '_') {
                continue;
            }
            let line = before.matches('\n').count() + 1;
            let rest = &code[at + root.len()..];
            found.extend(first_names(rest).into_iter().map(|name| (line, name)));
        }
    }
    found
}

/// The first names of a path, or of each path in a group: `a::b` gives `a`, `{a::b, c}` gives `a` and `c`.
fn first_names(path: &str) -> Vec<String> {
    let name =
        |text: &str| text.trim_start().chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect::<String>();
    let Some(group) = path.trim_start().strip_prefix('{') else { return vec![name(path)] };
    let (mut names, mut depth, mut begin) = (Vec::new(), 0, 0);
    for (at, c) in group.char_indices() {
        match c {
            '{' => depth += 1,
            ',' if depth == 0 => {
                names.push(name(&group[begin..at]));
                begin = at + 1;
            }
            '}' if depth == 0 => {
                names.push(name(&group[begin..at]));
                break;
            }
            '}' => depth -= 1,
            _ => {}
        }
    }
    names.retain(|name| !name.is_empty());
    names
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_of_imports_are_taken_apart() {
        assert_eq!(first_names("{mesh::{a, b}, map, rank::x,\n}"), ["mesh", "map", "rank"]);
        assert_eq!(first_names("mesh::{a, b};"), ["mesh"]);
    }

    #[test]
    fn a_module_below_reaches_the_root_by_more_supers() {
        assert_eq!(used_modules("use super::map::y;\n", 1), [(1, "map".to_owned())]);
        assert_eq!(used_modules("use super::x;\nuse super::super::map::y;\n", 2), [(2, "map".to_owned())]);
    }
}
