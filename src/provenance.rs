//! The build of this program.

use oqtal_observe::provenance::Provenance;

/// Version and revision of this build.
pub const PROVENANCE: Provenance =
    Provenance { version: env!("CARGO_PKG_VERSION"), revision: env!("REVISION_OF_OQTAL") };
