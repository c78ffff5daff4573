//! Every command line in the README and the documents is executed as written, in virtual time unless it names a clock; those that
//! need hardware, a running instance or minutes, such as `oqtal reproduce all`, are parsed only.

use std::os::unix::fs::symlink;

use clap::Parser;
use oqtal::cli::Cli;

use crate::common::sources::{read, root};
use crate::common::{Testbed, stderr};

/// Beginnings of lines that are parsed and not executed, with the reason.
const PARSED: [(&str, &str); 20] = [
    ("oqtal receiver", "needs a camera system"),
    ("oqtal bridge", "needs a vehicle"),
    ("oqtal chain", "needs a camera system and a vehicle: tests/bridge/chain"),
    ("oqtal fly --config deploy/presets", "needs a firmware: tests/firmware flies these lines"),
    ("oqtal mocap-emu serve", "runs until Ctrl-C: tests/receiver"),
    ("oqtal fly --controller external", "waits for a script: tests/external_law"),
    ("oqtal ctl", "needs a running instance: tests/faults, lab/tests/live.rs"),
    ("oqtal gateway run", "runs until Ctrl-C: tests/gateway"),
    ("oqtal record", "needs a running instance: tests/recordings"),
    ("oqtal monitor", "needs a running instance: tests/monitor"),
    ("oqtal doctor", "its exit code depends on the machine: tests/doctor"),
    ("oqtal latency", "measures in real time: tests/latency"),
    ("oqtal replay latest --controller", "its exit code tells that commands differ: tests/replays"),
    ("oqtal reproduce all", "minutes, parsed only: tests/reproduce and lab run its experiments"),
    ("oqtal robustness", "minutes: tests/studies flies a short form"),
    ("oqtal cameras noise", "minutes: tests in lab/tests/cameras.rs"),
    ("oqtal identify --hidden-plants", "minutes: tests in lab/tests/identify.rs"),
    ("oqtal tune", "minutes: tests/reproduce tunes with a small budget"),
    ("oqtal campaign --config my.toml --gains gains", "needs the gains of the line before"),
    (
        "oqtal fly --clock in-process --controller pd",
        "flies the law that docs/your-own-law.md adds",
    ),
];

/// Whether a line uses the law that docs/your-own-law.md adds.
fn is_of_own_law(line: &str) -> bool {
    line.contains(" pd ") || line.ends_with(" pd") || line.contains(",pd ")
}

/// The command lines of the shell blocks of a document, `oqtal` in place of its longer forms, without comments.
fn command_lines(text: &str) -> Vec<String> {
    let blocks = text.split("```sh\n").skip(1).filter_map(|rest| rest.split("```").next());
    let joined: Vec<String> = blocks.map(|block| block.replace("\\\n", " ")).collect();
    let lines = joined.iter().flat_map(|block| block.lines());
    let bare = lines.map(|line| line.split(" # ").next().unwrap_or_default().trim());
    bare.map(|line| line.replace("cargo run --release --", "oqtal"))
        .filter(|line| line.starts_with("oqtal"))
        .collect()
}

fn documents() -> Vec<String> {
    let docs = std::fs::read_dir(root().join("docs")).unwrap();
    let names = docs.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut found: Vec<String> =
        names.filter(|name| name.ends_with(".md")).map(|name| format!("docs/{name}")).collect();
    found.push("README.md".to_owned());
    found.sort();
    found
}

/// Executes a line in the directory of `testbed`; returns what failed.
fn failure(testbed: &Testbed, line: &str) -> Option<String> {
    let words: Vec<&str> = line.split_whitespace().skip(1).collect();
    let mut command = testbed.study(&words);
    command.env("OQTAL_ROOT", testbed.path("run"));
    command.env("OQTAL_CLOCK__KIND", "in-process").env("OQTAL_RECORD__FLIGHTS", "all");
    let output = command.output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    (!output.status.success()).then(|| format!("{line}\n{said}{}", stderr(&output)))
}

#[test]
fn every_command_line_of_the_documents_is_executed_as_written_or_parsed_for_a_reason() {
    let mut wrong = Vec::new();
    let mut used = [false; PARSED.len()];
    let mut executed = 0;
    for document in documents() {
        let testbed = Testbed::new("command-lines");
        for folder in ["deploy", "mocap-emu", "tests", "docs"] {
            symlink(root().join(folder), testbed.path(folder)).unwrap();
        }
        testbed.write("my.toml", "[vehicle]\nmass-kg = 0.6\nmax-thrust-n = 12.0\n");
        for line in command_lines(&read(&document)) {
            let parsed = PARSED.iter().position(|(start, _)| line.starts_with(start));
            if parsed.is_none() && !is_of_own_law(&line) {
                executed += 1;
                wrong.extend(failure(&testbed, &line).map(|what| format!("{document}: {what}")));
                continue;
            }
            parsed.into_iter().for_each(|index| used[index] = true);
            // `latest` is looked up when it is parsed.
            let line = line.replace(" latest", " flights");
            let words = line.split_whitespace().filter(|word| *word != "&");
            let refused = Cli::try_parse_from(words).err().filter(|_| !is_of_own_law(&line));
            wrong.extend(refused.map(|error| format!("{document}: {line}\n{error}")));
        }
    }
    let unused = PARSED.iter().zip(used).filter(|(_, used)| !used);
    wrong.extend(unused.map(|((start, _), _)| format!("no line begins with `{start}`")));
    assert!(wrong.is_empty(), "{}", wrong.join("\n\n"));
    assert!(executed > 20, "{executed} lines were executed");
}
