//! What carries bytes to a vehicle. Knows neither formats nor safety; another carrier is one more implementation.

use std::fmt::Debug;
use std::io;

/// A way for bytes, both ways. No call waits.
pub trait VehicleLink: Debug + Send {
    /// Reads what is there; 0 if that is nothing.
    ///
    /// # Errors
    /// The link is lost.
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize>;

    /// Hands over as many bytes as are taken now; 0 if that is none.
    ///
    /// # Errors
    /// The link is lost.
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize>;

    /// Bytes that were handed over and have not gone out, as far as the link can tell.
    ///
    /// # Errors
    /// The link is lost.
    fn queued(&self) -> io::Result<usize>;

    /// Drops them.
    ///
    /// # Errors
    /// The link is lost.
    fn discard(&mut self) -> io::Result<()>;
}
