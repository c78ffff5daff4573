//! Tests of the public interface, in one program.

mod common;

mod any_bytes;
mod asctec_bytes;
mod asctec_streams;
mod camera_bytes;
mod crtp_bytes;
mod mavlink;
mod mavlink_peer;
mod meaning;
mod msp_bytes;
mod natnet_sessions;
mod peers;
mod qtm_sessions;
mod vrpn_sessions;
mod xbee_bytes;
mod xbee_streams;
