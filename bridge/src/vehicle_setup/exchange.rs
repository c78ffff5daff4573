//! Parts of every set-up: the state of a parameter, the table, the port.

use std::time::Duration;

use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;
use oqtal_runtime::process::{Exit, Failure};
use oqtal_wire::link::LinkSpec;

use crate::link::VehicleLink;
use crate::setup::port;
use crate::wanted::WantedParameter;

/// Time within which an answer must arrive, and number of requests.
pub(super) const ANSWER_WITHIN: Span = Span::from_millis(500);
pub(super) const TRIES: usize = 5;
const PAUSE: Duration = Duration::from_millis(2);
pub(super) const READ_BUFFER: usize = 2048;

/// State of one parameter.
#[derive(Clone, Copy, Debug)]
pub(super) struct ParameterReport {
    /// The parameter.
    pub(super) wanted: WantedParameter,
    /// Value found in the vehicle \[-\]; `None` if the vehicle has no parameter of this name.
    pub(super) found: Option<f64>,
    /// Value read back after the parameter was set \[-\]; `None` if it was not set.
    pub(super) set: Option<f64>,
}

impl ParameterReport {
    /// Whether the parameter is correct.
    pub(super) fn is_right(&self) -> bool {
        self.set.or(self.found).is_some_and(|value| self.wanted.value.is_met_by(value))
    }

    /// Line of the table.
    pub(super) fn line(&self) -> String {
        let Self { wanted, found, set } = self;
        // Single precision on the wire.
        let is = found.map_or("none".to_owned(), |value| format!("{}", value as f32));
        let should = wanted.value.in_place_of(found.unwrap_or_default());
        let mark = match (self.is_right(), set) {
            (true, Some(_)) => "set",
            (true, None) => "",
            (false, Some(_)) => "NOT TAKEN",
            (false, None) => "wrong",
        };
        row([wanted.name, &is, &should.to_string(), mark, wanted.reason])
    }
}

/// Table of these lines for the vehicle `title`.
pub(super) fn table(title: &str, lines: impl IntoIterator<Item = String>) -> String {
    let head = row(["parameter", "is", "should be", "", "why"]);
    std::iter::once(head).chain(lines).fold(format!("{title}\n"), |text, line| text + &line + "\n")
}

/// Row of a table: name, value, allowed value, mark and reason.
pub(super) fn row([name, is, should, mark, reason]: [&str; 5]) -> String {
    format!("{name:<20} {is:>9} {should:>9}  {mark:<9}  {reason}")
}

/// Refuses changes of a vehicle whose motors run.
pub(super) fn refuse_in_flight(is_armed: bool) -> Result<(), Failure> {
    if is_armed {
        let message = "the motors of the vehicle run: its parameters are not changed in flight; stop them first";
        return Err(Failure::new(Exit::Peer, message));
    }
    Ok(())
}

/// Port of an exchange of parameters.
pub(super) struct SetupPort(Box<dyn VehicleLink>);

impl SetupPort {
    pub(super) fn open(config: &Config, spec: &LinkSpec) -> Result<Self, Failure> {
        Ok(Self(port(spec, config).open()?))
    }

    /// Reads what has arrived; waits a little if nothing has.
    pub(super) fn read<'a>(
        &mut self,
        buffer: &'a mut [u8; READ_BUFFER],
    ) -> Result<&'a [u8], Failure> {
        let count = self.0.read(buffer).map_err(|error| broken(&error))?;
        if count == 0 {
            std::thread::sleep(PAUSE);
        }
        Ok(&buffer[..count])
    }

    pub(super) fn write(&mut self, bytes: &[u8]) -> Result<(), Failure> {
        let (mut rest, deadline) = (bytes, Time::now() + ANSWER_WITHIN);
        while !rest.is_empty() && Time::now() < deadline {
            let taken = self.0.write(rest).map_err(|error| broken(&error))?;
            rest = &rest[taken..];
            if taken == 0 {
                std::thread::sleep(PAUSE);
            }
        }
        Ok(())
    }
}

fn broken(error: &std::io::Error) -> Failure {
    Failure::new(Exit::System, format!("the port broke: {error}"))
}
