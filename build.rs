//! Finds the revision of the sources in version control, for recordings to name the build that made them.

use std::path::Path;
use std::process::Command;

fn main() {
    println!("cargo::rerun-if-env-changed=REVISION_OF_OQTAL");
    let given = std::env::var("REVISION_OF_OQTAL").ok();
    // Cargo hands this variable to what it runs, too: a name with OQTAL_ in front would be taken for a setting.
    let revision = given.or_else(described).unwrap_or_else(|| "unknown".to_owned());
    println!("cargo::rustc-env=REVISION_OF_OQTAL={revision}");
    // The log of the checked-out revision grows with every commit and checkout.
    if let Some(log) = git(&["rev-parse", "--git-path", "logs/HEAD"])
        && Path::new(&log).exists()
    {
        println!("cargo::rerun-if-changed={log}");
    }
    println!("cargo::rerun-if-changed=build.rs");
}

/// The revision of the repository that this directory belongs to.
fn described() -> Option<String> {
    git(&["rev-parse", "--short=12", "HEAD"])
}

/// The output of a command of git on one line; `None` if it fails.
fn git(arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").args(arguments).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    (output.status.success() && !text.trim().is_empty()).then(|| text.trim().to_owned())
}
