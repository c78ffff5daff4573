//! Rules of the effective configuration.

use oqtal_control::options::OptionError;

use crate::config::Config;
use crate::error::ConfigError;
use crate::instance::ClockKind;
use crate::setting::Setting;

/// Lowest pose rate over the loop rate \[-\].
const LEAST_POSES_PER_TICK: f64 = 1.0 / 1.5;

impl Config {
    /// Checks the rules for single values, and for several together.
    ///
    /// # Errors
    /// The first broken rule, with the origin of the value that broke it.
    pub fn check(&self) -> Result<(), ConfigError> {
        self.check_rules().map_err(|error| {
            let breaks = |config: Self| config.check_rules().is_err_and(|it| it.key == error.key);
            let is_kept = |settings: &[Setting]| !Self::unchecked(settings).is_some_and(breaks);
            self.origins.locate_change(&error, is_kept)
        })
    }

    fn check_rules(&self) -> Result<(), OptionError> {
        self.check_sections().and_then(|()| self.check_together())
    }

    fn check_sections(&self) -> Result<(), OptionError> {
        self.vehicle.check()?;
        self.plant.check()?;
        self.mocap.check()?;
        self.control.check().map_err(|error| error.within("control"))?;
        self.position.check().map_err(|error| error.within("position"))?;
        self.trajectory.check().map_err(|error| error.within("trajectory"))?;
        self.reference.check()?;
        self.safety.check()?;
        self.fence.check()?;
        self.envelope.check()?;
        self.external.check()?;
        self.bridge.check()?;
        self.receiver.check()?;
        self.record.check()?;
        self.realtime.check()
    }

    /// Checks the rules for values of several sections.
    fn check_together(&self) -> Result<(), OptionError> {
        let links =
            [("plant.wire.link", &self.plant.wire.link), ("plant.truth", &self.plant.truth)];
        let link = links.into_iter().find(|(_, link)| !link.is_empty());
        if let Some((key, link)) = link.filter(|_| self.clock.kind != ClockKind::Real) {
            let allowed = "empty unless clock.kind = \"real\"";
            return Err(OptionError::new(key, format!("`{link}`"), allowed));
        }
        let (poses, loops) = (self.safety.pose_rate_hz, self.control.rate_hz);
        if poses < loops * LEAST_POSES_PER_TICK {
            let allowed = format!(
                "at least two thirds of control.rate-hz, {loops}: lower that to {poses}, one tick per pose, or, if the poses arrive faster, set mocap.rate-hz, or for real cameras safety.pose-rate-hz, to their rate"
            );
            return Err(OptionError::new("safety.pose-rate-hz", poses, allowed));
        }
        let (lift, gravity) =
            (self.position.vertical_acceleration_limit_m_s2, self.vehicle.gravity_m_s2);
        if lift >= gravity {
            let key = "position.vertical-acceleration-limit-m-s2";
            let allowed = format!("below gravity, {gravity}: thrust only pushes");
            return Err(OptionError::new(key, lift, allowed));
        }
        self.check_faults()?;
        self.check_awake()?;
        self.check_budget()?;
        self.check_motor_start()
    }

    /// Checks that loops wait awake for at most half of the time.
    fn check_awake(&self) -> Result<(), OptionError> {
        let options = &self.realtime;
        let most_us = (0.5e6 / self.safety.pose_rate_hz - options.warmup_us).max(0.0);
        if options.awake_us == 0.0 || options.awake_us <= most_us {
            return Ok(());
        }
        let allowed = format!("at most {most_us:.0}: with warmup-us, half a period of the poses");
        Err(OptionError::new("realtime.awake-us", options.awake_us, allowed))
    }

    /// Checks that an external law leaves half of a period to the rest of the loop.
    fn check_budget(&self) -> Result<(), OptionError> {
        let (budget_us, most_us) = (self.external.budget_us, 0.5e6 / self.control.rate_hz);
        if !self.control.is_external() || budget_us <= most_us {
            return Ok(());
        }
        let allowed = format!("at most half a period of control.rate-hz, {most_us:.0}");
        Err(OptionError::new("external.budget-us", budget_us, allowed))
    }

    /// Protects real vehicles from accidental faults: a bridge's link must lead to an emulated vehicle or to a firmware executed as a
    /// program.
    fn check_faults(&self) -> Result<(), OptionError> {
        let is_real = !self.bridge.link.is_empty() && !self.plant.is_simulated_behind_bridge();
        let Some(first) = self.fault.inject.first() else { return Ok(()) };
        if !is_real || self.fault.with_real_vehicle {
            return Ok(());
        }
        let allowed =
            "empty with a real vehicle at bridge.link, unless fault.with-real-vehicle = true";
        Err(OptionError::new("fault.inject", format!("`{first}`"), allowed))
    }

    /// Checks that the daemon does not abandon a start of motors on which the bridge still reports.
    fn check_motor_start(&self) -> Result<(), OptionError> {
        let sequence_ms = self.bridge.motor_sequence_ms;
        let least_ms = sequence_ms + self.safety.vehicle_silence_ms;
        if self.safety.motor_start_ms >= least_ms {
            return Ok(());
        }
        let allowed = format!(
            "at least {least_ms}, bridge.motor-sequence-ms and safety.vehicle-silence-ms together"
        );
        Err(OptionError::new("safety.motor-start-ms", self.safety.motor_start_ms, allowed))
    }
}
