use super::*;

#[test]
fn f57_a_stop_of_a_vehicle_that_another_controls_is_said_not_to_act() {
    let report = StopReport { daemon_obeys: true, another_has_control: true, ..Default::default() };
    let failure = ObeyedStop::new(report, None).check().unwrap_err();
    assert_eq!(failure.exit, Exit::Flight);
    let text = failure.message;
    assert!(text.contains("only the remote control stops its motors"), "{text}");
    assert!(!text.contains("hangs") && !text.contains("no command reaches"), "{text}");
}
