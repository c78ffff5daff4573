//! Commands that reached the vehicle, joined with the ticks that computed them.

use std::collections::HashMap;

use oqtal_bus::message::Stamps;
use oqtal_bus::time::Time;

use crate::flight::{Flight, FlightSample};
use crate::latency::OnwardTime;

/// Command that reached the vehicle.
#[derive(Clone, Copy, Debug)]
pub struct AppliedCommand {
    /// Sequence number \[-\].
    pub sequence: u64,
    /// Stamps, beginning with the capture of the pose.
    pub stamps: Stamps,
    /// Time from the last stamp to the effect.
    pub onward: OnwardTime,
    /// Battery voltage when the command was applied \[V\].
    pub battery_v: f64,
}

impl Flight {
    /// Every tick with its command as it reached the vehicle; `None` for a command that did not.
    pub fn samples_with_commands(
        &self,
    ) -> impl Iterator<Item = (&FlightSample, Option<&AppliedCommand>)> {
        // Each daemon of a recording counts its commands from 1, and `woken_at` is the instant of the tick.
        let by_tick = |command: &AppliedCommand| (command.sequence, command.stamps.woken_at);
        let applied: HashMap<(u64, Time), &AppliedCommand> =
            self.applied.iter().map(|command| (by_tick(command), command)).collect();
        self.samples.iter().map(move |sample| {
            let tick = (sample.telemetry.command_sequence, sample.telemetry.time);
            (sample, applied.get(&tick).copied())
        })
    }
}
