//! File of known tables of contents. It is read before the real-time thread begins, and written by the background thread when a
//! new table was read. A file that cannot be read or written only delays the next connection.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use crossbeam_channel::{Receiver, Sender, bounded};
use oqtal_runtime::background::BackgroundWorker;
use oqtal_wire::crtp::TableKind;

use super::known::{KnownTable, KnownTables};

/// Greatest file that is read \[bytes\].
const MAX_BYTES: u64 = 64 * 1024;

/// Newly read tables that may wait for the background thread \[-\]: both tables of a vehicle, and those of the next connection.
const MAX_LEARNED: usize = 4;

/// Known tables, and the destination of newly read ones.
#[derive(Clone, Debug)]
pub struct TableStore {
    tables: KnownTables,
    learned: Option<Sender<KnownTable>>,
}

impl TableStore {
    /// Store without a file: tables are kept as long as the store exists.
    pub fn without_file() -> Self {
        Self { tables: KnownTables::from_text(""), learned: None }
    }

    /// Store of the file that `bridge.crtp.table-cache` names, and the keeper of that file, if there is one.
    pub fn open(setting: &str) -> (Self, Option<TableKeeper>) {
        let Some(path) = path(setting) else { return (Self::without_file(), None) };
        let tables = read_tables(&path);
        let (sender, learned) = bounded(MAX_LEARNED);
        let store = Self { tables: tables.clone(), learned: Some(sender) };
        (store, Some(TableKeeper { path, tables, learned }))
    }

    /// The table of this kind and CRC.
    pub(super) fn find(&self, table: TableKind, crc: u32) -> Option<&KnownTable> {
        self.tables.find(table, crc)
    }

    /// Adds a table. Does not block; a table that is not kept in the file is read again next time.
    pub(super) fn learn(&mut self, table: KnownTable) {
        self.tables.add(table);
        if let Some(learned) = &self.learned {
            let _ = learned.try_send(table);
        }
    }
}

/// Writer of the file of tables, for the background thread.
#[derive(Debug)]
pub struct TableKeeper {
    path: PathBuf,
    tables: KnownTables,
    learned: Receiver<KnownTable>,
}

impl BackgroundWorker for TableKeeper {
    fn poll(&mut self) {
        let before = self.tables.clone();
        self.learned.try_iter().for_each(|table| self.tables.add(table));
        if self.tables == before {
            return;
        }
        if let Err(error) = write(&self.path, &self.tables.to_text()) {
            let path = self.path.display();
            tracing::warn!("the vehicle's table of contents is not kept in {path}: {error}");
        }
    }
}

/// Path of the file that `bridge.crtp.table-cache` names; `None` for no file.
fn path(setting: &str) -> Option<PathBuf> {
    match setting {
        "" => None,
        "auto" => {
            let variable = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty());
            let home = || variable("HOME").map(|home| PathBuf::from(home).join(".cache"));
            // Of systemd, of the user, of the user without one.
            let service = variable("CACHE_DIRECTORY").map(PathBuf::from);
            let user = || variable("XDG_CACHE_HOME").map(PathBuf::from).or_else(home);
            let directory = service.or_else(|| user().map(|cache| cache.join("oqtal")))?;
            Some(directory.join("crazyflie-tables"))
        }
        path => Some(path.into()),
    }
}

/// The tables of the file at `path`; none if it cannot be read.
fn read_tables(path: &Path) -> KnownTables {
    let is_short = fs::metadata(path).is_ok_and(|file| file.is_file() && file.len() <= MAX_BYTES);
    let text = if is_short { fs::read_to_string(path).unwrap_or_default() } else { String::new() };
    KnownTables::from_text(&text)
}

/// Replaces the file at `path`: another reader finds the old one or the new one.
fn write(path: &Path, text: &str) -> io::Result<()> {
    let directory = path.parent().ok_or(io::ErrorKind::InvalidInput)?;
    fs::create_dir_all(directory)?;
    let fresh = directory.join(format!(".crazyflie-tables.{}", std::process::id()));
    let mut options = fs::File::options();
    // A link that another user may have put there is not followed.
    let mut file = options.write(true).create_new(true).open(&fresh)?;
    let written = io::Write::write_all(&mut file, text.as_bytes());
    drop(file);
    written.and_then(|()| fs::rename(&fresh, path)).inspect_err(|_| {
        let _ = fs::remove_file(&fresh);
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_learned_table_is_in_the_file_and_a_broken_file_is_ignored() {
        let directory = std::env::temp_dir().join(format!("oqtal-tables-{}", std::process::id()));
        let path = directory.join("cache/tables");
        assert_eq!(read_tables(&path), KnownTables::from_text(""));
        let (mut store, keeper) = TableStore::open(path.to_str().unwrap());
        let mut keeper = keeper.unwrap();
        for crc in [1, 2] {
            store.learn(KnownTable::new(TableKind::Logging, crc));
            keeper.poll();
        }
        let read = read_tables(&path);
        assert!(read.find(TableKind::Logging, 2).is_some() && read == keeper.tables);
        fs::write(&path, [0xFF; 100]).unwrap();
        assert_eq!(read_tables(&path), KnownTables::from_text(""));
        fs::remove_dir_all(&directory).unwrap();
    }
}
