//! Commands from the page to the daemon, as `oqtal ctl` sends them.

use std::sync::{Mutex, TryLockError};

use oqtal_bus::code::OperatorCommand;
use oqtal_bus::paths::InstancePaths;
use oqtal_config::Config;
use oqtal_view::site::{Operator, OperatorReply};

use crate::ctl;

/// Sends commands to the daemon of an instance, one at a time; a stop waits for no other command.
#[derive(Debug)]
pub struct BusOperator {
    paths: InstancePaths,
    config: Config,
    /// Whether the daemon must run with `config`.
    expects_config: bool,
    busy: Mutex<()>,
}

impl BusOperator {
    /// An operator of the instance at `paths`.
    pub fn new(paths: InstancePaths, config: Config, expects_config: bool) -> Self {
        Self { paths, config, expects_config, busy: Mutex::new(()) }
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
        let request = (command, self.expects_config);
        match ctl::execute(&self.paths, &self.config, request) {
            Ok(text) => OperatorReply { is_accepted: true, text },
            Err(failure) => OperatorReply { is_accepted: false, text: failure.message },
        }
    }
}
