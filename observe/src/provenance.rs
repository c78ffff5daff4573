//! The build of the program that recorded or evaluated a flight.

/// A build.
#[derive(Clone, Copy, Debug)]
pub struct Provenance {
    /// Version of the program.
    pub version: &'static str,
    /// Revision of the sources in version control; `unknown` if the program was not built from a repository.
    pub revision: &'static str,
}
