//! The files of `oqtal tune --live`.

use std::path::PathBuf;

use oqtal_bus::paths::InstancePaths;
use oqtal_config::{Config, Setting};
use oqtal_lab::identify::identification::Identification;
use oqtal_lab::identify::{overview, vehicle_toml};
use oqtal_lab::output::{CONFIG, check_free, make, next_free, write_file};
use oqtal_lab::tune::tuned::Tuned;
use oqtal_lab::tune::{TuneArgs, page};
use oqtal_operator::request::silent;
use oqtal_runtime::process::{Exit, Failure};
use oqtal_runtime::program::print;

/// The files of the results.
pub struct LiveTuningFiles {
    /// Recording of the excitation.
    pub recording: PathBuf,
    gains: PathBuf,
    page: PathBuf,
    vehicle: PathBuf,
    /// Copy of the daemon's configuration, which its directory loses when it ends.
    config: PathBuf,
}

impl LiveTuningFiles {
    /// The files for the gains of `law`, in a directory that is made; none of them may exist.
    pub fn begin(args: &TuneArgs, law: &str) -> Result<Self, Failure> {
        if args.out.as_ref().is_some_and(|out| out.extension().is_some_and(|end| end == "toml")) {
            let reason = "--out: with --live, give a directory";
            return Err(Failure::new(Exit::Usage, reason));
        }
        let directory = args.out.clone().map_or_else(|| next_free("tune"), Ok)?;
        let within = |name: &str| directory.join(name);
        let files = Self {
            recording: within("excitation.mcap"),
            gains: within(&format!("{law}.toml")),
            page: within(&format!("{law}.html")),
            vehicle: within("vehicle.toml"),
            config: within(CONFIG),
        };
        let Self { recording, gains, page, vehicle, config } = &files;
        check_free(&[recording, gains, page, vehicle, config].map(Clone::clone))?;
        make(&directory)?;
        Ok(files)
    }

    /// Writes and prints the identified vehicle, and keeps the daemon's configuration.
    pub fn write_vehicle(
        &self,
        identification: &Identification,
        (paths, config): (&InstancePaths, &Config),
    ) -> Result<(), Failure> {
        let text = std::fs::read_to_string(paths.config()).map_err(|_| silent(paths))?;
        write_file(&self.config, text)?;
        write_file(&self.vehicle, vehicle_toml::toml(identification, config))?;
        let (found, vehicle) = (overview::text(identification), self.vehicle.display());
        print(&format!("{found}\nvehicle: {vehicle}, as identified"))
    }

    /// `settings` with the copy of the configuration as the origin of those in the configuration of the instance.
    pub fn with_config(&self, paths: &InstancePaths, settings: &[Setting]) -> Vec<Setting> {
        let (from, to) = (paths.config(), self.config.display());
        let from = from.display().to_string();
        let kept = |setting: &Setting| match setting.origin.strip_prefix(&from) {
            Some(line) => Setting { origin: format!("{to}{line}"), ..setting.clone() },
            None => setting.clone(),
        };
        settings.iter().map(kept).collect()
    }

    /// Writes and prints the gains.
    pub fn write(&self, tuned: &Tuned) -> Result<(), Failure> {
        write_file(
            &self.gains,
            tuned.to_toml(&[], "for the vehicle of excitation.mcap beside it"),
        )?;
        write_file(&self.page, page::html(tuned))?;
        let [page, gains] = [&self.page, &self.gains].map(|path| path.display());
        print(&format!(
            "{tuned}page: {page}\ngains: {gains}\nthe margins above are those of the identified vehicle; laws that predict use the \
             [vehicle] of the daemon: to predict by the identified values, start the daemon with vehicle.toml"
        ))
    }
}
