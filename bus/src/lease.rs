//! Lease of the port to a vehicle: words in shared memory by which the process that owns the port lets one other process, the
//! tenant, write flight set-points to it. At most one of the two writes at any time.
//!
//! The owner offers the port for a window of time, and closes it before it writes itself. The tenant takes the port for one frame. A tenant
//! that hangs with the port taken is ended by the owner, who then seizes the port. The window ends with the last command that the owner has
//! received: if the owner hangs, the tenant loses the port when that command times out.
//!
//! Both processes encode frames: each continues from the encoder state that the other left in the words.

mod words;

use std::fs::File;
use std::io;
use std::os::fd::{AsFd, BorrowedFd};
use std::sync::atomic::{AtomicU32, Ordering};

use rustix::fs::{MemfdFlags, SealFlags, fcntl_add_seals, memfd_create};

use crate::shared::SharedWords;
use crate::time::{Span, Time};

pub use words::ClosedPort;

/// Number of words of an encoder's state \[-\].
const ENCODER_WORDS: usize = 8;

/// State of the encoder of a protocol: what another process needs to encode the next frame.
pub type EncoderState = [u32; ENCODER_WORDS];

const STATE: usize = 0;
/// The window in which the tenant may write \[us, wraps around\].
const NOT_BEFORE: usize = 1;
const NOT_AFTER: usize = 2;
/// Sequence of the newest command that was written, its last 32 bits.
const NEWEST: usize = 3;
/// Instant at which the tenant wrote last \[us, wraps around\].
const WRITTEN_AT: usize = 4;
/// Number of bytes that the tenant has written since the owner offered the port \[-\].
const WRITTEN: usize = 5;
const ENCODER: usize = 6;
const WORDS: usize = ENCODER + ENCODER_WORDS;

/// Lease of a port; the memory ends with the last process that holds it.
#[derive(Debug)]
pub struct PortLease(SharedWords);

/// Last writes to a port before its owner closed it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LastWritten {
    /// Sequence of the newest command, its last 32 bits \[-\].
    pub sequence: u32,
    /// Instant at which the tenant wrote last.
    pub at: Time,
    /// Number of bytes that the tenant wrote since the port was offered \[-\].
    pub bytes: usize,
    /// State of the encoder afterwards.
    pub encoder: EncoderState,
}

impl PortLease {
    /// A new lease, closed.
    ///
    /// # Errors
    /// The operating system refuses.
    pub fn create() -> io::Result<Self> {
        let flags = MemfdFlags::CLOEXEC | MemfdFlags::ALLOW_SEALING;
        let file = File::from(memfd_create("oqtal-lease", flags)?);
        let words = SharedWords::of_file(file, WORDS)?;
        fcntl_add_seals(words.file(), SealFlags::SHRINK | SealFlags::GROW | SealFlags::SEAL)?;
        Ok(Self(words))
    }

    /// The lease in a file that its owner passed on.
    ///
    /// # Errors
    /// The file has another size, or cannot be mapped.
    pub fn of_file(file: File) -> io::Result<Self> {
        SharedWords::of_mapped_file(file, WORDS).map(Self)
    }

    /// The file of the words, to be passed on.
    pub fn descriptor(&self) -> BorrowedFd<'_> {
        self.0.file().as_fd()
    }

    fn load(&self, word: usize) -> u32 {
        self.0[word].load(Ordering::Relaxed)
    }

    fn store(&self, word: usize, value: u32) {
        self.0[word].store(value, Ordering::Relaxed);
    }

    fn encoder(&self) -> EncoderState {
        std::array::from_fn(|word| self.load(ENCODER + word))
    }

    fn set_encoder(&self, encoder: &EncoderState) {
        (ENCODER..).zip(encoder).for_each(|(word, value)| self.store(word, *value));
    }

    fn state(&self) -> &AtomicU32 {
        &self.0[STATE]
    }

    /// The owner's: closes the port to the tenant; `None` while the tenant is writing.
    pub fn close(&self) -> Option<ClosedPort> {
        words::close(self.state())
    }

    /// The owner's: closes the port to a tenant that has ended.
    pub fn seize(&self) -> ClosedPort {
        words::seize(self.state())
    }

    /// The owner's: the last writes until the port was closed, by the clock at `now`.
    pub fn last_written(&self, now: Time) -> LastWritten {
        let ago_us = micros(now).wrapping_sub(self.load(WRITTEN_AT));
        let at = now - Span::from_nanos(i64::from(ago_us) * 1000);
        let bytes = self.load(WRITTEN) as usize;
        LastWritten { sequence: self.load(NEWEST), at, bytes, encoder: self.encoder() }
    }

    /// The owner's: offers the closed port from one instant to another, for commands after `newest`.
    pub fn offer(&self, [from, to]: [Time; 2], newest: u64, encoder: &EncoderState) {
        self.store(NOT_BEFORE, micros(from));
        self.store(NOT_AFTER, micros(to));
        self.store(WRITTEN, 0);
        if is_after(low(newest), self.load(NEWEST)) {
            self.store(NEWEST, low(newest));
        }
        self.set_encoder(encoder);
        words::offer(self.state());
    }

    /// Called by the tenant: takes the port for the command `sequence` and returns the state of the encoder; `None` if the port is not
    /// offered at `now`, or if this command, or a later one, was written. `now` is read while the port is taken: a tenant that was
    /// suspended before it took the port finds that the window has passed.
    pub fn take(&self, now: impl FnOnce() -> Time, sequence: u64) -> Option<EncoderState> {
        if !words::take(self.state()) {
            return None;
        }
        let now = micros(now());
        let is_open = !is_after(self.load(NOT_BEFORE), now) && is_after(self.load(NOT_AFTER), now);
        if is_open && is_after(low(sequence), self.load(NEWEST)) {
            return Some(self.encoder());
        }
        words::release(self.state(), true);
        None
    }

    /// Called by the tenant before it writes the command `sequence` in a frame of `bytes`: records it as written, so that the owner does
    /// not write it again.
    pub fn begin(&self, sequence: u64, bytes: usize, encoder: &EncoderState) {
        self.store(NEWEST, low(sequence));
        self.store(WRITTEN, self.load(WRITTEN).wrapping_add(bytes as u32));
        self.set_encoder(encoder);
    }

    /// The tenant's: gives the port back with a frame written at `now`, whole or not.
    pub fn end(&self, now: Time, is_whole: bool) {
        self.store(WRITTEN_AT, micros(now));
        words::release(self.state(), is_whole);
    }

    /// The tenant's: gives the port back; none of the `bytes` of the command `sequence` was written.
    pub fn abandon(&self, sequence: u64, bytes: usize) {
        self.store(NEWEST, low(sequence.wrapping_sub(1)));
        self.store(WRITTEN, self.load(WRITTEN).wrapping_sub(bytes as u32));
        words::release(self.state(), true);
    }
}

fn micros(time: Time) -> u32 {
    (time.nanos() / 1000) as u32
}

fn low(sequence: u64) -> u32 {
    sequence as u32
}

/// Whether `one` follows `other`, where numbers wrap around.
fn is_after(one: u32, other: u32) -> bool {
    one.wrapping_sub(other).cast_signed() > 0
}

#[cfg(test)]
mod tests {
    use super::*;

    const ENCODER_STATE: EncoderState = [7; ENCODER_WORDS];

    fn at(millis: i64) -> Time {
        Time::VIRTUAL_START + Span::from_millis(millis)
    }

    /// Both ends of a lease, offered from 10 to 60 ms after the command 5.
    fn offered() -> [PortLease; 2] {
        let owner = PortLease::create().unwrap();
        let file = File::from(owner.descriptor().try_clone_to_owned().unwrap());
        let tenant = PortLease::of_file(file).unwrap();
        assert_eq!(tenant.take(|| at(20), 6), None, "closed at first");
        owner.offer([at(10), at(60)], 5, &ENCODER_STATE);
        [owner, tenant]
    }

    #[test]
    fn a_tenant_writes_newer_commands_within_the_window() {
        let [owner, tenant] = offered();
        for (millis, sequence) in [(9, 6), (60, 6), (61, 6), (20, 5), (20, 4)] {
            assert_eq!(tenant.take(|| at(millis), sequence), None, "{millis} {sequence}");
        }
        assert_eq!(tenant.take(|| at(20), 6), Some(ENCODER_STATE));
        assert_eq!(owner.close(), None, "it is writing");
        tenant.begin(6, 17, &[8; ENCODER_WORDS]);
        tenant.end(at(21), true);
        assert_eq!(owner.close(), Some(ClosedPort::Whole));
        let expected =
            LastWritten { sequence: 6, at: at(21), bytes: 17, encoder: [8; ENCODER_WORDS] };
        assert_eq!(owner.last_written(at(30)), expected);
        assert_eq!((owner.close(), tenant.take(|| at(30), 7)), (Some(ClosedPort::Before), None));
        owner.offer([at(30), at(90)], 6, &ENCODER_STATE);
        assert!(tenant.take(|| at(31), 7).is_some());
        tenant.begin(7, 17, &ENCODER_STATE);
        tenant.abandon(7, 17);
        assert_eq!(owner.last_written(at(31)).bytes, 0);
        assert!(tenant.take(|| at(31), 7).is_some(), "nothing was written");
    }

    #[test]
    fn a_tenant_that_ends_in_a_frame_leaves_a_spoilt_port() {
        let [owner, tenant] = offered();
        tenant.take(|| at(20), 6).unwrap();
        drop(tenant);
        assert_eq!((owner.close(), owner.seize()), (None, ClosedPort::Spoilt));
        let [owner, tenant] = offered();
        tenant.take(|| at(20), 6).unwrap();
        tenant.end(at(20), false);
        assert_eq!(tenant.take(|| at(21), 7), None);
        assert_eq!(owner.close(), Some(ClosedPort::Spoilt));
        assert_eq!(owner.close(), Some(ClosedPort::Before));
    }

    #[test]
    fn a_tenant_reads_its_clock_while_the_port_is_taken() {
        let [owner, tenant] = offered();
        let now = || {
            assert_eq!(owner.close(), None, "it is the tenant's");
            at(20)
        };
        assert!(tenant.take(now, 6).is_some());
    }
}
