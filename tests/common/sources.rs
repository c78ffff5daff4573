//! The files of the workspace: its crates, and their Rust sources.

use std::path::{Path, PathBuf};

/// A Rust file of the workspace.
pub struct Source {
    /// Path relative to the root, as in `bus/src/lib.rs`.
    pub path: String,
    pub text: String,
}

/// The root of the workspace.
pub fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The text of a file, by its path relative to the root.
pub fn read(path: &str) -> String {
    std::fs::read_to_string(root().join(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// A TOML file, by its path relative to the root.
pub fn read_toml(path: &str) -> toml::Table {
    read(path).parse().unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// The folders of the workspace's crates; `""` is the root package.
pub fn crates() -> Vec<String> {
    let manifest = read_toml("Cargo.toml");
    let members = manifest["workspace"]["members"].as_array().expect("an array of members");
    let members = members.iter().map(|member: &toml::Value| member.as_str().unwrap().to_owned());
    std::iter::once(String::new()).chain(members).collect()
}

/// Every Rust file of the workspace.
pub fn sources() -> Vec<Source> {
    let found: Vec<Source> = crates().iter().flat_map(|folder| sources_of(folder)).collect();
    assert!(found.len() > 200, "sources are missing");
    found
}

/// The Rust files of one crate.
pub fn sources_of(folder: &str) -> Vec<Source> {
    let mut found = Vec::new();
    for part in ["src", "tests", "benches", "examples"] {
        collect(&root().join(folder).join(part), &mut found);
    }
    found
}

fn collect(folder: &Path, found: &mut Vec<Source>) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    for path in paths {
        if path.is_dir() {
            collect(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            let path = path.strip_prefix(root()).unwrap().display().to_string();
            found.push(Source { text: read(&path), path });
        }
    }
}

/// Fails with the complete list of violations, one line each.
pub fn assert_none(rule: &str, violations: &[String]) {
    let count = violations.len();
    assert!(violations.is_empty(), "{rule} ({count}):\n  {}", violations.join("\n  "));
}
