//! Requests of operators and conditions of other processes that change the mode in the next tick.

use super::auto_takeoff::AutoTakeoff;

/// Requests that wait for the next tick.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Requests {
    /// Whether a requested flight begins with the next tick or not at all.
    now_or_never: bool,
    auto_takeoff: AutoTakeoff,
    stop: bool,
    /// Whether another vehicle took the place of the one for which a flight was requested.
    vehicle_replaced: bool,
    /// Whether processes of the instance run with different configurations.
    configs_differ: bool,
}

impl Requests {
    /// Requests before the first tick; `auto_takeoff` if a flight is to begin without an operator.
    pub(super) fn new(auto_takeoff: bool) -> Self {
        let auto_takeoff = if auto_takeoff { AutoTakeoff::Pending } else { AutoTakeoff::None };
        Self { auto_takeoff, ..Self::default() }
    }

    /// State of the automatic flight at start-up.
    pub(super) fn auto_takeoff(&self) -> AutoTakeoff {
        self.auto_takeoff
    }

    /// Cancels the automatic flight at start-up.
    pub(super) fn cancel_auto_takeoff(&mut self) {
        if self.auto_takeoff == AutoTakeoff::Pending {
            self.auto_takeoff = AutoTakeoff::None;
        }
    }

    /// Records that a flight begins.
    pub(super) fn begin_flight(&mut self) {
        if self.auto_takeoff == AutoTakeoff::Pending {
            self.auto_takeoff = AutoTakeoff::Started;
        }
    }

    /// Whether the automatic flight at start-up may begin in this tick: once, and only with a vehicle that reports that it is
    /// simulated. A vehicle that is not simulated cancels it.
    pub(super) fn check_auto_takeoff(&mut self, is_simulated: Option<bool>) -> bool {
        if self.auto_takeoff == AutoTakeoff::Pending && is_simulated == Some(false) {
            self.auto_takeoff = AutoTakeoff::Refused;
        }
        self.auto_takeoff == AutoTakeoff::Pending && is_simulated == Some(true)
    }

    /// Sets whether a requested flight begins with the next tick or not at all.
    pub(super) fn set_now_or_never(&mut self, now_or_never: bool) {
        self.now_or_never = now_or_never;
    }

    /// Whether a requested flight begins with the next tick or not at all.
    pub(super) fn is_now_or_never(&self) -> bool {
        self.now_or_never
    }

    /// Requests a stop.
    pub(super) fn stop(&mut self) {
        self.stop = true;
    }

    /// Takes the request of a stop.
    pub(super) fn take_stop(&mut self) -> bool {
        std::mem::take(&mut self.stop)
    }

    /// Records that another vehicle took the place of the one for which a flight was requested.
    pub(super) fn replace_vehicle(&mut self) {
        self.vehicle_replaced = true;
    }

    /// Takes the record that the vehicle was replaced.
    pub(super) fn take_vehicle_replaced(&mut self) -> bool {
        std::mem::take(&mut self.vehicle_replaced)
    }

    /// Records whether processes of the instance run with different configurations.
    pub(super) fn set_configs_differ(&mut self, differ: bool) {
        self.configs_differ = differ;
    }

    /// Whether processes of the instance run with different configurations.
    pub(super) fn configs_differ(&self) -> bool {
        self.configs_differ
    }
}
