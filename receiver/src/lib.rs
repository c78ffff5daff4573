//! The receiver process: poses of a real camera system, in place of the emulated one.
#![forbid(unsafe_code)]

mod attempt;
mod background;
pub mod clock;
mod command;
mod connect;
mod definitions;
mod discover;
pub mod gate;
pub mod link;
mod natnet;
mod note;
mod probe;
mod process;
mod qtm;
mod receiver;
mod routes;
mod socket;
mod stream;
mod transform;
mod turn;
mod vrpn;
mod watch;

pub use attempt::{CameraConnection, ConnectError};
pub use command::ReceiverCommand;
pub use connect::{connect, connect_to_all};
pub use definitions::BodyDefinitions;
pub use discover::{FoundServer, discover};
pub use probe::{
    BodyFigures, ClockFigures, FitnessVerdict, IntervalFigures, NoiseFigures, ProbeFigures,
    ProbeFinding, Severity, probe,
};
pub use process::{check, link as configured_link, run};
pub use receiver::PoseReceiver;
pub use routes::CameraBody;
pub use stream::{CameraStream, FrameSink, MeasuredBody};
pub use transform::PoseTransform;
