//! Places of the open connections, by class. Each class has a fixed number of places, and its oldest connection makes room for the
//! next one: connections without the token cannot keep out its holder, whose commands include stop.

use std::net::{Shutdown, TcpStream};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Class of a connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ConnectionClass {
    /// The request is not complete yet.
    Unread,
    /// The request did not contain the token.
    Anonymous,
    /// The request contained the token.
    TokenHolder,
}

impl ConnectionClass {
    /// Greatest number of open connections \[-\].
    pub const fn most(self) -> usize {
        match self {
            Self::Unread | Self::Anonymous => 32,
            Self::TokenHolder => 16,
        }
    }

    /// Direction that is shut down to make room. A request that has already arrived is still read and answered.
    fn eviction(self) -> Shutdown {
        match self {
            Self::Unread => Shutdown::Read,
            Self::Anonymous | Self::TokenHolder => Shutdown::Both,
        }
    }
}

/// Open connections of a server, in the order in which they entered their class.
#[derive(Debug, Default)]
pub struct Places {
    open: Mutex<Vec<(ConnectionClass, Arc<TcpStream>)>>,
}

/// Place of a connection; given back on drop.
#[derive(Debug)]
pub struct ConnectionPlace {
    places: Arc<Places>,
    stream: Arc<TcpStream>,
}

impl ConnectionPlace {
    /// Place of a new connection.
    pub fn take(places: &Arc<Places>, stream: TcpStream) -> Self {
        let place = Self { places: Arc::clone(places), stream: Arc::new(stream) };
        place.enter(ConnectionClass::Unread);
        place
    }

    /// The connection.
    pub fn stream(&self) -> &TcpStream {
        &self.stream
    }

    /// Moves the connection to `class`; the oldest one of a full class is disconnected.
    pub fn enter(&self, class: ConnectionClass) {
        self.leave();
        let mut open = self.places.lock();
        let mut of_class = open.iter().enumerate().filter(|(_, (other, _))| *other == class);
        let oldest = of_class.next().map(|(index, _)| index);
        let others = of_class.count();
        if let Some(oldest) = oldest.filter(|_| others + 1 >= class.most()) {
            // A connection that is closed already needs no shutdown.
            let _ = open.remove(oldest).1.shutdown(class.eviction());
        }
        open.push((class, Arc::clone(&self.stream)));
    }

    fn leave(&self) {
        self.places.lock().retain(|(_, stream)| !Arc::ptr_eq(stream, &self.stream));
    }
}

impl Drop for ConnectionPlace {
    fn drop(&mut self) {
        self.leave();
    }
}

impl Places {
    /// Locks the list, which is consistent even after a panic.
    fn lock(&self) -> MutexGuard<'_, Vec<(ConnectionClass, Arc<TcpStream>)>> {
        self.open.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
