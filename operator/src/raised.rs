//! Stop words that an operator raises: those that the processes hold, and those in the directory of the instance.

use oqtal_bus::bus::Bus;
use oqtal_bus::error::BusError;
use oqtal_bus::paths::InstancePaths;
use oqtal_bus::stop::{StopReport, StopSwitch};
use oqtal_bus::transport::Transport;

use crate::reach::{Reached, name_of};

/// Stop words that were raised.
#[derive(Debug, Default)]
pub(crate) struct RaisedStops {
    words: Vec<RaisedStop>,
    /// Number of vehicle processes whose stop words could not be raised \[-\].
    unreached: usize,
}

#[derive(Debug)]
struct RaisedStop {
    switch: StopSwitch,
    number: u32,
    /// Names of the vehicles' processes that read these words.
    vehicles: Vec<String>,
    /// Whether a process of a vehicle, found or not, reads these words.
    is_vehicles: bool,
    /// Whether a daemon that was found reads these words.
    has_daemon: bool,
}

impl RaisedStops {
    /// Raises the stop in the words that the processes hold; returns the result for each process.
    pub(crate) fn raise_held(&mut self, reached: &mut Reached) -> Vec<String> {
        let mut lines = Vec::new();
        for (process, held) in reached.processes.iter().zip(&mut reached.held) {
            let switch = match held {
                Ok(files) => files.stop.take().ok_or_else(|| "not open, or shortened".to_owned()),
                Err(error) => Err(error.to_string()),
            };
            let result = match switch {
                Ok(switch) => {
                    let raised = self.raise(switch, process.is_vehicle);
                    raised.has_daemon |= !process.is_vehicle;
                    raised.vehicles.extend(process.is_vehicle.then(|| name_of(process)));
                    "raised".to_owned()
                }
                Err(reason) => {
                    self.unreached += usize::from(process.is_vehicle && process.is_running());
                    reason
                }
            };
            lines.push(format!("stop words of {}: {result}", name_of(process)));
        }
        lines
    }

    /// Whether no words were raised.
    pub(crate) fn is_empty(&self) -> bool {
        self.words.is_empty()
    }

    /// Withdraws stops that no process obeys, since they would call off a later flight.
    pub(crate) fn withdraw(&self) {
        self.words.iter().for_each(|stop| stop.switch.withdraw(stop.number));
    }

    /// Raises the stop in the words in the directory of the instance; creates the words if only processes run that do not obey, since a
    /// vehicle may be starting. If no others could be raised, they count as those of the vehicle.
    pub(crate) fn raise_in(&mut self, paths: &InstancePaths) -> Result<(), BusError> {
        let made = || Bus::open_running(paths)?.map(|bus| bus.stop_switch()).transpose();
        if let Some(switch) = StopSwitch::existing(paths)?.map_or_else(made, |it| Ok(Some(it)))? {
            let is_vehicles = self.vehicles().next().is_none();
            self.raise(switch, is_vehicles);
            self.unreached = self.unreached.saturating_sub(usize::from(is_vehicles));
        }
        Ok(())
    }

    /// Raises the stop once in each set of words.
    fn raise(&mut self, switch: StopSwitch, is_vehicles: bool) -> &mut RaisedStop {
        let present = self.words.iter().position(|raised| raised.switch.is_same(&switch));
        let index = present.unwrap_or_else(|| {
            let (number, vehicles) = (switch.raise(), Vec::new());
            let new = RaisedStop { switch, number, vehicles, is_vehicles, has_daemon: false };
            self.words.push(new);
            self.words.len() - 1
        });
        let raised = &mut self.words[index];
        raised.is_vehicles |= is_vehicles;
        raised
    }

    /// Names of the vehicles' processes that have not obeyed, if others have.
    pub(crate) fn laggards(&self) -> Vec<String> {
        let of_vehicles = || self.words.iter().filter(|raised| raised.is_vehicles);
        let has_obeyed = |raised: &&RaisedStop| raised.report().vehicle_obeys;
        if !of_vehicles().any(|raised| has_obeyed(&raised)) {
            return Vec::new();
        }
        of_vehicles().filter(|it| !has_obeyed(it)).flat_map(|it| it.vehicles.clone()).collect()
    }

    /// Reports from the words that processes of vehicles read.
    pub(crate) fn vehicles(&self) -> impl Iterator<Item = StopReport> {
        let of_vehicles = self.words.iter().filter(|raised| raised.is_vehicles);
        of_vehicles.map(RaisedStop::report)
    }

    /// Whether a vehicle was found and the stop words of every vehicle were raised.
    pub(crate) fn reach_every_vehicle(&self) -> bool {
        self.unreached == 0 && self.vehicles().next().is_some()
    }

    /// The combined report: every vehicle has obeyed, and every daemon that was found, or one that was not.
    pub(crate) fn report(&self) -> StopReport {
        let reach_all = self.reach_every_vehicle();
        let obeys = |raised: &RaisedStop| raised.report().daemon_obeys;
        let has_silent = self.words.iter().any(|raised| raised.has_daemon && !obeys(raised));
        StopReport {
            vehicle_obeys: reach_all && self.vehicles().all(|report| report.vehicle_obeys),
            motors_off: reach_all && self.vehicles().all(|report| report.motors_off),
            daemon_obeys: !has_silent && self.words.iter().any(obeys),
            another_has_control: self.vehicles().any(|report| report.another_has_control),
        }
    }
}

impl RaisedStop {
    fn report(&self) -> StopReport {
        self.switch.report(self.number)
    }
}
