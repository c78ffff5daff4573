//! Comments that name the files from which a configuration was read, so that a later edit of them is found.

use std::fs::{self, File};
use std::hash::Hasher;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use crate::layer;
use crate::text::read_waypoints;

/// Beginning of a comment; the hash of the file's settings, a space and its absolute path follow.
const MARK: &str = "# read from ";
/// Beginning of the comment on a file that the daemon has read again; the same follows.
const REREAD_MARK: &str = "# read again ";

/// Beginning of the comment on the waypoint file whose points the daemon has; the hash of its text, a space and its path follow.
const WAYPOINTS_MARK: &str = "# waypoints read from ";

/// A comment line for each of `files` that is a regular file, with its present settings.
pub fn source_comments(files: &[PathBuf]) -> String {
    files.iter().filter_map(|file| comment(MARK, file)).collect()
}

/// `before`, comment lines of files that were read again, with the lines of `files` and their present settings added or replaced.
pub fn reread_comments(before: &str, files: &[PathBuf]) -> String {
    let read = files.iter().filter_map(|file| comment(REREAD_MARK, file)).collect::<String>();
    let is_read = |path| named(REREAD_MARK, &read).any(|(_, other)| other == path);
    let others = named(REREAD_MARK, before).filter(|(_, path)| !is_read(*path));
    let lines = others.map(|(hash, path)| format!("{REREAD_MARK}{hash} {path}\n"));
    lines.chain([read.clone()]).collect()
}

/// A comment line for the waypoint file at `path`, with its present text; empty if it cannot be read.
pub fn waypoints_comment(path: &Path) -> String {
    let name = path.to_str().filter(|name| !name.contains(char::is_control));
    let line = |(name, hash)| format!("{WAYPOINTS_MARK}{hash:016x} {name}\n");
    name.zip(text_hash(path)).map_or_else(String::new, line)
}

/// The waypoint file, if it was edited or removed after the daemon with the configuration in `text` had read it; `None` otherwise, or if
/// this user has no permission to read it.
pub fn edited_waypoints(text: &str) -> Option<PathBuf> {
    let (hash, path) = named(WAYPOINTS_MARK, text).next()?;
    Some(PathBuf::from(path)).filter(|path| is_edited(path, hash, text_hash))
}

/// Whether the configuration in `text` was written again because its daemon had read files again.
pub fn is_of_reload(text: &str) -> bool {
    text.starts_with(REREAD_MARK)
}

fn comment(mark: &str, file: &Path) -> Option<String> {
    let path = std::path::absolute(file).ok().filter(|path| path.is_file())?;
    let name = path.to_str().filter(|name| !name.contains(char::is_control))?;
    Some(format!("{mark}{:016x} {name}\n", settings_hash(&path)?))
}

/// Hashes and paths in the comment lines of `text` that begin with `mark`.
fn named<'a>(mark: &'a str, text: &'a str) -> impl Iterator<Item = (&'a str, &'a str)> {
    text.lines().filter_map(move |line| line.strip_prefix(mark)?.split_once(' '))
}

/// The comment lines of `text` that name files.
pub fn kept_source_comments(text: &str) -> String {
    text.lines().filter(|line| line.starts_with(MARK)).map(|line| format!("{line}\n")).collect()
}

/// Comment line in the configuration of a daemon that was started with the file in which it is.
pub const COPY_COMMENT: &str = "# started with this copy\n";

/// Whether the daemon of the configuration in `text` was started with a copy of an earlier one.
pub fn is_copy(text: &str) -> bool {
    has_line(text, COPY_COMMENT)
}

/// Comment line in the configuration of an instance whose daemon is part of `oqtal chain run`.
pub const CHAIN_COMMENT: &str = "# of the chain\n";

/// Whether the configuration in `text` is of `oqtal chain run`.
pub fn is_of_chain(text: &str) -> bool {
    has_line(text, CHAIN_COMMENT)
}

fn has_line(text: &str, comment: &str) -> bool {
    text.lines().any(|line| line == comment.trim_end())
}

/// Beginning of the comment in the configuration of an instance of one flight; the command of the flight follows.
const FLIGHT_MARK: &str = "# of the flight ";

/// A comment line for the configuration of an instance that `command` started and that ends with it.
pub fn flight_comment(command: &str) -> String {
    let is_line = !command.contains(char::is_control);
    if is_line { format!("{FLIGHT_MARK}{command}\n") } else { String::new() }
}

/// The command whose flight the configuration in `text` is of; `None` for that of a daemon of its own.
pub fn flight_of(text: &str) -> Option<&str> {
    text.lines().find_map(|line| line.strip_prefix(FLIGHT_MARK))
}

/// Files named by the comments of `text` that were removed since, or whose settings were edited: since the start of the daemon, or, with
/// `since_reload`, since it last read them.
pub fn edited_sources(text: &str, since_reload: bool) -> Vec<PathBuf> {
    let edited = named(MARK, text).filter(|(hash, path)| {
        let mut reread = named(REREAD_MARK, text).filter(|_| since_reload);
        let last = reread.find(|(_, other)| other == path);
        is_edited(Path::new(path), last.map_or(hash, |(hash, _)| hash), settings_hash)
    });
    edited.map(|(_, path)| PathBuf::from(path)).collect()
}

/// Whether the content of the file at `path` no longer has this hash, by `hash_of`; `false` if this user may not read it.
fn is_edited(path: &Path, hash: &str, hash_of: fn(&Path) -> Option<u64>) -> bool {
    match fs::metadata(path) {
        Ok(file) if file.is_file() => {
            let present = hash_of(path).map(|hash| format!("{hash:016x}"));
            File::open(path).is_ok() && present.as_deref() != Some(hash)
        }
        Ok(_) => true,
        Err(error) => error.kind() == ErrorKind::NotFound,
    }
}

/// Hash of the settings in the file at `path`; `None` if it cannot be read or is not TOML.
fn settings_hash(path: &Path) -> Option<u64> {
    let mut hasher = fnv::FnvHasher::default();
    for setting in layer::from_file(path).ok()? {
        hasher.write(format!("{}={}\n", setting.key, setting.value).as_bytes());
    }
    Some(hasher.finish())
}

/// Hash of the waypoint file at `path`; `None` if it cannot be read.
fn text_hash(path: &Path) -> Option<u64> {
    let mut hasher = fnv::FnvHasher::default();
    hasher.write(read_waypoints(path).ok()?.as_bytes());
    Some(hasher.finish())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_edit_that_the_daemon_has_read_again_is_none_until_the_next_one() {
        let directory = tempfile::tempdir().unwrap();
        let files = ["a.toml", "b.toml"].map(|name| directory.path().join(name));
        let write = |k: usize, limit| {
            fs::write(&files[k], format!("[position]\ntilt-limit-deg = {limit}\n")).unwrap();
        };
        write(0, 12.0);
        write(1, 12.0);
        let start = source_comments(&files);
        write(0, 13.0);
        let once = reread_comments("", &files[..1]);
        let text = |reread: &str| format!("{start}{reread}[vehicle]\n");
        assert_eq!(edited_sources(&text(&once), true), Vec::<PathBuf>::new());
        assert_eq!(edited_sources(&text(&once), false), files[..1]);
        write(0, 12.0);
        assert_eq!(edited_sources(&text(&once), true), files[..1], "as at the start, not as read");
        let twice = reread_comments(&once, &files);
        assert_eq!(twice.lines().count(), 2);
        assert_eq!(edited_sources(&text(&twice), true), Vec::<PathBuf>::new());
        assert!(is_of_chain(&(CHAIN_COMMENT.to_owned() + &start)) && !is_of_chain(&start));
    }

    #[test]
    fn an_edited_and_a_removed_file_are_found_and_a_new_comment_in_it_is_none() {
        let directory = tempfile::tempdir().unwrap();
        let files = ["a.toml", "b.toml"].map(|name| directory.path().join(name));
        let write = |k: usize, text: &str| fs::write(&files[k], text).unwrap();
        write(0, "[vehicle]\nmass-kg = 0.5\n");
        write(1, "[position]\ntilt-limit-deg = 12.0\n");
        let text = source_comments(&files) + "[vehicle]\nmass-kg = 0.5\n";
        assert_eq!(edited_sources(&text, false), Vec::<PathBuf>::new());
        let copy = kept_source_comments(&text) + COPY_COMMENT;
        assert!(is_copy(&copy) && edited_sources(&copy, true).is_empty());
        assert_eq!(kept_source_comments(&copy), source_comments(&files));
        write(0, "# heavier soon\n[vehicle]\nmass-kg = 0.5\n");
        assert_eq!(edited_sources(&text, false), Vec::<PathBuf>::new());
        write(0, "[vehicle]\nmass-kg = 0.6\n");
        assert_eq!(edited_sources(&kept_source_comments(&text), false), [files[0].clone()]);
        fs::remove_file(&files[1]).unwrap();
        assert_eq!(edited_sources(&text, false), files);
    }

    #[test]
    fn an_edited_and_a_removed_waypoint_file_are_found() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("path.csv");
        assert_eq!(waypoints_comment(&path), "", "it is missing");
        fs::write(&path, "t,x,y,z\n0,0,0,1\n").unwrap();
        let text = waypoints_comment(&path) + "[vehicle]\n";
        assert_eq!(edited_waypoints(&text), None);
        fs::write(&path, "t,x,y,z\n0,0,0,2\n").unwrap();
        assert_eq!(edited_waypoints(&text), Some(path.clone()));
        fs::remove_file(&path).unwrap();
        assert_eq!(edited_waypoints(&text), Some(path));
        assert_eq!(edited_waypoints("[vehicle]\n"), None);
    }
}
