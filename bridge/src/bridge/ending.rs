//! Last frames of a bridge that ends.

use oqtal_bus::time::Time;

use super::Bridge;
use crate::outbox::FrameKind;

impl Bridge {
    /// Begins one of the zero set-points before the bridge ends; nothing if another has control.
    pub fn begin_final_zero_setpoint(&mut self, now: Time) {
        if self.needs_final_stop() {
            self.protocol.end_flight();
        }
        self.begin_zero_setpoint(now);
    }

    /// Begins the frame that stops motors possibly started by this bridge, before the bridge ends; returns whether a frame was
    /// begun.
    pub fn begin_final_emergency_stop(&mut self, now: Time) -> bool {
        let needed = self.needs_final_stop();
        if needed {
            let frame = self.protocol.final_stop();
            self.begin(now, FrameKind::EmergencyStop, &frame);
        }
        needed
    }

    fn needs_final_stop(&self) -> bool {
        let is_ours = self.gate.may_run() && self.gate.may_stop_at_once();
        self.is_open && self.has_emergency_stop && is_ours
    }
}
