//! A pseudo-terminal in place of the radio's serial port, and the symbolic link by which it is found.

use std::fs;
use std::io::ErrorKind;
use std::os::fd::OwnedFd;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};

use oqtal_bus::time::{Span, Time};
use oqtal_runtime::process::{Exit, Failure};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{FlockOperation, Mode, OFlags, fcntl_getfl, fcntl_lock, fcntl_setfl, open};
use rustix::io::Errno;
use rustix::process::{Flock, FlockType, fcntl_getlk};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, ioctl_tiocnxcl, tcgetattr, tcsetattr};

/// Where the kernel keeps pseudo-terminals.
const TERMINALS: &str = "/dev/pts/";
/// Nobody looks at the line less often.
const LONGEST_WAIT: Span = Span::from_millis(20);

/// The vehicle's end of a serial line. The link goes when this is dropped.
#[derive(Debug)]
pub struct PseudoTerminal {
    near: OwnedFd,
    /// Kept open: the line stays as it was set while nobody is at the other end. It carries the lock by which the link is known to
    /// be in use.
    far: OwnedFd,
    terminal: PathBuf,
    link: PathBuf,
}

impl PseudoTerminal {
    /// Opens a line and makes `link` lead to its other end. A link that a dead process left is replaced.
    ///
    /// # BitErrors
    /// Another emulated vehicle is at `link` (exit code 75), something else is (78), or the operating system refuses (71, 77).
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
        Ok(Self { near, far, terminal, link: link.to_path_buf() })
    }

    /// Sleeps until `until`, or, if it is to listen, until somebody wrote; returns early now and then.
    ///
    /// # BitErrors
    /// The operating system refuses.
    pub fn wait(&self, until: Time, listen: bool) -> Result<(), Failure> {
        let left = until.since(Time::now()).clamp(Span::ZERO, LONGEST_WAIT).to_duration();
        let timeout = Timespec::try_from(left).unwrap_or_default();
        let mut fds = [PollFd::new(&self.near, PollFlags::IN)];
        let fds = if listen { &mut fds[..] } else { &mut [] };
        match poll(fds, Some(&timeout)) {
            Ok(_) | Err(Errno::INTR) => Ok(()),
            Err(error) => Err(system("waiting for the line", &error)),
        }
    }

    /// Reads what was written at the other end, as far as it fits; the number of bytes.
    ///
    /// # BitErrors
    /// The operating system refuses.
    pub fn read(&self, buffer: &mut [u8]) -> Result<usize, Failure> {
        match rustix::io::read(&self.near, buffer) {
            Ok(bytes) => Ok(bytes),
            Err(Errno::AGAIN | Errno::INTR | Errno::IO) => Ok(0),
            Err(error) => Err(system("reading the line", &error)),
        }
    }

    /// Writes; what nobody reads is lost, as on a serial port.
    ///
    /// # BitErrors
    /// The operating system refuses.
    pub fn write(&self, bytes: &[u8]) -> Result<(), Failure> {
        match rustix::io::write(&self.near, bytes) {
            Ok(_) | Err(Errno::AGAIN | Errno::INTR | Errno::IO) => Ok(()),
            Err(error) => Err(system("writing to the line", &error)),
        }
    }

    /// Opens the line to all again: a host that is killed leaves it in exclusive mode, which would last as long as this end.
    pub fn readmit(&self) {
        // Refused, the line stays as it is.
        let _ = ioctl_tiocnxcl(&self.far);
    }
}

impl Drop for PseudoTerminal {
    fn drop(&mut self) {
        // Another may have taken the place meanwhile.
        if fs::read_link(&self.link).is_ok_and(|target| target == self.terminal) {
            let _ = fs::remove_file(&self.link);
        }
    }
}

fn terminal_flags() -> OFlags {
    OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC | OFlags::NONBLOCK
}

/// Bytes pass as they are, and nobody waits for them; the lock says that somebody is here.
fn set_up(near: &OwnedFd, far: &OwnedFd) -> rustix::io::Result<()> {
    let mut settings = tcgetattr(far)?;
    settings.make_raw();
    tcsetattr(far, OptionalActions::Now, &settings)?;
    fcntl_setfl(near, fcntl_getfl(near)? | OFlags::NONBLOCK)?;
    fcntl_lock(far, FlockOperation::NonBlockingLockExclusive)
}

/// Makes `link` lead to `terminal`.
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
                format!("no permission to make {shown}: name a path in a directory of yours");
            return Err(Failure::new(Exit::Permission, message));
        }
        _ => {
            let message = format!("making the link {shown} failed: {error}");
            return Err(Failure::new(Exit::System, message));
        }
    }
    let old = fs::read_link(link).ok().filter(|target| target.starts_with(TERMINALS));
    let Some(old) = old else {
        let message = format!(
            "{shown} is there already and no link to a pseudo-terminal: remove it, or name another path in `vehicle.wire.link`"
        );
        return Err(Failure::new(Exit::Config, message));
    };
    // Where the number of a dead process's terminal was free again, the terminal is this one: looking would unlock it.
    if old != terminal {
        refuse_company(link, &old)?;
    }
    replace(link, terminal).map_err(|error| {
        Failure::new(Exit::System, format!("replacing the stale link {shown} failed: {error}"))
    })
}

/// A terminal that is gone, or that nobody has locked as [`set_up`] does, was a dead process's.
fn refuse_company(link: &Path, terminal: &Path) -> Result<(), Failure> {
    let shown = link.display();
    let far = match open(terminal, terminal_flags(), Mode::empty()) {
        Ok(far) => far,
        Err(Errno::ACCESS | Errno::PERM | Errno::BUSY) => {
            let message = format!(
                "{shown} leads to a terminal of somebody else, {}: remove it if nobody uses it, or name another path",
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
                "an emulated vehicle is at {shown} already{holder}: stop it, or name another path"
            );
            Err(Failure::new(Exit::Peer, message))
        }
        Ok(None) | Err(_) => Ok(()),
    }
}

/// In one step: whoever looks finds the old link or the new one.
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
