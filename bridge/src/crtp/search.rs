//! Search of a vehicle's table of contents for the names that the bridge uses: by the CRC among known tables, else element by
//! element, a few requests at a time, until every name is found or the table ends.

use oqtal_bus::time::{Span, Time};
use oqtal_wire::crtp::{CrtpReply, CrtpRequest, TableElement, TableInfo, TableKind};

use super::cache::TableStore;
use super::known::{KnownElement, KnownTable};
use super::names::names;
use crate::protocol::PeriodicTimer;

/// Requests that may be unanswered at a time \[-\]: firmware queues five packets at least.
const WINDOW: usize = 3;
/// Time after which a request is repeated.
const REPEAT: Span = Span::from_millis(150);

/// Search of one table.
#[derive(Clone, Debug)]
pub struct TableSearch {
    known: KnownTable,
    info: Option<TableInfo>,
    info_timer: PeriodicTimer,
    is_done: bool,
    /// Number of the first element that has not arrived yet \[-\].
    first: u16,
    /// For that element and those behind it: instant of the request, and whether it has arrived.
    slots: [(Time, bool); WINDOW],
}

impl TableSearch {
    /// Search of `table` that has not begun.
    pub fn new(table: TableKind) -> Self {
        Self {
            known: KnownTable::new(table, 0),
            info: None,
            info_timer: PeriodicTimer::new(REPEAT),
            is_done: false,
            first: 0,
            slots: [(Time::UNSET, false); WINDOW],
        }
    }

    /// Table that was found; `None` during the search.
    pub fn found(&self) -> Option<&KnownTable> {
        self.is_done.then_some(&self.known)
    }

    /// The request that is due at `now`, if any.
    pub fn request(&mut self, now: Time) -> Option<CrtpRequest> {
        if self.is_done {
            return None;
        }
        let Some(TableInfo { count, .. }) = self.info else {
            let is_due = self.info_timer.is_due(now, false);
            return is_due.then_some(CrtpRequest::TableInfo(self.known.table));
        };
        let (first, table) = (self.first, self.known.table);
        let is_due = |asked_at: Time| !asked_at.is_set() || now.since(asked_at) >= REPEAT;
        let mut ids = (first..count).zip(&mut self.slots);
        let (id, slot) = ids.find(|(_, (asked_at, is_here))| !*is_here && is_due(*asked_at))?;
        slot.0 = now;
        Some(CrtpRequest::TableElement(table, id))
    }

    /// Takes a reply. A table that is read to its end is added to `tables`.
    pub fn take(&mut self, reply: &CrtpReply, tables: &mut TableStore) {
        match reply {
            CrtpReply::TableInfo(table, info) if *table == self.known.table => {
                self.take_info(*info, tables);
            }
            CrtpReply::TableElement(table, element) if *table == self.known.table => {
                self.take_element(element, tables);
            }
            _ => {}
        }
    }

    fn take_info(&mut self, info: TableInfo, tables: &mut TableStore) {
        if self.info.is_some() {
            return;
        }
        (self.info, self.known.crc) = (Some(info), info.crc);
        if let Some(known) = tables.find(self.known.table, info.crc) {
            (self.known, self.is_done) = (*known, true);
        }
        self.finish(tables);
    }

    fn take_element(&mut self, element: &TableElement, tables: &mut TableStore) {
        let place = element.id.checked_sub(self.first).map(usize::from);
        let slot = place.and_then(|place| self.slots.get_mut(place));
        let Some(slot) = slot.filter(|(asked_at, _)| asked_at.is_set()) else { return };
        slot.1 = true;
        let mut pairs = self.known.elements.iter_mut().zip(names(self.known.table));
        if let Some((found, _)) = pairs.find(|(_, name)| **name == (element.group, element.name)) {
            *found = Some(KnownElement { id: element.id, kind: element.kind });
        }
        while self.slots[0].1 {
            self.slots.rotate_left(1);
            self.slots[WINDOW - 1] = (Time::UNSET, false);
            self.first = self.first.saturating_add(1);
        }
        self.finish(tables);
    }

    /// Ends the search if all names are found.
    fn finish(&mut self, tables: &mut TableStore) {
        let is_at_end = self.info.is_some_and(|info| self.first >= info.count);
        let ends = !self.is_done && (is_at_end || self.known.is_complete());
        if ends {
            self.is_done = true;
            tables.learn(self.known);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const COUNT: u16 = 300;
    const CRC: u32 = 77;

    /// Element of a table in which the searched names are among others.
    fn element(id: u16) -> TableElement<'static> {
        let wanted = names(TableKind::Logging);
        let place = usize::from(id).checked_sub(200).filter(|place| *place < wanted.len());
        let (group, name) = place.map_or(("other", "one"), |place| wanted[place]);
        TableElement { id, kind: 7, group, name }
    }

    /// Searches with every `lost`th answer lost; returns what was found, and the number of requests.
    fn search(tables: &mut TableStore, lost: u32) -> (KnownTable, u32) {
        let mut search = TableSearch::new(TableKind::Logging);
        let mut requests = 0;
        for millis in 0..20_000 {
            let now = Time::VIRTUAL_START + Span::from_millis(millis);
            while let Some(request) = search.request(now) {
                requests += 1;
                let reply = match request {
                    CrtpRequest::TableInfo(table) => {
                        CrtpReply::TableInfo(table, TableInfo { count: COUNT, crc: CRC })
                    }
                    CrtpRequest::TableElement(table, id) => {
                        assert!(id < COUNT);
                        CrtpReply::TableElement(table, element(id))
                    }
                    other => panic!("{other:?}"),
                };
                if requests % lost != 0 {
                    search.take(&reply, tables);
                }
            }
            if let Some(found) = search.found() {
                return (*found, requests);
            }
        }
        panic!("the search does not end");
    }

    #[test]
    fn every_name_is_found_despite_lost_answers_with_no_unneeded_requests() {
        for lost in [u32::MAX, 10, 3, 2] {
            let mut tables = TableStore::without_file();
            let (found, requests) = search(&mut tables, lost);
            assert!(found.is_complete());
            assert_eq!(tables.find(TableKind::Logging, CRC), Some(&found));
            assert_eq!(found.elements[1], Some(KnownElement { id: 201, kind: 7 }));
            assert!(lost != u32::MAX || requests < 215, "{requests}");
        }
    }

    #[test]
    fn a_known_table_is_not_asked_for_again() {
        let mut tables = TableStore::without_file();
        let (found, _) = search(&mut tables, u32::MAX);
        assert_eq!(search(&mut tables, u32::MAX), (found, 1));
    }

    #[test]
    fn an_element_that_was_not_asked_for_is_ignored() {
        let mut search = TableSearch::new(TableKind::Logging);
        let info = TableInfo { count: COUNT, crc: CRC };
        let mut tables = TableStore::without_file();
        search.take(&CrtpReply::TableInfo(TableKind::Logging, info), &mut tables);
        search.take(&CrtpReply::TableElement(TableKind::Logging, element(0)), &mut tables);
        assert_eq!(search.first, 0);
    }
}
