//! A panic on any thread of a process ends it with exit code 70 and a message. The test program is also that process.

use std::process::{Command, ExitCode};
use std::time::Duration;

use clap::Parser;
use oqtal_bus::topic::Role;
use oqtal_runtime::process::{Failure, Job, ProcessCommand, ProcessContext, execute};
use oqtal_runtime::program;

#[derive(Parser)]
struct Cli {
    #[command(subcommand)]
    command: ProcessCommand,
}

/// The loop panics.
fn loop_panics(_: &ProcessContext) -> Result<(), Failure> {
    panic!("the loop fell over")
}

/// Another thread panics; the loop ends only on request.
fn thread_panics(context: &ProcessContext) -> Result<(), Failure> {
    std::thread::scope(|threads| {
        threads.spawn(|| panic!("the thread fell over"));
        while !context.stop.is_set() {
            std::thread::sleep(Duration::from_millis(1));
        }
    });
    Ok(())
}

fn main() -> ExitCode {
    let process =
        |job: Job| program::run(|cli: Cli| execute(Role::Daemon, &cli.command, job, |_| Ok(())));
    match std::env::var("TEST_JOB").as_deref() {
        Ok("loop") => process(loop_panics),
        Ok("thread") => process(thread_panics),
        Ok(_) => program::run(|_: Cli| panic!("the program fell over")),
        Err(_) => {
            f16_a_panic_ends_with_exit_code_70("loop", "the loop fell over");
            f16_a_panic_ends_with_exit_code_70("thread", "the thread fell over");
            f16_a_panic_ends_with_exit_code_70("program", "the program fell over");
            ExitCode::SUCCESS
        }
    }
}

fn f16_a_panic_ends_with_exit_code_70(job: &str, says: &str) {
    let root = tempfile::tempdir().unwrap();
    let mut command = Command::new(std::env::current_exe().unwrap());
    command.args(["run", "--instance", "panics", "--root"]).arg(root.path()).env("TEST_JOB", job);
    let output = command.output().unwrap();
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(70), "{job}: {message}");
    assert!(message.contains(says) && message.contains("internal error"), "{job}: {message}");
}
