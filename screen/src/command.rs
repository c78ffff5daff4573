//! The command `oqtal monitor` and its loop.

use std::io::{self, IsTerminal};
use std::time::Duration;

use clap::Args;
use oqtal_bus::paths::InstancePaths;
use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;
use oqtal_observe::instance::InstanceModel;
use oqtal_observe::instance_observer::InstanceObserver;
use oqtal_observe::law_query::LawQuery;
use oqtal_runtime::health::SILENCE;
use oqtal_runtime::process::{CommonArgs, Exit, Failure, instance_paths, stop_on_signals};
use oqtal_runtime::stop::StopFlag;

use crate::draw::draw;
use crate::keys::Key;
use crate::look::ScreenLook;
use crate::model::{MonitorModel, ShownAnswer};
use crate::requests::{ExecuteLine, RequestThreads};
use crate::terminal::OpenTerminal;

/// Refresh period of the picture.
const PICTURE_PERIOD: Duration = Duration::from_millis(100);

/// Reason why no process of an instance answers.
pub type Silent = fn(&InstancePaths) -> Failure;

/// Arguments of `oqtal monitor`.
#[derive(Args, Debug)]
pub struct MonitorArgs {
    /// Use words and bold letters instead of colours, as the variable NO_COLOR does
    #[arg(long)]
    no_color: bool,
    #[command(flatten)]
    common: CommonArgs,
}

impl MonitorArgs {
    /// Shows the instance until q, Ctrl-C or SIGTERM. `request` executes a request as after `oqtal ctl`, and returns the answer as
    /// one line.
    ///
    /// # Errors
    /// The output is not a terminal (exit code 64), no process runs on the instance (75), or the terminal or the bus failed.
    pub fn execute(&self, request: ExecuteLine, silent: Silent) -> Result<Exit, Failure> {
        let config = Config::load(&self.common.config, &self.common.settings()?)?;
        let paths = instance_paths(&config)?;
        require_terminal(&paths)?;
        paths.become_owner()?;
        let end = stop_on_signals()?;
        let observer = InstanceObserver::open(&paths, &InstanceModel::topics())?;
        let model = MonitorModel::new(&config.instance.name, Time::now());
        let requests = RequestThreads::new(request, paths);
        let law_query = LawQuery::default();
        let mut watch = Watch { observer, model, law_query, look: self.look(), end, requests };
        watch.find(silent)?;
        let shown = watch.run();
        watch.requests.finish();
        shown.map(|()| Exit::Ok)
    }

    fn look(&self) -> ScreenLook {
        let set = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty());
        let look = ScreenLook::of_environment(set);
        ScreenLook { has_colour: look.has_colour && !self.no_color, ..look }
    }
}

/// Fails unless standard output is a terminal with cursor addressing.
fn require_terminal(paths: &InstancePaths) -> Result<(), Failure> {
    let place = paths.flags();
    let remedy = format!(
        "run it in a terminal; in scripts use `oqtal ctl status --json {place}` or `oqtal record {place}`"
    );
    let is_dumb = std::env::var_os("TERM").is_some_and(|term| term == "dumb");
    let what = match (io::stdout().is_terminal(), is_dumb) {
        (true, false) => return Ok(()),
        (true, true) => "the terminal cannot place text (TERM=dumb)",
        (false, _) => "standard output is not a terminal",
    };
    Err(Failure::new(Exit::Usage, format!("{what}; {remedy}")))
}

/// Observation of an instance.
struct Watch {
    observer: InstanceObserver,
    model: MonitorModel,
    law_query: LawQuery,
    look: ScreenLook,
    end: StopFlag,
    requests: RequestThreads,
}

impl Watch {
    /// Waits until a process of the instance publishes its health.
    fn find(&mut self, silent: Silent) -> Result<(), Failure> {
        let give_up = Time::now() + SILENCE;
        while !self.end.is_set() {
            self.poll()?;
            if self.model.instance.is_alive() {
                return Ok(());
            }
            if Time::now() > give_up {
                let failure = silent(&self.requests.paths);
                if failure.exit == Exit::Permission {
                    return Err(failure);
                }
                let (name, place) = (&self.model.name, self.requests.paths.flags());
                let message = format!(
                    "no process of instance `{name}` runs; start `oqtal fly {place}` or its services, or name another with --instance"
                );
                return Err(Failure::new(Exit::Peer, message));
            }
            std::thread::sleep(Span::from_millis(20).to_duration());
        }
        Ok(())
    }

    /// Shows the instance until a key or a signal ends it.
    fn run(&mut self) -> Result<(), Failure> {
        let failed =
            |error: io::Error| Failure::new(Exit::System, format!("the terminal failed: {error}"));
        let mut terminal = OpenTerminal::enter().map_err(failed)?;
        while !self.end.is_set() {
            self.poll()?;
            if let Some((line, text)) = self.requests.poll() {
                self.model.show_answer(Time::now(), &line, &text);
            }
            let picture = draw(&self.model, self.look, terminal.size().map_err(failed)?);
            terminal.show(picture, self.look).map_err(failed)?;
            let Some(bytes) = terminal.keys(PICTURE_PERIOD).map_err(failed)? else { continue };
            match self.model.keyboard.take(&bytes, Time::now()) {
                Some(Key::Quit) => break,
                Some(Key::Restart) => {
                    self.model.instance.restart_figures();
                    self.model.answer = None;
                }
                Some(Key::Stop) => self.request("stop"),
                Some(Key::Request(line)) => self.request(&line),
                None => {}
            }
        }
        Ok(())
    }

    fn request(&mut self, line: &str) {
        let text = match self.requests.start(line) {
            Ok(()) => format!("`{line}` is being executed"),
            Err(reason) => reason,
        };
        self.model.answer = Some(ShownAnswer::at(Time::now(), "", &text));
    }

    fn poll(&mut self) -> Result<(), Failure> {
        let now = Time::now();
        self.model.advance(now);
        let reported = self.law_query.poll(self.observer.bus(), now);
        self.model.instance.note_law(reported);
        Ok(self.observer.poll(now, &mut self.model)?)
    }
}
