//! Stands in for the vehicle: takes each command as the plant does, applies it at once, and says so.

use oqtal_bus::code::Actuation;
use oqtal_bus::message::{Stamps, VehicleV1};
use oqtal_bus::topic::{COMMAND, VEHICLE};
use oqtal_bus::transport::{Publish, Subscribe, Transport};
use oqtal_runtime::process::{Failure, ProcessContext};

/// Takes commands until asked to stop.
///
/// # Errors
/// The bus refuses or breaks.
pub fn run(context: &ProcessContext) -> Result<(), Failure> {
    let bus = context.bus()?;
    let mut commands = bus.reader(&COMMAND)?;
    let mut vehicles = bus.writer(&VEHICLE)?;
    let mut pace = context.loop_clock(&bus, &COMMAND)?;
    context.enter_realtime();
    while pace.wait(None)?.is_some() {
        let Some((header, command)) = commands.latest()? else { continue };
        let received_at = pace.now();
        let stamps = Stamps { received_at, applied_at: pace.now(), ..header.stamps };
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
