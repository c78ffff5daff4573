//! Replies to requests, independent of sockets.

use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};

use oqtal_bus::time::Time;
use serde::Deserialize;

use crate::access::Access;
use crate::assets;
use crate::hub::Hub;
use crate::live::NANOS_PER_MS;
use crate::request::Request;
use crate::response::Response;
use crate::scene::SceneDescription;

const JSON: &str = "application/json";

/// Commands of `oqtal ctl` that a page can send. `reload` is not one: it reads a file of this machine.
const COMMANDS: [&str; 13] = [
    "status",
    "arm",
    "disarm",
    "resume",
    "land",
    "goto",
    "fly",
    "hover",
    "set",
    "get",
    "undo",
    "controller",
    "stop",
];

/// Executes commands of operators.
pub trait Operator: fmt::Debug + Send + Sync {
    /// Executes a command of `oqtal ctl` with its arguments, and returns the reply. `seen_at`: instant of the newest update that
    /// the page had when the command was given; unset if it had none.
    fn execute(&self, command: &str, arguments: &[String], seen_at: Time) -> OperatorReply;
}

/// Reply to a command.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OperatorReply {
    /// Whether it was accepted.
    pub is_accepted: bool,
    /// Reply in words.
    pub text: String,
}

/// Subject of the page.
#[derive(Debug)]
pub enum Subject {
    /// A running instance: its updates, and the executor of commands.
    Live(Arc<Hub>, Option<Box<dyn Operator>>),
    /// A recording, as a document.
    Recorded(String),
}

/// The site of one `oqtal view`.
#[derive(Debug)]
pub struct Site {
    access: Access,
    scene: Mutex<String>,
    subject: Subject,
}

/// Reply to a request.
#[derive(Debug)]
pub enum Reply<'a> {
    /// A response.
    Whole(Response),
    /// Updates of an instance until either side closes.
    Updates(&'a Hub),
}

/// The body of a command.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CommandBody {
    command: String,
    #[serde(default)]
    arguments: Vec<String>,
    /// `at_ms` of the newest update that the page had when the command was given \[ms\].
    #[serde(default)]
    seen_ms: u64,
}

impl Site {
    /// A site that shows `subject`.
    pub fn new(access: Access, scene: &SceneDescription, subject: Subject) -> Self {
        Self { access, scene: Mutex::new(json(scene)), subject }
    }

    /// Shows the subject in another `scene`; open pages load it when they detect that the daemon runs with another configuration.
    pub fn change_scene(&self, scene: &SceneDescription) {
        *self.scene.lock().unwrap_or_else(PoisonError::into_inner) = json(scene);
    }

    /// Whether `request` has the token.
    pub fn is_token_holder(&self, request: &Request) -> bool {
        self.access.has_token(request)
    }

    /// The answer to `request`.
    pub fn answer(&self, request: &Request) -> Reply<'_> {
        self.checked(request).unwrap_or_else(Reply::Whole)
    }

    fn checked(&self, request: &Request) -> Result<Reply<'_>, Response> {
        self.access.admit(request)?;
        if request.path == "/control" {
            return self.control(request).map(Reply::Whole);
        }
        if !["GET", "HEAD"].contains(&&*request.method) {
            return Err(Response::text(405, "only GET is answered here"));
        }
        if let Some(asset) = assets::find(&request.path) {
            return Ok(Reply::Whole(asset));
        }
        match (&*request.path, &self.subject) {
            ("/scene", _) => {
                self.access.may_read(request)?;
                let scene = self.scene.lock().unwrap_or_else(PoisonError::into_inner).clone();
                Ok(Reply::Whole(Response::ok(JSON, scene)))
            }
            ("/live", Subject::Live(hub, _)) => {
                self.access.may_read(request)?;
                Ok(Reply::Updates(hub))
            }
            ("/recording", Subject::Recorded(document)) => {
                self.access.may_read(request)?;
                Ok(Reply::Whole(Response::ok(JSON, document.clone())))
            }
            _ => Err(Response::text(404, "not found; the page is at /")),
        }
    }

    fn control(&self, request: &Request) -> Result<Response, Response> {
        if request.method != "POST" {
            return Err(Response::text(405, "commands require POST"));
        }
        self.access.may_control(request)?;
        let Subject::Live(_, Some(operator)) = &self.subject else {
            return Err(Response::text(403, "a recording accepts no commands"));
        };
        let CommandBody { command, arguments, seen_ms } = command(&request.body)?;
        let seen_at = Time::from_nanos(seen_ms.saturating_mul(NANOS_PER_MS));
        let OperatorReply { is_accepted, text } = operator.execute(&command, &arguments, seen_at);
        Ok(Response::text(if is_accepted { 200 } else { 409 }, &text))
    }
}

fn json(scene: &SceneDescription) -> String {
    serde_json::to_string(scene).expect("a scene is plain JSON")
}

/// The command of a body.
fn command(body: &[u8]) -> Result<CommandBody, Response> {
    let parsed: Option<CommandBody> = serde_json::from_slice(body).ok();
    let known = parsed.filter(|body| COMMANDS.contains(&&*body.command));
    known.ok_or_else(|| {
        let example = r#"{"command": "goto", "arguments": ["0", "0", "1"], "seen_ms": 5000}"#;
        let names = COMMANDS.join(", ");
        Response::text(400, &format!("a command has the form {example}, with at_ms of the newest update; commands: {names}"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use oqtal_config::Config;

    #[derive(Debug)]
    struct Echo;

    impl Operator for Echo {
        fn execute(&self, command: &str, arguments: &[String], seen_at: Time) -> OperatorReply {
            let text = format!("{command} {}", arguments.join(" "));
            let is_accepted = command != "land" && seen_at == Time::VIRTUAL_START;
            OperatorReply { is_accepted, text }
        }
    }

    fn site(has_control: bool) -> Site {
        let token = Some("secret".to_owned());
        let listen = "127.0.0.1:1".parse().unwrap();
        let access = Access::new(listen, has_control, false, token).unwrap();
        let scene = SceneDescription::of_instance(&Config::default(), has_control);
        Site::new(access, &scene, Subject::Live(Arc::default(), Some(Box::new(Echo))))
    }

    fn request(method: &str, path: &str, body: &str) -> Request {
        let headers = [("host", "localhost:1"), ("authorization", "Bearer secret")];
        let mut request = Request::made(method, path, &headers);
        request.body = body.into();
        request
    }

    fn status(site: &Site, request: &Request) -> u16 {
        match site.answer(request) {
            Reply::Whole(response) => response.status,
            Reply::Updates(_) => 200,
        }
    }

    #[test]
    fn every_address_has_its_answer() {
        let site = site(true);
        for (method, path, expected) in [
            ("GET", "/", 200),
            ("GET", "/style.css", 200),
            ("GET", "/scene", 200),
            ("GET", "/live", 200),
            ("GET", "/recording", 404),
            ("GET", "/../etc/passwd", 404),
            ("POST", "/", 405),
            ("OPTIONS", "/control", 405),
            ("GET", "/control", 405),
        ] {
            assert_eq!(status(&site, &request(method, path, "")), expected, "{method} {path}");
        }
    }

    #[test]
    fn commands_are_executed_and_a_refusal_is_reported() {
        let post = |site: &Site, body: &str| status(site, &request("POST", "/control", body));
        let with = site(true);
        assert_eq!(post(&with, r#"{"command": "arm", "seen_ms": 1000}"#), 200);
        assert_eq!(post(&with, r#"{"command": "land", "seen_ms": 1000}"#), 409);
        assert_eq!(post(&with, r#"{"command": "arm"}"#), 409, "without the time of an update");
        let goto = r#"{"command": "goto", "arguments": ["0", "0", "1"], "seen_ms": 1000}"#;
        assert_eq!(post(&with, goto), 200);
        for wrong in ["", "arm", r#"{"command": "reload"}"#, r#"{"command": "arm", "x": 1}"#] {
            assert_eq!(post(&with, wrong), 400, "{wrong}");
        }
        assert_eq!(post(&site(false), r#"{"command": "arm"}"#), 403);
        let without_token = Request::made("POST", "/control", &[("host", "localhost:1")]);
        assert_eq!(status(&with, &without_token), 401);
    }

    #[test]
    fn a_request_by_another_name_gets_nothing() {
        let site = site(true);
        for path in ["/", "/main.js", "/scene", "/live", "/control"] {
            let request = Request::made("GET", path, &[("host", "evil.example")]);
            assert_eq!(status(&site, &request), 403, "{path}");
        }
    }
}
