//! Commands from the page to the daemon, sent as by `oqtal ctl`.

use std::sync::{Mutex, TryLockError};

use oqtal_bus::code::OperatorCommand;
use oqtal_bus::paths::InstancePaths;
use oqtal_operator::AddressedInstance;
use oqtal_view::site::{Operator, OperatorReply};

/// Sends commands to the daemon of an instance, one at a time; a stop does not wait for other commands.
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
    fn execute(&self, command: OperatorCommand) -> OperatorReply {
        let busy = match command {
            OperatorCommand::Stop => None,
            _ => Some(self.busy.try_lock()),
        };
        if let Some(Err(TryLockError::WouldBlock)) = busy {
            let text = "another command is being answered".to_owned();
            return OperatorReply { is_accepted: false, text };
        }
        match oqtal_operator::execute(&self.address, (command, self.expected)) {
            Ok(text) => OperatorReply { is_accepted: true, text },
            Err(failure) => OperatorReply { is_accepted: false, text: failure.message },
        }
    }
}
