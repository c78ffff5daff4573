//! Test of the answers to operators.

use super::*;
use crate::code::OperatorCommand;
use crate::message::{ControlRequestV1, ControlResponseV1};
use crate::time::Span;

/// A process that ends while its request is being answered leaves its place to the next one.
#[test]
fn an_answer_to_a_request_that_was_given_up_is_not_taken_for_that_to_the_next_one() {
    let (_root, place) = temporary();
    let bus = Bus::open(&place).unwrap();
    let server = bus.control_server().unwrap();
    let (given_up, wait) = std::sync::mpsc::channel::<()>();
    let operator = std::thread::spawn(move || {
        let bus = Bus::open(&place).unwrap();
        let ask = |command, timeout| {
            let client = bus.control_client().unwrap();
            client.ask(ControlRequestV1::of(command), timeout).unwrap()
        };
        assert!(ask(OperatorCommand::Land, Span::from_millis(300)).is_none());
        drop(given_up);
        ask(OperatorCommand::Arm, Span::from_seconds(60.0)).unwrap().mode
    });
    let mut asked = Vec::new();
    while !asked.contains(&OperatorCommand::Arm.code()) {
        let answer = |request: ControlRequestV1| {
            asked.push(request.command);
            if request.command == OperatorCommand::Land.code() {
                let _ = wait.recv();
                // The next request is sent meanwhile. Without this pause the test is easier, but passes as well.
                std::thread::sleep(std::time::Duration::from_millis(50));
            }
            ControlResponseV1 { mode: request.command, ..ControlResponseV1::default() }
        };
        server.serve(answer).unwrap();
    }
    assert_eq!(operator.join().unwrap(), OperatorCommand::Arm.code());
}
