//! Processes that an operator addresses, found without the bus and without their files.

use std::io;
use std::path::PathBuf;

use oqtal_bus::error::BusError;
use oqtal_bus::obeying::{HeldFiles, ObeyingProcess};
use oqtal_bus::paths::{InstancePaths, quoted};
use oqtal_runtime::process::{Exit, Failure};
use rustix::process::{Resource, Rlimit, Signal, getrlimit, setrlimit};

/// Instance that an operator addresses.
#[derive(Clone, Debug)]
pub struct AddressedInstance {
    /// Name and root.
    pub paths: InstancePaths,
    /// Whether the operator gave the root. Otherwise the name counts under every root: a stop that reaches one vehicle too many
    /// is better than one that reaches none.
    pub has_root: bool,
}

impl AddressedInstance {
    /// Address of the instance at `paths`, such as one that the calling process observes.
    pub fn at(paths: &InstancePaths) -> Self {
        Self { paths: paths.clone(), has_root: true }
    }
}

/// Processes that obey operators, as seen from an address.
#[derive(Debug)]
pub struct Reached {
    /// Addressed processes.
    pub processes: Vec<ObeyingProcess>,
    /// Files held by each of them.
    pub held: Vec<io::Result<HeldFiles>>,
    /// Name and root of the instance on which they run, or of the address.
    pub paths: InstancePaths,
    others: Vec<ObeyingProcess>,
    address: AddressedInstance,
}

/// Processes that obey operators, found without reading a file: processes of another user that look like ours may hold many files.
#[derive(Debug)]
pub struct FoundProcesses {
    /// Addressed processes.
    pub addressed: Vec<ObeyingProcess>,
    others: Vec<ObeyingProcess>,
}

impl FoundProcesses {
    /// Searches all processes of this machine.
    pub fn search(address: &AddressedInstance) -> Self {
        allow_files();
        let AddressedInstance { paths, has_root } = address;
        let is_addressed = |process: &ObeyingProcess| {
            let is_here = !has_root || process.is_under(paths);
            process.is_ours() && process.is_of_instance(&paths.instance) && is_here
        };
        let (addressed, others) = ObeyingProcess::all().into_iter().partition(is_addressed);
        Self { addressed, others }
    }
}

impl Reached {
    /// Searches all processes of this machine, and reads the files of those that are addressed.
    pub fn find(address: &AddressedInstance) -> Self {
        Self::of(FoundProcesses::search(address), address)
    }

    /// Reads the files of the addressed processes. Root opens the files that they hold, but nothing in a directory of theirs.
    pub fn of(found: FoundProcesses, address: &AddressedInstance) -> Self {
        let FoundProcesses { addressed: processes, others } = found;
        let paths = &address.paths;
        let held: Vec<_> = processes.iter().map(ObeyingProcess::held_files).collect();
        let from_files = held.iter().flatten().filter_map(|files| files.paths.clone());
        let known = std::iter::once(paths.clone()).chain(from_files).chain(under_roots(paths));
        let is_theirs = |paths: &InstancePaths| processes.iter().any(|p| p.is_under(paths));
        let found = known.into_iter().find(is_theirs).unwrap_or_else(|| paths.clone());
        Self { processes, held, paths: found, others, address: address.clone() }
    }

    /// Names and roots of the instances of the addressed processes, the first that of [`Self::paths`].
    pub fn places(&self) -> Vec<InstancePaths> {
        let mut places = vec![self.paths.clone()];
        for paths in self.held.iter().flatten().filter_map(|files| files.paths.as_ref()) {
            if places.iter().all(|place| place.root_hash() != paths.root_hash()) {
                places.push(paths.clone());
            }
        }
        places
    }

    /// Name and root of an instance of this name and user under another root than the one addressed; `None` if there is none.
    pub fn elsewhere(&self) -> Option<InstancePaths> {
        let paths = &self.address.paths;
        let is_same = |process: &&ObeyingProcess| {
            process.is_ours() && process.is_of_instance(&paths.instance)
        };
        let root = root_of(self.others.iter().find(is_same)?, paths)?;
        Some(InstancePaths { root, ..paths.clone() })
    }

    /// Whether a daemon was found.
    pub fn has_daemon(&self) -> bool {
        self.processes.iter().any(|process| !process.is_vehicle)
    }

    /// Roots of the instances that were reached; none if the addressed one is the only one.
    pub fn told_roots(&self, address: &AddressedInstance) -> Vec<PathBuf> {
        let roots: Vec<_> = self.places().into_iter().map(|place| place.root).collect();
        if roots == [address.paths.root.clone()] { Vec::new() } else { roots }
    }

    /// Whether a daemon was found under the root of the command.
    pub fn has_addressed_daemon(&self) -> bool {
        self.processes.iter().any(|process| !process.is_vehicle && process.is_under(&self.paths))
    }

    /// Whether a daemon was found without a process of its vehicle.
    pub fn lacks_vehicle(&self) -> bool {
        let has_vehicle = |daemon: &ObeyingProcess| {
            self.processes.iter().any(|it| it.is_vehicle && it.has_root_of(daemon))
        };
        self.processes.iter().any(|process| !process.is_vehicle && !has_vehicle(process))
    }

    /// Whether no daemon was found, or one without a process of its vehicle.
    pub fn lacks_process(&self) -> bool {
        !self.has_daemon() || self.lacks_vehicle()
    }

    /// Failure of `command` without an addressed process; `nobody` states this. Another user's process on the instance is a
    /// missing permission.
    pub fn nobody(&self, command: &str, nobody: String) -> Failure {
        if let Some(failure) = self.forbidden(command) {
            return failure;
        }
        let mut lines = vec![nobody, format!("  searched: all processes; {}", self.searched())];
        lines.extend(self.others.iter().map(|other| format!("  running: {}", place_of(other))));
        Failure::new(Exit::Peer, lines.join("\n"))
    }

    /// Failure of `command` that reached no process, since the bus refuses with `error`.
    pub fn unreachable(&self, command: &str, error: BusError) -> Failure {
        let place = &self.place_for_root();
        self.forbidden(command).unwrap_or_else(|| match error {
            BusError::Permission { path } => Failure::new(
                Exit::Permission,
                format!(
                    "{command}: no permission for {}; run `sudo oqtal ctl {command} {place}`",
                    path.display()
                ),
            ),
            error => error.into(),
        })
    }

    /// Failure of `command` because another user runs the instance, under the addressed root or, if nobody whom this user reaches runs
    /// it, under another; `None` otherwise.
    fn forbidden(&self, command: &str) -> Option<Failure> {
        let AddressedInstance { paths, has_root } = &self.address;
        let is_here = |process: &&ObeyingProcess| process.is_under(paths);
        let is_theirs = |process: &&ObeyingProcess| {
            !process.is_ours() && process.is_of_instance(&paths.instance)
        };
        let (here, elsewhere): (Vec<_>, Vec<_>) =
            self.others.iter().filter(is_theirs).partition(is_here);
        let is_elsewhere = here.is_empty() && (!has_root || self.elsewhere().is_none());
        let forbidden = if is_elsewhere { elsewhere } else { here };
        let first = forbidden.first()?;
        let root = root_of(first, paths);
        let is_of_first = |it: &&&ObeyingProcess| it.has_root_of(first) && it.user == first.user;
        let names: Vec<_> = forbidden.iter().filter(is_of_first).map(|it| name_of(it)).collect();
        let place = match &root {
            Some(root) => format!(" in {}", root.display()),
            None if *has_root => " under another root".to_owned(),
            None => String::new(),
        };
        let (instance, user) = (&paths.instance, first.user);
        // Without a root the name counts under every root.
        let flag = root
            .filter(|_| *has_root)
            .map(|root| format!(" --root {}", quoted(&root.display().to_string())));
        let mut message = format!(
            "{command}: instance `{instance}` runs{place} as user {user}: no permission for {}; run `sudo oqtal ctl {command} --instance \
             {instance}{}`",
            names.join(" and "),
            flag.unwrap_or_default()
        );
        let others = forbidden.iter().filter(|process| !is_of_first(process));
        message.extend(others.map(|process| format!("\n  also {}", place_of(process))));
        Some(Failure::new(Exit::Permission, message))
    }

    /// Flags by which root, whose default is another one, addresses the instance.
    fn place_for_root(&self) -> String {
        let AddressedInstance { paths: InstancePaths { instance, root }, has_root } = &self.address;
        match has_root {
            true => format!("--instance {instance} --root {}", quoted(&root.display().to_string())),
            false => format!("--instance {instance}"),
        }
    }

    /// Roots of the instances that this machine may have.
    fn searched(&self) -> String {
        let mut roots = vec![self.address.paths.root.clone()];
        for root in InstancePaths::default_roots() {
            if !roots.contains(&root) {
                roots.push(root);
            }
        }
        let names: Vec<_> = roots.iter().map(|root| root.display().to_string()).collect();
        names.join(", ")
    }
}

/// Line of a status that names the root of the instance at `paths`, and those under which others of this name run; `None` if none does.
pub fn namesakes(paths: &InstancePaths) -> Option<String> {
    let all = ObeyingProcess::all();
    let is_other = |process: &&ObeyingProcess| {
        process.is_of_instance(&paths.instance) && !process.is_under(paths)
    };
    let mut roots = Vec::new();
    for process in all.iter().filter(is_other) {
        let root = root_of(process, paths);
        let root = root.map_or_else(|| "an unknown root".to_owned(), |it| it.display().to_string());
        if !roots.contains(&root) {
            roots.push(root);
        }
    }
    let place = format!("{:<10} under {}", "instance", paths.root.display());
    (!roots.is_empty())
        .then(|| format!("{place}; others of this name run under {}", roots.join(" and ")))
}

/// Sends `signal` to each of `processes`; returns a line with the result for each.
pub fn signal_all<'a>(
    signal: Signal,
    processes: impl IntoIterator<Item = &'a ObeyingProcess>,
) -> Vec<String> {
    let report = |process: &ObeyingProcess| {
        let result = process.signal(signal).map_or_else(|e| e.to_string(), |()| "sent".into());
        format!("signal to {}: {result}", name_of(process))
    };
    processes.into_iter().map(report).collect()
}

/// Raises the number of files that this process may open to its maximum: each process found needs one, and any user can start
/// processes that look like ours.
fn allow_files() {
    let Rlimit { maximum, .. } = getrlimit(Resource::Nofile);
    // With the present limit, fewer paths to the vehicle work.
    let _ = setrlimit(Resource::Nofile, Rlimit { current: maximum, maximum });
}

/// The instance of this name under each default root.
fn under_roots(paths: &InstancePaths) -> impl Iterator<Item = InstancePaths> {
    let instance = paths.instance.clone();
    let under = move |root: PathBuf| InstancePaths { instance: instance.clone(), root };
    InstancePaths::default_roots().into_iter().map(under)
}

/// Root of the instance of `process`: that of `paths`, a default one, or one that its files name.
pub fn root_of(process: &ObeyingProcess, paths: &InstancePaths) -> Option<PathBuf> {
    let held = process.held_files().ok().and_then(|files| files.paths);
    let mut known = std::iter::once(paths.clone()).chain(under_roots(paths)).chain(held);
    known.find(|paths| process.is_under(paths)).map(|paths| paths.root)
}

/// Role and number of a process.
pub fn name_of(process: &ObeyingProcess) -> String {
    let role = if process.is_vehicle { "the vehicle's process" } else { "the daemon," };
    format!("{role} {}", process.pid)
}

/// Role, number, user and, as far as it can be read, instance of a process.
pub fn place_of(process: &ObeyingProcess) -> String {
    let paths = process.held_files().ok().and_then(|files| files.paths);
    let place = paths.map_or_else(String::new, |paths| {
        format!(", instance `{}` in {}", paths.instance, paths.root.display())
    });
    format!("{} of user {}{place}", name_of(process), process.user)
}
