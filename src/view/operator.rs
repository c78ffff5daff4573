//! Commands from the page to the daemon, sent as by `oqtal ctl`.

use std::sync::{Mutex, TryLockError};

use oqtal_bus::paths::InstancePaths;
use oqtal_operator::{AddressedInstance, CtlRequest};
use oqtal_view::site::{Operator, OperatorReply};

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
    fn execute(&self, command: &str, arguments: &[String]) -> OperatorReply {
        let refused = |text: String| OperatorReply { is_accepted: false, text };
        let command = match CtlRequest::named(command) {
            Ok(command) => command,
            Err(reason) => return refused(reason),
        };
        let busy = (!command.ends_flight()).then(|| self.busy.try_lock());
        if let Some(Err(TryLockError::WouldBlock)) = busy {
            return refused("another command is being answered".to_owned());
        }
        let request = (command, arguments);
        match oqtal_operator::execute(&self.address, request, self.expected, |request| request) {
            Ok(text) => OperatorReply { is_accepted: true, text },
            Err(failure) => refused(failure.message),
        }
    }
}
