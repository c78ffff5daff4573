//! Origin of a message: the process that wrote it.

use std::fmt;
use std::sync::OnceLock;

use crate::message::{FNV_OFFSET, fnv1a};

/// A process on a host. In a message's header: process id in bits 0 to 31, host number in bits 32 to 63.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Origin(u64);

impl Origin {
    /// The process with this id on the host with this number.
    pub const fn new(host: u32, process: u32) -> Self {
        Self((host as u64) << 32 | process as u64)
    }

    /// This process on this host.
    pub fn own() -> Self {
        Self::new(own_host(), std::process::id())
    }

    /// The origin with this representation in a header.
    pub const fn from_bits(bits: u64) -> Self {
        Self(bits)
    }

    /// Representation in a header \[-\].
    pub const fn bits(self) -> u64 {
        self.0
    }

    /// Process id \[-\].
    pub const fn process(self) -> u32 {
        (self.0 & 0xffff_ffff) as u32
    }

    /// Host number: a hash of the host's name, never 0 \[-\].
    pub const fn host(self) -> u32 {
        (self.0 >> 32) as u32
    }
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "process {}", self.process())?;
        if self.host() == own_host() {
            return Ok(());
        }
        write!(f, " on host {:08x}", self.host())
    }
}

fn own_host() -> u32 {
    static HOST: OnceLock<u32> = OnceLock::new();
    *HOST.get_or_init(|| host_number(rustix::system::uname().nodename().to_bytes()))
}

/// Host number for this name: FNV-1a folded to 32 bits.
fn host_number(name: &[u8]) -> u32 {
    let hash = fnv1a(FNV_OFFSET, name);
    let folded = (hash >> 32) ^ (hash & 0xffff_ffff);
    u32::try_from(folded).map_or(1, |folded| folded.max(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_origin_names_process_and_host() {
        let own = Origin::own();
        assert_eq!(own.process(), std::process::id());
        assert_ne!(own.host(), 0);
        assert_eq!(Origin::from_bits(own.bits()), own);
        assert_eq!(own.to_string(), format!("process {}", std::process::id()));
        let elsewhere = Origin::new(own.host() ^ 1, 7);
        assert_eq!(elsewhere.to_string(), format!("process 7 on host {:08x}", own.host() ^ 1));
        assert_ne!(host_number(b"lab-1"), host_number(b"lab-2"));
    }
}
