//! Arming: waits until a simulated vehicle is at rest, and until the flight has begun.

use std::time::Duration;

use oqtal_bus::bus::Bus;
use oqtal_bus::code::{Answer, Mode, OperatorCommand};
use oqtal_bus::error::BusError;
use oqtal_bus::message::{AS_STARTED, ControlRequestV1, ControlResponseV1, VehicleV1};
use oqtal_bus::obstacle::ArmingObstacles;
use oqtal_bus::text::LongText;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::VEHICLE;
use oqtal_bus::transport::{Subscribe, Transport};

use crate::report::put_back;
use crate::request::{request, send, send_signed};

/// Maximum time for the vehicle to come to rest: a fall from the height of a room, and half a second without motion.
const REST_TIMEOUT: Span = Span::from_millis(5000);
/// Time within which a running vehicle process publishes its state.
const VEHICLE_TIMEOUT: Span = Span::from_millis(400);
/// Maximum time until an accepted flight has begun: a few ticks.
const BEGIN_TIMEOUT: Span = Span::from_millis(900);
/// Time between two requests.
const PERIOD: Duration = Duration::from_millis(50);

/// Arms by the request `arming`, and returns the daemon's last answer; `None` if there is none. `expected`: hash of the configuration
/// that the daemon must run with, without settings changed since its start. `tell` receives the reason of a wait, and a remedy for a
/// simulated vehicle; once `is_cancelled`, a flight that has not begun is called off.
///
/// # Errors
/// The bus refuses.
pub fn ask(
    bus: &Bus,
    arming: ControlRequestV1,
    expected: Option<u64>,
    tell: &mut dyn FnMut(&str),
    is_cancelled: &dyn Fn() -> bool,
) -> Result<Option<ControlResponseV1>, BusError> {
    let text = LongText::new(expected.map_or("", |_| AS_STARTED));
    let arming = ControlRequestV1 { text, ..arming };
    let mut vehicles = bus.observer::<VehicleV1>(&VEHICLE)?;
    let asked_at = Time::now();
    let (mut simulated, mut is_reported, mut refusal) = (None, false, None);
    loop {
        if let Some((_, vehicle)) = vehicles.latest()? {
            simulated = Some(vehicle.simulated == 1);
        }
        if refusal.is_some() && (simulated == Some(false) || is_cancelled()) {
            return Ok(refusal);
        }
        let timeout = match simulated {
            Some(true) => REST_TIMEOUT,
            // A real vehicle in motion may be in a person's hands.
            Some(false) => Span::ZERO,
            None => VEHICLE_TIMEOUT,
        };
        let is_last = Time::now().since(asked_at) >= timeout;
        let arming = ControlRequestV1 { repeated: u8::from(!is_last), ..arming };
        let Some(response) = send(bus, arming, expected)? else { return Ok(None) };
        if response.answer != Answer::Refused.code() {
            return begun(bus, response, is_cancelled);
        }
        if is_last || !response.comes_to_rest() {
            let remedy = put_back(ArmingObstacles::from_bits(response.obstacles));
            remedy.filter(|_| simulated == Some(true)).into_iter().for_each(&mut *tell);
            return Ok(Some(response));
        }
        if simulated == Some(true) && !is_reported {
            tell("arm: waits until the vehicle is at rest; Ctrl-C cancels");
            is_reported = true;
        }
        refusal = Some(response);
        std::thread::sleep(PERIOD);
    }
}

/// Arms by the request `arming` and its author, without a wait for a vehicle in motion; returns the daemon's last answer, `None` if there
/// is none. `expected`: as in [`ask`].
///
/// # Errors
/// The bus refuses.
pub(crate) fn ask_once(
    bus: &Bus,
    arming: ControlRequestV1,
    expected: Option<u64>,
) -> Result<Option<ControlResponseV1>, BusError> {
    match send_signed(bus, arming, expected)? {
        Some(accepted) if accepted.answer != Answer::Refused.code() => {
            begun(bus, accepted, &|| false)
        }
        refused => Ok(refused),
    }
}

/// Answer of the daemon once the flight announced by `accepted` has begun; a refusal if it was cancelled or has not begun in time, and
/// `None` if the daemon no longer answers.
fn begun(
    bus: &Bus,
    accepted: ControlResponseV1,
    is_cancelled: &dyn Fn() -> bool,
) -> Result<Option<ControlResponseV1>, BusError> {
    let give_up = Time::now() + BEGIN_TIMEOUT;
    let mut newest = accepted;
    while !is_in_flight(&newest) && !is_called_off(&newest) {
        if Time::now() >= give_up || is_cancelled() {
            // The flight must not begin after the operator was told that it did not.
            let Some(answer) = request(bus, OperatorCommand::Disarm, None)? else {
                return Ok(None);
            };
            newest = answer;
            break;
        }
        std::thread::sleep(Duration::from_millis(10));
        newest = request(bus, OperatorCommand::Status, None)?.unwrap_or(newest);
    }
    let is_begun = is_in_flight(&newest);
    let answer = if is_begun { newest.answer } else { Answer::Refused.code() };
    Ok(Some(ControlResponseV1 { answer, text: accepted.text, ..newest }))
}

fn is_in_flight(response: &ControlResponseV1) -> bool {
    Mode::from_code(response.mode).is_some_and(Mode::is_armed)
}

/// Whether the loop itself reports that it does not fly. An answer given in place of the loop repeats the last known mode.
fn is_called_off(response: &ControlResponseV1) -> bool {
    response.answer == Answer::Done.code() && response.mode == Mode::Disarmed.code()
}
