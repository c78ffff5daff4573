//! Definitions of bodies that arrive while frames come: taken as bytes by the real-time thread, read by another.

use oqtal_wire::natnet::{ModelDefinitions, NatNetVersion};
use oqtal_wire::qtm::QtmParameters;

use crate::routes::{CameraBody, RouteTable};

/// Memory for definitions \[bytes\]: the longest packet of QTM.
const CAPACITY: usize = 1 << 20;

/// Format of definitions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DefinitionFormat {
    /// Parameters of QTM.
    Qtm,
    /// Models of NatNet of this version.
    Natnet(NatNetVersion),
}

/// Definitions of bodies: as received, and as read.
#[derive(Debug)]
pub struct BodyDefinitions {
    format: DefinitionFormat,
    bytes: Vec<u8>,
    routes: RouteTable,
    state: DefinitionState,
}

/// State of definitions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum DefinitionState {
    Received,
    Read,
    Unreadable,
}

impl BodyDefinitions {
    /// Whether these are to be read.
    pub fn is_unread(&self) -> bool {
        self.state == DefinitionState::Received
    }

    /// Reads what was received. Allocates.
    ///
    /// # Errors
    /// The definitions cannot be read: the bodies stay as they were.
    pub fn read(&mut self) -> Result<(), String> {
        self.state = DefinitionState::Unreadable;
        let bodies = read(&self.bytes, self.format)?;
        self.routes.replace(bodies);
        self.state = DefinitionState::Read;
        Ok(())
    }
}

/// The bodies that received definitions name.
///
/// # Errors
/// The definitions cannot be read.
pub fn read(bytes: &[u8], format: DefinitionFormat) -> Result<Vec<CameraBody>, String> {
    match format {
        DefinitionFormat::Qtm => {
            let text = std::str::from_utf8(bytes).map_err(|error| error.to_string())?;
            let parameters = QtmParameters::from_xml(text).map_err(|error| error.to_string())?;
            let bodies = parameters.bodies.into_iter().flatten().zip(0..);
            Ok(bodies.map(|(body, key)| CameraBody { key, name: body.name }).collect())
        }
        DefinitionFormat::Natnet(version) => {
            let models =
                ModelDefinitions::parse(bytes, version).map_err(|error| error.to_string())?;
            let bodies = models.bodies.into_iter();
            Ok(bodies.map(|body| CameraBody { key: i64::from(body.id), name: body.name }).collect())
        }
    }
}

/// The definitions of a stream: here and empty, received, or on their way to be read. Nothing allocates but [`DefinitionSlot::new`].
#[derive(Debug)]
pub struct DefinitionSlot {
    spare: Option<Box<BodyDefinitions>>,
    received: bool,
    /// New definitions arrived while others were being read: they must be requested again.
    missed: bool,
}

impl DefinitionSlot {
    /// An empty slot of a stream with these routes.
    pub fn new(format: DefinitionFormat, routes: &RouteTable) -> Self {
        let (bytes, routes) = (Vec::with_capacity(CAPACITY), routes.clone());
        let spare = BodyDefinitions { format, bytes, routes, state: DefinitionState::Received };
        Self { spare: Some(Box::new(spare)), received: false, missed: false }
    }

    /// Keeps definitions that differ from those kept last. Of those that come before any were taken, the last are kept.
    pub fn receive(&mut self, bytes: &[u8]) {
        match &mut self.spare {
            Some(spare) if spare.bytes == bytes => {}
            Some(spare) if bytes.len() <= spare.bytes.capacity() => {
                spare.bytes.clear();
                spare.bytes.extend_from_slice(bytes);
                spare.state = DefinitionState::Received;
                self.received = true;
            }
            Some(_) => {}
            None => self.missed = true,
        }
    }

    /// Takes received definitions, to be read.
    pub fn take(&mut self) -> Option<Box<BodyDefinitions>> {
        if std::mem::take(&mut self.received) { self.spare.take() } else { None }
    }

    /// Applies the definitions read. Returns whether others have arrived meanwhile, which must be requested again.
    pub fn apply_definitions(
        &mut self,
        mut definitions: Box<BodyDefinitions>,
        routes: &mut RouteTable,
    ) -> bool {
        if definitions.state == DefinitionState::Read {
            std::mem::swap(&mut definitions.routes, routes);
        }
        self.spare = Some(definitions);
        std::mem::take(&mut self.missed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn named(name: &str) -> String {
        format!(
            "<QTM_Parameters_Ver_1.25><The_6D><Body><Name>{name}</Name></Body></The_6D></QTM_Parameters_Ver_1.25>"
        )
    }

    #[test]
    fn definitions_are_in_force_when_they_are_read_and_bad_ones_never() {
        let mut routes = RouteTable::new(vec!["b".to_owned()]);
        let mut slot = DefinitionSlot::new(DefinitionFormat::Qtm, &routes);
        assert!(slot.take().is_none());
        for (text, is_good) in [(named("b"), true), ("<open".to_owned(), false), (named("c"), true)]
        {
            slot.receive(text.as_bytes());
            let mut taken = slot.take().unwrap();
            assert!(slot.take().is_none());
            assert_eq!(taken.read().is_ok(), is_good, "{text}");
            assert!(!slot.apply_definitions(taken, &mut routes));
            assert_eq!(routes.has(0), text != named("c"), "{text}");
        }
    }

    #[test]
    fn definitions_that_come_while_others_are_read_are_asked_for_again() {
        let mut routes = RouteTable::new(vec!["b".to_owned()]);
        let mut slot = DefinitionSlot::new(DefinitionFormat::Qtm, &routes);
        slot.receive(named("a").as_bytes());
        let taken = slot.take().unwrap();
        slot.receive(named("b").as_bytes());
        assert!(slot.take().is_none());
        assert!(slot.apply_definitions(taken, &mut routes));
        slot.receive(&vec![b' '; CAPACITY + 1]);
        assert!(slot.take().is_none(), "more than there is room for");
    }
}
