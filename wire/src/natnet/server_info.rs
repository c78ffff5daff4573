//! Description of a server.

use std::net::Ipv4Addr;

use super::message::{MessageId, NatNetError, NatNetVersion, write_content};
use crate::bytes::{ByteOrder, ByteReader};

/// Length of the server's name on the wire \[bytes\].
const NAME_BYTES: usize = 256;

/// Answer to *connect*.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ServerInfo {
    /// Name of the application.
    pub name: String,
    /// Version of the application \[-\].
    pub app_version: [u8; 4],
    /// Version of the protocol.
    pub version: NatNetVersion,
    /// Rate of the server's clock \[Hz\].
    pub clock_hz: u64,
    /// Port of the frames \[-\].
    pub data_port: u16,
    /// Group of the frames; `None` for a unicast server.
    pub multicast: Option<Ipv4Addr>,
}

impl ServerInfo {
    /// Parses the content of the message.
    ///
    /// # Errors
    /// The content is truncated, or the clock in it does not advance.
    pub fn parse(content: &[u8]) -> Result<Self, NatNetError> {
        Self::read(content).ok_or(NatNetError::Content("the server info"))
    }

    /// Whether a message has the same content. The name is ignored: it is not part of the protocol.
    pub fn is_in(&self, content: &[u8]) -> bool {
        let numbers = |info: &Self| {
            (info.app_version, info.version, info.clock_hz, info.data_port, info.multicast)
        };
        Self::numbers(content).is_some_and(|found| numbers(&found) == numbers(self))
    }

    fn read(content: &[u8]) -> Option<Self> {
        let name = content.get(..NAME_BYTES)?;
        let end = name.iter().position(|byte| *byte == 0).unwrap_or(NAME_BYTES);
        let name = String::from_utf8_lossy(&name[..end]).into_owned();
        Some(Self { name, ..Self::numbers(content)? })
    }

    /// Reads the part after the name, with an empty name.
    fn numbers(content: &[u8]) -> Option<Self> {
        let mut reader = ByteReader::new(content.get(NAME_BYTES..)?, ByteOrder::Little);
        let (app_version, [major, minor, _, _]) = (reader.take()?, reader.take()?);
        let (clock_hz, data_port) = (reader.u64()?, reader.u16()?);
        let (is_multicast, group) = (reader.u8()? != 0, reader.take::<4>()?);
        let version = NatNetVersion::new(major, minor);
        let multicast = is_multicast.then(|| Ipv4Addr::from(group));
        (clock_hz > 0).then_some(Self {
            name: String::new(),
            app_version,
            version,
            clock_hz,
            data_port,
            multicast,
        })
    }

    /// Appends the message to `out`.
    pub fn write(&self, out: &mut Vec<u8>) {
        let mut name = [0; NAME_BYTES];
        // The last byte stays a NUL.
        for (place, byte) in name[..NAME_BYTES - 1].iter_mut().zip(self.name.bytes()) {
            *place = byte;
        }
        let group = self.multicast.unwrap_or(Ipv4Addr::UNSPECIFIED);
        write_content(out, MessageId::ServerInfo, |writer| {
            let version = [self.version.major, self.version.minor, 0, 0];
            writer.bytes(&name).bytes(&self.app_version).bytes(&version);
            writer.u64(self.clock_hz).u16(self.data_port);
            writer.bytes(&[u8::from(self.multicast.is_some())]).bytes(&group.octets());
        });
    }
}
