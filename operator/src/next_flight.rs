//! Commands for the next flight, printed after a stop.

use std::fmt;

use oqtal_bus::message::ControlResponseV1;
use oqtal_bus::obeying::{ObeyingProcess, starting_command};
use oqtal_bus::obstacle::{ArmingObstacle, ArmingObstacles};
use oqtal_bus::paths::InstancePaths;
use oqtal_observe::config_file;
use serde::ser::{Serialize, SerializeMap, Serializer};

use crate::reach::Reached;
use crate::request::{as_owner, edited_note, start_beside, start_daemon, start_without};
use crate::running::RunningProcesses;

/// The next flight of each instance that a stop has reached.
#[derive(Debug, Default)]
pub(crate) struct NextFlights(Vec<NextFlight>);

/// The next flight of one instance.
#[derive(Debug)]
struct NextFlight {
    paths: InstancePaths,
    /// Another user, as whom the command is to be given.
    user: Option<u32>,
    /// Command that starts a daemon before the flight, if none runs.
    start: Option<String>,
    /// The same in words, if no file has the configuration of the processes that run.
    other_config: Option<String>,
    /// Command that started the processes and ends with this flight, or that arms again.
    command: String,
    /// Whether the command arms processes that run.
    is_arming: bool,
    /// Whether files of the instance are known to be lost: its processes end.
    is_lost: bool,
    /// Process id of a daemon that does not answer and has not obeyed.
    hanging: Option<u32>,
    /// Process id of the vehicle's process that has not obeyed.
    disobedient: Option<u32>,
    /// Whether the vehicle is known to be behind a bridge.
    has_bridge: bool,
    /// Whether the daemon runs without a process of its vehicle.
    lacks_vehicle: bool,
    /// Step before the command, at the vehicle itself or at processes with different configurations.
    first_step: Option<&'static str>,
    /// Note of files of the configuration that were edited since; `None` if the command reads them again.
    edited: Option<String>,
}

impl NextFlights {
    /// The commands of the next flight for the processes in `reached`. Called before these end, as those of `oqtal fly` do.
    pub(crate) fn of(reached: &Reached) -> Self {
        let processes = |paths: &InstancePaths| {
            let all = reached.processes.iter();
            all.filter(|process| process.is_under(paths)).collect::<Vec<_>>()
        };
        Self(reached.places().into_iter().map(|it| NextFlight::of(&processes(&it), it)).collect())
    }

    /// These commands; none with `no_flight`.
    pub(crate) fn unless(self, no_flight: bool) -> Self {
        if no_flight { Self::default() } else { self }
    }

    /// Computes the next flight again for instances of which a process has ended since. A flight whose processes end with their command
    /// is left as it is.
    fn note_ended(&mut self, reached: &Reached) {
        for flight in self.0.iter_mut().filter(|flight| flight.is_arming && !flight.is_lost) {
            let here: Vec<_> =
                reached.processes.iter().filter(|it| it.is_under(&flight.paths)).collect();
            let running: Vec<_> = here.iter().copied().filter(|it| it.is_running()).collect();
            if running.len() < here.len() {
                *flight = NextFlight::of(&running, flight.paths.clone());
            }
        }
    }

    /// Records the losses of `reached`, the processes that have ended since, and those that run at its paths: a daemon needs their
    /// configuration.
    pub(crate) fn note_running(&mut self, reached: &Reached, running: &RunningProcesses) {
        self.note_losses(reached);
        self.note_ended(reached);
        let paths = &reached.paths;
        // A simulator that obeys no stop takes its commands over a wire.
        let is_at_wire =
            running.has_simulator() && !reached.processes.iter().any(|it| it.is_vehicle);
        for flight in self.0.iter_mut().filter(|it| it.paths == *paths) {
            flight.has_bridge |= is_at_wire;
        }
        let Some(other) = running.of_other_config(paths) else { return };
        let has_start = |it: &&mut NextFlight| it.start.is_some() && it.paths == *paths;
        for flight in self.0.iter_mut().filter(has_start) {
            (flight.start, flight.edited) = (None, None);
            flight.other_config = Some(start_beside(other, paths));
        }
    }

    /// Records what the `response` of the addressed daemon of `reached` implies for the next flight. A daemon without a response hangs
    /// unless it `obeys`; a running process of the vehicle has not obeyed unless `vehicle_obeys`.
    pub(crate) fn note_processes(
        &mut self,
        reached: &Reached,
        response: Option<&ControlResponseV1>,
        [obeys, vehicle_obeys]: [bool; 2],
    ) {
        let is_alive = response.is_some() || obeys;
        let here = || reached.processes.iter().filter(|it| it.is_under(&reached.paths));
        let daemon = here().find(|it| !it.is_vehicle && !is_alive && it.is_running());
        // With several roots it is not known whose vehicle has not obeyed.
        let is_told = !vehicle_obeys && reached.places().len() == 1;
        let vehicle = here().find(|it| it.is_vehicle && is_told && it.is_running());
        for flight in self.0.iter_mut().filter(|it| it.paths == reached.paths) {
            flight.hanging = daemon.map(|daemon| daemon.pid);
            flight.disobedient = vehicle.map(|vehicle| vehicle.pid);
            if let Some(response) = response {
                flight.note_obstacles(ArmingObstacles::from_bits(response.obstacles));
            }
        }
    }

    /// Records the instances of `reached` that have lost files.
    pub(crate) fn note_losses(&mut self, reached: &Reached) {
        for flight in &mut self.0 {
            let is_lost = |it: &ObeyingProcess| it.is_under(&flight.paths) && it.has_lost_files();
            flight.is_lost |= flight.is_arming && reached.processes.iter().any(is_lost);
        }
    }
}

impl NextFlight {
    /// The next flight of the instance at `paths`, on which `processes` run.
    fn of(processes: &[&ObeyingProcess], paths: InstancePaths) -> Self {
        let parents = processes.iter().find_map(|it| starting_command(it.pid));
        let is_arming = parents.is_none();
        let has_daemon = processes.iter().any(|process| !process.is_vehicle);
        let lacks_vehicle = is_arming && !processes.iter().any(|process| process.is_vehicle);
        let start = (is_arming && !has_daemon).then(|| start_daemon(&paths));
        let (command, user) = match parents {
            Some(command) => (command, paths.user_to_become()),
            None => (format!("oqtal ctl arm {}", paths.flags()), None),
        };
        let edited = match &start {
            _ if !is_arming => None,
            Some(_) => start_without(&paths),
            None => edited_note(&paths),
        };
        Self {
            has_bridge: config_file::has_bridge(&paths.config()),
            paths,
            user,
            start,
            other_config: None,
            command,
            is_arming,
            is_lost: false,
            hanging: None,
            disobedient: None,
            lacks_vehicle,
            first_step: None,
            edited,
        }
    }

    /// Records the step that the `obstacles` to a take-off require.
    fn note_obstacles(&mut self, obstacles: ArmingObstacles) {
        // Without a process that obeys, the vehicle may answer as soon as there is one.
        let has_process = !self.lacks_vehicle && self.disobedient.is_none();
        self.first_step = if obstacles.contains(ArmingObstacle::Locked) {
            Some("restart the vehicle, which is locked")
        } else if obstacles.contains(ArmingObstacle::VehicleSilent) && has_process {
            Some("switch the vehicle on or bring it into range (it does not answer)")
        } else if obstacles.contains(ArmingObstacle::Configuration) {
            Some(
                "restart the processes, whose configurations differ, with the same --config and --set",
            )
        } else {
            None
        };
    }

    /// Writes the steps before the command.
    fn fmt_steps(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_lost {
            write!(f, "the processes lost their files and end; ")?;
        }
        if !self.is_arming && self.hanging.or(self.disobedient).is_some() {
            write!(f, "a process of the flight hangs: end its command with Ctrl-C; then ")?;
        } else if let Some(daemon) = self.hanging {
            let restart = start_daemon(&self.paths);
            write!(
                f,
                "the daemon does not answer; continue it with `kill -CONT {daemon}`, or end it and start another with `{restart}`; then "
            )?;
        }
        if let Some(vehicle) = self.disobedient.filter(|_| self.is_arming) {
            write!(
                f,
                "the process of the vehicle has not obeyed; if it hangs, continue it with `kill -CONT {vehicle}`; then "
            )?;
        }
        if self.lacks_vehicle && self.has_bridge {
            let (user, place) = (as_owner(&self.paths), self.paths.flags());
            write!(f, "start `{user}oqtal bridge run {place}` with its --config, then ")?;
        }
        match (&self.start, &self.other_config) {
            (Some(start), _) => write!(f, "`{start}`, then ")?,
            (None, Some(start)) => write!(f, "{start}; then ")?,
            (None, None) if self.is_lost => write!(f, "start them again, then ")?,
            (None, None) => {}
        }
        if self.lacks_vehicle && !self.has_bridge {
            let (user, place) = (as_owner(&self.paths), self.paths.flags());
            write!(
                f,
                "start the process of the vehicle, `{user}oqtal plant-sim run {place}` or `{user}oqtal bridge run {place}`, with the daemon's --config, then "
            )?;
        }
        self.first_step.iter().try_for_each(|step| write!(f, "{step}, then "))
    }

    /// Whether the flight needs no step besides `start` and `command`.
    fn is_ready(&self) -> bool {
        let is_whole = !(self.is_lost || self.lacks_vehicle) && self.first_step.is_none();
        let all_obey = self.hanging.is_none() && self.disobedient.is_none();
        is_whole && all_obey && self.other_config.is_none()
    }
}

impl fmt::Display for NextFlights {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let has_several = self.0.len() > 1;
        self.0.iter().try_for_each(|flight| {
            write!(f, "\nto fly again")?;
            if has_several {
                write!(f, " under {}", flight.paths.root.display())?;
            }
            write!(f, "{flight}")
        })
    }
}

impl fmt::Display for NextFlight {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(user) = self.user {
            write!(f, ", as user {user}")?;
        }
        write!(f, ": ")?;
        self.fmt_steps(f)?;
        write!(f, "`{}`", self.command)?;
        self.edited.iter().try_for_each(|note| write!(f, "; {note}"))
    }
}

impl Serialize for NextFlights {
    /// Two entries, with the commands of several roots joined by `; `: `start_again`, if no daemon runs and a file has the configuration, and
    /// `arm_again`, of the flights that need no other step.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let joined = |commands: Vec<&str>| Some(commands.join("; ")).filter(|it| !it.is_empty());
        let ready = self.0.iter().filter(|flight| flight.is_ready());
        let arm = joined(ready.map(|flight| flight.command.as_str()).collect());
        let start = joined(self.0.iter().filter_map(|flight| flight.start.as_deref()).collect());
        let mut map = serializer.serialize_map(None)?;
        for (key, commands) in [("arm_again", arm), ("start_again", start)] {
            if let Some(commands) = commands {
                map.serialize_entry(key, &commands)?;
            }
        }
        map.end()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_process_of_the_vehicle_and_a_locked_vehicle_come_before_the_command() {
        let root = tempfile::tempdir().unwrap();
        let paths = InstancePaths::new("a", Some(root.path())).unwrap();
        let told = |obstacle| {
            let mut flight = NextFlight::of(&[], paths.clone());
            flight.note_obstacles(ArmingObstacles::default().with(obstacle, true));
            flight.to_string()
        };
        let text = told(ArmingObstacle::VehicleSilent);
        let order = ["oqtal daemon run", "oqtal bridge run --instance a", "oqtal ctl arm"];
        let at = order.map(|command| text.find(command).unwrap());
        assert!(at.is_sorted() && !text.contains("switch"), "{text}");
        let text = told(ArmingObstacle::Locked);
        assert!(text.contains("restart the vehicle, which is locked, then `oqtal ctl arm"));
        let flights = NextFlights(vec![NextFlight::of(&[], paths.clone())]);
        let json = serde_json::to_value(flights).unwrap();
        assert!(json["start_again"].is_string() && json["arm_again"].is_null(), "{json}");
    }

    #[test]
    fn a_vehicle_that_does_not_answer_and_different_configurations_come_before_the_command() {
        let root = tempfile::tempdir().unwrap();
        let paths = InstancePaths::new("a", Some(root.path())).unwrap();
        let mut flight = NextFlight { lacks_vehicle: false, ..NextFlight::of(&[], paths) };
        assert!(flight.is_ready());
        for (obstacle, step) in [
            (ArmingObstacle::VehicleSilent, "switch the vehicle on"),
            (ArmingObstacle::Configuration, "with the same --config and --set"),
        ] {
            flight.note_obstacles(ArmingObstacles::default().with(obstacle, true));
            let text = flight.to_string();
            assert!(text.contains(step) && !flight.is_ready(), "{text}");
        }
    }

    #[test]
    fn beside_a_vehicle_that_is_behind_a_bridge_only_the_bridge_is_started() {
        let root = tempfile::tempdir().unwrap();
        let paths = InstancePaths::new("a", Some(root.path())).unwrap();
        let of = |has_bridge| {
            NextFlight { has_bridge, ..NextFlight::of(&[], paths.clone()) }.to_string()
        };
        assert!(of(false).contains("plant-sim") && !of(true).contains("plant-sim"));
        std::fs::create_dir_all(paths.directory()).unwrap();
        std::fs::write(paths.config(), "[bridge]\nlink = \"msp:tcp:host:5761\"\n").unwrap();
        let text = NextFlight::of(&[], paths.clone()).to_string();
        assert!(text.contains("bridge run") && !text.contains("plant-sim"), "{text}");
    }
}
