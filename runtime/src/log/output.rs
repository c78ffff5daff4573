//! Output of the log thread: the journal, or standard error.

use std::io::Write;

use oqtal_bus::topic::Role;
use systemd_journal_logger::JournalLog;
use tracing::Level;

use super::queue::LogRecord;
use crate::exit::without_error_numbers;

/// Prefix of the journal's fields: `OQTAL_STATE`, `OQTAL_CAUSE`, `OQTAL_SEQUENCE`.
const PREFIX: &str = "OQTAL_";

/// The output of the log.
pub(super) enum Output {
    /// Structured records.
    Journal(JournalLog),
    /// One line per record.
    StandardError,
}

impl Output {
    /// The journal if standard error is connected to it, otherwise standard error.
    pub fn of_process(role: Role) -> Self {
        if !systemd_journal_logger::connected_to_journal() {
            return Self::StandardError;
        }
        match JournalLog::new() {
            Ok(journal) => {
                Self::Journal(journal.with_syslog_identifier(format!("oqtal-{}", role.name())))
            }
            Err(_) => Self::StandardError,
        }
    }

    /// Writes a record. Errors are ignored: there is no other channel to report them.
    pub fn write(&mut self, record: &LogRecord) {
        match self {
            Self::Journal(journal) => {
                let level = match record.level {
                    Level::ERROR => log::Level::Error,
                    Level::WARN => log::Level::Warn,
                    Level::INFO => log::Level::Info,
                    Level::DEBUG => log::Level::Debug,
                    Level::TRACE => log::Level::Trace,
                };
                let fields = journal_fields(record);
                let text = without_error_numbers(record.message.clone());
                let message = format_args!("{text}");
                let entry =
                    log::Record::builder().level(level).args(message).key_values(&fields).build();
                let _ = journal.journal_send(&entry);
            }
            Self::StandardError => {
                let _ = writeln!(std::io::stderr(), "{}", line(record));
            }
        }
    }
}

/// Fields of a record with their names in the journal.
fn journal_fields(record: &LogRecord) -> Vec<(String, String)> {
    let name = |name: &str| format!("{PREFIX}{}", name.to_uppercase());
    record.fields.iter().map(|(field, value)| (name(field), value.clone())).collect()
}

/// Formats a record as a line: time, level, message, fields.
fn line(record: &LogRecord) -> String {
    let LogRecord { time, level, message, fields } = record;
    let fields: String = fields
        .iter()
        .map(|(name, value)| match value.contains(char::is_whitespace) {
            true => format!(" {name}={value:?}"),
            false => format!(" {name}={value}"),
        })
        .collect();
    format!("{time} {level:>5} {}{fields}", without_error_numbers(message.clone()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_has_time_level_message_and_fields() {
        let record = coasting();
        let expected =
            "2026-01-02T03:04:05Z  WARN flying, Coast: no pose cause=\"no pose\" sequence=7";
        assert_eq!(line(&record), expected);
    }

    #[test]
    fn fields_of_the_journal_have_the_prefix() {
        let fields = journal_fields(&coasting());
        let names: Vec<&str> = fields.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names, ["OQTAL_CAUSE", "OQTAL_SEQUENCE"]);
    }

    fn coasting() -> LogRecord {
        LogRecord {
            time: "2026-01-02T03:04:05Z".to_owned(),
            level: Level::WARN,
            message: "flying, Coast: no pose".to_owned(),
            fields: vec![("cause", "no pose".to_owned()), ("sequence", "7".to_owned())],
        }
    }
}
