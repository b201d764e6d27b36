//! The walls of the house (ARCHITECTURE.md): what a folder may name. A violation is reported as file:line with the reason.

#![expect(clippy::unwrap_used, reason = "a failed expectation of a test may panic")]

use std::fmt;
use std::path::{Path, PathBuf};

/// Names that no file of a folder may contain as whole words outside comments, and why.
struct Wall {
    folder: &'static str,
    names: &'static [&'static str],
    reason: &'static str,
}

const WALLS: &[Wall] = &[
    Wall {
        folder: "src/vision",
        names: &["axum", "hyper", "reqwest", "http"],
        reason: "the core takes and gives numbers and images; HTTP is the business of src/http",
    },
    Wall {
        folder: "src/vision",
        names: &["sqlx", "object_store"],
        reason: "the core stores nothing; only src/store knows the database",
    },
    Wall {
        folder: "src/vision",
        names: &["tokio", "futures", "async", "await"],
        reason: "the core computes and never waits; the caller decides on which thread it runs",
    },
    Wall {
        folder: "src/vision",
        names: &["serde", "serde_json", "csv", "png", "zstd"],
        reason: "the core has no file formats; src/pipeline writes and reads them",
    },
    Wall {
        folder: "src/vision",
        names: &["std::fs", "std::io", "std::net", "std::env", "std::process"],
        reason: "the core does no input or output; pass it what it needs",
    },
    Wall {
        folder: "src/vision",
        names: &["std::time", "jiff", "Instant", "SystemTime"],
        reason: "the core reads no clock: the same input gives the same result at any time",
    },
    Wall {
        folder: "src/vision",
        names: &["rand", "rand_chacha", "uuid"],
        reason: "the core draws no chance that it was not given; pass a closure of uniform numbers",
    },
    Wall {
        folder: "src/vision",
        names: &["println", "print", "eprintln", "eprint", "dbg", "tracing", "metrics"],
        reason: "the core says everything in its results; logs and metrics are the caller's",
    },
    Wall {
        folder: "src/vision",
        names: &["static mut", "thread_local", "OnceLock", "LazyLock", "Mutex"],
        reason: "the core keeps no global state",
    },
    Wall {
        folder: "src/vision",
        names: &["ropescope"],
        reason: "the core names itself `crate::vision` or `super`, so that it can become a crate of its own",
    },
    Wall {
        folder: "src/simulate",
        names: &["sqlx", "axum", "tokio"],
        reason: "simulated acquisitions are made without service and database",
    },
    Wall {
        folder: "src/experiments",
        names: &["sqlx", "axum", "tokio"],
        reason: "experiments run from the command line, without service and database",
    },
    Wall {
        folder: "src/pipeline",
        names: &["sqlx", "axum", "tokio"],
        reason: "the pipeline runs from the command line too, without service and database",
    },
];

/// Which other top-level modules a folder may use. Folders that are not listed may use all.
struct Uses {
    folder: &'static str,
    only: &'static [&'static str],
    reason: &'static str,
}

const USES: &[Uses] = &[
    Uses {
        folder: "src/vision",
        only: &["vision"],
        reason: "the paper depends on nothing of the service, so that it can become a crate of its own by `git mv`",
    },
    Uses {
        folder: "src/simulate",
        only: &["simulate", "vision", "pipeline"],
        reason: "the simulator shares geometry and the form of rope.json, else it would test the program with itself",
    },
    Uses {
        folder: "src/evaluate",
        only: &["evaluate"],
        reason: "who judges the results must not share code with who made them",
    },
    Uses {
        folder: "src/experiments",
        only: &["experiments", "simulate", "pipeline", "vision", "evaluate", "drawing"],
        reason: "an experiment simulates, runs the pipeline as everybody does, and has the results judged",
    },
    Uses {
        folder: "src/pipeline",
        only: &["pipeline", "vision"],
        reason: "the pipeline does not know where frames come from or where results go",
    },
];

/// Names that say nothing about what is in a file.
const EMPTY_NAMES: &[&str] = &["utils", "util", "common", "helpers", "helper", "misc", "tools", "stuff"];

struct Violation {
    path: PathBuf,
    line: usize,
    what: String,
    reason: &'static str,
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}: {}: {}", self.path.display(), self.line, self.what, self.reason)
    }
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// All Rust files below a folder of the repository, sorted.
fn rust_files(folder: &str) -> Vec<PathBuf> {
    let mut files = Vec::new();
    let mut folders = vec![root().join(folder)];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display())) {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "rs") {
                files.push(path);
            }
        }
    }
    files.sort();
    assert!(!files.is_empty(), "no Rust files in {folder}: was it moved? Then move its wall, too");
    files
}

/// A line without its comment. `//` inside a string cuts the rest of that line off, which hides at most a name after an address.
fn code(line: &str) -> &str {
    line.find("//").map_or(line, |at| &line[..at])
}

/// True if `name` occurs in `code` and neither continues a word nor is continued.
fn names(code: &str, name: &str) -> bool {
    let word = |c: char| c.is_alphanumeric() || c == '_';
    code.match_indices(name).any(|(at, _)| {
        let before = code[..at].chars().next_back();
        let after = code[at + name.len()..].chars().next();
        !before.is_some_and(word) && !after.is_some_and(word)
    })
}

/// Top-level modules that a line of code names: in `crate::a::b` and in every branch of `crate::{a::b, c}`.
fn modules_named(code: &str) -> Vec<&str> {
    let word = |text: &str| text.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(text.len());
    let mut found = Vec::new();
    for (at, path) in code.match_indices("crate::") {
        if code[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_') {
            continue;
        }
        let rest = &code[at + path.len()..];
        let Some(branches) = rest.strip_prefix('{') else {
            found.push(&rest[..word(rest)]);
            continue;
        };
        if branches.trim().is_empty() {
            found.push("{"); // goes on in the next line, where it cannot be judged: let nobody hide there
        }
        let mut depth = 0;
        let mut start = true;
        for (k, c) in branches.char_indices() {
            match c {
                '{' => depth += 1,
                '}' if depth == 0 => break,
                '}' => depth -= 1,
                ',' if depth == 0 => start = true,
                c if start && c.is_alphabetic() => {
                    found.push(&branches[k..k + word(&branches[k..])]);
                    start = false;
                }
                _ => {}
            }
        }
    }
    found
}

/// Violations in all lines of a folder that `judge` objects to.
fn search(folder: &str, reason: &'static str, judge: impl Fn(&str) -> Option<String>) -> Vec<Violation> {
    let mut violations = Vec::new();
    for path in rust_files(folder) {
        let text = std::fs::read_to_string(&path).unwrap();
        for (number, line) in text.lines().enumerate() {
            if let Some(what) = judge(code(line)) {
                let path = path.strip_prefix(root()).unwrap().to_path_buf();
                violations.push(Violation { path, line: number + 1, what, reason });
            }
        }
    }
    violations
}

fn assert_none(violations: Vec<Violation>) {
    let list: Vec<String> = violations.iter().map(Violation::to_string).collect();
    assert!(
        list.is_empty(),
        "{} broken:\n{}",
        if list.len() == 1 { "a wall is" } else { "walls are" },
        list.join("\n")
    );
}

#[test]
fn folders_name_only_what_is_their_business() {
    let broken = WALLS.iter().flat_map(|wall| {
        search(wall.folder, wall.reason, |code| {
            wall.names.iter().find(|name| names(code, name)).map(|name| format!("names `{name}`"))
        })
    });
    assert_none(broken.collect());
}

#[test]
fn folders_use_only_the_modules_below_them() {
    let broken = USES.iter().flat_map(|uses| {
        search(uses.folder, uses.reason, |code| {
            modules_named(code).into_iter().find(|m| !uses.only.contains(m)).map(|m| format!("uses `crate::{m}`"))
        })
    });
    assert_none(broken.collect());
}

#[test]
fn only_the_store_contains_sql() {
    let reason = "SQL lives in src/store alone, so that a migration has one place to be followed up";
    let sql = |code: &str| {
        ["sqlx::query", "sqlx::query_as", "sqlx::query_scalar", "query_as", "query_scalar"]
            .into_iter()
            .find(|name| names(code, name))
            .map(|name| format!("names `{name}`"))
    };
    assert_none(search("src", reason, sql).into_iter().filter(|v| !v.path.starts_with("src/store")).collect());
}

#[test]
fn every_file_is_named_after_its_idea() {
    let nameless = |path: &Path| {
        path.components().any(|c| {
            let name = Path::new(c.as_os_str()).file_stem().and_then(|n| n.to_str()).unwrap_or_default();
            EMPTY_NAMES.contains(&name)
        })
    };
    let broken = ["src", "tests"]
        .into_iter()
        .flat_map(rust_files)
        .map(|path| path.strip_prefix(root()).unwrap().to_path_buf())
        .filter(|path| nameless(path))
        .map(|path| Violation {
            path,
            line: 1,
            what: "is a name for anything".into(),
            reason: "name the file after the one idea in it",
        });
    assert_none(broken.collect());
}

#[test]
fn the_wall_itself_sees_what_it_should() {
    assert!(names("use std::fs;", "std::fs") && names("async fn f()", "async"));
    assert!(!names("let operand = 1;", "rand") && !names("std::fstream", "std::fs"));
    assert_eq!(code("let x = 1; // tokio would wait here"), "let x = 1; ");
    assert_eq!(modules_named("use crate::store::jobs;"), ["store"]);
    assert_eq!(modules_named("use crate::{vision::{rope, wire}, http};"), ["vision", "http"]);
    assert_eq!(modules_named("pub(crate) fn f(g: crate::http::G)"), ["http"]);
    assert_eq!(modules_named("use crate::{"), ["{"]);
    assert!(modules_named("use my_crate::http;").is_empty());
}
