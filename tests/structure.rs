//! Rules for the sources of the workspace that clippy does not check: length of files, dependencies between files and crates, unique
//! names, units, tables of files, words. Each test prints the complete list of violations.

mod circles;
mod dependencies;
mod modules;
mod names;
mod tables;
mod units;
mod words;

use crate::common::sources::{assert_none, crates, sources, sources_of};

const MAX_FILE_LINES: usize = 400;

#[test]
fn files_are_at_most_400_lines_long() {
    let lengths = sources().into_iter().map(|file| (file.text.lines().count(), file.path));
    let long = lengths.filter(|(lines, _)| *lines > MAX_FILE_LINES);
    let violations: Vec<String> = long.map(|(lines, path)| format!("{path}: {lines}")).collect();
    assert_none("files of more than 400 lines", &violations);
}

#[test]
fn no_crate_has_a_circle_of_files() {
    let mut violations = Vec::new();
    for folder in crates() {
        let roots =
            sources_of(&folder).into_iter().filter(|file| modules::is_root(&folder, &file.path));
        for root in roots {
            violations.extend(circles::find(&root.path));
        }
    }
    assert_none("files that use each other", &violations);
}

#[test]
fn a_circle_is_found_through_a_re_export_and_inside_a_macro() {
    let folder = "tests/structure/fixture";
    let expected = format!(
        "2 files\n    {folder}/left.rs → {folder}/right.rs by super::Right\n    \
         {folder}/right.rs → {folder}/left.rs by crate::left::Left"
    );
    assert_eq!(circles::find(&format!("{folder}/lib.rs")), [expected]);
}

#[test]
fn crates_depend_in_one_direction() {
    assert_none("dependencies against the order of crates", &dependencies::against_the_order());
}

#[test]
fn the_daemon_builds_without_plotting_tuning_and_serial_crates() {
    assert_none("crates in the daemon's tree", &dependencies::forbidden_in_the_daemon());
}

#[test]
fn type_names_are_unique_in_the_workspace() {
    assert_none("type names with more than one definition", &names::repeated());
}

#[test]
fn public_numbers_have_a_unit() {
    assert_none("public numbers without a unit in name or documentation", &units::missing());
}

#[test]
fn words_are_plain() {
    assert_none("words with a plainer equivalent", &words::used());
}

#[test]
fn a_command_in_a_message_addresses_the_instance() {
    assert_none("commands without the instance", &words::unaddressed_commands());
}

#[test]
fn lines_of_documents_have_at_most_400_characters_outside_tables() {
    assert_none("lines of more than 400 characters", &words::long_lines());
}

#[test]
fn every_file_is_in_the_table_of_its_crate() {
    assert_none("differences between files and the table in lib.rs", &tables::wrong());
}
