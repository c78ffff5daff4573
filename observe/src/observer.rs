//! The front door's ears on the bus: everything goes to the recorder, nothing comes back.

use oqtal_bus::error::BusError;
use oqtal_bus::message::{PoseV1, TelemetryV1, TruthV1, VehicleV1};
use oqtal_bus::topic::{POSE, TELEMETRY, TRUTH, VEHICLE};
use oqtal_bus::transport::{Subscribe, Transport};

use crate::recorder::Recorder;

/// Listens to all topics that a flight is judged by.
#[derive(Debug)]
pub struct Observer<T: Transport> {
    truths: T::Reader<TruthV1>,
    poses: T::Reader<PoseV1>,
    vehicles: T::Reader<VehicleV1>,
    telemetry: T::Reader<TelemetryV1>,
    daemon: Option<u64>,
}

impl<T: Transport> Observer<T> {
    /// Opens the ears.
    ///
    /// # Errors
    /// The bus refuses.
    pub fn new(bus: &T) -> Result<Self, BusError> {
        Ok(Self {
            truths: bus.observer(&TRUTH)?,
            poses: bus.observer(&POSE)?,
            vehicles: bus.observer(&VEHICLE)?,
            telemetry: bus.observer(&TELEMETRY)?,
            daemon: None,
        })
    }

    /// Passes on all that was said since the last call; `true` if the daemon said something.
    ///
    /// # Errors
    /// A topic speaks another version.
    pub fn listen(&mut self, recorder: &mut Recorder) -> Result<bool, BusError> {
        let mut heard = false;
        while let Some((header, telemetry)) = self.telemetry.receive()? {
            self.daemon = Some(u64::from(header.origin().process()));
            recorder.telemetry(&telemetry);
            heard = true;
        }
        while let Some((_, truth)) = self.truths.receive()? {
            recorder.truth(&truth);
        }
        while let Some((header, pose)) = self.poses.receive()? {
            recorder.pose(&header, &pose);
        }
        while let Some((header, vehicle)) = self.vehicles.receive()? {
            recorder.vehicle(&header, &vehicle);
        }
        Ok(heard)
    }

    /// Process id of the daemon, once it was heard.
    #[must_use]
    pub fn daemon(&self) -> Option<u64> {
        self.daemon
    }

    /// Samples that nobody heard because this process was late.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.truths.lost() + self.poses.lost() + self.vehicles.lost() + self.telemetry.lost()
    }
}
