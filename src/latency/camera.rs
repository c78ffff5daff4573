//! Stand-in for the cameras: publishes poses of a hovering vehicle, regularly or with jitter, and in between sends a message by
//! each bare mechanism.

use oqtal_bus::message::{PoseV1, Stamps};
use oqtal_bus::port::Writer;
use oqtal_bus::time::{Grid, Span, Time};
use oqtal_bus::topic::POSE;
use oqtal_bus::transport::{Publish, Transport};
use oqtal_runtime::process::{Exit, Failure, ProcessContext};

use super::bare::{Mechanism, Parcel, ParcelSender, directory, failed, open_sender};
use super::condition::delay_ms;
use super::record::Record;
use super::sleep::sleep_until;

/// File of the recorded wake-up lateness.
pub const RECORD: &str = "sleep.record";

/// Publishes a pose at the beginning of every period, then sends by the bare mechanisms at even intervals, in rotating order.
///
/// # Errors
/// The bus or a mechanism fails.
pub fn run(context: &ProcessContext) -> Result<(), Failure> {
    let bus = context.bus()?;
    let mut poses = bus.writer(&POSE)?;
    let mut senders = Mechanism::ALL
        .iter()
        .map(|&mechanism| Ok((mechanism, open_sender(mechanism, context)?)))
        .collect::<Result<Vec<_>, Failure>>()?;
    let mut lateness = Record::with_room();
    context.enter_realtime();
    let jitter_ms = context.config.mocap.jitter_ms;
    let turns = senders.len() as u64 + 1;
    let mut grid = Grid::new(
        Time::now() + Span::from_millis(50),
        context.config.control.rate_hz * turns as f64,
    );
    while !context.stop.is_set() {
        let (on_grid, round, turn) = (grid.next(), grid.index() / turns, grid.index() % turns);
        let delay_ms = if turn == 0 { delay_ms(round, jitter_ms) } else { 0.0 };
        let at = on_grid + Span::from_seconds(delay_ms * 1e-3);
        grid.advance();
        sleep_until(at).map_err(|e| Failure::new(Exit::System, format!("sleeping failed: {e}")))?;
        lateness.add(at, Time::now());
        if turn == 0 {
            publish(&mut poses, round, at)?;
        } else {
            let next = ((turn - 1 + round) % senders.len() as u64) as usize;
            send(&mut senders[next], &Parcel::now())?;
        }
    }
    finish(context, &mut senders, &lateness)
}

/// Publishes a hover pose like the cameras' process: stamped, sent, announced.
fn publish(poses: &mut Writer<PoseV1>, round: u64, captured_at: Time) -> Result<(), Failure> {
    // A constant pose would be rejected as frozen.
    let noise = if round.is_multiple_of(2) { 1e-4 } else { -1e-4 };
    let pose = PoseV1 {
        position: [noise, -noise, 1.0 + noise],
        attitude: [noise, -noise, noise, 1.0],
        tracked: 1,
        ..PoseV1::default()
    };
    let stamps = Stamps { captured_at, pose_published_at: Time::now(), ..Stamps::default() };
    poses.send(round + 1, stamps, pose)?;
    Ok(poses.notify()?)
}

fn send(
    (mechanism, sender): &mut (Mechanism, ParcelSender),
    parcel: &Parcel,
) -> Result<(), Failure> {
    sender(parcel).map_err(|error| failed(*mechanism, "sending", &error))
}

fn finish(
    context: &ProcessContext,
    senders: &mut [(Mechanism, ParcelSender)],
    lateness: &Record,
) -> Result<(), Failure> {
    for sender in senders {
        send(sender, &Parcel::LAST)?;
    }
    lateness.save(&directory(&context.config.instance.name).join(RECORD))
}
