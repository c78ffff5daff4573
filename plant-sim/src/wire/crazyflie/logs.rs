//! Log blocks of a host, with their schedules.

use oqtal_bus::time::{Span, Time};
use oqtal_wire::crtp::{CrtpPacket, CrtpReply, LogBlock, LogCommand};

use super::tables::Logged;
use crate::wire::schedule::MessageSchedule;

/// Most log blocks \[-\].
const MAX_BLOCKS: usize = 16;
/// Error codes of C for refusals \[-\]: no such block, no room for another, the block exists.
const NO_SUCH_BLOCK: u8 = 2;
const NO_ROOM: u8 = 12;
const EXISTS: u8 = 17;

/// Log block with its schedule if it is started.
#[derive(Clone, Copy, Debug)]
struct RunningBlock {
    block: LogBlock,
    schedule: Option<MessageSchedule>,
}

/// The log blocks of one host.
#[derive(Clone, Debug, Default)]
pub(super) struct LogBlocks {
    blocks: Vec<RunningBlock>,
}

impl LogBlocks {
    /// Deletes all blocks.
    pub(super) fn reset(&mut self) -> CrtpReply<'static> {
        self.blocks.clear();
        CrtpReply::Log(LogCommand::Reset, 0, 0)
    }

    /// Makes a block.
    pub(super) fn create(&mut self, block: LogBlock) -> CrtpReply<'static> {
        let reason = if self.blocks.iter().any(|known| known.block.id == block.id) {
            EXISTS
        } else if self.blocks.len() >= MAX_BLOCKS {
            NO_ROOM
        } else {
            self.blocks.push(RunningBlock { block, schedule: None });
            0
        };
        CrtpReply::Log(LogCommand::Create, block.id, reason)
    }

    /// Starts a block whose period is `period` \[10 ms\].
    pub(super) fn start(&mut self, now: Time, id: u8, period: u8) -> CrtpReply<'static> {
        let period = Span::from_millis(10 * i64::from(period.max(1)));
        let found = self.blocks.iter_mut().find(|known| known.block.id == id);
        let reason = match found {
            Some(block) => {
                block.schedule = Some(MessageSchedule::new(now + period, period));
                0
            }
            None => NO_SUCH_BLOCK,
        };
        CrtpReply::Log(LogCommand::Start, id, reason)
    }

    /// Instant at which a block is due next.
    pub(super) fn next_event(&self) -> Option<Time> {
        self.blocks
            .iter()
            .filter_map(|block| block.schedule.as_ref().map(MessageSchedule::next))
            .min()
    }

    /// Passes the packets that are due at `now` to `send`; `clock_ms` is the vehicle's clock.
    pub(super) fn tick(
        &mut self,
        now: Time,
        clock_ms: u32,
        logged: &Logged,
        mut send: impl FnMut(CrtpPacket),
    ) {
        for RunningBlock { block, schedule } in &mut self.blocks {
            if !schedule.as_mut().is_some_and(|schedule| schedule.is_due(now)) {
                continue;
            }
            let values = block.variables().iter().map(|(kind, id)| (*kind, logged.value(*id)));
            send(CrtpReply::log_data(block.id, clock_ms, values));
        }
    }
}
