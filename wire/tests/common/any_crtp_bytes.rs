//! Properties of CRTP for arbitrary bytes, shared by the property tests and the fuzz targets.

use oqtal_wire::crtp::{
    CrtpPacket, CrtpReply, CrtpRequest, LogType, MAX_CRTP_PACKET, ParameterType,
};

/// Checks both ends: no panic, and what is read from a packet encodes to a packet that reads the same.
pub fn any_crtp_bytes(bytes: &[u8]) {
    let Ok(packet) = CrtpPacket::parse(bytes) else {
        assert!(bytes.is_empty() || bytes.len() > MAX_CRTP_PACKET);
        return;
    };
    assert_eq!(packet.as_bytes()[1..], bytes[1..]);
    if let Some(request) = CrtpRequest::read(&packet) {
        let again = request.packet();
        let read = CrtpRequest::read(&again).map(|request| request.packet());
        assert_eq!(read, Some(again), "{request:?}");
        if let CrtpRequest::Poses(poses) = request {
            let norms = poses.poses().iter().map(|pose| pose.pose().attitude);
            norms.for_each(|q| assert!((q.iter().map(|c| c * c).sum::<f64>() - 1.0).abs() < 1e-9));
        }
    }
    if let Some(reply) = CrtpReply::read(&packet) {
        let again = reply.packet();
        assert!(again.as_bytes().len() <= MAX_CRTP_PACKET);
        any_values(reply);
    }
}

fn any_values(reply: CrtpReply) {
    match reply {
        CrtpReply::LogData { mut values, .. } => {
            let kinds = (1..=7).filter_map(LogType::from_wire);
            assert!(kinds.filter_map(|kind| values.next(kind)).count() <= 7);
        }
        CrtpReply::Parameter(_, value) | CrtpReply::Written(_, value) => {
            let kinds = (0..16).filter_map(ParameterType::from_wire);
            assert!(kinds.filter_map(|kind| value.number(kind)).count() <= 7);
        }
        _ => {}
    }
}
