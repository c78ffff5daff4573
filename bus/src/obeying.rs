//! Processes that obey an operator's signals, found in /proc by the name of one of their threads.
//!
//! Such a process names a thread after its role, its instance and its root ([`thread_name`]) once its signal handlers are
//! installed. Every user can read the name, no removal of a file changes it, and it is visible from outside the namespaces of a
//! service. A user of the process, and root, can also open the files that it holds, whether they were removed or not.

use std::fs::{self, File, OpenOptions};
use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::OFlags;
use rustix::process::{Pid, PidfdFlags, Signal, geteuid, pidfd_open, pidfd_send_signal};

use crate::message::{FNV_OFFSET, fnv1a};
use crate::paths::{InstancePaths, quoted};
use crate::stop::{self, StopSwitch};
use crate::time::Time;
use crate::topic::Role;
use crate::{member_files, private, remains, watch};

/// Signal that requests a stop. A process without a handler ignores it.
pub const STOP_SIGNAL: Signal = Signal::URG;
/// Signal that requests a landing from the daemon. It would end a process without a handler.
pub const LAND_SIGNAL: Signal = Signal::USR1;

/// Number of hexadecimal digits of each hash in a thread name \[-\]; the kernel keeps 15 characters of a name.
const DIGITS: usize = 7;

/// Maximum number of files of a process that are looked at \[-\]; ours hold some two hundred.
const MOST_FILES: usize = 1024;

/// Name of a thread of a process with this role on the instance at `paths`: `v` for the process of a vehicle or `d` for the
/// daemon, then hashes of the instance's name and of its root; `None` for a role that does not obey operators.
pub fn thread_name(paths: &InstancePaths, role: Role) -> Option<String> {
    let letter = match role {
        Role::Plant | Role::Bridge => 'v',
        Role::Daemon => 'd',
        Role::Mocap | Role::Receiver | Role::Recorder => return None,
    };
    Some(format!("{letter}{}{}", instance_digits(&paths.instance), digits(paths.root_hash())))
}

fn instance_digits(instance: &str) -> String {
    digits(fnv1a(FNV_OFFSET, instance.as_bytes()))
}

fn digits(hash: u64) -> String {
    format!("{:0DIGITS$x}", (hash ^ hash >> 32) & ((1 << (4 * DIGITS)) - 1))
}

/// Running process that obeys operators.
#[derive(Debug)]
pub struct ObeyingProcess {
    /// Process id.
    pub pid: u32,
    /// User that runs it.
    pub user: u32,
    /// Whether it is the process of a vehicle; otherwise it is a daemon.
    pub is_vehicle: bool,
    instance: String,
    root: String,
    /// Process descriptor; `None` for a process that cannot be signalled, so that processes of other users do not use up this one's open
    /// files.
    handle: Option<OwnedFd>,
}

/// Files that a process holds.
#[derive(Debug, Default)]
pub struct HeldFiles {
    /// Name and root of the process's instance, from the path of its files.
    pub paths: Option<InstancePaths>,
    /// The stop words that it reads; `None` if it has not opened them, or if they were shortened.
    pub stop: Option<StopSwitch>,
}

/// Value of the field `name` of /proc/PID/status.
fn field<'a>(status: &'a str, name: &str) -> Option<&'a str> {
    status.lines().find_map(|line| line.strip_prefix(name)).map(str::trim)
}

/// The command of `oqtal` that started the process `pid` and ends with it, such as `oqtal fly --duration 5`, as typed in a shell, with the
/// settings of its environment, and after a change to its directory if it runs in another one than this process; `None` for a process that
/// was not started in this way.
pub fn starting_command(pid: u32) -> Option<String> {
    let status = fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
    let parent = format!("/proc/{}", field(&status, "PPid:")?);
    let line = fs::read(format!("{parent}/cmdline")).ok()?;
    let line = String::from_utf8_lossy(&line);
    let (program, arguments) = line.trim_end_matches('\0').split_once('\0').unwrap_or((&line, ""));
    let is_ours = Path::new(program.trim_end_matches('\0')).file_name()? == "oqtal";
    // Its results are kept.
    let words = without_out(arguments.split_terminator('\0')).map(quoted);
    let command = ["oqtal".to_owned()].into_iter().chain(words).collect::<Vec<_>>().join(" ");
    let environment = fs::read(format!("{parent}/environ")).unwrap_or_default();
    let command = settings_in(&String::from_utf8_lossy(&environment)) + &command;
    let directory = fs::read_link(format!("{parent}/cwd")).ok();
    let other = directory.filter(|it| std::env::current_dir().ok().as_ref() != Some(it));
    let change = other.map(|it| format!("cd {} && ", quoted(&it.display().to_string())));
    is_ours.then(|| change.unwrap_or_default() + &command)
}

/// The settings in `environment`, variables that end with zero bytes, as typed before a command.
fn settings_in(environment: &str) -> String {
    let settings = environment.split_terminator('\0').filter_map(|text| {
        let (name, value) = text.split_once('=')?;
        let is_setting = name == "OQTAL_ROOT" || name.starts_with("OQTAL_") && name.contains("__");
        is_setting.then(|| format!("{name}={} ", quoted(value)))
    });
    settings.collect()
}

impl ObeyingProcess {
    /// All running processes that obey operators, of every user and instance.
    pub fn all() -> Vec<Self> {
        let entries = fs::read_dir("/proc").into_iter().flatten().flatten();
        entries.filter_map(|entry| Self::of(entry.file_name().to_str()?.parse().ok()?)).collect()
    }

    /// The process `pid`, if it obeys operators.
    fn of(pid: u32) -> Option<Self> {
        let status = fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
        let caught = u64::from_str_radix(field(&status, "SigCgt:")?, 16).ok()?;
        if caught & (1 << (STOP_SIGNAL.as_raw() - 1)) == 0 {
            return None;
        }
        let user = field(&status, "Uid:")?.split_whitespace().next()?.parse().ok()?;
        // Opened before the name is read: if the number is given to another process in between, the handle's process has ended.
        let open = || pidfd_open(Pid::from_raw(pid.cast_signed())?, PidfdFlags::empty()).ok();
        let handle = if may_signal(user) { Some(open()?) } else { None };
        let threads = fs::read_dir(format!("/proc/{pid}/task")).ok()?.flatten();
        threads
            .into_iter()
            .find_map(|thread| {
                let name = fs::read_to_string(thread.path().join("comm")).ok()?;
                let (is_vehicle, instance, root) = parse(name.trim_end())?;
                Some((is_vehicle, instance.to_owned(), root.to_owned()))
            })
            .map(|(is_vehicle, instance, root)| Self {
                pid,
                user,
                is_vehicle,
                instance,
                root,
                handle,
            })
    }

    /// Whether it runs on an instance of this name, under any root.
    pub fn is_of_instance(&self, instance: &str) -> bool {
        self.instance == instance_digits(instance)
    }

    /// Whether its instance is under this root.
    pub fn is_under(&self, paths: &InstancePaths) -> bool {
        self.is_under_hash(paths.root_hash())
    }

    /// Whether its instance is under the root that had this [hash](InstancePaths::root_hash) when it was started.
    pub fn is_under_hash(&self, root: u64) -> bool {
        self.root == digits(root)
    }

    /// Whether the instances of both are under the same root.
    pub fn has_root_of(&self, other: &Self) -> bool {
        self.root == other.root
    }

    /// Whether this process may send it a signal: it runs as the same user, or this process is root's.
    pub fn is_ours(&self) -> bool {
        may_signal(self.user)
    }

    /// Instant of its start, to a hundredth of a second; `None` if it has ended.
    pub fn started_at(&self) -> Option<Time> {
        const NANOS_PER_TICK: u64 = 10_000_000;
        let stat = fs::read_to_string(format!("/proc/{}/stat", self.pid)).ok()?;
        // Behind the name, which may contain spaces: state is field 3, the start in ticks of the boot-time clock field 22.
        let ticks: u64 = stat.rsplit(')').next()?.split_whitespace().nth(19)?.parse().ok()?;
        Some(Time::from_nanos(ticks * NANOS_PER_TICK))
    }

    /// Whether the process is still running.
    pub fn is_running(&self) -> bool {
        let Some(handle) = &self.handle else {
            return Path::new(&format!("/proc/{}", self.pid)).exists();
        };
        // A handle becomes readable when its process ends.
        let mut handle = [PollFd::new(handle, PollFlags::IN)];
        poll(&mut handle, Some(&Timespec { tv_sec: 0, tv_nsec: 0 })) == Ok(0)
    }

    /// Sends `signal` to the process; another process with the same number never receives it.
    ///
    /// # Errors
    /// The process has ended, or belongs to another user.
    pub fn signal(&self, signal: Signal) -> io::Result<()> {
        let handle = self.handle.as_ref().ok_or(io::ErrorKind::PermissionDenied)?;
        Ok(pidfd_send_signal(handle, signal)?)
    }

    /// Files that the process holds.
    ///
    /// # Errors
    /// This process may not look at it: it belongs to another user, or runs in a user namespace and this process is not root's.
    pub fn held_files(&self) -> io::Result<HeldFiles> {
        let mut held = HeldFiles::default();
        for entry in fs::read_dir(format!("/proc/{}/fd", self.pid))?.flatten().take(MOST_FILES) {
            let Ok(link) = fs::read_link(entry.path()) else { continue };
            let text = link.to_string_lossy();
            let path = Path::new(text.strip_suffix(" (deleted)").unwrap_or(&text));
            if is_stop_file(path) && held.stop.is_none() {
                held.stop = self.open(&entry.path()).and_then(StopSwitch::of_held_file).ok();
            }
            held.paths = held.paths.or_else(|| paths_of(path));
        }
        Ok(held)
    }

    /// Whether files of its instance that cannot be restored were removed: it holds a removed directory or port, or a member of the run
    /// has recorded the loss. A process that is closing its ports may count; a removal less than a second ago, or of a process that
    /// this user may not inspect, may be missed.
    pub fn has_lost_files(&self) -> bool {
        let entries =
            fs::read_dir(format!("/proc/{}/fd", self.pid)).into_iter().flatten().flatten();
        entries.take(MOST_FILES).any(|entry| {
            let Ok(link) = fs::read_link(entry.path()) else { return false };
            let text = link.to_string_lossy();
            if let Some(path) = text.strip_suffix(" (deleted)").map(Path::new) {
                let is_directory = fs::metadata(entry.path()).is_ok_and(|it| it.is_dir());
                return is_directory && (is_run(path) || self.is_home(path));
            }
            is_run(&link)
                && (private::loss(&entry.path()).is_some()
                    || !watch::removed_files(self.pid, &link).is_empty())
        })
    }

    /// Whether shared memory or the root of `paths` is another directory for this process, as in a container or a private file system;
    /// `false` if this process may not look.
    pub fn sees_other_files(&self, paths: &InstancePaths) -> bool {
        let there = format!("/proc/{}/root", self.pid);
        let identity = |path: &Path| {
            let found = fs::metadata(path).ok()?;
            Some((found.dev(), found.ino()))
        };
        let differs = |path: &Path| {
            let theirs = Path::new(&there).join(path.strip_prefix("/").unwrap_or(path));
            identity(path).zip(identity(&theirs)).is_some_and(|(ours, theirs)| ours != theirs)
        };
        differs(remains::SHARED_MEMORY.as_ref()) || differs(&paths.root)
    }

    /// Whether a directory at `path` has the name of its instance.
    fn is_home(&self, path: &Path) -> bool {
        let instance = path.file_name().and_then(|name| name.to_str());
        instance.is_some_and(|instance| self.is_of_instance(instance))
    }

    /// Opens a file that the process holds: a regular file of its own user, so that root, which may open everything, writes
    /// nothing that this user could not write.
    fn open(&self, descriptor: &Path) -> io::Result<File> {
        let is_own = |file: &fs::Metadata| file.is_file() && file.uid() == self.user;
        let flags = (OFlags::NONBLOCK | OFlags::CLOEXEC).bits().cast_signed();
        let mut options = OpenOptions::new();
        options.read(true).write(true).custom_flags(flags);
        // Checked before as well: opening another kind of file may have an effect.
        if is_own(&fs::metadata(descriptor)?) {
            let file = options.open(descriptor)?;
            if is_own(&file.metadata()?) {
                return Ok(file);
            }
        }
        Err(io::ErrorKind::PermissionDenied.into())
    }
}

/// Whether this process is permitted to signal processes of the user id `user`.
fn may_signal(user: u32) -> bool {
    geteuid().is_root() || geteuid().as_raw() == user
}

/// The `words` of a command line without `--out` and its path, and without `--force`, which permits to overwrite that path.
pub fn without_out<W: AsRef<str>>(words: impl Iterator<Item = W>) -> impl Iterator<Item = W> {
    let mut is_path = false;
    words.filter(move |word| {
        let word = word.as_ref();
        let is_of_out =
            is_path || word == "--out" || word.starts_with("--out=") || word == "--force";
        is_path = !is_path && word == "--out";
        !is_of_out
    })
}

/// Subcommand of a command line of `oqtal` whose first argument is `word`: `fly` if that is an option, or missing.
pub fn subcommand(word: &str) -> &str {
    if word.is_empty() || word.starts_with('-') { "fly" } else { word }
}

/// Role and hashes in the name of a thread; `None` for other threads.
fn parse(name: &str) -> Option<(bool, &str, &str)> {
    let (role, hashes) = name.split_at_checked(1)?;
    let is_hash = |c: u8| c.is_ascii_digit() || (b'a'..=b'f').contains(&c);
    let is_ours = hashes.len() == 2 * DIGITS && hashes.bytes().all(is_hash);
    let (instance, root) = is_ours.then(|| hashes.split_at(DIGITS))?;
    matches!(role, "v" | "d").then_some((role == "v", instance, root))
}

/// Whether `path` is that of the stop words of an instance.
fn is_stop_file(path: &Path) -> bool {
    let directory = path.parent().map(Path::as_os_str).unwrap_or_default();
    let ours = remains::shared("oqtal_");
    path.ends_with(stop::FILE)
        && directory.as_encoded_bytes().starts_with(ours.as_os_str().as_encoded_bytes())
}

/// Whether `path` is that of the private directory of a run.
fn is_run(path: &Path) -> bool {
    let ours = remains::shared("oqtal_");
    path.parent() == ours.parent()
        && path.extension().is_none()
        && path.as_os_str().as_encoded_bytes().starts_with(ours.as_os_str().as_encoded_bytes())
}

/// Paths of the instance of which `path` is the file of its members.
fn paths_of(path: &Path) -> Option<InstancePaths> {
    let directory = path.ends_with(member_files::MEMBERS).then(|| path.parent())??;
    let root = directory.parent().map(PathBuf::from)?;
    InstancePaths::new(directory.file_name()?.to_str()?, Some(&root)).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_of_the_environment_precede_the_command() {
        let environment = "HOME=/root\0OQTAL_VEHICLE__MASS_KG=0.6\0OQTAL_PEERS=1\0OQTAL_ROOT=/x\0OQTAL_A__B=c d\0";
        assert_eq!(
            settings_in(environment),
            "OQTAL_VEHICLE__MASS_KG=0.6 OQTAL_ROOT=/x OQTAL_A__B='c d' "
        );
    }

    #[test]
    fn a_thread_name_names_role_instance_and_root_in_15_characters() {
        let paths = |instance: &str, root: &str| {
            InstancePaths::new(instance, Some(Path::new(root))).unwrap()
        };
        let lab = paths("lab", "/nowhere/oqtal");
        let name = thread_name(&lab, Role::Bridge).unwrap();
        assert_eq!(name.len(), 15);
        let (is_vehicle, instance, root) = parse(&name).unwrap();
        assert!(is_vehicle);
        let daemon = thread_name(&lab, Role::Daemon).unwrap();
        assert_eq!(parse(&daemon), Some((false, instance, root)));
        assert_eq!(thread_name(&lab, Role::Mocap), None);
        for other in [paths("lab2", "/nowhere/oqtal"), paths("lab", "/nowhere/oqtal2")] {
            assert_ne!(thread_name(&other, Role::Daemon), Some(daemon.clone()));
        }
        for other in ["", "oqtal", "pages", "v0123", "x01234567890123", "v0123456789abcg", "é"] {
            assert_eq!(parse(other), None, "{other}");
        }
    }

    #[test]
    fn a_command_line_without_a_command_is_that_of_a_flight() {
        let commands = ["campaign", "fly", "--trajectory", ""].map(subcommand);
        assert_eq!(commands, ["campaign", "fly", "fly", "fly"]);
    }

    #[test]
    fn paths_of_held_files_name_the_instance_and_its_stop() {
        let held = paths_of(Path::new("/run/oqtal/lab/members")).unwrap();
        assert_eq!((held.instance.as_str(), held.root.as_path()), ("lab", Path::new("/run/oqtal")));
        assert_eq!(paths_of(Path::new("/run/oqtal/lab/stop")), None);
        assert!(is_stop_file(Path::new("/dev/shm/oqtal_lab_0_1/stop")));
        assert!(!is_stop_file(Path::new("/dev/shm/other/stop")));
        assert!(!is_stop_file(Path::new("/dev/shm/oqtal_lab_0_1/pose.count")));
    }
}
