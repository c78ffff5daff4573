//! Exit codes, and the failures that cause them.

use std::process::ExitCode;

use oqtal_bus::error::BusError;
use oqtal_config::ConfigError;

/// Exit code of a process (sysexits.h, and 1 for a flight that did not end as requested).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Exit {
    /// Success.
    Ok = 0,
    /// The flight did not end as requested.
    Flight = 1,
    /// The command line is wrong.
    Usage = 64,
    /// The input data are invalid.
    Data = 65,
    /// Internal error.
    Internal = 70,
    /// The operating system refused.
    System = 71,
    /// Another controller holds the topic, or a peer did not answer.
    Peer = 75,
    /// The running processes are of another version.
    Version = 76,
    /// No permission.
    Permission = 77,
    /// The configuration is wrong.
    Config = 78,
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(exit as u8)
    }
}

/// Failure of a process: a message for the operator and an exit code for the service manager.
#[derive(Debug, thiserror::Error)]
#[error("{message}")]
pub struct Failure {
    /// The exit code.
    pub exit: Exit,
    /// The message: object, error, remedy.
    pub message: String,
}

impl Failure {
    /// Failure with this code and message.
    pub fn new(exit: Exit, message: impl Into<String>) -> Self {
        Self { exit, message: without_error_numbers(message.into()) }
    }
}

/// `text` without the numbers that the standard library appends to errors of the operating system: " (os error 2)".
pub(crate) fn without_error_numbers(mut text: String) -> String {
    const NUMBER: &str = " (os error ";
    while let Some(begin) = text.find(NUMBER) {
        let length = text[begin..].find(')').map_or(text.len() - begin, |end| end + 1);
        text.replace_range(begin..begin + length, "");
    }
    text
}

impl From<BusError> for Failure {
    fn from(error: BusError) -> Self {
        let exit = match &error {
            BusError::Held { .. } | BusError::Crowded { .. } => Exit::Peer,
            BusError::Version { .. } => Exit::Version,
            BusError::Permission { .. } => Exit::Permission,
            BusError::Name { .. } => Exit::Usage,
            BusError::Full { .. }
            | BusError::Descriptors { .. }
            | BusError::Locked { .. }
            | BusError::System { .. } => Exit::System,
        };
        Self::new(exit, error.to_string())
    }
}

impl From<ConfigError> for Failure {
    fn from(error: ConfigError) -> Self {
        Self::new(Exit::Config, error.to_string())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_has_no_number_of_an_error() {
        let missing = |path: &str| std::fs::read(path).unwrap_err();
        let message =
            format!("a: {}; b: {}, give another", missing("/none"), missing("/dev/null/x"));
        let failure = Failure::new(Exit::System, message);
        let expected = "a: No such file or directory; b: Not a directory, give another";
        assert_eq!(failure.message, expected);
        assert_eq!(Failure::new(Exit::System, "x (os error 2").message, "x");
    }
}
