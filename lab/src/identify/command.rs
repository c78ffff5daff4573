//! The command line of `oqtal identify`.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use clap::Args;
use oqtal_config::{Config, Interface, Setting};
use oqtal_observe::flight::Flight;
use oqtal_observe::recording::recording_path;
use oqtal_runtime::process::{Exit, Failure, SettingArgs};
use oqtal_runtime::program::print;

use super::data::FlightData;
use super::excitation_flight::{self, ExcitationFlight};
use super::hidden_plants::{HiddenPlants, study};
use super::identification::{Scale, identify};
use super::{overview, page, vehicle_toml};
use crate::output::{CONFIG, add_provenance, check_free, config_file_text, make, next_free, write};
use crate::study::args::{say_notes, warnings};

/// Reads the flight of a recording.
pub type ReadFlight = dyn Fn(&Path) -> Result<Flight, Failure>;

/// Files of the results.
const FILES: [&str; 4] = ["vehicle.toml", "identification.json", "identification.html", CONFIG];
/// Files of a study of hidden plants.
const STUDY_FILES: [&str; 3] = ["hidden-plants.json", "hidden-plants.md", CONFIG];

/// Arguments of `oqtal identify`.
#[derive(Args, Debug)]
pub struct IdentifyArgs {
    /// Recordings of flights of one vehicle, best of `oqtal fly --trajectory excitation`
    #[arg(value_name = "FILE", value_parser = recording_path, conflicts_with_all = ["fly", "config", "set", "plant", "seed"])]
    files: Vec<PathBuf>,
    /// Fly the excitation in virtual time and identify the simulated vehicle of `[plant]`, with a controller configured for `[vehicle]`
    #[arg(long)]
    fly: bool,
    /// Mass as weighed [kg]: flights determine only the thrust over the mass [default: that of `[vehicle]`]
    #[arg(long, value_name = "KG", value_parser = mass)]
    mass: Option<f64>,
    /// Greatest thrust as measured [N], in place of the mass
    #[arg(long, value_name = "N", value_parser = thrust, conflicts_with = "mass")]
    max_thrust: Option<f64>,
    /// Configuration file (TOML) of the vehicle and its surroundings, with --fly; may be repeated, later files override earlier ones
    #[arg(long, value_name = "FILE")]
    config: Vec<PathBuf>,
    #[command(flatten)]
    settings: SettingArgs,
    /// Attitude law, with --fly
    #[arg(long, value_name = "NAME", requires = "fly")]
    controller: Option<String>,
    /// Seed of every random source, with --fly
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    seed: Option<u32>,
    /// Directory of vehicle.toml, identification.json and identification.html [default: results/identify-N]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Replace results that --out holds already
    #[arg(long, requires = "out")]
    force: bool,
    /// Print JSON instead of a table
    #[arg(long)]
    json: bool,
    /// Identify N vehicles whose parameters are drawn within 30 %, in each of four laboratories, and print the errors of the
    /// findings
    #[arg(long, value_name = "N", conflicts_with_all = ["files", "fly", "mass", "max_thrust", "seed"], value_parser = clap::value_parser!(u64).range(1..=10_000))]
    hidden_plants: Option<u64>,
}

impl IdentifyArgs {
    /// Identifies the vehicle, prints the findings and writes them.
    ///
    /// # Errors
    /// The directory holds results (exit code 64), a setting is invalid (78), a recording is invalid or too short (65), the flight
    /// failed (1), or a file cannot be written (71).
    pub fn execute(&self, read: &ReadFlight) -> Result<Exit, Failure> {
        if let Some(count) = self.hidden_plants {
            return self.study(count);
        }
        self.check_out(&FILES)?;
        let flights = self.flights(read)?;
        let Some(first) = flights.first() else {
            let reason = "nothing to identify a vehicle from; give recordings, or --fly";
            return Err(Failure::new(Exit::Usage, reason));
        };
        let flown = first.config_of_longest_flight();
        say_notes(vehicle_notes(&self.files, &flights));
        let data: Vec<FlightData> = flights.iter().map(FlightData::of).collect();
        let identification = identify(&data, &flown.vehicle, self.scale())?;
        let json = json(&identification, &flown)?;
        let directory = self.out.clone().map_or_else(|| next_free("identify"), Ok)?;
        let [vehicle, document, page, copy] = FILES;
        let found = vehicle_toml::toml(&identification, &flown);
        write(&directory, vehicle, &found)?;
        write(&directory, document, &json)?;
        write(&directory, page, page::html(&identification, &data))?;
        write(&directory, copy, config_file_text(&flown))?;
        let [vehicle, page] = [vehicle, page].map(|name| directory.join(name));
        let written = format!("\npage: {}\nwritten: {}", page.display(), vehicle.display());
        let text = overview::text(&identification) + &written;
        print(if self.json { json.trim_end() } else { &text })?;
        let known = warnings(&flown);
        let found = Config::parse(FILES[0], &found, &[]);
        let notes = found.map_or_else(|error| vec![error.to_string()], |it| warnings(&it));
        say_notes(notes.into_iter().filter(|note| !known.contains(note)));
        Ok(Exit::Ok)
    }

    /// Creates the directory of `--out`, and refuses one that holds one of `files` unless they may be replaced.
    fn check_out(&self, files: &[&str]) -> Result<(), Failure> {
        let Some(directory) = &self.out else { return Ok(()) };
        let files: Vec<PathBuf> = files.iter().map(|name| directory.join(name)).collect();
        if !self.force {
            check_free(&files)?;
        }
        make(directory)
    }

    fn study(&self, count: u64) -> Result<Exit, Failure> {
        self.check_out(&STUDY_FILES)?;
        let settings = self.own_settings()?;
        let config = Config::from_settings(&settings)?;
        let study = study(&settings, 1..count + 1, HiddenPlants::LABORATORIES)?;
        let (json, tables) = (json(&study, &config)?, study.to_markdown());
        if let Some(directory) = &self.out {
            let [document, markdown, copy] = STUDY_FILES;
            write(directory, copy, config_file_text(&config))?;
            write(directory, document, &json)?;
            write(directory, markdown, &tables)?;
        }
        print(if self.json { json.trim_end() } else { tables.trim_end() })?;
        Ok(Exit::Ok)
    }

    fn scale(&self) -> Scale {
        match (self.mass, self.max_thrust) {
            (Some(mass_kg), _) => Scale::Mass(mass_kg),
            (None, Some(thrust_n)) => Scale::Thrust(thrust_n),
            (None, None) => Scale::Unknown,
        }
    }

    /// Flights of the files, or one flown now.
    fn flights(&self, read: &ReadFlight) -> Result<Vec<Flight>, Failure> {
        let mut flights = Vec::new();
        if self.fly {
            let config = Config::from_settings(&self.own_settings()?)?;
            check_interface(&config)?;
            say_notes(warnings(&config));
            let ExcitationFlight { flight, assumption } = excitation_flight::fly(&config)?;
            say_notes(assumption);
            flights.push(flight);
        }
        for file in &self.files {
            let flight = read(file)?;
            check_interface(&flight.config)?;
            let named = |note| format!("{}: {note}", file.display());
            say_notes(record_notes(&flight).into_iter().map(named));
            flights.push(flight);
        }
        check_distinct(&flights.iter().collect::<Vec<_>>())?;
        Ok(flights)
    }

    fn own_settings(&self) -> Result<Vec<Setting>, Failure> {
        let mut settings = Config::layers(&self.config)?;
        settings.extend(self.settings.settings()?);
        let law = |name: &String| Setting::flag("--controller", "control.controller", name.clone());
        settings.extend(self.controller.as_ref().map(law));
        let seed = self.seed.map(|seed| Setting::flag("--seed", "clock.seed", i64::from(seed)));
        settings.extend(seed);
        Ok(settings)
    }
}

/// Refuses a vehicle that is not commanded by rates.
///
/// # Errors
/// The way to identify it instead (exit code 64).
pub fn check_interface(config: &Config) -> Result<(), Failure> {
    let remedy = match config.vehicle.interface {
        Interface::Rate => return Ok(()),
        Interface::Attitude => {
            "a vehicle that holds attitudes hides its rate loop; fly it with vehicle.interface = \"rate\", which Crazyflie and \
             MAVLink autopilots take, and identify that flight"
        }
        Interface::Torque => {
            "a vehicle that takes torque has no rate loop; its inertia is [vehicle] inertia-kg-m2, by calculation or by a \
             pendulum, and its delay is measured by `oqtal latency --attach`"
        }
    };
    let reason = format!("only vehicles that are commanded by rates are identified: {remedy}");
    Err(Failure::new(Exit::Usage, reason))
}

/// Refuses a flight that is given twice, also as a copy: the confidence intervals would be too narrow.
///
/// # Errors
/// Two flights have the same number of ticks and the same last one (exit code 64).
pub fn check_distinct(flights: &[&Flight]) -> Result<(), Failure> {
    let key = |flight: &&Flight| {
        let last = flight.samples.last()?.telemetry;
        Some((flight.samples.len(), last.time, last.position.map(f64::to_bits)))
    };
    let mut known = HashSet::new();
    if flights.iter().filter_map(key).all(|key| known.insert(key)) {
        return Ok(());
    }
    let reason = "a flight is given twice, and the intervals would be too narrow; leave one of its recordings out";
    Err(Failure::new(Exit::Usage, reason))
}

/// Why a recording may not be that of one flight with its configuration.
pub fn record_notes(flight: &Flight) -> Vec<String> {
    let count = flight.flights().count();
    let several = (count > 1).then(|| {
        format!("{count} flights in one recording: the vehicle is identified from the longest")
    });
    several.into_iter().chain(flight.record_flaws()).collect()
}

/// Notes on recordings whose `[vehicle]` differs from that of the first, by which all are identified; `files` are their names.
fn vehicle_notes(files: &[PathBuf], flights: &[Flight]) -> Vec<String> {
    let configs: Vec<Config> = flights.iter().map(Flight::config_of_longest_flight).collect();
    let note = |(file, config): (&PathBuf, &Config)| {
        let differences = configs[0].described_differences(config);
        let of_vehicle: Vec<_> =
            differences.iter().filter(|it| it.starts_with("vehicle.")).map(|it| &**it).collect();
        (!of_vehicle.is_empty()).then(|| {
            format!(
                "{}: another [vehicle] than that of the first recording, with which all are identified: {}; if the vehicle itself was \
                 changed, identify each alone",
                file.display(),
                of_vehicle.join(", ")
            )
        })
    };
    files.iter().zip(&configs).skip(1).filter_map(note).collect()
}

/// A result of flights of `config` as a document.
fn json(value: &impl serde::Serialize, config: &Config) -> Result<String, Failure> {
    let document = serde_json::to_value(value);
    let mut document = document.map_err(|error| Failure::new(Exit::Internal, error.to_string()))?;
    add_provenance(&mut document, config);
    Ok(format!("{document:#}\n"))
}

/// Parses a mass that is plausible for an indoor vehicle \[kg\].
fn mass(text: &str) -> Result<f64, String> {
    within(text, (0.01, 50.0), "kg")
}

/// Parses a thrust that is plausible for an indoor vehicle \[N\].
fn thrust(text: &str) -> Result<f64, String> {
    within(text, (0.1, 1e4), "N")
}

fn within(text: &str, (least, most): (f64, f64), unit: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "not a number".to_owned())?;
    let is_within = (least..=most).contains(&value);
    is_within.then_some(value).ok_or_else(|| format!("not within {least} to {most} {unit}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recordings_with_another_vehicle_than_the_first_are_noted() {
        let flight = |mass_kg: f64| {
            let mass = Setting::flag("test", "vehicle.mass-kg", mass_kg);
            Flight::new(&Config::from_settings(&[mass]).unwrap())
        };
        let files = ["a.mcap", "b.mcap", "c.mcap"].map(PathBuf::from);
        let notes = vehicle_notes(&files, &[flight(0.5), flight(0.5), flight(0.6)]);
        let [note] = notes.as_slice() else { panic!("{notes:?}") };
        assert!(note.starts_with("c.mcap: ") && note.contains("vehicle.mass-kg=0.6"), "{note}");
    }
}
