//! Words and phrases that the sources and documents do not use, each with plain ones.

use crate::common::sources::{crates, read, root, sources};

/// Words that are replaced: in comments, names, messages and documents.
const WORDS: &[(&str, &str)] = &[
    ("anew", "again"),
    ("some day", "eventually"),
    ("without a word", "without a message"),
    ("goes on", "continues"),
    ("judge", "check, evaluate"),
    ("judged", "checked, evaluated"),
    ("judges", "checks, evaluates"),
    ("believe", "accept"),
    ("believed", "accepted"),
    ("believes", "accepts"),
    ("suspect", "outlier"),
    ("suspected", "possible"),
    ("suspects", "outliers"),
    ("doubt", "hypothesis"),
    ("doubted", "unconfirmed"),
    ("doubts", "hypotheses"),
    ("heard", "received"),
    ("wishes", "options"),
    ("errand", "request"),
    ("errands", "requests"),
    ("stranger", "other sender"),
    ("strangers", "other senders"),
    ("meddle", "override"),
    ("meddles", "overrides"),
    ("patience", "timeout"),
];

/// Beginnings of a comment that do not name the item.
const BEGINNINGS: [&str; 3] = ["What ", "Those ", "Who "];

/// The key of `oqtal ctl status --json`, which programs read.
const JSON_KEY: &str = "\"heard\"";

/// Greatest length of a line of a document outside a table \[characters\].
const MAX_LINE: usize = 400;

/// Files without this rule: this one, and the changelog of earlier versions.
const EXEMPT: [&str; 2] = ["tests/structure/words.rs", "CHANGELOG.md"];

/// The uses of such words in every Rust file and document, one line each.
pub fn used() -> Vec<String> {
    let rust = sources().into_iter().map(|file| (file.path, file.text));
    let documents = documents().into_iter().map(|path| (path.clone(), read(&path)));
    let files = rust.chain(documents).filter(|(path, _)| !EXEMPT.contains(&path.as_str()));
    let mut found = Vec::new();
    for (path, text) in files {
        for (number, line) in (1..).zip(text.lines()) {
            let uses = uses(line, path.ends_with(".rs"));
            found.extend(uses.into_iter().map(|text| format!("{path}:{number}: {text}")));
        }
    }
    found
}

/// Messages with a command of `oqtal ctl` that does not address the instance, one line each: it would reach another one for an operator
/// who gave a root.
pub fn unaddressed_commands() -> Vec<String> {
    let is_of_test = |path: &str| path.contains("tests");
    let mut found = Vec::new();
    for file in sources().into_iter().filter(|file| !is_of_test(&file.path)) {
        let code = file.text.split("#[cfg(test)]").next().unwrap_or_default();
        for (number, line) in (1..).zip(code.lines()) {
            let is_comment = line.trim_start().starts_with("//");
            let commands = line.split("`oqtal ctl ").skip(1).filter(|_| !is_comment);
            let lacks_place =
                |rest: &str| rest.split('`').next().is_some_and(|it| !it.contains('{'));
            found.extend(
                commands
                    .filter(|rest| lacks_place(rest))
                    .map(|_| format!("{}:{number}", file.path)),
            );
        }
    }
    found
}

/// Lines of documents outside tables that are longer than a paragraph may be, one line each.
pub fn long_lines() -> Vec<String> {
    let mut found = Vec::new();
    for path in documents() {
        let text = read(&path);
        let is_long = |line: &str| !line.starts_with('|') && line.chars().count() > MAX_LINE;
        let long = (1..).zip(text.lines()).filter(|(_, line)| is_long(line));
        found.extend(long.map(|(number, _)| format!("{path}:{number}")));
    }
    found
}

/// The documents at the root, in `docs` and in the folders of the crates.
fn documents() -> Vec<String> {
    let folders = crates().into_iter().chain(["docs".to_owned()]);
    let names = folders.flat_map(|folder| {
        let entries = std::fs::read_dir(root().join(&folder)).unwrap();
        let prefix = if folder.is_empty() { folder } else { format!("{folder}/") };
        entries.map(move |entry| format!("{prefix}{}", entry.unwrap().file_name().display()))
    });
    names.filter(|name| name.ends_with(".md")).collect()
}

fn uses(line: &str, is_code: bool) -> Vec<String> {
    let text = line.replace(JSON_KEY, "").replace('_', " ").to_lowercase();
    let words = WORDS.iter().filter(|(word, _)| has_phrase(&text, word));
    let mut found: Vec<String> =
        words.map(|(word, plain)| format!("`{word}`; write {plain}")).collect();
    if ["is no", "are no"].iter().any(|phrase| is_negation(&text, phrase)) {
        found.push("`is no ...`; write `is not a ...`".to_owned());
    }
    let comment = line.trim_start().strip_prefix("//").filter(|_| is_code);
    let comment = comment.map(|rest| rest.trim_start_matches(['/', '!', ' ']));
    let beginning = BEGINNINGS.iter().find(|word| comment.is_some_and(|c| c.starts_with(*word)));
    found.extend(beginning.map(|word| format!("a comment begins with `{word}`; name the item")));
    found
}

/// Whether `phrase` occurs between characters that are not letters.
fn has_phrase(text: &str, phrase: &str) -> bool {
    text.match_indices(phrase).any(|(at, _)| is_bounded(text, at, phrase.len()))
}

fn is_bounded(text: &str, at: usize, length: usize) -> bool {
    let before = text[..at].chars().next_back();
    let after = text[at + length..].chars().next();
    [before, after].into_iter().flatten().all(|c| !c.is_alphabetic())
}

/// Whether `is no` negates a noun: not in `there is no` and `is no longer`.
fn is_negation(text: &str, phrase: &str) -> bool {
    text.match_indices(phrase).any(|(at, _)| {
        let (before, after) = (text[..at].trim_end(), text[at + phrase.len()..].trim_start());
        let is_existence = before.ends_with("there");
        let is_time = after.starts_with("longer") || after.starts_with("more");
        is_bounded(text, at, phrase.len()) && !is_existence && !is_time
    })
}

#[test]
fn words_are_found_as_whole_words_in_names_and_comments() {
    let found = |line| uses(line, true).len();
    assert_eq!(found("fn it_goes_on_anew() {}"), 2);
    assert_eq!(found("/// What the file is: it is no file, and there is no other."), 2);
    assert_eq!(found("let judgement = renewable(\"heard\"); // is no longer used"), 0);
}
