//! Mutated examples into every parser: none panics, and none uses more memory than a small multiple of its input and a constant.
//! `OQTAL_TEST_MUTATIONS` is the number of mutations of each example, and `OQTAL_TEST_SEED` the first seed.

#[path = "../../wire/tests/common/any_bytes.rs"]
mod any_bytes;
#[path = "../../wire/tests/common/any_camera_bytes.rs"]
mod any_camera_bytes;
#[path = "../../wire/tests/common/any_crtp_bytes.rs"]
mod any_crtp_bytes;
mod any_file;
mod any_table;
#[path = "../../control/tests/allocation/counter.rs"]
mod counter;
mod examples;
mod mutation;
#[allow(dead_code)]
#[path = "../common/random.rs"]
mod random;

use counter::most_bytes;
use mutation::mutated;
use oqtal_wire::asctec::{HostGrammar, VehicleGrammar};
use oqtal_wire::mavlink::MavlinkGrammar;
use oqtal_wire::msp::MspGrammar;
use random::{Random, length};

/// Bound of the memory in use.
#[derive(Clone, Copy)]
struct MemoryBound {
    /// Multiple of the size of the input \[-\].
    per_byte: u64,
    /// Memory for an empty input \[bytes\].
    constant: u64,
}

/// Passes mutations of `example` to `parse`: `cases` of them, unless the environment sets another number.
#[track_caller]
fn mutations(cases: u64, example: &[u8], bound: MemoryBound, parse: fn(&[u8])) {
    let first = length("OQTAL_TEST_SEED", 0);
    for seed in first..first + length("OQTAL_TEST_MUTATIONS", cases) {
        let bytes = mutated(&mut Random(seed), example);
        let (used, result) = most_bytes(|| std::panic::catch_unwind(|| parse(&bytes)));
        assert!(result.is_ok(), "seed {seed}: panic");
        let most = bound.per_byte * bytes.len() as u64 + bound.constant;
        assert!(used <= most, "seed {seed}: {used} bytes used for {}, of {most}", bytes.len());
    }
}

#[test]
fn the_memory_in_use_is_measured() {
    let (used, _) = most_bytes(|| drop(std::hint::black_box(vec![0_u8; 1000])));
    assert_eq!(used, 1000);
}

#[test]
fn a_mutated_recording_is_read_in_bounded_memory() {
    let bound = MemoryBound { per_byte: 40, constant: 5 << 20 };
    mutations(150, &examples::recording(), bound, any_file::any_recording);
}

#[test]
fn a_mutated_configuration_is_read_in_bounded_memory() {
    let bound = MemoryBound { per_byte: 16, constant: 1 << 20 };
    mutations(150, oqtal_config::DEFAULTS.as_bytes(), bound, any_file::any_configuration);
}

#[test]
fn mutated_poses_and_waypoints_are_read_in_bounded_memory() {
    let bound = MemoryBound { per_byte: 16, constant: 4096 };
    for example in examples::poses() {
        mutations(1000, example.as_bytes(), bound, any_table::any_poses);
    }
    mutations(1000, examples::waypoints().as_bytes(), bound, any_table::any_waypoints);
}

#[test]
fn mutated_streams_of_cameras_are_read_in_bounded_memory() {
    use any_camera_bytes::{any_natnet_bytes, any_qtm_bytes, any_vrpn_bytes};
    let [qtm, vrpn, natnet] = examples::camera_streams();
    // The constants are the buffers of the clients for the longest message.
    let with_buffer = |constant| MemoryBound { per_byte: 16, constant };
    mutations(1000, &qtm, with_buffer(3 << 20), any_qtm_bytes);
    mutations(1000, &vrpn, with_buffer(1 << 19), any_vrpn_bytes);
    mutations(1000, &natnet, with_buffer(1 << 14), any_natnet_bytes);
    // Without the header, the content of a frame.
    mutations(1000, &natnet[4..], with_buffer(1 << 14), any_natnet_bytes);
}

#[test]
fn mutated_streams_of_vehicles_are_read_in_bounded_memory() {
    use any_bytes::{any_bytes, any_radio_bytes};
    let bound = MemoryBound { per_byte: 16, constant: 0 };
    for parse in [
        any_bytes::<HostGrammar>,
        any_bytes::<VehicleGrammar>,
        any_bytes::<MavlinkGrammar>,
        any_bytes::<MspGrammar>,
        any_radio_bytes,
        any_crtp_bytes::any_crtp_bytes,
    ] {
        mutations(500, &examples::heads_of_frames(), bound, parse);
    }
}
