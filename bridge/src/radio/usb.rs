//! Crazyradio on USB: settings by vendor requests, packets by bulk transfers, the acknowledgement with a status byte before it.

use std::io;
use std::time::Duration;

use nusb::transfer::{Bulk, ControlOut, ControlType, In, Out, Recipient, TransferError};
use nusb::{Endpoint, ErrorKind, Interface, MaybeFuture, list_devices};
use oqtal_wire::crtp::CrtpPacket;
use oqtal_wire::link::{RadioRate, RadioSpec};

use super::dongle::{RadioAck, RadioDongle};
use crate::link::PortOpenError;

const VENDOR: u16 = 0x1915;
const PRODUCT: u16 = 0x7777;
/// First firmware whose settings are known here, 0.4 as USB counts it.
const OLDEST_FIRMWARE: u16 = 0x0040;
/// Error of the operating system where there is no list of devices \[-\].
const NO_SUCH_FILE: u32 = 2;
const ENDPOINT_OUT: u8 = 0x01;
const ENDPOINT_IN: u8 = 0x81;
/// Longest answer of the radio \[bytes\].
const MAX_ANSWER: usize = 64;
const TIMEOUT: Duration = Duration::from_millis(200);

/// Settings of the radio.
const CHANNEL: u8 = 0x01;
const ADDRESS: u8 = 0x02;
const RATE: u8 = 0x03;
const POWER: u8 = 0x04;
const REPEAT_DELAY: u8 = 0x05;
const REPEAT_COUNT: u8 = 0x06;
const ACKNOWLEDGE: u8 = 0x10;
/// Address at which every Crazyflie receives in addition to its own.
const EVERYBODY: [u8; 5] = [0xFF, 0xE7, 0xE7, 0xE7, 0xE7];
const CARRIER: u8 = 0x20;

/// Greatest power, 0 dBm of the chip.
const FULL_POWER: u16 = 3;
/// Repetitions of a packet that is not acknowledged \[-\]: about 3 ms at the most.
const REPEATS: u16 = 3;
/// Wait for an acknowledgement of up to 32 bytes.
const LONGEST_ACK: u16 = 0x80 | 32;

/// Open Crazyradio.
pub struct UsbDongle {
    interface: Interface,
    output: Endpoint<Bulk, Out>,
    input: Endpoint<Bulk, In>,
    /// Present settings of the radio; `None` if unknown.
    target: Option<RadioSpec>,
}

impl std::fmt::Debug for UsbDongle {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("UsbDongle").field("target", &self.target).finish_non_exhaustive()
    }
}

impl UsbDongle {
    /// Opens the first Crazyradio.
    ///
    /// # Errors
    /// No radio is plugged in, another program uses it, permission is missing, or its firmware is too old.
    pub fn open() -> Result<Self, PortOpenError> {
        // A machine without USB has no list of devices either.
        let devices = list_devices().wait().map_err(|error| match error.os_error() {
            Some(NO_SUCH_FILE) => PortOpenError::NoCrazyradio,
            _ => refused(&error),
        })?;
        let is_radio = |device: &nusb::DeviceInfo| {
            (device.vendor_id(), device.product_id()) == (VENDOR, PRODUCT)
        };
        let found = devices.into_iter().find(is_radio).ok_or(PortOpenError::NoCrazyradio)?;
        if found.device_version() < OLDEST_FIRMWARE {
            return Err(PortOpenError::OldCrazyradio { version: found.device_version() });
        }
        let device = found.open().wait().map_err(|error| refused(&error))?;
        let interface = device.claim_interface(0).wait().map_err(|error| refused(&error))?;
        let output = interface.endpoint(ENDPOINT_OUT).map_err(|error| refused(&error))?;
        let input = interface.endpoint(ENDPOINT_IN).map_err(|error| refused(&error))?;
        let dongle = Self { interface, output, input, target: None };
        dongle.set_up().map_err(|error| unknown(error.to_string()))?;
        Ok(dongle)
    }

    fn set_up(&self) -> Result<(), TransferError> {
        self.set(CARRIER, 0, &[])?;
        self.set(POWER, FULL_POWER, &[])?;
        self.set(REPEAT_COUNT, REPEATS, &[])?;
        self.set(REPEAT_DELAY, LONGEST_ACK, &[])?;
        self.set(ACKNOWLEDGE, 1, &[])
    }

    fn set(&self, request: u8, value: u16, data: &[u8]) -> Result<(), TransferError> {
        let (control_type, recipient) = (ControlType::Vendor, Recipient::Device);
        let message = ControlOut { control_type, recipient, request, value, index: 0, data };
        self.interface.control_out(message, TIMEOUT).wait()
    }

    /// Sets channel, rate and address, as far as they differ from the last ones.
    fn tune(&mut self, target: &RadioSpec) -> Result<(), TransferError> {
        let last = self.target.take();
        if last.is_none_or(|last| last.channel != target.channel) {
            self.set(CHANNEL, u16::from(target.channel), &[])?;
        }
        if last.is_none_or(|last| last.rate != target.rate) {
            let rate = match target.rate {
                RadioRate::K250 => 0,
                RadioRate::M1 => 1,
                RadioRate::M2 => 2,
            };
            self.set(RATE, rate, &[])?;
        }
        if last.is_none_or(|last| last.address != target.address) {
            self.set(ADDRESS, 0, &target.address)?;
        }
        self.target = Some(*target);
        Ok(())
    }

    fn send(&mut self, packet: &CrtpPacket) -> Result<(), TransferError> {
        let bytes = packet.as_bytes().to_vec();
        self.output.transfer_blocking(bytes.into(), TIMEOUT).status
    }
}

impl RadioDongle for UsbDongle {
    fn exchange(&mut self, target: &RadioSpec, packet: &CrtpPacket) -> io::Result<RadioAck> {
        self.tune(target).map_err(lost)?;
        self.send(packet).map_err(lost)?;
        let answer = self.input.allocate(MAX_ANSWER);
        let received = self.input.transfer_blocking(answer, TIMEOUT);
        received.status.map_err(lost)?;
        Ok(read_answer(&received.buffer))
    }

    fn broadcast(&mut self, target: &RadioSpec, packet: &CrtpPacket) -> io::Result<()> {
        self.tune(&RadioSpec { address: EVERYBODY, ..*target }).map_err(lost)?;
        // If no acknowledgement is expected, the radio answers nothing.
        self.set(ACKNOWLEDGE, 0, &[]).map_err(lost)?;
        self.send(packet).map_err(lost)?;
        self.set(ACKNOWLEDGE, 1, &[]).map_err(lost)
    }
}

fn lost(error: TransferError) -> io::Error {
    io::Error::new(io::ErrorKind::BrokenPipe, error)
}

/// Reads status and reply: bit 0 for an acknowledgement, the repetitions in the upper half.
fn read_answer(bytes: &[u8]) -> RadioAck {
    let [status, reply @ ..] = bytes else {
        return RadioAck { is_acknowledged: false, repeated: 0, reply: None };
    };
    let is_acknowledged = status & 1 != 0;
    let reply = CrtpPacket::parse(reply).ok().filter(|_| is_acknowledged);
    RadioAck { is_acknowledged, repeated: u32::from(status >> 4), reply }
}

fn refused(error: &nusb::Error) -> PortOpenError {
    match error.kind() {
        ErrorKind::PermissionDenied => PortOpenError::CrazyradioPermission,
        ErrorKind::Busy => PortOpenError::CrazyradioBusy,
        ErrorKind::Disconnected => PortOpenError::NoCrazyradio,
        _ => unknown(error.to_string()),
    }
}

/// The failure to open the radio for another reason.
pub fn unknown(reason: String) -> PortOpenError {
    PortOpenError::System { port: "the Crazyradio".to_owned(), reason }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn status_repetitions_and_reply_are_read() {
        let ack = read_answer(&[0x21, 0xFC, 0x01]);
        assert!(ack.is_acknowledged && ack.repeated == 2);
        assert_eq!(ack.reply.unwrap().as_bytes(), [0xFC, 0x01]);
        let nothing = RadioAck { is_acknowledged: true, repeated: 0, reply: None };
        assert_eq!(read_answer(&[0x01]), nothing);
        for lost in [&[][..], &[0x00], &[0x00, 0xFC]] {
            assert!(!read_answer(lost).is_acknowledged && read_answer(lost).reply.is_none());
        }
    }
}
