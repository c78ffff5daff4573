//! The bridge whose port is lent to a tenant, which writes flight set-points in its place.

use oqtal_bus::lease::{EncoderState, LastWritten};
use oqtal_bus::time::Time;

use super::{Bridge, VehicleReport};
use crate::protocol::VehicleFrame;
use crate::safety::ForwardedCommand;

impl Bridge {
    /// Whether the bridge has something to write at `now`.
    pub fn is_due(&self, now: Time) -> bool {
        self.is_setpoint_due(now) || self.emergency_stop_waits || !self.outbox.is_empty()
    }

    /// The window in which the next flight command, the first after the newest one, would be written as it comes; `None` if it would not.
    pub fn flight_window(&self, now: Time) -> Option<[Time; 2]> {
        let may_fly = self.flies && self.gate.is_flying() && self.is_answering(now);
        let is_free = !self.zero_first && !self.emergency_stop_waits && !self.outbox.is_blocked();
        let ends_at = self.gate.times_out_at().filter(|at| now < *at)?;
        let is_open = may_fly && is_free && !self.holds_back(now) && self.transport.is_bare();
        is_open.then(|| [self.outbox.clear_at(now), ends_at])
    }

    /// State of the encoder for the next flight set-point; `None` if no other process can encode it.
    pub fn encoder_state(&self) -> Option<EncoderState> {
        self.protocol.encoder_state()
    }

    /// Sequence of the newest command that was executed \[-\].
    pub fn newest_executed(&self) -> u64 {
        self.last_command
    }

    /// Continues behind what a tenant of the port has written.
    pub fn resume(&mut self, written: LastWritten) {
        self.protocol.continue_encoder(&written.encoder);
        self.written = Some(written);
    }

    /// Report of the command whose set-point, `frame`, a tenant has written; `None` if it has not.
    pub(super) fn report_written(
        &mut self,
        now: Time,
        forwarded: Option<ForwardedCommand>,
        frame: &VehicleFrame,
    ) -> Option<VehicleReport> {
        let (mut forwarded, written) = (forwarded?, self.written.take()?);
        if forwarded.command as u32 != written.sequence {
            return None;
        }
        // The frame was encoded for the state of the protocol alone.
        self.protocol.continue_encoder(&written.encoder);
        let at = written.at.max(forwarded.stamps.command_published_at).min(now);
        forwarded.stamps.received_at = forwarded.stamps.received_at.min(at);
        let on_wire = self.outbox.add(at, frame.bytes().len());
        if self.sizes.acknowledgement > 0 {
            self.monitor.count_request(at);
        }
        Some(self.report(at, Some(forwarded), on_wire))
    }
}
