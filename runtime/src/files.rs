//! Files made by a process, protected against other users: links are not followed, and directories are new.

use std::fs::{DirBuilder, File, OpenOptions};
use std::io::{self, Read};
use std::os::unix::fs::{DirBuilderExt, FileTypeExt, MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

use rustix::fs::OFlags;

/// Maximum length of a secret \[bytes\].
const LONGEST_SECRET: u64 = 1024;

/// Highest number of a numbered directory \[-\].
const HIGHEST_NUMBER: u32 = 99_999;

/// Creates a directory that only this user can access.
///
/// # Errors
/// The name exists already, or the directory cannot be made.
pub fn create_private_directory(path: &Path) -> io::Result<()> {
    DirBuilder::new().mode(0o700).create(path)
}

/// Creates the first directory `NAME-N` in `parent` that does not exist, N from 1.
///
/// # Errors
/// The directory cannot be made, or no number is free.
pub fn create_numbered(parent: &Path, name: &str) -> io::Result<PathBuf> {
    for number in 1..=HIGHEST_NUMBER {
        let directory = parent.join(format!("{name}-{number}"));
        match std::fs::create_dir(&directory) {
            Ok(()) => return Ok(directory),
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            Err(error) => return Err(error),
        }
    }
    Err(io::Error::other("no free number; remove old directories"))
}

/// Refuses a directory that is a link or belongs to another user, who could replace its files by links.
///
/// # Errors
/// The directory is refused, or does not exist.
pub fn check_own_directory(path: &Path) -> io::Result<()> {
    let metadata = std::fs::symlink_metadata(path)?;
    let reason = if !metadata.is_dir() {
        "not a directory"
    } else if metadata.uid() != rustix::process::geteuid().as_raw() {
        "belongs to another user"
    } else {
        return Ok(());
    };
    Err(io::Error::new(io::ErrorKind::PermissionDenied, reason))
}

/// Creates a file, or truncates an existing one; a link is not followed.
///
/// # Errors
/// The path is a link, or the file cannot be created.
pub fn create(path: &Path) -> io::Result<File> {
    open_unlinked(OpenOptions::new().write(true).truncate(true), path)
}

/// Opens a file to read and write it, and creates it if it does not exist; a link is not followed.
///
/// # Errors
/// The path is a link, or the file cannot be opened.
pub fn open(path: &Path) -> io::Result<File> {
    open_unlinked(OpenOptions::new().read(true).write(true), path)
}

/// Opens a file with `options`, creating it if it does not exist; a link is not followed.
fn open_unlinked(options: &mut OpenOptions, path: &Path) -> io::Result<File> {
    let flags = (OFlags::NOFOLLOW | OFlags::CLOEXEC).bits().cast_signed();
    options.create(true).custom_flags(flags).open(path).map_err(|error| {
        match error.raw_os_error() == Some(rustix::io::Errno::LOOP.raw_os_error()) {
            true => {
                io::Error::new(io::ErrorKind::PermissionDenied, "a link, which is not followed")
            }
            false => error,
        }
    })
}

/// Checks that [`create`] will be able to write a file; its content is kept. A pipe is not opened: its reader would interpret the end of
/// the check as the end of the file.
///
/// # Errors
/// Like [`create`].
pub fn check_writable(path: &Path) -> io::Result<()> {
    if path.symlink_metadata().is_ok_and(|found| found.file_type().is_fifo()) {
        return Ok(());
    }
    open_unlinked(OpenOptions::new().append(true), path).map(drop)
}

/// Removes a file, which may be missing.
///
/// # Errors
/// The file exists, and cannot be removed.
pub fn remove(path: &Path) -> io::Result<()> {
    match std::fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
}

/// Device and inode of the file at `path`; `None` without one. No other file has them while this one is in use.
pub fn identity(path: &Path) -> Option<(u64, u64)> {
    std::fs::symlink_metadata(path).ok().map(|file| (file.dev(), file.ino()))
}

/// Removes the file at `path` if it is the one of this [`identity`]: another process may have created its own file there.
pub fn remove_same(path: &Path, file: Option<(u64, u64)>) {
    if identity(path) == file {
        let _ = std::fs::remove_file(path);
    }
}

/// Writes `content` to a file, which is replaced as a whole: if writing fails, an existing file stays as it was, and no part of a new one
/// is left. A link is not followed; a pipe or a device is written directly.
///
/// # Errors
/// Like [`create`], or the disk is full.
pub fn write(path: &Path, content: impl AsRef<[u8]>) -> io::Result<()> {
    let found = path.symlink_metadata().ok();
    if found.as_ref().is_some_and(|found| !found.is_file()) {
        return io::Write::write_all(&mut create(path)?, content.as_ref());
    }
    if found.is_some() {
        check_writable(path)?;
    }
    let (draft, mut file) = match create_draft(path) {
        // The directory is not writable, and the file is.
        Err(error) if error.kind() == io::ErrorKind::PermissionDenied && found.is_some() => {
            return io::Write::write_all(&mut create(path)?, content.as_ref());
        }
        made => made?,
    };
    let written = io::Write::write_all(&mut file, content.as_ref())
        .and_then(|()| found.map_or(Ok(()), |found| keep_access(&file, &found)))
        .and_then(|()| std::fs::rename(&draft, path));
    written.inspect_err(|_| drop(std::fs::remove_file(&draft)))
}

/// Sets the owner of `file`, if this user is permitted to, and its permissions to those of the file that it replaces.
fn keep_access(file: &File, found: &std::fs::Metadata) -> io::Result<()> {
    // Ignored: only root may give a file away.
    let _ = std::os::unix::fs::fchown(file, Some(found.uid()), Some(found.gid()));
    file.set_permissions(found.permissions())
}

/// Creates a new file beside `path`, to be renamed to it.
fn create_draft(path: &Path) -> io::Result<(PathBuf, File)> {
    let mut number = 0_u32;
    loop {
        let draft = path.with_file_name(format!(".oqtal-{}-{number}", std::process::id()));
        match OpenOptions::new().write(true).create_new(true).open(&draft) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => number += 1,
            opened => return opened.map(|file| (draft, file)),
        }
    }
}

/// Reads the text of a file that only its owner, this user or root, may read.
///
/// # Errors
/// Other users may read or write it, it is not a regular file, it is too long, or it cannot be read.
pub fn read_secret(path: &Path) -> io::Result<String> {
    let flags = (OFlags::NONBLOCK | OFlags::CLOEXEC).bits().cast_signed();
    let file = OpenOptions::new().read(true).custom_flags(flags).open(path)?;
    let metadata = file.metadata()?;
    let is_own = [0, rustix::process::geteuid().as_raw()].contains(&metadata.uid());
    let reason = if !metadata.is_file() {
        "not a file"
    } else if !is_own {
        "belongs to another user"
    } else if metadata.mode() & 0o077 != 0 {
        "others may read or write it; run chmod 600 on it"
    } else {
        let mut text = String::new();
        file.take(LONGEST_SECRET).read_to_string(&mut text)?;
        return Ok(text);
    };
    Err(io::Error::new(io::ErrorKind::PermissionDenied, reason))
}

#[cfg(test)]
mod tests {
    use std::fs::Permissions;
    use std::os::unix::fs::PermissionsExt;

    use super::*;

    #[test]
    fn nothing_is_written_or_made_through_a_link() {
        let directory = tempfile::tempdir().unwrap();
        let path = |name: &str| directory.path().join(name);
        std::fs::write(path("target"), "kept").unwrap();
        std::os::unix::fs::symlink(path("target"), path("link")).unwrap();
        let refused = write(&path("link"), "lost").unwrap_err();
        assert_eq!(refused.to_string(), "a link, which is not followed");
        assert!(check_writable(&path("link")).is_err());
        assert_eq!(std::fs::read_to_string(path("target")).unwrap(), "kept");
        write(&path("file"), "new").unwrap();
        check_writable(&path("file")).unwrap();
        assert_eq!(std::fs::read_to_string(path("file")).unwrap(), "new");
        std::fs::set_permissions(path("file"), Permissions::from_mode(0o640)).unwrap();
        write(&path("file"), "newer").unwrap();
        assert_eq!(std::fs::metadata(path("file")).unwrap().mode() & 0o777, 0o640);
        let drafts = std::fs::read_dir(directory.path()).unwrap().flatten();
        assert!(!drafts.into_iter().any(|it| it.file_name().as_encoded_bytes()[0] == b'.'));
        std::os::unix::fs::symlink(directory.path(), path("place")).unwrap();
        assert!(create_private_directory(&path("place")).is_err());
        assert!(check_own_directory(&path("place")).is_err());
        create_private_directory(&path("own")).unwrap();
        check_own_directory(&path("own")).unwrap();
        assert_eq!(std::fs::metadata(path("own")).unwrap().mode() & 0o777, 0o700);
    }
}
