//! Frame of every program: command line, panics as exit codes, output to a terminal or a pipe that may be closed.

use std::any::Any;
use std::io::{ErrorKind, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::channel;
use std::time::Duration;

use clap::Parser;
use clap::error::{ContextKind, ContextValue};
use oqtal_bus::code::OperatorCommand;
use oqtal_bus::obeying::subcommand;
use serde::Serialize;

use crate::exit::{Exit, Failure, without_error_numbers};
use crate::stop::StopFlag;

/// Whether results were printed on standard output.
static HAS_PRINTED: AtomicBool = AtomicBool::new(false);

/// Maximum time that a message waits for standard error.
const SAY_TIMEOUT: Duration = Duration::from_millis(300);

/// Parses the command line and runs `execute`. An invalid command line ends with [`Exit::Usage`], a panic with
/// [`Exit::Internal`].
pub fn run<C: Parser>(execute: impl FnOnce(C) -> ExitCode) -> ExitCode {
    survive_size_limits();
    match C::try_parse() {
        Ok(command) => guarded(|| Ok(execute(command))).unwrap_or_else(|f| conclude("oqtal", &f)),
        Err(error) => explain(error),
    }
}

/// Makes a write beyond the file size limit (`ulimit -f`) fail, as on a full disk, instead of ending the process.
fn survive_size_limits() {
    // The flag is never read: with any handler the write returns an error. If the registration fails, the signal ends the
    // process.
    let _ = signal_hook::flag::register(signal_hook::consts::SIGXFSZ, Arc::default());
}

/// Flag that Ctrl-C or SIGTERM sets; if it is set already, the signal ends the program. Never set if the registration fails: the
/// first signal then ends the program.
pub fn interrupt_flag() -> StopFlag {
    let flag = StopFlag::default();
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        let ended = Exit::Flight as i32;
        let _ = signal_hook::flag::register_conditional_shutdown(signal, ended, flag.shared())
            .and_then(|_| signal_hook::flag::register(signal, flag.shared()));
    }
    flag
}

/// Executes `work` and converts a panic to a failure; values are dropped as after an error.
///
/// # Errors
/// The error of `work`; [`Exit::Internal`] after a panic.
pub fn guarded<T>(work: impl FnOnce() -> Result<T, Failure>) -> Result<T, Failure> {
    // Data that the work left unfinished are not used again.
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|panic| {
        let what = message(panic.as_ref());
        Err(Failure::new(Exit::Internal, format!("internal error: {what}; please report it")))
    })
}

/// Prints the failure of `command` of `oqtal` and returns its exit code, as [`conclude`]; the document of `--json` names `command`.
pub fn fail(command: &str, failure: &Failure) -> ExitCode {
    print_failure(command, failure.exit, &failure.message);
    conclude("oqtal", failure)
}

/// First word of the command line; `fly` without one.
pub fn command_word() -> String {
    let word = std::env::args_os().nth(1).map(|word| word.to_string_lossy().into_owned());
    subcommand(&word.unwrap_or_default()).to_owned()
}

/// Failure of a command as JSON.
#[derive(Debug, Serialize)]
struct FailureDocument<'a> {
    command: &'a str,
    /// Always "none".
    answer: &'static str,
    /// Reason, with the remedy.
    error: &'a str,
    /// Exit code of the command \[-\].
    exit_code: u8,
}

fn print_failure(command: &str, exit: Exit, error: &str) {
    if std::env::args_os().any(|word| word == "--json") && !HAS_PRINTED.load(Ordering::Relaxed) {
        let document = FailureDocument { command, answer: "none", error, exit_code: exit as u8 };
        // The failure that is reported already matters more.
        let _ = print(&serde_json::to_string_pretty(&document).expect("plain JSON"));
    }
}

/// Prints on standard error the reason why `program` failed, and returns its exit code. With `--json`, the failure is also a document on
/// standard output, unless the command has printed one.
pub fn conclude(program: &str, failure: &Failure) -> ExitCode {
    print_failure(&command_word(), failure.exit, &failure.message);
    say(&format!("{program}: {failure}"));
    failure.exit.into()
}

/// Prints a line of results on standard output. A closed pipe does not count as an error: its reader does not need further lines.
///
/// # Errors
/// The output cannot be written, as on a full disk.
pub fn print(text: &str) -> Result<(), Failure> {
    HAS_PRINTED.store(true, Ordering::Relaxed);
    let mut output = std::io::stdout().lock();
    match writeln!(output, "{text}").and_then(|()| output.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            Err(Failure::new(Exit::System, format!("writing to standard output failed: {error}")))
        }
        _ => Ok(()),
    }
}

/// Prints a message on standard error. Waits at most 300 ms for an output that does not drain. An error is ignored: there is no
/// other channel to report it.
pub fn say(text: &str) {
    let line = format!("{}\n", without_error_numbers(text.to_owned()));
    let (done, is_done) = channel();
    beside(move || {
        let _ = std::io::stderr().write_all(line.as_bytes());
        let _ = done.send(());
    });
    let _ = is_done.recv_timeout(SAY_TIMEOUT);
}

/// Executes `work` on a thread of its own, or on the calling thread if the system grants no other.
pub fn beside(work: impl FnOnce() + Clone + Send + 'static) {
    let again = work.clone();
    if std::thread::Builder::new().spawn(work).is_err() {
        again();
    }
}

/// Prints help, version or a usage error, and returns its exit code.
fn explain(mut error: clap::Error) -> ExitCode {
    if let Some(ContextValue::String(word)) = error.get(ContextKind::InvalidSubcommand)
        && is_request(word)
    {
        let tip = format!("requests to a running daemon follow `ctl`, as in `oqtal ctl {word}`");
        error.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![tip.into()]));
    }
    // Ignored: standard output and error may be closed.
    let _ = error.print();
    if !error.use_stderr() {
        return Exit::Ok.into();
    }
    print_failure(&command_word(), Exit::Usage, error.to_string().trim_end());
    Exit::Usage.into()
}

/// Whether `word` is the name of a request to the daemon.
fn is_request(word: &str) -> bool {
    (0..=u8::MAX).filter_map(OperatorCommand::from_code).any(|it| it.to_string() == word)
}

/// The message of a panic.
fn message(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("a panic without a message")
}
