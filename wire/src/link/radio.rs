//! Radio of a Crazyflie in a link: `CHANNEL/RATE/ADDRESS`, for example `80/2M/E7E7E7E7E7`.

use std::fmt;
use std::str::FromStr;

use crate::hex::from_hex;

/// Greatest channel \[-\].
const MAX_CHANNEL: u8 = 125;

/// Rate of a radio.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RadioRate {
    /// 250 kbit/s.
    K250,
    /// 1 Mbit/s.
    M1,
    /// 2 Mbit/s.
    M2,
}

impl RadioRate {
    const ALL: [(&'static str, Self); 3] =
        [("250K", Self::K250), ("1M", Self::M1), ("2M", Self::M2)];
}

/// Channel, rate and address of a vehicle's radio.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RadioSpec {
    /// Channel: frequency above 2400 MHz \[MHz, 0..125\].
    pub channel: u8,
    /// Rate.
    pub rate: RadioRate,
    /// Address, first byte first.
    pub address: [u8; 5],
}

impl RadioSpec {
    /// Number of this vehicle in packets for several vehicles: the last byte of its address.
    pub fn vehicle_id(&self) -> u8 {
        self.address[4]
    }
}

impl FromStr for RadioSpec {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts: Vec<&str> = text.split('/').collect();
        let [channel, rate, address] = parts[..] else {
            return Err(format!("`{text}` is not CHANNEL/RATE/ADDRESS, as 80/2M/E7E7E7E7E7"));
        };
        let number = channel.parse().ok().filter(|channel| *channel <= MAX_CHANNEL);
        let channel = number
            .ok_or_else(|| format!("channel `{channel}` is not between 0 and {MAX_CHANNEL}"))?;
        let found = RadioRate::ALL.into_iter().find(|(name, _)| *name == rate);
        let (_, rate) = found.ok_or_else(|| format!("rate `{rate}` is not 250K, 1M or 2M"))?;
        let address = from_hex(address.as_bytes())
            .ok_or_else(|| format!("address `{address}` is not 10 hexadecimal digits"))?;
        Ok(Self { channel, rate, address })
    }
}

impl fmt::Display for RadioSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = RadioRate::ALL.into_iter().find(|(_, rate)| *rate == self.rate);
        write!(f, "{}/{}/", self.channel, name.map_or("2M", |(name, _)| name))?;
        self.address.iter().try_for_each(|byte| write!(f, "{byte:02X}"))
    }
}
