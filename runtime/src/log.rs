//! The log of a process. Threads that must not block only queue their records; the log thread formats and writes them to the
//! journal if the service manager started the process, otherwise to standard error.

mod output;
mod queue;

use std::time::Duration;

use oqtal_bus::topic::Role;
use oqtal_config::LogLevel;
use tracing::Level;
use tracing_subscriber::filter::LevelFilter;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;

use output::Output;
use queue::{LogQueue, log_queue};

/// Maximum time that a process waits at its end for the log to be written.
const FLUSH_TIMEOUT: Duration = Duration::from_millis(200);

/// Starts the log of `role`; records below `level` are discarded. The log is flushed when the returned guard is dropped. The log
/// thread lives as long as the process and can have a `name`.
pub fn start(level: LogLevel, role: Role, name: Option<String>) -> LogGuard {
    let level = match level {
        LogLevel::Error => Level::ERROR,
        LogLevel::Warn => Level::WARN,
        LogLevel::Info => Level::INFO,
        LogLevel::Debug => Level::DEBUG,
        LogLevel::Trace => Level::TRACE,
    };
    let (queue, records) = log_queue(level >= Level::DEBUG);
    // Never joined: an output that does not drain must not prevent the process from ending.
    let thread = name.into_iter().fold(std::thread::Builder::new(), std::thread::Builder::name);
    let started = thread.spawn(move || {
        let mut output = Output::of_process(role);
        records.drain_into(|record| output.write(record));
    });
    started.expect("a process may start a thread");
    tracing_subscriber::registry().with(LevelFilter::from_level(level)).with(queue.clone()).init();
    LogGuard(queue)
}

/// Flushes the log when it is dropped.
#[derive(Debug)]
pub struct LogGuard(LogQueue);

impl Drop for LogGuard {
    fn drop(&mut self) {
        self.0.flush(FLUSH_TIMEOUT);
    }
}
