//! Stand-in for the vehicle: receives each command like the plant, applies it at once, and reports it.

use oqtal_bus::code::Actuation;
use oqtal_bus::message::{Stamps, VehicleV1};
use oqtal_bus::topic::{COMMAND, VEHICLE};
use oqtal_bus::transport::{Publish, Subscribe, Transport};
use oqtal_runtime::process::{Failure, ProcessContext};

/// Receives commands. Returns when a stop is requested.
///
/// # Errors
/// The bus fails.
pub fn run(context: &ProcessContext) -> Result<(), Failure> {
    let bus = context.bus()?;
    let mut commands = bus.reader(&COMMAND)?;
    let mut vehicles = bus.writer(&VEHICLE)?;
    let mut clock = context.loop_clock(&bus, &COMMAND)?;
    context.enter_realtime();
    while clock.wait(None)?.is_some() {
        let Some((header, command)) = commands.latest()? else { continue };
        let received_at = clock.now();
        let stamps = Stamps { received_at, applied_at: clock.now(), ..header.stamps };
        let vehicle = VehicleV1 {
            command_sequence: header.sequence,
            lost: commands.lost(),
            battery_v: f64::NAN,
            link_quality: f64::NAN,
            estimate_position: [f64::NAN; 3],
            armed: u8::from(command.actuation != Actuation::Disarmed.code()),
            link: 1,
            ..VehicleV1::default()
        };
        vehicles.send(header.pose_sequence, stamps, vehicle)?;
    }
    Ok(())
}
