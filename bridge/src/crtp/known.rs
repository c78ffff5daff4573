//! Entries of tables of contents for the names that the bridge uses, by the CRC of each table; and their text, one table per line:
//! `logging 8a3f01c2 pm.vbat=12:7 supervisor.info=-`, with number and type of each name, or a dash where the table lacks it.

use oqtal_wire::crtp::TableKind;

use super::names::{MAX_NAMES, names};

/// Most tables that are kept \[-\]: two of a firmware.
const MAX_TABLES: usize = 64;

/// Number and type of a name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct KnownElement {
    /// Number of the element \[-\].
    pub id: u16,
    /// Type of the element as on the wire \[-\].
    pub kind: u8,
}

/// Entries of one table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct KnownTable {
    /// Kind of the table.
    pub table: TableKind,
    /// CRC of the table \[-\].
    pub crc: u32,
    /// The names in the order of [`names`].
    pub elements: [Option<KnownElement>; MAX_NAMES],
}

impl KnownTable {
    /// Table of which nothing is known yet.
    pub fn new(table: TableKind, crc: u32) -> Self {
        Self { table, crc, elements: [None; MAX_NAMES] }
    }

    /// Whether the table has every name.
    pub fn is_complete(&self) -> bool {
        self.elements.iter().zip(names(self.table)).all(|(element, _)| element.is_some())
    }

    /// The line of this table.
    pub fn line(&self) -> String {
        let mut line = format!("{} {:08x}", table_name(self.table), self.crc);
        for ((group, name), element) in names(self.table).iter().zip(self.elements) {
            let value = match element {
                Some(KnownElement { id, kind }) => format!("{id}:{kind}"),
                None => "-".to_owned(),
            };
            line.push_str(&format!(" {group}.{name}={value}"));
        }
        line
    }

    /// Reads a line; `None` if it is invalid, or has other names.
    pub fn from_line(line: &str) -> Option<Self> {
        let mut words = line.split(' ');
        let kind = words.next()?;
        let table = [TableKind::Logging, TableKind::Parameters]
            .into_iter()
            .find(|t| table_name(*t) == kind)?;
        let mut known = Self::new(table, u32::from_str_radix(words.next()?, 16).ok()?);
        for ((group, name), element) in names(table).iter().zip(&mut known.elements) {
            let (key, value) = words.next()?.split_once('=')?;
            let is_same = key.strip_prefix(group).and_then(|k| k.strip_prefix('.')) == Some(*name);
            *element = match value.split_once(':') {
                _ if !is_same => return None,
                None if value == "-" => None,
                None => return None,
                Some((id, kind)) => {
                    Some(KnownElement { id: id.parse().ok()?, kind: kind.parse().ok()? })
                }
            };
        }
        words.next().is_none().then_some(known)
    }
}

fn table_name(table: TableKind) -> &'static str {
    match table {
        TableKind::Logging => "logging",
        TableKind::Parameters => "parameters",
    }
}

/// Tables that are known, the newest last.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct KnownTables {
    tables: Vec<KnownTable>,
}

impl KnownTables {
    /// Reads lines; invalid ones are left out.
    pub fn from_text(text: &str) -> Self {
        let mut known = Self { tables: Vec::with_capacity(MAX_TABLES) };
        text.lines().filter_map(KnownTable::from_line).for_each(|table| known.add(table));
        known
    }

    /// The text of all tables.
    pub fn to_text(&self) -> String {
        self.tables.iter().map(|table| table.line() + "\n").collect()
    }

    /// The table of this kind and CRC.
    pub fn find(&self, table: TableKind, crc: u32) -> Option<&KnownTable> {
        self.tables.iter().find(|known| (known.table, known.crc) == (table, crc))
    }

    /// Adds a table in place of an older one; the oldest is dropped if there are too many. Does not allocate after the capacity
    /// was reserved.
    pub fn add(&mut self, table: KnownTable) {
        self.tables.retain(|known| (known.table, known.crc) != (table.table, table.crc));
        if self.tables.len() >= MAX_TABLES {
            self.tables.remove(0);
        }
        self.tables.push(table);
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn a_table_is_read_back(
            crc: u32,
            ids in prop::collection::vec(prop::option::of(any::<(u16, u8)>()), MAX_NAMES),
            is_logging: bool,
        ) {
            let table = if is_logging { TableKind::Logging } else { TableKind::Parameters };
            let mut known = KnownTable::new(table, crc);
            let count = names(table).len();
            for (element, id) in known.elements.iter_mut().zip(ids).take(count) {
                *element = id.map(|(id, kind)| KnownElement { id, kind });
            }
            let text = known.line();
            let tables = KnownTables::from_text(&format!("nonsense\n{text}\n\n{text}"));
            prop_assert_eq!(tables.to_text(), format!("{text}\n"));
            prop_assert_eq!(tables.find(table, crc), Some(&known));
        }

        #[test]
        fn any_text_is_read(text: String) {
            let known = KnownTables::from_text(&text);
            prop_assert_eq!(KnownTables::from_text(&known.to_text()), known);
        }
    }

    #[test]
    fn a_line_with_other_names_is_left_out() {
        let line = KnownTable::new(TableKind::Logging, 1).line();
        assert!(KnownTable::from_line(&line).is_some());
        assert!(KnownTable::from_line(&line.replace("vbat", "vbatt")).is_none());
        assert!(KnownTable::from_line(&format!("{line} pm.x=1:1")).is_none());
    }
}
