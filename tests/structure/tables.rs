//! The table of files at the head of a crate's `lib.rs`.

use crate::common::sources::{crates, read, sources_of};

/// Crates without such a table: the root package, whose modules are its commands, and the control crate, whose documentation
/// leads from a problem to a type.
const WITHOUT: [&str; 2] = ["", "control"];
/// Row for all files without a separate row.
const THE_OTHERS: &str = "//! | the others |";

/// Files at the top of a crate that are missing in its table, and files in the table that do not exist.
pub fn wrong() -> Vec<String> {
    let folders = crates().into_iter().filter(|folder| !WITHOUT.contains(&folder.as_str()));
    folders.flat_map(|folder| wrong_in(&folder)).collect()
}

fn wrong_in(folder: &str) -> Vec<String> {
    let lib = format!("{folder}/src/lib.rs");
    let text = read(&lib);
    let rows: Vec<&str> = text.lines().filter(|line| line.starts_with("//! |")).collect();
    let named: Vec<String> = rows.iter().flat_map(|row| files_named(row)).collect();
    let files = files_of(folder);
    let has_others = rows.iter().any(|row| row.starts_with(THE_OTHERS));
    let missing = files.iter().filter(|file| !has_others && !named.contains(file));
    let absent = named.iter().filter(|name| !files.contains(name) && !name.contains('/'));
    let missing = missing.map(|file| format!("{lib}: no row for {file}"));
    missing.chain(absent.map(|name| format!("{lib}: a row for the missing file {name}"))).collect()
}

/// The files named in the first column of a row, as `` `name.rs` `` or ``[`name`]``.
fn files_named(row: &str) -> Vec<String> {
    let first = row.split('|').nth(1).unwrap_or_default();
    let quoted = first.split('`').skip(1).step_by(2);
    quoted
        .map(|name| if name.ends_with(".rs") { name.into() } else { format!("{name}.rs") })
        .collect()
}

fn files_of(folder: &str) -> Vec<String> {
    let top = format!("{folder}/src/");
    let names = sources_of(folder).into_iter().filter_map(|file| {
        let name = file.path.strip_prefix(&top)?;
        (!name.contains('/') && !["lib.rs", "main.rs", "tests.rs"].contains(&name))
            .then(|| name.to_owned())
    });
    names.collect()
}
