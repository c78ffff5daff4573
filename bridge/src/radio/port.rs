//! One vehicle's port through a Crazyradio: queues between the real-time thread and the thread that waits for USB.

use std::io::{self, ErrorKind};
use std::thread::{Builder, JoinHandle};
use std::time::Duration;

use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, TryRecvError, TrySendError, bounded};
use oqtal_bus::time::{Span, Time};
use oqtal_wire::crtp::CrtpPacket;
use oqtal_wire::link::RadioSpec;

use super::dongle::RadioDongle;
use super::schedule::MAX_AGE;
use super::usb::{UsbDongle, unknown};
use super::worker::RadioWorker;
use crate::link::{PortOpenError, PortOptions, VehicleLink};

/// Most packets between the threads, each way \[-\].
const MAX_QUEUED: usize = 32;

/// Vehicle behind the first Crazyradio.
#[derive(Clone, Debug)]
pub struct RadioPortOptions {
    /// Radio of the vehicle.
    pub vehicle: RadioSpec,
    /// Greatest rate of packets other than set-points to the vehicle \[1/s\].
    pub packets_per_s: f64,
}

/// Open port: the thread ends when it is dropped.
#[derive(Debug)]
pub struct RadioLink {
    up: Option<Sender<(Time, CrtpPacket)>>,
    down: Receiver<CrtpPacket>,
    thread: Option<JoinHandle<()>>,
}

impl PortOptions for RadioPortOptions {
    fn open(&self) -> Result<Box<dyn VehicleLink>, PortOpenError> {
        let dongle = UsbDongle::open()?;
        let worker = RadioWorker::new(dongle, vec![self.vehicle], self.packets_per_s);
        let link = RadioLink::start(worker).map_err(|error| unknown(error.to_string()))?;
        Ok(Box::new(link))
    }
}

impl RadioLink {
    /// Starts the thread of `worker`, which has one vehicle.
    fn start<D: RadioDongle + Send + 'static>(worker: RadioWorker<D>) -> io::Result<Self> {
        let (up, from_bridge) = bounded(MAX_QUEUED);
        let (to_bridge, down) = bounded(MAX_QUEUED);
        let run = move || {
            if let Err(error) = work(worker, &from_bridge, &to_bridge) {
                tracing::warn!("the Crazyradio is lost: {error}");
            }
        };
        let thread = Builder::new().name("radio".to_owned()).spawn(run)?;
        Ok(Self { up: Some(up), down, thread: Some(thread) })
    }
}

/// Exchanges packets until the bridge drops its end, and then its last ones.
fn work<D: RadioDongle>(
    mut worker: RadioWorker<D>,
    up: &Receiver<(Time, CrtpPacket)>,
    down: &Sender<CrtpPacket>,
) -> io::Result<()> {
    loop {
        let now = Time::now();
        let left = worker.next_event().map_or(Span::from_millis(10), |at| at.since(now));
        let wait = if left > Span::ZERO { left.to_duration() } else { Duration::ZERO };
        match up.recv_timeout(wait) {
            Ok((at, packet)) => worker.push(at, 0, packet),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return finish(&mut worker, &mut Time::now),
        }
        for (at, packet) in up.try_iter().take(MAX_QUEUED) {
            worker.push(at, 0, packet);
        }
        if let Some((_, Some(reply))) = worker.exchange(&mut Time::now)? {
            // A reply that the bridge does not read in time is lost, as on the air.
            let _ = down.try_send(reply);
        }
        worker.give_account(Time::now());
    }
}

/// Exchanges the last packets of a bridge that has ended, for at most [`MAX_AGE`]: a zero set-point until it is acknowledged.
fn finish<D: RadioDongle>(
    worker: &mut RadioWorker<D>,
    clock: &mut dyn FnMut() -> Time,
) -> io::Result<()> {
    let give_up = clock() + MAX_AGE;
    while !worker.is_finished() && clock() < give_up {
        if worker.exchange(clock)?.is_none() {
            std::thread::sleep(Duration::from_millis(1));
        }
    }
    Ok(())
}

impl VehicleLink for RadioLink {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self.down.try_recv() {
            Ok(packet) => {
                let bytes = packet.as_bytes();
                let place = buffer.get_mut(..bytes.len()).ok_or(ErrorKind::InvalidInput)?;
                place.copy_from_slice(bytes);
                Ok(bytes.len())
            }
            Err(TryRecvError::Empty) => Ok(0),
            Err(TryRecvError::Disconnected) => Err(ErrorKind::BrokenPipe.into()),
        }
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let Some(up) = &self.up else { return Err(ErrorKind::BrokenPipe.into()) };
        let Ok(packet) = CrtpPacket::parse(bytes) else { return Ok(bytes.len()) };
        match up.try_send((Time::now(), packet)) {
            Ok(()) => Ok(bytes.len()),
            Err(TrySendError::Full(_)) => Ok(0),
            Err(TrySendError::Disconnected(_)) => Err(ErrorKind::BrokenPipe.into()),
        }
    }

    fn queued(&self) -> io::Result<usize> {
        Ok(0)
    }

    fn discard(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Drop for RadioLink {
    fn drop(&mut self) {
        self.up = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radio::RadioAck;
    use oqtal_wire::crtp::{CrtpRequest, LegacySetpoint};

    /// Radio whose first packets are not acknowledged.
    #[derive(Debug)]
    struct LossyDongle {
        missed: usize,
        sent: Vec<CrtpPacket>,
    }

    impl RadioDongle for &mut LossyDongle {
        fn exchange(&mut self, _: &RadioSpec, packet: &CrtpPacket) -> io::Result<RadioAck> {
            self.sent.push(*packet);
            let is_acknowledged = self.sent.len() > self.missed;
            Ok(RadioAck { is_acknowledged, repeated: 0, reply: None })
        }

        fn broadcast(&mut self, _: &RadioSpec, _: &CrtpPacket) -> io::Result<()> {
            Ok(())
        }
    }

    /// Number of times that `packet` was sent after a bridge has ended, to a vehicle that misses this number of packets.
    fn sent_at_the_end(packet: &CrtpPacket, missed: usize) -> usize {
        let mut dongle = LossyDongle { missed, sent: Vec::new() };
        let mut now = Time::VIRTUAL_START;
        let mut clock = || {
            now = now + Span::from_millis(1);
            now
        };
        let vehicle = "80/2M/E7E7E7E701".parse().unwrap();
        let mut worker = RadioWorker::new(&mut dongle, vec![vehicle], 250.0);
        let last = CrtpRequest::EndOfSetpoints(0).packet();
        [*packet, last].into_iter().for_each(|packet| worker.push(clock(), 0, packet));
        // The first attempt is made before the bridge has ended.
        worker.exchange(&mut clock).unwrap();
        finish(&mut worker, &mut clock).unwrap();
        let count = |wanted| dongle.sent.iter().filter(|sent| **sent == wanted).count();
        assert!(count(last) > 0, "the end of the set-points");
        count(*packet)
    }

    #[test]
    fn f33_the_last_frames_of_a_bridge_are_sent_until_they_are_acknowledged() {
        let setpoint =
            |thrust| CrtpRequest::Setpoint(LegacySetpoint { thrust, ..LegacySetpoint::ZERO });
        assert_eq!(sent_at_the_end(&setpoint(0).packet(), 0), 1);
        assert_eq!(sent_at_the_end(&setpoint(0).packet(), 3), 4);
        assert_eq!(sent_at_the_end(&setpoint(9000).packet(), 3), 1, "flight is not repeated");
    }
}
