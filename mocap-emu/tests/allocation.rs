//! No frame of the emulated cameras allocates.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use oqtal_bus::message::TruthV1;
use oqtal_bus::time::{Span, Time};
use oqtal_config::{Config, Setting};
use oqtal_mocap_emu::Cameras;

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

/// The system's allocator, counted for each thread.
struct Counted;

// SAFETY: every call goes on to the system's allocator as it is; counting touches no memory of its own, for the cell
// is a constant-initialised number without a destructor.
unsafe impl GlobalAlloc for Counted {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.set(ALLOCATIONS.get() + 1);
        // SAFETY: the caller keeps the contract of `alloc`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the pointer came from `alloc` above, that is, from the system.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static COUNTED: Counted = Counted;

/// How often twenty seconds of the cameras allocate.
fn allocations(settings: &[(&str, &str)]) -> u64 {
    let settings: Vec<Setting> =
        settings.iter().map(|(key, value)| Setting::flag("test", key, *value)).collect();
    let config = Config::from_settings(&settings).unwrap();
    let mut cameras = Cameras::new(&config.mocap, 7);
    let mut truth = TruthV1 {
        time: Time::VIRTUAL_START,
        position: [0.1, 0.2, 1.0],
        attitude: [0.0, 0.0, 0.0, 1.0],
        ..TruthV1::default()
    };
    let mut delivered = 0;
    let before = ALLOCATIONS.get();
    for _ in 0..(20.0 * config.mocap.rate_hz) as u64 {
        truth.capture += 1;
        truth.time = truth.time + Span::period_of(config.mocap.rate_hz);
        cameras.capture(&truth);
        while cameras.deliver(truth.time).is_some() {
            delivered += 1;
        }
    }
    assert!(delivered > 1000);
    ALLOCATIONS.get() - before
}

#[test]
fn no_frame_of_any_model_allocates() {
    assert_eq!(allocations(&[]), 0);
    assert_eq!(allocations(&[("mocap.model", "markers")]), 0);
    assert_eq!(allocations(&[("mocap.preset", "room")]), 0);
    assert_eq!(allocations(&[("mocap.preset", "room"), ("mocap.model", "markers")]), 0);
    // The counter counts.
    let before = ALLOCATIONS.get();
    drop(std::hint::black_box(Box::new(5)));
    assert_eq!(ALLOCATIONS.get() - before, 1);
}
