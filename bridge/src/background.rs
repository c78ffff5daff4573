//! What must not happen on the loop's thread: logs, and opening and closing ports. Fed through bounded queues that drop and
//! count rather than block.

use std::time::Duration;

use crossbeam_channel::{Receiver, Sender, TrySendError, bounded};
use oqtal_bus::time::{Span, Time};
use oqtal_runtime::stop::StopFlag;

use crate::link::Link;
use crate::motors::Change;

const QUEUE: usize = 64;
/// How often there is looked for something to do.
const POLL: Duration = Duration::from_millis(5);
/// A lost port is looked for again after so long at first,
const SHORTEST_PAUSE: Span = Span::from_millis(100);
/// and after so long at last.
const LONGEST_PAUSE: Span = Span::from_millis(2000);

/// What is worth a line in the log.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Note {
    /// The vehicle answers.
    Answers,
    /// It does not any more; so many frames came damaged so far.
    Silent {
        /// Damaged frames.
        damaged: u64,
    },
    /// The motors, or what was tried with them.
    Motors(Change),
    /// A command was too old, or from the future.
    RefusedOld,
    /// The port did not pass on what it was given; that was dropped.
    Stuck,
}

/// The loop's end.
#[derive(Debug)]
pub struct RtHandle {
    notes: Sender<Note>,
    lost: Sender<Box<dyn Link>>,
    opened: Receiver<Box<dyn Link>>,
    unlogged: u64,
}

/// The background thread's end.
#[derive(Debug)]
pub struct BackgroundWorker {
    notes: Receiver<Note>,
    lost: Receiver<Box<dyn Link>>,
    opened: Sender<Box<dyn Link>>,
}

/// Both ends.
#[must_use]
pub fn rt_handle() -> (RtHandle, BackgroundWorker) {
    let (note_in, note_out) = bounded(QUEUE);
    let (lost_in, lost_out) = bounded(1);
    let (opened_in, opened_out) = bounded(1);
    (
        RtHandle { notes: note_in, lost: lost_in, opened: opened_out, unlogged: 0 },
        BackgroundWorker { notes: note_out, lost: lost_out, opened: opened_in },
    )
}

impl RtHandle {
    /// Has something logged, or counts what found the queue full.
    pub fn note(&mut self, note: Note) {
        if let Err(TrySendError::Full(_)) = self.notes.try_send(note) {
            self.unlogged += 1;
        }
    }

    /// Notes that were not logged, in total.
    #[must_use]
    pub fn unlogged(&self) -> u64 {
        self.unlogged
    }

    /// Hands over a link that is lost, to be closed, and opened anew.
    pub fn lost(&self, link: Box<dyn Link>) {
        // There is one link, so there is room for it.
        let _ = self.lost.try_send(link);
    }

    /// The link opened in place of a lost one, once there is one.
    #[must_use]
    pub fn opened(&self) -> Option<Box<dyn Link>> {
        self.opened.try_recv().ok()
    }
}

impl BackgroundWorker {
    /// Keeps house until asked to stop. Lost links are replaced by what `open` opens.
    pub fn run<L: Link + 'static, E: std::fmt::Display>(
        &self,
        stop: &StopFlag,
        mut open: impl FnMut() -> Result<L, E>,
    ) {
        let mut search: Option<Search> = None;
        while !stop.is_set() {
            self.notes.try_iter().for_each(log);
            if let Ok(link) = self.lost.try_recv() {
                tracing::warn!("the port is lost: neutral first when it is back");
                drop(link);
                search = Some(Search::new(Time::now()));
            }
            let found = search.as_mut().and_then(|search| search.look(Time::now(), &mut open));
            if let Some(link) = found {
                tracing::info!("the port is open again");
                search = None;
                let _ = self.opened.try_send(Box::new(link));
            }
            std::thread::sleep(POLL);
        }
        self.notes.try_iter().for_each(log);
    }
}

/// The search for a lost port.
#[derive(Clone, Debug)]
struct Search {
    next: Time,
    pause: Span,
    last_reason: String,
}

impl Search {
    fn new(now: Time) -> Self {
        Self { next: now + SHORTEST_PAUSE, pause: SHORTEST_PAUSE, last_reason: String::new() }
    }

    /// Looks for the port if it is time to; a reason for its absence is said once.
    fn look<L, E: std::fmt::Display>(
        &mut self,
        now: Time,
        open: &mut impl FnMut() -> Result<L, E>,
    ) -> Option<L> {
        if now < self.next {
            return None;
        }
        match open() {
            Ok(link) => Some(link),
            Err(error) => {
                let reason = error.to_string();
                if reason != self.last_reason {
                    tracing::warn!("{reason}");
                    self.last_reason = reason;
                }
                self.pause = self.pause.scaled(2.0).min(LONGEST_PAUSE);
                self.next = now + self.pause;
                None
            }
        }
    }
}

fn log(note: Note) {
    match note {
        Note::Answers => tracing::info!("the vehicle answers"),
        Note::Silent { damaged } => tracing::warn!(
            damaged,
            "the vehicle is silent: is it switched on, is the serial interface released on its remote control?"
        ),
        Note::Motors(change) => log_motors(change),
        Note::RefusedOld => {
            tracing::warn!(
                "a command was older than allowed and is not sent; nor are others like it"
            );
        }
        Note::Stuck => tracing::warn!(
            "the port holds back what it is given, and that was dropped: is flow control as the radio wants it?"
        ),
    }
}

fn log_motors(change: Change) {
    match change {
        Change::Starts => tracing::info!("motors are being started"),
        Change::Runs => tracing::info!("motors run"),
        Change::Stops => tracing::info!("motors are being stopped"),
        Change::Stands => tracing::info!("motors stand"),
        Change::StartFailed => tracing::warn!(
            "motors did not start: neutral until disarmed; look at bridge.asctec.motor-yaw-counts and the remote control"
        ),
        Change::StopFailed => {
            tracing::warn!("motors did not stop: neutral; stop them by the remote control");
        }
        Change::Stalled => tracing::warn!("motors stopped in flight: neutral until disarmed"),
        Change::Abandoned => {
            tracing::warn!(
                "the daemon fell silent in flight: neutral until it is there and disarmed"
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lost_port_is_looked_for_ever_more_seldom_and_at_least_every_two_seconds() {
        let mut now = Time::VIRTUAL_START;
        let mut search = Search::new(now);
        let mut pauses = Vec::new();
        for _ in 0..7 {
            pauses.push(search.next.since(now).nanos() / 1_000_000);
            now = search.next;
            assert!(search.look(now, &mut || Err::<(), _>("none")).is_none());
        }
        assert_eq!(pauses, [100, 200, 400, 800, 1600, 2000, 2000]);
        assert!(search.look(search.next, &mut || Ok::<_, String>(())).is_some());
    }

    #[test]
    fn a_full_desk_counts_what_it_cannot_log() {
        let (mut rt_handle, _housekeeping) = rt_handle();
        for _ in 0..QUEUE + 3 {
            rt_handle.note(Note::Answers);
        }
        assert_eq!(rt_handle.unlogged(), 3);
    }
}
