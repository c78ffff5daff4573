//! The loop of a process: wait, turn, heartbeat, and a safe output at the end.

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};

use oqtal_bus::error::BusError;

use crate::health::Heartbeat;
use crate::loop_clock::LoopClock;
use crate::turn::Turn;

/// Executes turns until a stop is requested or the transport fails, and leaves the outputs safe in any case. The heartbeat is
/// sent after each turn; if there is none, another thread sends it.
///
/// # Errors
/// The transport failed.
pub fn run(
    turn: &mut impl Turn,
    clock: &mut LoopClock,
    heartbeat: Option<&mut Heartbeat>,
) -> Result<(), BusError> {
    let result = catch_unwind(AssertUnwindSafe(|| turns(turn, clock, heartbeat)));
    let shut_down = turn.shut_down(clock);
    match result {
        Ok(result) => result.and(shut_down),
        Err(panic) => resume_unwind(panic),
    }
}

fn turns(
    turn: &mut impl Turn,
    clock: &mut LoopClock,
    mut heartbeat: Option<&mut Heartbeat>,
) -> Result<(), BusError> {
    while clock.wait(turn.next_event(clock.now()))?.is_some() {
        turn.turn(clock)?;
        clock.note_motors(turn.motors());
        if let Some(heartbeat) = &mut heartbeat {
            heartbeat.beat(turn.health(clock.now()))?;
        }
    }
    Ok(())
}
