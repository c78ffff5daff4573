//! Emulated Crazyflie behind its radio, one packet per datagram. Pure: time is an argument.

use oqtal_bus::time::Time;
use oqtal_config::Config;
use oqtal_control::options::OptionError;
use oqtal_wire::crtp::CrtpPacket;

use super::board::CrazyflieBoard;
use crate::plant::Plant;
use crate::wire::datagrams::DatagramModel;
use crate::wire::vehicle::EmulatedVehicle;

/// Emulated Crazyflie controlled over its radio.
pub type CrtpVehicle = EmulatedVehicle<DatagramModel, CrazyflieBoard>;

impl CrtpVehicle {
    /// The vehicle of `config` on the floor at `start`.
    ///
    /// # Errors
    /// An option of `[plant.wire.crtp]` is invalid.
    pub fn new(config: &Config, start: Time) -> Result<Self, OptionError> {
        let air = DatagramModel::new(&config.plant.wire, config.clock.seed);
        let board = CrazyflieBoard::new(&config.plant, start)?;
        Ok(Self::with_parts(Plant::new(config, start), air, board))
    }

    /// Takes the next packet that has arrived at the host by `now`.
    pub fn host_receives(&mut self, now: Time) -> Option<CrtpPacket> {
        self.host_reads_next(now, |bytes| CrtpPacket::parse(bytes).ok()).flatten()
    }
}
