//! The log: structured records in the journal if the service manager started the process, else lines on standard error.

use std::io::IsTerminal;

use tracing::Level;
use tracing_subscriber::filter::LevelFilter;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;

use oqtal_bus::topic::Role;
use oqtal_config::LogLevel;

/// Prefix of the journal fields: `OQTAL_STATE`, `OQTAL_CAUSE`, `OQTAL_SEQUENCE`.
const PREFIX: &str = "OQTAL";

/// Starts the log of `role`; records below `level` are discarded.
pub fn start(level: LogLevel, role: Role) {
    let level = match level {
        LogLevel::Error => Level::ERROR,
        LogLevel::Warn => Level::WARN,
        LogLevel::Info => Level::INFO,
        LogLevel::Debug => Level::DEBUG,
        LogLevel::Trace => Level::TRACE,
    };
    let filter = LevelFilter::from_level(level);
    match journal(role) {
        Some(journal) => tracing_subscriber::registry().with(filter).with(journal).init(),
        None => tracing_subscriber::fmt()
            .with_max_level(filter)
            .with_writer(std::io::stderr)
            .with_ansi(std::io::stderr().is_terminal())
            .with_target(false)
            // If standard error is closed, the process goes on without a log.
            .log_internal_errors(false)
            .init(),
    }
}

/// The journal layer, if standard error is connected to the journal.
fn journal(role: Role) -> Option<tracing_journald::Layer> {
    let stream = std::env::var("JOURNAL_STREAM").ok()?;
    let stderr = rustix::fs::fstat(std::io::stderr()).ok()?;
    if !is_stream(&stream, stderr.st_dev, stderr.st_ino) {
        return None;
    }
    let journal = tracing_journald::layer().ok()?;
    let name = format!("oqtal-{}", role.name());
    Some(journal.with_field_prefix(Some(PREFIX.to_owned())).with_syslog_identifier(name))
}

/// Whether `JOURNAL_STREAM` names this file by device and inode (systemd.exec(5)). The variable is inherited also when standard
/// error was redirected.
fn is_stream(text: &str, device: u64, inode: u64) -> bool {
    let number = |text: &str| text.parse::<u64>().ok();
    text.split_once(':')
        .is_some_and(|(dev, ino)| number(dev) == Some(device) && number(ino) == Some(inode))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_stream_that_the_journal_opened_is_the_journal() {
        assert!(is_stream("8:12345", 8, 12345));
        for other in ["", "8", "8:", ":12345", "8:12346", "9:12345", "x:y", "8:12345:1"] {
            assert!(!is_stream(other, 8, 12345), "{other}");
        }
    }
}
