use std::os::unix::fs::PermissionsExt;

use oqtal_runtime::packet_socket::connect;

use super::*;

fn answers(law: &OwnedFd, sequence: u64) {
    let mut bytes = [0; ExternalV1::SIZE];
    ExternalV1 { sequence, thrust: 4.9, ..ExternalV1::default() }.encode(&mut bytes);
    let packet = [&ANSWER[..], &bytes[..ANSWERED]].concat();
    send(law, &packet, SendFlags::empty()).unwrap();
}

fn ask(law: &mut SocketLaw, sequence: u64, budget_ms: i64) -> Option<ExternalV1> {
    let answer_by = Time::now() + Span::from_millis(budget_ms);
    law.answer(&StateV1 { sequence, answer_by, ..StateV1::default() })
}

/// Waits for the question 5 and answers it twice.
fn answer_twice(law: &OwnedFd) {
    let mut bytes = [0; QUESTION.len() + StateV1::SIZE];
    let (_, length) = recv(law, &mut bytes, RecvFlags::empty()).unwrap();
    assert_eq!((length, &bytes[..16]), (bytes.len(), &b"OQTALST1\x05\0\0\0\0\0\0\0"[..]));
    answers(law, 5);
    answers(law, 5);
}

#[test]
fn a_law_answers_this_question_and_a_second_law_is_refused() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("law");
    let (sender, receiver) = connections();
    let mut listener = LawListener::open(path.clone(), sender).unwrap();
    assert_eq!(path.metadata().unwrap().permissions().mode() & 0o777, 0o600);
    let (first, second) = (connect(&path).unwrap(), connect(&path).unwrap());
    listener.poll();
    listener.poll();
    let mut law = SocketLaw::new(receiver, StopFlag::default());
    // Late; after the question the right one, twice.
    answers(&first, 4);
    let answer = std::thread::scope(|threads| {
        threads.spawn(|| answer_twice(&first));
        ask(&mut law, 5, 60_000).unwrap()
    });
    assert_eq!((answer.sequence, answer.thrust), (5, 4.9));
    assert!(answer.answered_at >= answer.asked_at && answer.asked_at.is_set());
    assert_eq!(ask(&mut law, 6, 1).unwrap().sequence, 5, "the answer to another question");
    assert_eq!(ask(&mut law, 7, 1), None);
    send(&first, &ANSWER, SendFlags::empty()).unwrap();
    assert_eq!(ask(&mut law, 7, 1).unwrap().verdict, HandoverCause::Malformed.code());
    let mut bytes = [0; 8];
    assert_eq!(recv(&second, &mut bytes, RecvFlags::empty()).unwrap().1, 0, "refused");
    drop(first);
    // A law that is gone is not waited for.
    let told = |answer: Option<ExternalV1>| answer.as_ref().and_then(reason_of);
    assert_eq!(told(ask(&mut law, 8, 60_000)), Some(HandoverCause::Ended));
    assert_eq!(told(ask(&mut law, 9, 60_000)), Some(HandoverCause::Absent));
    listener.poll();
    assert!(!listener.has_law(), "its end was noticed");
    let _third = connect(&path).unwrap();
    listener.poll();
    assert_eq!(law.connections.len(), 1);
    drop(listener);
    assert!(!path.exists());
}

#[test]
fn a_law_that_reads_no_more_frees_its_place() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("law");
    let (sender, receiver) = connections();
    let mut listener = LawListener::open(path.clone(), sender).unwrap();
    let half_closed = connect(&path).unwrap();
    shutdown(&half_closed, Shutdown::Read).unwrap();
    listener.poll();
    assert!(listener.has_law());
    let answer_by = Time::now() + Span::from_millis(60_000);
    let state = StateV1 { sequence: 1, answer_by, ..StateV1::default() };
    let told = SocketLaw::new(receiver, StopFlag::default()).answer(&state);
    assert_eq!(told.as_ref().and_then(reason_of), Some(HandoverCause::Ended));
    listener.poll();
    assert!(!listener.has_law());
}

#[test]
fn a_law_connects_after_the_socket_was_removed() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("law");
    let mut listener = LawListener::open(path.clone(), connections().0).unwrap();
    std::fs::remove_file(&path).unwrap();
    listener.poll();
    let _law = connect(&path).unwrap();
    listener.poll();
    assert!(listener.has_law());
}

#[test]
fn a_law_that_ends_before_it_is_asked_is_replaced_and_an_empty_packet_is_an_answer() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("law");
    let (slot, receiver) = connections();
    let mut listener = LawListener::open(path.clone(), slot).unwrap();
    let mut law = SocketLaw::new(receiver, StopFlag::default());
    let mut ask = |sequence| {
        let answer_by = Time::now() + Span::from_millis(1);
        let answer = law.answer(&StateV1 { sequence, answer_by, ..StateV1::default() });
        answer.map(|answer| (answer.sequence, reason_of(&answer)))
    };
    let ended = connect(&path).unwrap();
    listener.poll();
    drop(ended);
    assert_eq!(ask(1), Some((0, Some(HandoverCause::Absent))), "not the end of a law");
    // Between flights nothing asks.
    for _ in 0..3 {
        let ended = connect(&path).unwrap();
        listener.poll();
        drop(ended);
    }
    let connected = connect(&path).unwrap();
    listener.poll();
    assert_eq!(ask(2), None);
    send(&connected, &[], SendFlags::empty()).unwrap();
    assert_eq!(ask(3), Some((0, Some(HandoverCause::Malformed))));
    answers(&connected, 3);
    assert_eq!(ask(4), Some((3, None)), "it is still connected");
    for sequence in 5..8 {
        answers(&connected, sequence);
    }
    assert_eq!(ask(5), Some((0, None)), "answers to questions that were not asked yet");
    assert_eq!([ask(6), ask(7)], [None, None], "none of them is kept");
    (0..=MOST_WAITING as u64).for_each(|_| answers(&connected, 9));
    assert_eq!([ask(8), ask(9)], [Some((0, None)); 2], "the last one waited, too");
    assert_eq!(ask(10), None, "all are read");
}
