//! Dependencies between the crates of the workspace, from their manifests.

use crate::common::sources::{crates, read_toml};

/// Order of the crates, each with the workspace crates that it may depend on.
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
    ("operator", &["bus", "runtime", "observe"]),
    ("screen", &["bus", "config", "runtime", "observe"]),
    ("view", &["control", "bus", "config", "observe"]),
    ("rivals", &["control"]),
    (
        "lab",
        &[
            "control",
            "bus",
            "config",
            "runtime",
            "observe",
            "daemon",
            "plant-sim",
            "mocap-emu",
            "rivals",
        ],
    ),
];

/// Crates for plotting, tables, tuning, parallel sweeps and serial ports, which a real-time controller does not need.
const NOT_IN_THE_DAEMON: &[&str] =
    &["maud", "comfy-table", "indicatif", "hdrhistogram", "csv", "rayon", "serialport"];

/// Edges between crates that are missing in `ORDER`, and crates that are not in it.
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

/// Forbidden crates in the manifests of the daemon's dependency tree.
pub fn forbidden_in_the_daemon() -> Vec<String> {
    let (_, below) =
        ORDER.iter().find(|(name, _)| *name == "daemon").expect("a place in the order");
    let tree = below.iter().chain(&["daemon"]);
    let names = tree.flat_map(|folder| dependencies(folder, "dependencies"));
    names.filter(|name| NOT_IN_THE_DAEMON.contains(&name.as_str())).collect()
}

/// Names of a crate's dependencies in one section of its manifest.
fn dependencies(folder: &str, section: &str) -> Vec<String> {
    let manifest = read_toml(&format!("{folder}/Cargo.toml"));
    let table = manifest.get(section).and_then(toml::Value::as_table);
    table.map(|table| table.keys().cloned().collect()).unwrap_or_default()
}
