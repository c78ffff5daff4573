//! Pseudo-terminal in place of the radio's serial port, and a symbolic link to it.

use std::fs;
use std::io::ErrorKind;
use std::os::fd::OwnedFd;
use std::os::unix::fs::{MetadataExt, symlink};
use std::path::{Path, PathBuf};

use oqtal_bus::time::{Span, Time};
use oqtal_runtime::process::{Exit, Failure};
use rustix::event::{PollFd, PollFlags};
use rustix::fs::{FlockOperation, Mode, OFlags, fcntl_getfl, fcntl_lock, fcntl_setfl, open};
use rustix::io::Errno;
use rustix::process::{Flock, FlockType, fcntl_getlk};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, ioctl_tiocnxcl, tcgetattr, tcsetattr};

use crate::socket::{VehiclePort, wait_until};

/// Directory of the kernel's pseudo-terminals.
const TERMINALS: &str = "/dev/pts/";
/// Time between two releases of exclusive access to the terminal.
const RELEASE_PERIOD: Span = Span::from_millis(100);

/// Vehicle's end of a serial line. The symbolic link is removed on drop.
#[derive(Debug)]
pub struct PseudoTerminal {
    near: OwnedFd,
    /// The host's end, kept open so that the line keeps its settings without a host. A lock on it marks the link as in use.
    far: OwnedFd,
    terminal: PathBuf,
    link: PathBuf,
    released_at: Time,
}

impl PseudoTerminal {
    /// Opens a line and makes `link` a symbolic link to the host's end. A link left by a dead process is replaced.
    ///
    /// # Errors
    /// Another emulated vehicle uses `link` (exit code 75), `link` is something else (78), or the operating system refuses (71, 77).
    pub fn open(link: &Path) -> Result<Self, Failure> {
        let failed = |error| system("opening a pseudo-terminal", &error);
        let near = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)
            .map_err(failed)?;
        grantpt(&near).and_then(|()| unlockpt(&near)).map_err(failed)?;
        let name = ptsname(&near, Vec::new()).map_err(failed)?;
        let far = open(name.as_c_str(), terminal_flags(), Mode::empty()).map_err(failed)?;
        set_up(&near, &far).map_err(failed)?;
        let terminal = PathBuf::from(name.to_string_lossy().into_owned());
        make_link(link, &terminal)?;
        Ok(Self { near, far, terminal, link: link.to_path_buf(), released_at: Time::UNSET })
    }
}

impl VehiclePort for PseudoTerminal {
    fn wait(&self, until: Time, listen: bool) -> Result<(), Failure> {
        let mut fds = [PollFd::new(&self.near, PollFlags::IN)];
        wait_until(until, if listen { &mut fds } else { &mut [] })
    }

    fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Failure> {
        match rustix::io::read(&self.near, buffer) {
            Ok(bytes) => Ok(bytes),
            Err(Errno::AGAIN | Errno::INTR | Errno::IO) => Ok(0),
            Err(error) => Err(system("reading the line", &error)),
        }
    }

    /// Writes `bytes`; they are lost without a host, as on a serial port.
    fn write(&mut self, bytes: &[u8]) -> Result<(), Failure> {
        match rustix::io::write(&self.near, bytes) {
            Ok(_) | Err(Errno::AGAIN | Errno::INTR | Errno::IO) => Ok(()),
            Err(error) => Err(system("writing to the line", &error)),
        }
    }

    /// Releases exclusive access to the line, which a killed host leaves set for as long as this end is open.
    fn maintain(&mut self) {
        let now = Time::now();
        if now.since(self.released_at) >= RELEASE_PERIOD {
            self.released_at = now;
            // On failure the line stays exclusive until the next attempt.
            let _ = ioctl_tiocnxcl(&self.far);
        }
    }
}

impl Drop for PseudoTerminal {
    fn drop(&mut self) {
        // Another process may have replaced the link meanwhile.
        if fs::read_link(&self.link).is_ok_and(|target| target == self.terminal) {
            let _ = fs::remove_file(&self.link);
        }
    }
}

fn terminal_flags() -> OFlags {
    OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC | OFlags::NONBLOCK
}

/// Sets raw bytes and non-blocking access, and takes the lock that marks the line as in use.
fn set_up(near: &OwnedFd, far: &OwnedFd) -> rustix::io::Result<()> {
    let mut settings = tcgetattr(far)?;
    settings.make_raw();
    tcsetattr(far, OptionalActions::Now, &settings)?;
    fcntl_setfl(near, fcntl_getfl(near)? | OFlags::NONBLOCK)?;
    fcntl_lock(far, FlockOperation::NonBlockingLockExclusive)
}

/// Creates the symbolic link `link` to `terminal`.
fn make_link(link: &Path, terminal: &Path) -> Result<(), Failure> {
    let error = match symlink(terminal, link) {
        Ok(()) => return Ok(()),
        Err(error) => error,
    };
    let shown = link.display();
    match error.kind() {
        ErrorKind::AlreadyExists => {}
        ErrorKind::PermissionDenied => {
            let message =
                format!("no permission to create {shown}; name a path in a directory of your own");
            return Err(Failure::new(Exit::Permission, message));
        }
        _ => {
            let message = format!("creating the link {shown} failed: {error}");
            return Err(Failure::new(Exit::System, message));
        }
    }
    let old = fs::read_link(link).ok().filter(|target| target.starts_with(TERMINALS));
    let Some(old) = old else {
        let message = format!(
            "{shown} exists and is not a link to a pseudo-terminal; remove it, or name another path in `plant.wire.link`"
        );
        return Err(Failure::new(Exit::Config, message));
    };
    // If the kernel has reused the terminal number of a dead process, the old target is this terminal: opening it again would
    // release the lock.
    if old != terminal && !is_number_reused(link, &old) {
        refuse_if_in_use(link, &old)?;
    }
    replace(link, terminal).map_err(|error| {
        Failure::new(Exit::System, format!("replacing the stale link {shown} failed: {error}"))
    })
}

/// Whether `terminal` was made after the link `link` to it: the kernel has reused the terminal number of a dead process.
fn is_number_reused(link: &Path, terminal: &Path) -> bool {
    let Ok((link, terminal)) =
        fs::symlink_metadata(link).and_then(|link| Ok((link, fs::metadata(terminal)?)))
    else {
        return false;
    };
    (link.ctime(), link.ctime_nsec()) < (terminal.ctime(), terminal.ctime_nsec())
}

/// Fails if a process holds the lock on `terminal` that [`set_up`] takes. A terminal that is missing or unlocked belonged to a
/// dead process.
fn refuse_if_in_use(link: &Path, terminal: &Path) -> Result<(), Failure> {
    let shown = link.display();
    let far = match open(terminal, terminal_flags(), Mode::empty()) {
        Ok(far) => far,
        Err(Errno::ACCESS | Errno::PERM | Errno::BUSY) => {
            let message = format!(
                "{shown} links to a terminal of another user, {}; remove it if it is unused, or name another path",
                terminal.display()
            );
            return Err(Failure::new(Exit::Permission, message));
        }
        Err(_) => return Ok(()),
    };
    match fcntl_getlk(&far, &Flock::from(FlockType::WriteLock)) {
        Ok(Some(lock)) => {
            let holder = lock
                .pid
                .map_or_else(String::new, |pid| format!(" (process {})", pid.as_raw_nonzero()));
            let message = format!(
                "{shown} is in use by another emulated vehicle{holder}; stop it, or name another path"
            );
            Err(Failure::new(Exit::Peer, message))
        }
        Ok(None) | Err(_) => Ok(()),
    }
}

/// Replaces the symbolic link `link` atomically: it always points to the old or to the new terminal.
fn replace(link: &Path, terminal: &Path) -> std::io::Result<()> {
    let mut name = link.as_os_str().to_owned();
    name.push(format!(".{}", std::process::id()));
    let fresh = PathBuf::from(name);
    symlink(terminal, &fresh)?;
    fs::rename(&fresh, link).inspect_err(|_| {
        let _ = fs::remove_file(&fresh);
    })
}

fn system(what: &str, error: &Errno) -> Failure {
    Failure::new(Exit::System, format!("{what} failed: {error}"))
}
