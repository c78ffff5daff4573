//! Limits on the workspace's sources: lengths, arguments, dependencies between files and crates, unique names, units, tables of files.
//! Each test prints the complete list of violations.

#[path = "structure/circles.rs"]
mod circles;
#[path = "structure/dependencies.rs"]
mod dependencies;
#[path = "structure/functions.rs"]
mod functions;
#[path = "structure/modules.rs"]
mod modules;
#[path = "structure/names.rs"]
mod names;
#[path = "common/sources.rs"]
mod sources;
#[path = "structure/tables.rs"]
mod tables;
#[path = "structure/units.rs"]
mod units;

use sources::{assert_none, crates, sources, sources_of};

const MAX_FILE_LINES: usize = 400;
const MAX_BODY_LINES: usize = 40;
const MAX_ARGUMENTS: usize = 4;

#[test]
fn files_are_at_most_400_lines_long() {
    let lengths = sources().into_iter().map(|file| (file.text.lines().count(), file.path));
    let long = lengths.filter(|(lines, _)| *lines > MAX_FILE_LINES);
    let violations: Vec<String> = long.map(|(lines, path)| format!("{path}: {lines}")).collect();
    assert_none("files of more than 400 lines", &violations);
}

#[test]
fn functions_are_at_most_40_lines_long() {
    let long = functions::all().into_iter().filter(|f| f.body_lines > MAX_BODY_LINES);
    let violations: Vec<String> = long
        .map(|f| format!("{}:{}: {}, {} lines", f.path, f.line, f.name, f.body_lines))
        .collect();
    assert_none("functions of more than 40 lines between their braces", &violations);
}

#[test]
fn functions_take_at_most_4_arguments() {
    let wide = functions::all().into_iter().filter(|f| f.arguments > MAX_ARGUMENTS);
    let violations: Vec<String> =
        wide.map(|f| format!("{}:{}: {}, {}", f.path, f.line, f.name, f.arguments)).collect();
    assert_none("functions of more than 4 arguments, self not counted", &violations);
}

#[test]
fn lines_and_arguments_are_counted_inside_macros_too() {
    let text =
        "proptest! {\n fn f(&self, a: Map<u8, u8>, g: fn(u8) -> u8, c in 0..3) {\n\n // d\n }\n}";
    let found = functions::of("sample.rs", text);
    let counted: Vec<_> =
        found.iter().map(|f| (&*f.name, f.line, f.body_lines, f.arguments)).collect();
    assert_eq!(counted, [("f", 2, 2, 3)]);
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
fn every_crate_depends_only_on_what_it_uses() {
    assert_none("dependencies that no source names", &dependencies::unused());
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
fn every_allowed_repetition_of_a_type_name_exists() {
    assert_none("allowed, but not repeated", &names::allowed_in_vain());
}

#[test]
fn public_numbers_have_a_unit() {
    assert_none("public numbers without a unit in name or documentation", &units::missing());
}

#[test]
fn every_file_is_in_the_table_of_its_crate() {
    assert_none("differences between files and the table in lib.rs", &tables::wrong());
}
