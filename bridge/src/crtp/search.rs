//! Search of a vehicle's table of contents for the names that the bridge uses: by the CRC among known tables, else element by
//! element, a few requests at a time, until every name is found or the table ends.

use oqtal_bus::time::{Span, Time};
use oqtal_wire::crtp::{CrtpReply, CrtpRequest, TableElement, TableInfo, TableKind};

use super::known::{KnownElement, KnownTable, KnownTables};
use super::names::names;

/// Requests that may be unanswered at a time \[-\]: firmware queues five packets at least.
const WINDOW: usize = 3;
/// Time after which a request is repeated.
const REPEAT: Span = Span::from_millis(150);

/// Search of one table.
#[derive(Clone, Debug)]
pub struct TableSearch {
    known: KnownTable,
    info: Option<TableInfo>,
    info_asked_at: Time,
    is_done: bool,
    /// Number of the first element that is not here yet \[-\].
    first: u16,
    /// For that element and those behind it: when it was asked for, and whether it is here.
    slots: [(Time, bool); WINDOW],
}

impl TableSearch {
    /// Search of `table` that has not begun.
    #[must_use]
    pub fn new(table: TableKind) -> Self {
        Self {
            known: KnownTable::new(table, 0),
            info: None,
            info_asked_at: Time::UNSET,
            is_done: false,
            first: 0,
            slots: [(Time::UNSET, false); WINDOW],
        }
    }

    /// What was found; `None` while the search lasts.
    #[must_use]
    pub fn found(&self) -> Option<&KnownTable> {
        self.is_done.then_some(&self.known)
    }

    /// The request that is due at `now`, if any.
    pub fn request(&mut self, now: Time) -> Option<CrtpRequest> {
        let is_due = |asked_at: Time| !asked_at.is_set() || now.since(asked_at) >= REPEAT;
        if self.is_done {
            return None;
        }
        let Some(TableInfo { count, .. }) = self.info else {
            let due = is_due(self.info_asked_at);
            self.info_asked_at = if due { now } else { self.info_asked_at };
            return due.then_some(CrtpRequest::TableInfo(self.known.table));
        };
        let (first, table) = (self.first, self.known.table);
        let mut ids = (first..count).zip(&mut self.slots);
        let (id, slot) = ids.find(|(_, (asked_at, is_here))| !*is_here && is_due(*asked_at))?;
        slot.0 = now;
        Some(CrtpRequest::TableElement(table, id))
    }

    /// Takes a reply. Returns the table if the search ends and it was not known.
    pub fn take(&mut self, reply: &CrtpReply, tables: &KnownTables) -> Option<KnownTable> {
        match reply {
            CrtpReply::TableInfo(table, info) if *table == self.known.table => {
                self.take_info(*info, tables)
            }
            CrtpReply::TableElement(table, element) if *table == self.known.table => {
                self.take_element(element)
            }
            _ => None,
        }
    }

    fn take_info(&mut self, info: TableInfo, tables: &KnownTables) -> Option<KnownTable> {
        if self.info.is_some() {
            return None;
        }
        (self.info, self.known.crc) = (Some(info), info.crc);
        if let Some(known) = tables.find(self.known.table, info.crc) {
            (self.known, self.is_done) = (*known, true);
            return None;
        }
        self.finish()
    }

    fn take_element(&mut self, element: &TableElement) -> Option<KnownTable> {
        let place = usize::from(element.id.checked_sub(self.first)?);
        let slot = self.slots.get_mut(place).filter(|(asked_at, _)| asked_at.is_set())?;
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
        self.finish()
    }

    /// Ends the search if nothing is left to find; returns the table then.
    fn finish(&mut self) -> Option<KnownTable> {
        let is_at_end = self.info.is_some_and(|info| self.first >= info.count);
        let ends = !self.is_done && (is_at_end || self.known.is_complete());
        self.is_done |= ends;
        ends.then_some(self.known)
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
    fn search(tables: &KnownTables, lost: u32) -> (KnownTable, u32, Option<KnownTable>) {
        let mut search = TableSearch::new(TableKind::Logging);
        let (mut requests, mut news) = (0, None);
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
                    news = search.take(&reply, tables).or(news);
                }
            }
            if let Some(found) = search.found() {
                return (*found, requests, news);
            }
        }
        panic!("the search does not end");
    }

    #[test]
    fn every_name_is_found_also_where_answers_are_lost_and_no_more_is_asked_than_needed() {
        let nothing = KnownTables::default();
        for lost in [u32::MAX, 10, 3, 2] {
            let (found, requests, news) = search(&nothing, lost);
            assert!(found.is_complete() && news == Some(found));
            assert_eq!(found.elements[1], Some(KnownElement { id: 201, kind: 7 }));
            assert!(lost != u32::MAX || requests < 215, "{requests}");
        }
    }

    #[test]
    fn a_known_table_is_not_asked_for_again() {
        let nothing = KnownTables::default();
        let (found, ..) = search(&nothing, u32::MAX);
        let mut tables = KnownTables::default();
        tables.add(found);
        assert_eq!(search(&tables, u32::MAX), (found, 1, None));
    }

    #[test]
    fn an_element_that_was_not_asked_for_is_ignored() {
        let mut search = TableSearch::new(TableKind::Logging);
        let info = TableInfo { count: COUNT, crc: CRC };
        search.take(&CrtpReply::TableInfo(TableKind::Logging, info), &KnownTables::default());
        let reply = CrtpReply::TableElement(TableKind::Logging, element(0));
        search.take(&reply, &KnownTables::default());
        assert_eq!(search.first, 0);
    }
}
