//! Statements of the documents are checked against the code: paths, symbols, tests, equations, errata, defaults, commands.
//! Rules of the code that concern its text are checked here too, as the imports of the mathematics.

mod text;

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use crate::common::sources::{Source, assert_none, read, root, sources};
use oqtal_bus::code::{Cause, Mode, SafetyState};
use oqtal_config::Config;
use oqtal_control::controller::ControlOptions;
use oqtal_control::estimator::EstimatorOptions;
use oqtal_control::position::PositionOptions;
use oqtal_control::predictive::PredictiveOptions;
use oqtal_control::trajectory::TrajectoryOptions;
use oqtal_runtime::process::Exit;
use text::{Row, Table, cited_equations, cited_errata, errata, has_word, links, numbers, quoted};

/// Every Markdown file at the root and in `docs`, except the generated ones.
fn documents() -> Vec<String> {
    let mut found = Vec::new();
    for folder in ["", "docs/"] {
        for entry in std::fs::read_dir(root().join(folder)).unwrap() {
            let name = entry.unwrap().file_name().into_string().unwrap();
            let is_generated = ["reproduction.md", "robustness.md"].contains(&name.as_str());
            if name.ends_with(".md") && !is_generated {
                found.push(format!("{folder}{name}"));
            }
        }
    }
    assert!(found.len() > 8, "documents are missing: {found:?}");
    found
}

fn is_path(token: &str) -> bool {
    token.contains('/') && !token.contains([' ', '<', '$', '*']) && !token.starts_with('/')
}

/// Whether `text` defines an item of this name.
fn defines(text: &str, name: &str) -> bool {
    ["fn", "struct", "enum", "trait", "type", "const"]
        .iter()
        .any(|kind| has_word(text, &format!("{kind} {name}")))
}

/// The paths in a table cell, each with the symbols that follow it.
fn places(cell: &str) -> Vec<(String, Vec<String>)> {
    let mut places: Vec<(String, Vec<String>)> = Vec::new();
    for token in quoted(cell) {
        match places.last_mut() {
            _ if is_path(token) => places.push((token.to_owned(), Vec::new())),
            Some((_, symbols)) => symbols.push(token.to_owned()),
            None => {}
        }
    }
    places
}

fn index() -> Table {
    Table::all(&read("docs/paper.md")).into_iter().next().expect("docs/paper.md has a table")
}

#[test]
fn links_and_paths_in_the_documents_exist() {
    let mut wrong = Vec::new();
    for document in &documents() {
        let text = read(document);
        let folder = root().join(document).parent().unwrap().to_owned();
        for link in links(&text) {
            let file = link.split('#').next().unwrap_or_default();
            if !link.contains("://") && !folder.join(file).exists() {
                wrong.push(format!("{document}: link {link}"));
            }
        }
        for token in quoted(&text).into_iter().filter(|token| is_path(token)) {
            // A token is a path if it begins with the name of a file or folder at the root, unlike `m/s`. Folders of builds and
            // of flights do not exist in a clean clone.
            let first = token.split('/').next().unwrap_or_default();
            let is_made = ["target", "flights"].contains(&first);
            let ours = !is_made && root().join(first).exists();
            if ours && !root().join(token).exists() {
                wrong.push(format!("{document}: path {token}"));
            }
        }
    }
    assert_none("links and paths that do not exist", &wrong);
}

#[test]
fn every_equation_of_the_index_is_implemented_cited_and_tested_in_the_named_places() {
    let mut wrong = Vec::new();
    for row in index().rows() {
        let equation = &row["Eq."];
        let (code, tests) = (places(&row["implemented in"]), places(&row["test"]));
        if code.is_empty() || tests.is_empty() || tests.iter().any(|(_, names)| names.is_empty()) {
            wrong.push(format!("{equation}: no place, or no test"));
        }
        for (path, symbols) in code.iter().chain(&tests) {
            let text = if root().join(path).is_file() { read(path) } else { String::new() };
            let parts = symbols.iter().flat_map(|symbol| symbol.split("::"));
            for part in parts.filter(|part| !defines(&text, part)) {
                wrong.push(format!("{equation}: {path} has no `{part}`"));
            }
        }
        let numbers = numbers(equation);
        let cited: BTreeSet<u32> =
            code.iter().flat_map(|(path, _)| cited_equations(&read(path))).collect();
        if !numbers.is_empty() && numbers.iter().all(|number| !cited.contains(number)) {
            wrong.push(format!("{equation}: not cited in {}", row["implemented in"]));
        }
    }
    assert_none("docs/paper.md is out of step", &wrong);
}

#[test]
fn every_equation_cited_in_the_mathematics_is_in_the_index() {
    let known: BTreeSet<u32> = index().rows().flat_map(|row| numbers(&row["Eq."])).collect();
    let mut wrong = Vec::new();
    for Source { path, text } in
        sources().iter().filter(|file| file.path.starts_with("control/src"))
    {
        for number in cited_equations(text).difference(&known) {
            wrong.push(format!("{path}: Eq. ({number})"));
        }
    }
    assert_none("cited, but not in docs/paper.md", &wrong);
}

#[test]
fn errata_are_cited_in_the_code_and_known() {
    let tables = Table::all(&read("docs/errata.md"));
    let rows = || tables.iter().flat_map(Table::rows);
    let known: BTreeSet<String> = rows().map(|row| row["id"].clone()).collect();
    let indexed: BTreeSet<String> =
        index().rows().flat_map(|row| errata(&row["erratum"])).collect();
    let mut wrong = Vec::new();
    let mut cited = BTreeSet::new();
    for Source { path, text } in sources() {
        let here = cited_errata(&text);
        wrong.extend(here.difference(&known).map(|id| format!("{path}: {id} is not an erratum")));
        cited.extend(here);
    }
    wrong.extend(
        indexed.difference(&known).map(|id| format!("docs/paper.md: {id} is not an erratum")),
    );
    // The code does not deviate from the paper where only the print is unclear.
    let departs = |row: &text::Row| !["obvious", "notation"].contains(&row["evidence"].as_str());
    let departures: BTreeSet<String> =
        rows().filter(departs).map(|row| row["id"].clone()).collect();
    for id in indexed.intersection(&departures).filter(|id| !cited.contains(*id)) {
        // `E-T` and `E-S` concern tables and text, which have no equation to cite.
        if !id.starts_with("E-T") && !id.starts_with("E-S") {
            wrong.push(format!("docs/paper.md says that {id} is implemented; no code cites it"));
        }
    }
    assert_none("errata and code disagree", &wrong);
}

#[test]
fn every_test_that_an_erratum_names_exists() {
    let files = sources();
    let mut wrong = Vec::new();
    for row in Table::all(&read("docs/errata.md")).iter().flat_map(Table::rows) {
        let Some(cell) = row.get("test") else { continue };
        for name in quoted(cell) {
            if !files.iter().any(|file| has_word(&file.text, &format!("fn {name}"))) {
                wrong.push(format!("{}: {name}", row["id"]));
            }
        }
    }
    assert_none("errata name tests that do not exist", &wrong);
}

fn faults() -> Table {
    let mut tables = Table::all(&read("docs/faults.md")).into_iter();
    tables.find(|table| table.has("fault")).expect("a table of faults")
}

#[test]
fn every_fault_has_a_response_and_a_test_and_every_test_of_a_fault_its_row() {
    let table = faults();
    let tests: BTreeSet<String> =
        sources().iter().flat_map(|file| faults_tested(&file.text)).collect();
    let ids: BTreeSet<String> = table.rows().map(|row| row["id"].clone()).collect();
    let incomplete = table.rows().filter(|row| row.values().any(String::is_empty));
    let mut wrong: Vec<String> =
        incomplete.map(|row| format!("{}: a cell is empty", row["id"])).collect();
    wrong.extend(ids.difference(&tests).map(|id| format!("{id}: no test")));
    wrong.extend(tests.difference(&ids).map(|id| format!("{id}: no row, but tests")));
    assert_none("docs/faults.md is out of step", &wrong);
}

#[test]
fn every_fault_has_a_command_line_that_a_test_executes_or_a_reason_for_none() {
    let tables = Table::all(&read("docs/faults.md"));
    let shown = tables.iter().find(|table| table.has("line")).expect("a table of lines");
    let executed = read("tests/faults_injected.rs");
    let mut wrong = Vec::new();
    for fault in faults().rows() {
        let id = &fault["id"];
        let rows: Vec<_> = shown.rows().filter(|row| row["row"] == *id).collect();
        if rows.is_empty() || rows.iter().any(|row| row["shows"].is_empty()) {
            wrong.push(format!("{id}: neither a command line nor a reason"));
        }
        for line in rows.iter().flat_map(|row| quoted(&row["line"])) {
            let options = line.strip_prefix("oqtal fly --trajectory hover --duration ");
            let options = options.and_then(|rest| rest.split_once(' ')).map(|(_, options)| options);
            if !options.is_some_and(|options| executed.contains(&format!("\"{options}\""))) {
                wrong.push(format!("{id}: no test executes {line}"));
            }
        }
    }
    assert_none("command lines of docs/faults.md without a test", &wrong);
}

/// Ids of the faults that the tests of a source verify: `F45` and `F46` for `fn f45_f46_...`.
fn faults_tested(text: &str) -> Vec<String> {
    let names = text.lines().filter_map(|line| line.trim().strip_prefix("fn "));
    let is_id = |part: &&str| {
        let digits = part.strip_prefix('f').filter(|digits| digits.len() == 2);
        digits.is_some_and(|digits| digits.bytes().all(|byte| byte.is_ascii_digit()))
    };
    let ids = names.flat_map(|name| name.split('_').take_while(is_id));
    ids.map(str::to_uppercase).collect()
}

#[test]
fn the_shipped_configuration_is_the_defaults_and_shows_every_key() {
    let file = root().join("deploy/oqtal.toml");
    let shipped = Config::load(std::slice::from_ref(&file), &[]).unwrap();
    assert_eq!(shipped, Config::load(&[], &[]).unwrap());

    let shown: toml::Table = read("deploy/oqtal.toml").parse().unwrap();
    let known: toml::Table = shipped.to_toml().parse().unwrap();
    let (shown, known) = (keys(&shown, ""), keys(&known, ""));
    // A table that inherits from another one is shown as one key that names the other.
    let is_shown = |key: &String| {
        shown.contains(key) || key.rmatch_indices('.').any(|(end, _)| shown.contains(&key[..end]))
    };
    let hidden: Vec<&String> = known.iter().filter(|key| !is_shown(key)).collect();
    assert_eq!(hidden, Vec::<&String>::new(), "not shown");
}

/// The dotted keys of a table.
fn keys(table: &toml::Table, prefix: &str) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    for (name, value) in table {
        match value {
            toml::Value::Table(inner) => found.extend(keys(inner, &format!("{prefix}{name}."))),
            _ => drop(found.insert(format!("{prefix}{name}"))),
        }
    }
    found
}

#[test]
fn the_shipped_configuration_agrees_with_the_defaults_of_the_mathematics() {
    let config = Config::default();
    assert_eq!(config.control, ControlOptions::default());
    assert_eq!(config.control.estimator, EstimatorOptions::default());
    assert_eq!(config.control.predictive, PredictiveOptions::default());
    assert_eq!(config.position, PositionOptions::default());
    assert_eq!(config.trajectory, TrajectoryOptions::default());
}

#[test]
fn every_preset_file_equals_the_preset_of_its_name() {
    for (key, name, file) in [
        ("vehicle.preset", "spacecraft", "spacecraft"),
        ("vehicle.preset", "crazyflie-2.1", "crazyflie-2.1"),
        ("vehicle.preset", "ardupilot-quad", "ardupilot-quad"),
        ("vehicle.preset", "px4-quad", "px4-quad"),
        ("vehicle.preset", "betaflight-quad", "betaflight-quad"),
        ("mocap.preset", "ideal", "mocap-ideal"),
        ("mocap.preset", "measured", "mocap-measured"),
        ("mocap.preset", "room", "mocap-room"),
    ] {
        let by_name = [oqtal_config::Setting::flag("test", key, name)];
        let by_file = root().join(format!("deploy/presets/{file}.toml"));
        let loaded = Config::load(std::slice::from_ref(&by_file), &[]).unwrap();
        assert_eq!(loaded, Config::load(&[], &by_name).unwrap(), "{file}");
    }
}

#[test]
fn exit_codes_are_listed_for_users_and_for_operators() {
    let codes = [
        Exit::Ok,
        Exit::Flight,
        Exit::Usage,
        Exit::Data,
        Exit::Internal,
        Exit::System,
        Exit::Peer,
        Exit::Version,
        Exit::Permission,
        Exit::Config,
    ];
    for document in ["docs/commands.md", "docs/operations.md"] {
        // operations.md also lists signals.
        let mut listed = column(document, "exit code");
        listed.retain(|code| code.parse::<u8>().is_ok());
        assert_eq!(listed, codes.map(|code| (code as u8).to_string()), "{document}");
    }
}

/// Cells of a column in the first table that has it, without backticks.
fn column(document: &str, name: &str) -> Vec<String> {
    let tables = Table::all(&read(document));
    let table = tables.iter().find(|table| table.has(name));
    let table = table.unwrap_or_else(|| panic!("{document} has no table with a column `{name}`"));
    table.rows().map(|row| row[name].replace('`', "")).collect()
}

#[test]
fn every_alarm_is_explained_to_operators() {
    let all = |text: &dyn Fn(u8) -> Option<String>| {
        (0..=u8::MAX).filter_map(text).filter(|text| !text.is_empty()).collect::<BTreeSet<_>>()
    };
    let explained = |name| BTreeSet::from_iter(column("docs/operations.md", name));
    assert_eq!(explained("cause"), all(&|code| Some(Cause::from_code(code)?.to_string())));
    assert_eq!(explained("state"), all(&|code| Some(SafetyState::from_code(code)?.to_string())));
    assert_eq!(explained("mode"), all(&|code| Some(Mode::from_code(code)?.to_string())));
}

#[test]
fn programs_are_thin() {
    let wrong: Vec<String> = sources()
        .into_iter()
        .filter(|file| Path::new(&file.path).ends_with("src/main.rs"))
        .filter(|file| file.text.lines().count() >= 60)
        .map(|file| file.path)
        .collect();
    assert_none("60 lines or more", &wrong);
}

#[test]
fn the_mathematics_touches_no_clock_file_network_thread_or_environment() {
    let outside = ["std::time", "std::fs", "std::net", "std::thread", "std::env"];
    let wrong: Vec<String> = sources()
        .into_iter()
        .filter(|file| file.path.starts_with("control/src"))
        .filter(|file| outside.iter().any(|module| file.text.contains(module)))
        .map(|file| file.path)
        .collect();
    assert_none("the mathematics is not pure", &wrong);
}

/// A page refreshed in part mixes figures of two versions of the program: tables of the same flights then differ.
#[test]
fn the_tables_of_the_published_square_are_of_one_run() {
    let page = read("docs/reproduction.md");
    assert!(!page.contains("NaN"), "a text names a row that its table does not have");
    let tables = Table::all(&page);
    let tuned = |table: &Table| -> BTreeMap<String, Row> {
        let rows = table.rows().filter(|row| row["settings"] == "tuned alike, deploy/tuned");
        rows.map(|row| (row["controller"].clone(), row)).collect()
    };
    let square = tables.iter().filter(|table| table.has("max q is")).map(tuned);
    let square: Vec<BTreeMap<String, Row>> = square.filter(|laws| !laws.is_empty()).collect();
    let [nominal, mismatched @ ..] = &square[..] else { panic!("the square is missing") };
    assert_eq!(mismatched.len(), 5);
    let is_intervals = |table: &&Table| table.has("hover RMS [mm]") && !table.has("settings");
    let intervals = tables.iter().find(is_intervals).expect("a table of intervals");
    let mut wrong = Vec::new();
    for row in intervals.rows() {
        let law = &row["controller"];
        for column in ["hover RMS [mm]", "overshoot [mm]", "jitter [rad/s]", "chirp 4° RMS [°]"] {
            let mean = row[column].split(" ±").next().unwrap_or_default();
            if nominal[law][column] != mean {
                wrong.push(format!("{law}, {column}: {} and {mean}", nominal[law][column]));
            }
        }
        let max_q = |laws: &BTreeMap<String, Row>| laws[law]["max q"].clone();
        let differs = |laws: &&BTreeMap<String, Row>| max_q(laws) != max_q(nominal);
        wrong.extend(mismatched.iter().filter(differs).map(|_| format!("{law}: max q")));
    }
    assert_none("tables of docs/reproduction.md are of different runs", &wrong);
}
