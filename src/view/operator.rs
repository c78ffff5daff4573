//! Commands from the page to the daemon, sent as by `oqtal ctl`.

use std::sync::{Mutex, TryLockError};

use oqtal_bus::message::ControlRequestV1;
use oqtal_bus::paths::InstancePaths;
use oqtal_bus::time::{Span, Time};
use oqtal_operator::{AddressedInstance, CtlRequest};
use oqtal_view::site::{Operator, OperatorReply};

/// Age of the newest update of a page above which its commands are refused: they may have waited in a connection that was
/// interrupted, and their operator does not see what they would change.
const LONGEST_AGE: Span = Span::from_millis(3000);

/// Sends commands to the daemon of an instance, one at a time; a stop or landing does not wait for others.
#[derive(Debug)]
pub struct BusOperator {
    address: AddressedInstance,
    /// Hash of the configuration that the daemon must run with.
    expected: Option<u64>,
    busy: Mutex<()>,
}

impl BusOperator {
    /// Operator of the instance at `paths`; `expected` is the hash of the configuration that the daemon must run with.
    pub fn new(paths: &InstancePaths, expected: Option<u64>) -> Self {
        Self { address: AddressedInstance::at(paths), expected, busy: Mutex::new(()) }
    }
}

impl Operator for BusOperator {
    fn execute(&self, command: &str, arguments: &[String], seen_at: Time) -> OperatorReply {
        let refused = |text: String| OperatorReply { is_accepted: false, text };
        let command = match CtlRequest::named(command) {
            Ok(command) => command,
            Err(reason) => return refused(reason),
        };
        if is_outdated(command, seen_at, Time::now()) {
            return refused("not executed: the page was not up to date; press again".to_owned());
        }
        let busy = (!command.ends_flight()).then(|| self.busy.try_lock());
        if let Some(Err(TryLockError::WouldBlock)) = busy {
            return refused("another command is being answered".to_owned());
        }
        let request = (command, arguments);
        // As old as what its operator saw: a stop or a landing pressed after it calls it off, even if it is received after them.
        let sign = |request| match command {
            CtlRequest::Arm => ControlRequestV1 { asked_at: seen_at, ..request },
            _ => request,
        };
        match oqtal_operator::execute(&self.address, request, self.expected, sign) {
            Ok(text) => OperatorReply { is_accepted: true, text },
            Err(failure) => refused(failure.message),
        }
    }
}

/// Whether `command`, which has an effect and is neither a stop nor a landing, must not be executed at `now`. `seen_at`: instant of the
/// newest update of its page.
fn is_outdated(command: CtlRequest, seen_at: Time, now: Time) -> bool {
    let is_exempt =
        command.ends_flight() || matches!(command, CtlRequest::Status | CtlRequest::Get);
    !is_exempt && !(Span::ZERO..=LONGEST_AGE).contains(&now.since(seen_at))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_of_a_page_without_new_updates_is_refused_except_a_stop_or_a_landing() {
        let seen_at = Time::VIRTUAL_START;
        let is_outdated =
            |command, millis| is_outdated(command, seen_at, seen_at + Span::from_millis(millis));
        for command in [CtlRequest::Arm, CtlRequest::Goto, CtlRequest::Hover, CtlRequest::Set] {
            assert!(!is_outdated(command, 3000) && is_outdated(command, 3001), "{command:?}");
            assert!(is_outdated(command, -1), "the stamp is of an earlier start of the machine");
        }
        for command in [CtlRequest::Land, CtlRequest::Stop, CtlRequest::Status, CtlRequest::Get] {
            assert!(!is_outdated(command, 60_000), "{command:?}");
        }
    }
}
