//! `oqtal doctor`: whether this machine is ready to fly, and what would improve it.
//!
//! | file | subject |
//! |---|---|
//! | `system.rs` | facts: files, and answers of the kernel |
//! | `finding.rs` | the result of a check |
//! | `scheduling.rs` | permissions, preemption, throttling |
//! | `processor.rs` | number, clock source, frequency and idle states of processors |
//! | `memory.rs` | shared memory, locked memory, swap |
//! | `place.rs` | files of instances, who may remove them, objects left by killed processes, serial ports |
//!
//! Not checked: timer slack, which every loop sets for itself; transparent huge pages, since locked memory is resident before
//! it is used; the time of day, since all clocks are monotonic.

mod finding;
mod memory;
mod place;
mod processor;
mod scheduling;
mod system;

use clap::Args;
use oqtal_config::Config;
use oqtal_observe::explain::wrapped;
use oqtal_runtime::process::{CommonArgs, Exit, Failure, instance_paths};
use oqtal_runtime::program::{print, say};

use finding::{Finding, Level};
use system::System;

/// Check of the machine; `None` if it does not apply.
type MachineCheck = fn(&System) -> Option<Finding>;

/// Checks, blocking ones first.
const CHECKS: [MachineCheck; 16] = [
    memory::shared,
    place::root,
    place::sharing,
    place::log_out,
    place::remains,
    place::serial_ports,
    scheduling::permission,
    memory::locked,
    memory::swap,
    scheduling::throttling,
    scheduling::preemption,
    processor::number,
    processor::governor,
    processor::idle_states,
    processor::clock_source,
    processor::hypervisor,
];

/// Arguments of `oqtal doctor`.
#[derive(Args, Clone, Debug)]
pub struct DoctorArgs {
    /// Print one JSON document instead of text
    #[arg(long)]
    json: bool,
    /// First remove the objects that killed processes left in shared memory
    #[arg(long)]
    remove_strays: bool,
    #[command(flatten)]
    common: CommonArgs,
}

impl DoctorArgs {
    /// Runs all checks and prints their findings. The exit code is the code of the first problem that prevents a flight.
    ///
    /// # Errors
    /// The configuration is invalid.
    pub fn execute(&self) -> Result<Exit, Failure> {
        let config = Config::load(&self.common.config, &self.common.settings()?)?;
        let system = System::live(&instance_paths(&config)?.root);
        if self.remove_strays {
            place::remove_strays(&system).iter().for_each(|run| say(&format!("removed: {run}")));
        }
        let findings = examine(&system);
        print(&if self.json { json(&findings) } else { text(&findings) })?;
        let problem = findings.iter().find(|finding| finding.level == Level::Problem);
        Ok(problem.map_or(Exit::Ok, |finding| finding.exit))
    }
}

fn examine(system: &System) -> Vec<Finding> {
    CHECKS.iter().filter_map(|check| check(system)).collect()
}

fn json(findings: &[Finding]) -> String {
    let worst = findings.iter().map(|finding| finding.level).max().unwrap_or(Level::Ok);
    let document = serde_json::json!({ "level": worst, "checks": findings });
    serde_json::to_string_pretty(&document).expect("findings hold only what JSON can say")
}

/// One line per check, followed by reason and remedy for every advice or problem.
fn text(findings: &[Finding]) -> String {
    let mut lines = Vec::new();
    for finding in findings {
        let found = format!("{}: {}", finding.name, finding.found);
        lines.push(format!("{:8} {}", finding.level.name(), wrapped(&found, 9)));
        if finding.level > Level::Ok {
            lines.push(format!("         {}", wrapped(&format!("why: {}", finding.why), 14)));
            lines.extend(finding.remedy.iter().map(|remedy| format!("         remedy: {remedy}")));
        }
    }
    let count = |level| findings.iter().filter(|finding| finding.level == level).count();
    lines.push(match (count(Level::Problem), count(Level::Advice)) {
        (0, 0) => "fit to fly".to_owned(),
        (0, advice) => format!("fit to fly; {advice} could be better"),
        (problems, _) => format!("not fit to fly: {problems} to mend first"),
    });
    lines.join("\n")
}

#[cfg(test)]
mod tests;
