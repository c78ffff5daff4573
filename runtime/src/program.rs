//! What every program does around its work: reads its command line, makes a panic an exit code, and writes to a terminal or
//! a pipe that may be gone.

use std::any::Any;
use std::io::{ErrorKind, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;

use clap::Parser;

use crate::exit::{Exit, Failure};

/// Runs a program: reads its command line and does what it says by `execute`. A command line that is wrong ends with
/// [`Exit::Usage`], a panic with [`Exit::Internal`].
#[must_use]
pub fn run<C: Parser>(execute: impl FnOnce(C) -> ExitCode) -> ExitCode {
    match C::try_parse() {
        Ok(command) => guarded(|| Ok(execute(command))).unwrap_or_else(|f| conclude("oqtal", &f)),
        Err(error) => explain(&error),
    }
}

/// Does `work`, and makes a panic in it a failure of ours; what it held is dropped on the way, as after an error.
///
/// # Errors
/// Those of `work`; [`Exit::Internal`] after a panic.
pub fn guarded<T>(work: impl FnOnce() -> Result<T, Failure>) -> Result<T, Failure> {
    // Nothing that the work has left half done is looked at again.
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|panic| {
        let what = message(panic.as_ref());
        Err(Failure::new(Exit::Internal, format!("internal error: {what}; please report it")))
    })
}

/// Says on standard error why `program` failed, and gives the exit code that goes with it.
#[must_use]
pub fn conclude(program: &str, failure: &Failure) -> ExitCode {
    say(&format!("{program}: {failure}"));
    failure.exit.into()
}

/// Writes a line of results to standard output. A reader that has gone away has read enough.
///
/// # Errors
/// The output cannot be written: a full disk.
pub fn print(text: &str) -> Result<(), Failure> {
    let mut output = std::io::stdout().lock();
    match writeln!(output, "{text}").and_then(|()| output.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            Err(Failure::new(Exit::System, format!("writing to standard output failed: {error}")))
        }
        _ => Ok(()),
    }
}

/// Writes a line to a person, on standard error; nobody is left to tell if that is closed.
pub fn say(text: &str) {
    let _ = writeln!(std::io::stderr(), "{text}");
}

/// Prints help, version or what is wrong with the command line, with the exit code that goes with it.
fn explain(error: &clap::Error) -> ExitCode {
    // Nothing is left to tell if standard output and error are closed.
    let _ = error.print();
    if error.use_stderr() { Exit::Usage.into() } else { Exit::Ok.into() }
}

/// What a panic says.
fn message(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("a panic without a message")
}
