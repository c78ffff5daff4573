//! Rules of the effective configuration.

use oqtal_control::options::OptionError;

use crate::config::Config;
use crate::error::{BrokenRule, ConfigError};
use crate::instance::ClockKind;
use crate::setting::Setting;

/// Lowest pose rate over the loop rate \[-\].
const LEAST_POSES_PER_TICK: f64 = 1.0 / 1.5;

impl Config {
    /// Checks the rules for single values, and for several together.
    ///
    /// # Errors
    /// The first broken rule, with the origin of the offending value.
    pub fn check(&self) -> Result<(), ConfigError> {
        self.check_rules().map_err(|broken| {
            let is_kept = |settings: &[Setting]| {
                Self::unchecked(settings).is_none_or(|config| config.check_rules().is_ok())
            };
            self.origins.locate_change(&broken, is_kept)
        })
    }

    fn check_rules(&self) -> Result<(), BrokenRule> {
        self.check_sections().and_then(|()| self.check_together())
    }

    fn check_sections(&self) -> Result<(), BrokenRule> {
        self.vehicle.check()?;
        self.plant.check()?;
        self.mocap.check()?;
        self.control.check().map_err(|error| error.within("control"))?;
        self.position.check().map_err(|error| error.within("position"))?;
        self.trajectory.check().map_err(|error| error.within("trajectory"))?;
        self.reference.check()?;
        self.safety.check()?;
        self.fence.check().map_err(|error| {
            let is_of_ranges = !error.key.ends_with("polygon-m");
            let others: &[_] = if is_of_ranges { &["fence.soft-margin-m"] } else { &[] };
            BrokenRule { error, others }
        })?;
        self.envelope.check()?;
        self.external.check()?;
        self.bridge.check()?;
        self.receiver.check()?;
        self.record.check()?;
        Ok(self.realtime.check()?)
    }

    /// Checks the rules for values of several sections.
    fn check_together(&self) -> Result<(), BrokenRule> {
        if !self.plant.wire.link.is_empty() && self.clock.kind != ClockKind::Real {
            let link = format!("`{}`", self.plant.wire.link);
            let allowed = "empty unless clock.kind = \"real\"";
            let error = OptionError::new("plant.wire.link", link, allowed);
            return Err(BrokenRule { error, others: &["clock.kind"] });
        }
        let (poses, loops) = (self.safety.pose_rate_hz, self.control.rate_hz);
        if poses < loops * LEAST_POSES_PER_TICK {
            let allowed = format!("at least two thirds of control.rate-hz, {loops}");
            let error = OptionError::new("safety.pose-rate-hz", poses, allowed);
            return Err(BrokenRule { error, others: &["control.rate-hz", "mocap.rate-hz"] });
        }
        let (lift, gravity) =
            (self.position.vertical_acceleration_limit_m_s2, self.vehicle.gravity_m_s2);
        if lift >= gravity {
            let key = "position.vertical-acceleration-limit-m-s2";
            let allowed = format!("below gravity, {gravity}: thrust only pushes");
            let others = &["vehicle.gravity-m-s2", "vehicle.preset"];
            return Err(BrokenRule { error: OptionError::new(key, lift, allowed), others });
        }
        self.check_faults()?;
        self.check_budget()?;
        self.check_motor_start()
    }

    /// Checks that an external law leaves half of a period to the rest of the loop.
    fn check_budget(&self) -> Result<(), BrokenRule> {
        let (budget_us, most_us) = (self.external.budget_us, 0.5e6 / self.control.rate_hz);
        if !self.control.is_external() || budget_us <= most_us {
            return Ok(());
        }
        let allowed = format!("at most half a period of control.rate-hz, {most_us:.0}");
        let error = OptionError::new("external.budget-us", budget_us, allowed);
        Err(BrokenRule { error, others: &["control.rate-hz", "control.controller"] })
    }

    /// Protects real vehicles from accidental faults: a bridge's link must lead to the simulated vehicle.
    fn check_faults(&self) -> Result<(), BrokenRule> {
        let is_real = !self.bridge.link.is_empty() && self.plant.wire.link.is_empty();
        let Some(first) = self.fault.inject.first() else { return Ok(()) };
        if !is_real || self.fault.with_real_vehicle {
            return Ok(());
        }
        let allowed =
            "empty with a real vehicle at bridge.link, unless fault.with-real-vehicle = true";
        let error = OptionError::new("fault.inject", format!("`{first}`"), allowed);
        Err(BrokenRule { error, others: &["bridge.link", "fault.with-real-vehicle"] })
    }

    /// Checks that the daemon does not abandon a start of motors on which the bridge still reports.
    fn check_motor_start(&self) -> Result<(), BrokenRule> {
        let sequence_ms = self.bridge.motor_sequence_ms;
        let least_ms = sequence_ms + self.safety.vehicle_silence_ms;
        if self.safety.motor_start_ms >= least_ms {
            return Ok(());
        }
        let allowed = format!(
            "at least {least_ms}, bridge.motor-sequence-ms and safety.vehicle-silence-ms together"
        );
        Err(BrokenRule {
            error: OptionError::new("safety.motor-start-ms", self.safety.motor_start_ms, allowed),
            others: &["bridge.motor-sequence-ms", "safety.vehicle-silence-ms"],
        })
    }
}
