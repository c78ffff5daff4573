//! The bridge whose port is lent to a tenant, which writes flight set-points in its place.

use oqtal_bus::lease::{EncoderState, LastWritten};
use oqtal_bus::time::Time;

use super::{Bridge, VehicleReport, WrittenSetpoint};
use crate::safety::ForwardedCommand;

impl Bridge {
    /// Whether the bridge has something to write at `now`.
    pub fn is_due(&self, now: Time) -> bool {
        self.is_setpoint_due(now) || self.emergency_stop_waits || !self.outbox.is_empty()
    }

    /// The window in which the next flight command, the first after the newest one, would be written as soon as it arrives; `None` if it
    /// would not.
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

    /// Takes over the encoder state and the last writes of the tenant.
    pub fn resume(&mut self, written: LastWritten) {
        self.protocol.continue_encoder(&written.encoder);
        if written.bytes == 0 {
            return;
        }
        let on_wire = self.outbox.add(written.at, written.bytes);
        if self.sizes.acknowledgement > 0 {
            self.monitor.count_request(written.at);
        }
        self.written =
            Some(WrittenSetpoint { sequence: written.sequence, at: written.at, on_wire });
    }

    /// Report of a command whose set-point a tenant has written; `None` if it has not.
    pub(super) fn report_written(
        &mut self,
        now: Time,
        forwarded: Option<ForwardedCommand>,
    ) -> Option<VehicleReport> {
        let (mut forwarded, written) = (forwarded?, self.written.take()?);
        if forwarded.command as u32 != written.sequence {
            return None;
        }
        let at = written.at.max(forwarded.stamps.command_published_at).min(now);
        forwarded.stamps.received_at = forwarded.stamps.received_at.min(at);
        Some(self.report(at, Some(forwarded), written.on_wire))
    }
}
