//! Check of a camera system: listens to it for some seconds and reports whether it is fit to fly with.

mod checks;
mod figures;
mod finding;
mod listener;
mod statistics;

use oqtal_bus::time::{Span, Time};
use oqtal_config::{Config, StampSource};
use oqtal_runtime::process::{Exit, Failure};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;

use crate::attempt::CameraConnection;
use crate::connect::{connect, known};
use crate::routes::CameraBody;
use listener::ProbeListener;
use oqtal_wire::link::{CameraLink, CameraProtocol};

pub use figures::ProbeFigures;
pub use finding::{FitnessVerdict, ProbeFinding};

/// Longest wait for a frame, after which the end is checked \[ns\].
const WAIT_NS: i64 = 20_000_000;

/// Listens to the camera system at `link` for `duration` and compares it with what flights with `config` need. Without bodies in
/// the link, all are listened to.
///
/// # Errors
/// There is no usable server, or it ends the connection.
pub fn probe(link: &CameraLink, config: &Config, duration: Span) -> Result<ProbeFigures, Failure> {
    let CameraConnection { mut stream, server, bodies, wanted } = connect(link)?;
    let lost = |error: std::io::Error| {
        let message = format!("{}:{}: {error}; start the probe again", link.host, link.port);
        Failure::new(Exit::System, message)
    };
    let gates = if stream.gate_per_body() { wanted.len() } else { 1 };
    let mut listener = ProbeListener::new(&config.receiver, (gates, wanted.len()));
    let end = Time::now() + duration;
    while Time::now() < end {
        wait(&*stream)?;
        stream.receive(&Time::now, &mut listener).map_err(lost)?;
        if let Some(mut definitions) = stream.take_definitions() {
            // Unreadable definitions change nothing.
            let _ = definitions.read();
            stream.apply_definitions(definitions);
        }
        stream.maintain(Time::now()).map_err(lost)?;
    }
    let present = (0..wanted.len()).map(|route| stream.has(route)).collect::<Vec<_>>();
    let mut figures = listener.figures(duration, Time::now());
    figures.server = server;
    checks::set_rates(&mut figures, config);
    figures.dates_by_arrival = config.receiver.stamps == StampSource::Arrival;
    (figures.loss_warning, figures.coast_ms) =
        (config.safety.pose_loss_warning, config.safety.coast_ms);
    figures.has_tcp = matches!(link.protocol, CameraProtocol::Qtm { udp: true, .. });
    name_bodies(&mut figures, (&wanted, &present), &bodies);
    let found = checks::findings(&figures);
    figures.findings.extend(found);
    figures.verdict = FitnessVerdict::of(&figures.findings);
    Ok(figures)
}

/// Names the bodies. One that is wanted and not there is a finding.
fn name_bodies(
    figures: &mut ProbeFigures,
    (wanted, present): (&[String], &[bool]),
    there: &[CameraBody],
) {
    for ((body, name), present) in figures.bodies.iter_mut().zip(wanted).zip(present) {
        body.name.clone_from(name);
        if !present {
            body.is_unknown = true;
            figures.findings.push(ProbeFinding::missing(name, &known(there)));
        }
    }
}

/// Waits until a socket of the stream is readable, at most [`WAIT_NS`].
fn wait(stream: &dyn crate::stream::CameraStream) -> Result<(), Failure> {
    let sockets = stream.sockets();
    let sockets = sockets.into_iter().flatten();
    let mut polled: Vec<PollFd<'_>> =
        sockets.map(|socket| PollFd::from_borrowed_fd(socket, PollFlags::IN)).collect();
    match poll(&mut polled, Some(&Timespec { tv_sec: 0, tv_nsec: WAIT_NS })) {
        Ok(_) | Err(Errno::INTR) => Ok(()),
        Err(error) => {
            Err(Failure::new(Exit::System, format!("waiting for the network failed: {error}")))
        }
    }
}
