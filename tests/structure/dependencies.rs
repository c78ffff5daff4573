//! Dependencies between the workspace's crates, from their manifests and the lock file.

use std::collections::{BTreeMap, BTreeSet};

use crate::sources::{crates, read, read_toml, sources_of};

/// The order of crates: each with the crates of the workspace that it may depend on.
const ORDER: &[(&str, &[&str])] = &[
    ("control", &[]),
    ("wire", &[]),
    ("bus", &["control"]),
    ("config", &["control"]),
    ("runtime", &["control", "bus", "config"]),
    ("daemon", &["control", "bus", "config", "runtime"]),
    ("plant-sim", &["control", "bus", "config", "runtime", "wire"]),
    ("mocap-emu", &["control", "bus", "config", "runtime", "wire"]),
    ("bridge", &["control", "bus", "config", "runtime", "wire"]),
    ("receiver", &["control", "bus", "config", "runtime", "wire"]),
    ("observe", &["control", "bus", "config"]),
    ("screen", &["bus", "config", "runtime", "observe"]),
    ("view", &["control", "bus", "config", "observe"]),
    (
        "lab",
        &["control", "bus", "config", "runtime", "observe", "daemon", "plant-sim", "mocap-emu"],
    ),
];

/// Plotting, tables, tuning, parallel sweeps and serial ports: nothing that a real-time controller needs.
const NOT_IN_THE_DAEMON: &[&str] = &[
    "maud",
    "comfy-table",
    "ratatui",
    "indicatif",
    "hdrhistogram",
    "csv",
    "rayon",
    "serialport",
];

/// Edges between crates that `ORDER` does not have, and crates that it does not know.
pub fn against_the_order() -> Vec<String> {
    let mut violations = Vec::new();
    for folder in crates().into_iter().filter(|folder| !folder.is_empty()) {
        let Some((_, allowed)) = ORDER.iter().find(|(name, _)| *name == folder) else {
            violations.push(format!("{folder} has no place in the order"));
            continue;
        };
        for section in ["dependencies", "dev-dependencies", "build-dependencies"] {
            let names = dependencies(&folder, section);
            let ours = names.iter().filter_map(|name| name.strip_prefix("oqtal-"));
            let wrong = ours.filter(|name| !allowed.contains(name));
            violations.extend(wrong.map(|name| format!("{folder} → {name} ({section})")));
        }
    }
    violations
}

/// Dependencies whose name occurs in no source of the crate.
pub fn unused() -> Vec<String> {
    let mut violations = Vec::new();
    for folder in crates() {
        let (library, all): (Vec<_>, Vec<_>) =
            sources_of(&folder).into_iter().partition(|file| file.path.contains("src/"));
        for (section, files) in [("dependencies", &library), ("dev-dependencies", &all)] {
            for name in dependencies(&folder, section) {
                let ident = name.replace('-', "_");
                let tested = section == "dev-dependencies";
                let mut places = files.iter().chain(library.iter().filter(|_| tested));
                if !places.any(|file| file.text.contains(&ident)) {
                    violations.push(format!("{}Cargo.toml: {name} ({section})", prefix(&folder)));
                }
            }
        }
    }
    violations
}

/// Crates of the daemon's tree that have no business there.
pub fn forbidden_in_the_daemon() -> Vec<String> {
    let locked = locked();
    let mut tree = BTreeSet::new();
    let mut todo = vec!["oqtal-daemon".to_owned()];
    while let Some(name) = todo.pop() {
        // The lock file does not tell dependencies of tests from others, manifests do.
        let below = match name.strip_prefix("oqtal-") {
            Some(folder) => dependencies(folder, "dependencies"),
            None => locked.get(&name).cloned().unwrap_or_default(),
        };
        if tree.insert(name) {
            todo.extend(below);
        }
    }
    assert!(tree.contains("iceoryx2"), "the daemon's tree is not complete");
    tree.into_iter().filter(|name| NOT_IN_THE_DAEMON.contains(&name.as_str())).collect()
}

fn prefix(folder: &str) -> String {
    if folder.is_empty() { String::new() } else { format!("{folder}/") }
}

/// The names of a crate's dependencies in one section of its manifest.
fn dependencies(folder: &str, section: &str) -> Vec<String> {
    let manifest = read_toml(&format!("{}Cargo.toml", prefix(folder)));
    let table = manifest.get(section).and_then(toml::Value::as_table);
    table.map(|table| table.keys().cloned().collect()).unwrap_or_default()
}

/// The dependencies of every package in the lock file.
fn locked() -> BTreeMap<String, Vec<String>> {
    let lock: toml::Table = read("Cargo.lock").parse().expect("Cargo.lock is TOML");
    let mut found: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for package in lock["package"].as_array().expect("packages") {
        let below = package.get("dependencies").and_then(toml::Value::as_array);
        // `name`, or `name version` where there are several.
        let names =
            below.into_iter().flatten().filter_map(|below| below.as_str()?.split(' ').next());
        let name = package["name"].as_str().expect("a name").to_owned();
        found.entry(name).or_default().extend(names.map(str::to_owned));
    }
    found
}
