//! `oqtal view`: a page in the browser for a running instance or a recording.

mod operator;

use std::net::{SocketAddr, TcpListener};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use clap::Args;
use oqtal_bus::paths::InstancePaths;
use oqtal_bus::time::Time;
use oqtal_config::{Config, is_of_reload};
use oqtal_observe::instance_observer::InstanceObserver;
use oqtal_observe::law_query::LawQuery;
use oqtal_observe::recording::recording_path;
use oqtal_operator::require_daemon;
use oqtal_runtime::health::SILENCE;
use oqtal_runtime::process::{CommonArgs, Exit, Failure, instance_paths, stop_on_signals};
use oqtal_runtime::program::say;
use oqtal_runtime::stop::StopFlag;
use oqtal_view::access::Access;
use oqtal_view::hub::Hub;
use oqtal_view::live::LiveView;
use oqtal_view::recorded::RecordedView;
use oqtal_view::scene::SceneDescription;
use oqtal_view::server;
use oqtal_view::site::{Site, Subject};

use crate::daemon_config::text_and_config;
use crate::recordings::{self, failure};
use crate::token::random_token;
use operator::BusOperator;

/// Update period: 40 updates per second.
const UPDATE_PERIOD: Duration = Duration::from_millis(25);
/// Period of the checks for an interrupt while a recording is shown.
const CHECK_PERIOD: Duration = Duration::from_millis(50);

/// Arguments of `oqtal view`.
#[derive(Args, Debug)]
pub struct ViewArgs {
    /// A recording, one of its flights as FILE#NUMBER, the directory of a flight, or `latest`; without one the running
    /// instance is shown
    #[arg(value_parser = recording_path)]
    file: Option<PathBuf>,
    /// Address and port of the page; another address than this machine's own needs --token. Port 0 is any free one
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:8600")]
    listen: SocketAddr,
    /// Offer the commands of an operator to holders of the token that is printed
    #[arg(long, conflicts_with = "file")]
    control: bool,
    /// Show nothing without the token that is printed
    #[arg(long)]
    token: bool,
    /// Wait for an instance if none is running
    #[arg(long, conflicts_with = "file")]
    wait: bool,
    #[command(flatten)]
    common: CommonArgs,
}

impl ViewArgs {
    /// Serves the page until it is interrupted.
    ///
    /// # Errors
    /// The address needs a token (exit code 64) or is in use (71); the file is not a recording (65) or of another version (76); no
    /// daemon runs (75, without `--wait`).
    pub fn execute(&self) -> Result<Exit, Failure> {
        let token = (self.control || self.token).then(random_token).transpose()?;
        let access = Access::new(self.listen, self.control, self.token, token);
        let access = access.ok_or_else(|| needs_token(self.listen))?;
        match &self.file {
            Some(file) => self.show_recording(file, access),
            None => self.show_instance(access),
        }
    }

    fn show_recording(&self, file: &Path, access: Access) -> Result<Exit, Failure> {
        let RecordedView { scene, document } =
            RecordedView::of(&recordings::read(file)?).map_err(failure)?;
        let stop = stop_on_signals()?;
        let site = Site::new(access.clone(), &scene, Subject::Recorded(document));
        self.open(site, &access, &file.display().to_string())?;
        while !stop.is_set() {
            std::thread::sleep(CHECK_PERIOD);
        }
        Ok(Exit::Ok)
    }

    fn show_instance(&self, access: Access) -> Result<Exit, Failure> {
        let config = Config::load(&self.common.config, &self.common.settings()?)?;
        let paths = instance_paths(&config)?;
        paths.become_owner()?;
        let stop = stop_on_signals()?;
        let observer = InstanceObserver::open(&paths, &LiveView::topics())?;
        if !self.wait {
            require_daemon(observer.bus(), "open the page with --wait")?;
        }
        let hub = Arc::new(Hub::default());
        let expected = (!self.common.config.is_empty()).then(|| config.hash());
        let operator = BusOperator::new(&paths, expected);
        let operator = self.control.then(|| Box::new(operator) as _);
        let subject = Subject::Live(Arc::clone(&hub), operator);
        let mut daemon = DaemonConfig { place: paths, written: None };
        let shown = daemon.changed().unwrap_or_else(|| config.clone());
        let scene = SceneDescription::of_instance(&shown, self.control);
        let site = Site::new(access.clone(), &scene, subject);
        let site = self.open(site, &access, &format!("instance `{}`", config.instance.name))?;
        self.feed((observer, daemon), &shown, (&site, &hub, &stop))?;
        Ok(Exit::Ok)
    }

    /// Starts serving the site, and prints its address.
    fn open(&self, site: Site, access: &Access, subject: &str) -> Result<Arc<Site>, Failure> {
        let failed = |error: std::io::Error| {
            let message = format!("{}: {error}; choose another with --listen", self.listen);
            Failure::new(Exit::System, message)
        };
        let listener = TcpListener::bind(self.listen).map_err(failed)?;
        let address = listener.local_addr().map_err(failed)?;
        let site = Arc::new(site);
        let served = Arc::clone(&site);
        std::thread::Builder::new()
            .name("pages".to_owned())
            .spawn(move || server::serve(&listener, &served))
            .map_err(failed)?;
        say(&format!("oqtal: http://{address}/ shows {subject}; Ctrl-C ends"));
        if let Some(token) = &access.token {
            let purpose = match (self.control, access.guards_reading) {
                (true, true) => "to see it and to command",
                (true, false) => "to command",
                (false, _) => "to see it",
            };
            say(&format!("oqtal: token {purpose}: {token}"));
        }
        if !access.is_loopback {
            say(
                "oqtal: token and page cross the network unencrypted: use a private network or an ssh tunnel",
            );
        }
        Ok(site)
    }

    /// Feeds the pages until the command is interrupted. They show the room of the daemon that runs, that of `config` before one does.
    fn feed(
        &self,
        (mut observer, mut daemon): (InstanceObserver, DaemonConfig),
        config: &Config,
        (site, hub, stop): (&Site, &Hub, &StopFlag),
    ) -> Result<(), Failure> {
        let mut view = LiveView::new(config, SILENCE);
        let mut law_query = LawQuery::default();
        while !stop.is_set() {
            if let Some(config) = daemon.changed() {
                site.change_scene(&SceneDescription::of_instance(&config, self.control));
                view = LiveView::new(&config, SILENCE);
            }
            std::thread::sleep(UPDATE_PERIOD);
            let now = Time::now();
            observer.poll(now, &mut view)?;
            view.instance.note_law(law_query.poll(observer.bus(), now));
            let (collected, status) = view.take(now);
            hub.publish(now, &collected, status);
        }
        Ok(())
    }
}

/// Configuration of an instance's daemon, as the daemon wrote it at its start.
#[derive(Debug)]
struct DaemonConfig {
    place: InstancePaths,
    /// Modification time of the file when it was last read.
    written: Option<SystemTime>,
}

impl DaemonConfig {
    /// The configuration, if a daemon that started has written it since the last call.
    fn changed(&mut self) -> Option<Config> {
        let written = std::fs::metadata(self.place.config()).and_then(|file| file.modified()).ok();
        if written.is_none() || written == self.written {
            return None;
        }
        // A file that is not complete yet is read again.
        let (text, config) = text_and_config(&self.place)?;
        let is_of_start = !is_of_reload(&text) || self.written.is_none();
        self.written = written;
        is_of_start.then_some(config)
    }
}

fn needs_token(listen: SocketAddr) -> Failure {
    let message = format!(
        "--listen {listen}: other machines can reach this address; give --token, so that only its holders see the page"
    );
    Failure::new(Exit::Usage, message)
}
