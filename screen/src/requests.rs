//! Requests of the operator, executed on threads beside the picture: a daemon that hangs delays neither the picture nor a stop.

use std::sync::mpsc::{Receiver, TryRecvError, channel};

use oqtal_bus::paths::InstancePaths;
use oqtal_runtime::program::beside;

/// Executes a request to the instance at these paths and returns the answer as one line.
pub type ExecuteLine = fn(&InstancePaths, &str) -> String;

/// Executor of the requests to one instance.
#[derive(Debug)]
pub struct RequestThreads {
    execute: ExecuteLine,
    /// Paths of the instance.
    pub paths: InstancePaths,
    pending: Option<PendingRequest>,
}

/// A request that is being executed.
#[derive(Debug)]
struct PendingRequest {
    line: String,
    answer: Receiver<String>,
}

impl RequestThreads {
    /// Executor of requests to the instance at `paths` by `execute`.
    pub fn new(execute: ExecuteLine, paths: InstancePaths) -> Self {
        Self { execute, paths, pending: None }
    }

    /// Starts the request `line`. A landing does not wait for the answer to another request, a stop also not for that to a landing; the
    /// earlier answer is then dropped.
    ///
    /// # Errors
    /// The answer to another request is awaited; the reason as text.
    pub fn start(&mut self, line: &str) -> Result<(), String> {
        if let Some(PendingRequest { line: pending, .. }) = &self.pending
            && rank(pending) >= rank(line)
        {
            return Err(format!(
                "`{pending}` is being executed; the next request after its answer"
            ));
        }
        let (sender, answer) = channel();
        let (execute, paths, line) = (self.execute, self.paths.clone(), line.to_owned());
        let request = line.clone();
        beside(move || {
            // Fails once the answer was dropped.
            let _ = sender.send(execute(&paths, &request));
        });
        self.pending = Some(PendingRequest { line, answer });
        Ok(())
    }

    /// The request that was answered since the last call, with its answer.
    pub fn poll(&mut self) -> Option<(String, String)> {
        let text = match self.pending.as_ref()?.answer.try_recv() {
            Ok(text) => text,
            Err(TryRecvError::Empty) => return None,
            Err(TryRecvError::Disconnected) => "the request failed".to_owned(),
        };
        self.pending.take().map(|pending| (pending.line, text))
    }

    /// Waits for the answer to a request that is being executed, so that the end of the process does not interrupt a stop.
    pub fn finish(&mut self) {
        // Without an answer the request has failed.
        let _ = self.pending.take().map(|pending| pending.answer.recv());
    }
}

/// Rank of the request `line`; only requests of a lower rank may be pending when it is started.
fn rank(line: &str) -> u8 {
    match line.split_whitespace().next() {
        Some("stop") => 2,
        Some("land") => 1,
        _ => 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the answer to a landing or a stop; the daemon hangs in other requests.
    fn execute(_: &InstancePaths, line: &str) -> String {
        while rank(line) == 0 {
            std::thread::park();
        }
        format!("{line}: done")
    }

    #[test]
    fn a_stop_does_not_wait_for_the_answer_to_another_request() {
        let paths = InstancePaths::new("a", Some("/none".as_ref())).unwrap();
        let mut requests = RequestThreads::new(execute, paths);
        assert_eq!(requests.start("arm"), Ok(()));
        assert!(requests.poll().is_none());
        assert!(requests.start("goto 0 0 1").unwrap_err().contains("`arm` is being executed"));
        assert_eq!((requests.start("land"), requests.start("stop")), (Ok(()), Ok(())));
        assert!(requests.start("stop").is_err() && requests.start("land").is_err());
        let answered = std::iter::from_fn(|| Some(requests.poll())).flatten().next();
        assert_eq!(answered, Some(("stop".to_owned(), "stop: done".to_owned())));
        assert_eq!(requests.start("get"), Ok(()), "the next request");
    }
}
