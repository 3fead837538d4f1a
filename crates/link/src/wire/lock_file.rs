//! A lock file in a folder that every user can write in, such as the temporary folder.
//!
//! The system releases the lock when its owner ends for any reason. The owner removes the file while it holds the lock. A program
//! that had opened the file before that locks a file that is gone, so it compares the file with the path and opens the path again.
//! Only a killed owner leaves its file. [`sweep`] removes such files after a day.

use palpate_core::quantity::hexadecimal;
use sha2::{Digest, Sha256};
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::thread;
use std::time::{Duration, SystemTime};

/// Number of attempts to open a lock file that was removed or replaced.
const TRIES: usize = 10;

/// Number of times that a held lock is tried again, and the time between. A sweep holds a lock for far less than that, and an owner
/// that ends removes its file in this time.
const HELD_TRIES: usize = 5;
const HELD_EVERY: Duration = Duration::from_millis(2);

/// Age from which a file that no process holds is removed. A file that was just created may not be locked yet.
const STALE_AFTER: Duration = Duration::from_secs(24 * 3600);

/// Largest number of entries of the folder that a sweep looks at, so that a full folder doesn't delay a run: under 0.2 s.
const SWEPT_MOST: usize = 50_000;

/// Largest length of a process number, in bytes.
const NUMBER_MOST: u64 = 10;

const START: &str = "palpate-link-";
const END: &str = ".lock";

/// A lock that ends, and whose file is removed, when this value is dropped.
#[derive(Debug)]
pub(super) struct LockFile {
    path: PathBuf,
    /// `None` only during the drop.
    file: Option<File>,
}

/// Result of an attempt to lock.
#[derive(Debug)]
pub(super) enum LockAttempt {
    Taken(LockFile),
    /// Held by another process, with its process number.
    Held(Option<u32>),
}

impl LockFile {
    /// Returns the path of the file that locks something of this name.
    pub(super) fn path(folder: &Path, name: &str) -> PathBuf {
        folder.join(format!("{START}{}{END}", hexadecimal(&Sha256::digest(name))))
    }

    /// Takes the lock of a file, which is created if it is missing.
    pub(super) fn take(path: &Path) -> io::Result<LockAttempt> {
        let (mut replaced, mut held) = (0, 0);
        loop {
            let attempt = open(path)?.map(|file| LockFile::of(file, path)).transpose()?.flatten();
            match attempt {
                None if replaced < TRIES => replaced += 1,
                None => return Err(io::Error::other("it is replaced repeatedly")),
                Some(LockAttempt::Held(_)) if held < HELD_TRIES => {
                    held += 1;
                    thread::sleep(HELD_EVERY);
                }
                Some(attempt) => return Ok(attempt),
            }
        }
    }

    /// Locks an opened file. Returns `None` if the file at the path is another one by now.
    fn of(mut file: File, path: &Path) -> io::Result<Option<LockAttempt>> {
        match file.try_lock() {
            Ok(()) if is_at(&file, path)? => {
                // only for other readers; a read-only file of another user is locked too
                let _ = sign(&mut file);
                Ok(Some(LockAttempt::Taken(LockFile { path: path.to_owned(), file: Some(file) })))
            }
            Ok(()) => Ok(None),
            Err(TryLockError::WouldBlock) => Ok(Some(LockAttempt::Held(signed(&mut file)))),
            Err(TryLockError::Error(error)) => Err(error),
        }
    }
}

impl Drop for LockFile {
    fn drop(&mut self) {
        if let Some(file) = self.file.take() {
            remove(file, &self.path);
        }
    }
}

/// Removes the lock files of a folder that are older than a day and that no process holds. What can't be removed stays: it may be
/// another user's.
pub(super) fn sweep(folder: &Path, now: SystemTime) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    for entry in entries.take(SWEPT_MOST).flatten() {
        if entry.file_name().to_str().is_some_and(is_ours) {
            sweep_file(&entry.path(), now);
        }
    }
}

fn sweep_file(path: &Path, now: SystemTime) {
    let is_stale = |found: &fs::Metadata| {
        let age = found.modified().ok().and_then(|modified| now.duration_since(modified).ok());
        found.is_file() && age.is_some_and(|age| age > STALE_AFTER)
    };
    if !fs::symlink_metadata(path).is_ok_and(|found| is_stale(&found)) {
        return;
    }
    let Ok(file) = open_existing(path) else { return };
    // an owner may have signed it since
    if file.try_lock().is_ok() && file.metadata().is_ok_and(|found| is_stale(&found)) {
        remove(file, path);
    }
}

/// Whether a file has a name that only [`LockFile::path`] gives.
fn is_ours(name: &str) -> bool {
    let hash = name.strip_prefix(START).and_then(|rest| rest.strip_suffix(END));
    hash.is_some_and(|hash| hash.len() == 64 && hash.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'a'..=b'f')))
}

/// Removes a file that this process has locked, and then releases it.
#[cfg(unix)]
fn remove(file: File, path: &Path) {
    if is_at(&file, path).unwrap_or(false) {
        let _ = fs::remove_file(path); // in a folder of another user's file: the sweep of that user removes it
    }
    drop(file);
}

/// Releases a file and then removes it. The system refuses that while any program has it open, so nobody loses a lock.
#[cfg(not(unix))]
fn remove(file: File, path: &Path) {
    drop(file);
    let _ = fs::remove_file(path);
}

/// Opens a lock file, or creates it. Returns `None` if another program created or removed it at the same time. Every user can
/// write in temporary folders. So an existing file isn't opened in create mode, which Linux refuses for another user's file, and
/// links aren't followed.
fn open(path: &Path) -> io::Result<Option<File>> {
    let opened = match fs::symlink_metadata(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => make(path),
        Err(error) => Err(error),
        Ok(found) if !found.is_file() => Err(io::Error::other("it isn't a regular file")),
        Ok(_) => open_existing(path),
    };
    match opened {
        Ok(file) => Ok(Some(file)),
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => Ok(None),
        Err(error) if error.kind() == io::ErrorKind::NotFound && path.parent().is_some_and(Path::is_dir) => Ok(None),
        Err(error) => Err(error),
    }
}

fn open_existing(path: &Path) -> io::Result<File> {
    match options().write(true).open(path) {
        // made by another user who hasn't given access yet, or can't: enough for a lock
        Err(error) if error.kind() == io::ErrorKind::PermissionDenied => options().open(path),
        opened => opened,
    }
}

/// Creates a lock file that every user may open, for any default permissions of this user's files.
fn make(path: &Path) -> io::Result<File> {
    let file = options().write(true).create_new(true).open(path)?;
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        file.set_permissions(fs::Permissions::from_mode(0o666))?;
    }
    Ok(file)
}

fn options() -> OpenOptions {
    let mut options = OpenOptions::new();
    options.read(true);
    #[cfg(windows)]
    {
        use std::os::windows::fs::OpenOptionsExt;
        options.share_mode(0b011); // FILE_SHARE_READ and FILE_SHARE_WRITE, without FILE_SHARE_DELETE
    }
    options
}

/// Checks that the opened file is the file at the path. It mustn't have been removed since, and mustn't be a link to another file
/// or a hard link, because the program would write into that file.
#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> io::Result<bool> {
    use std::os::unix::fs::MetadataExt;
    let opened = file.metadata()?;
    if opened.nlink() > 1 {
        return Err(io::Error::other("it is a hard link of another file"));
    }
    let is_it = |there: fs::Metadata| (there.dev(), there.ino()) == (opened.dev(), opened.ino());
    Ok(fs::symlink_metadata(path).is_ok_and(is_it))
}

/// Returns `true`: on this system a file that is opened like this can't be removed.
#[cfg(not(unix))]
fn is_at(_: &File, _: &Path) -> io::Result<bool> {
    Ok(true)
}

fn sign(file: &mut File) -> io::Result<()> {
    file.set_len(0)?;
    file.rewind()?;
    file.write_all(std::process::id().to_string().as_bytes())
}

/// Returns the number of the process that signed the file. `None` if no process has signed it yet, or if the locked file can't be
/// read.
fn signed(file: &mut File) -> Option<u32> {
    let mut text = String::new();
    file.take(NUMBER_MOST).read_to_string(&mut text).ok()?;
    text.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn taken(path: &Path) -> Option<LockFile> {
        match LockFile::take(path).unwrap() {
            LockAttempt::Taken(lock) => Some(lock),
            LockAttempt::Held(_) => None,
        }
    }

    #[test]
    fn no_file_outlives_its_owner() {
        let folder = tempfile::tempdir().unwrap();
        let path = LockFile::path(folder.path(), "tcp stage 1");
        let owner = taken(&path).unwrap();
        assert!(path.exists() && taken(&path).is_none());
        assert!(path.exists(), "a refused program removes nothing");
        drop(owner);
        assert!(!path.exists());
        assert!(taken(&path).is_some());
    }

    #[cfg(unix)]
    #[test]
    fn lock_of_a_removed_file_does_not_count() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lock");
        let owner = taken(&path).unwrap();
        // opened before the owner ends, and locked after that
        let [second, third] = [0, 1].map(|_| open(&path).unwrap().unwrap());
        assert!(matches!(LockFile::of(open(&path).unwrap().unwrap(), &path).unwrap(), Some(LockAttempt::Held(_))));
        drop(owner);
        assert!(LockFile::of(second, &path).unwrap().is_none(), "no file is at the path");
        let fourth = taken(&path).unwrap();
        let removed = third.try_clone().unwrap();
        assert!(LockFile::of(third, &path).unwrap().is_none(), "the fourth program's file is at the path");
        assert!(taken(&path).is_none());
        // the owner of a removed file doesn't remove the new one
        drop(LockFile { path: path.clone(), file: Some(removed) });
        assert!(path.exists());
        drop(fourth);
        assert!(!path.exists());
    }

    #[test]
    fn sweep_removes_only_old_lock_files_that_no_process_holds() {
        let folder = tempfile::tempdir().unwrap();
        let now = SystemTime::now();
        let file = |name: &str, hours: u64| {
            let path = folder.path().join(name);
            let file = options().write(true).create_new(true).open(&path).unwrap();
            file.set_modified(now - Duration::from_secs(hours * 3600)).unwrap();
            (path, file)
        };
        let named = |letter: &str| format!("{START}{}{END}", letter.repeat(64));
        let (stale, _) = file(&named("a"), 25);
        let (young, _) = file(&named("b"), 23);
        let (held, lock) = file(&named("c"), 25);
        lock.try_lock().unwrap();
        let others = [format!("{START}{}{END}", "a".repeat(63)), named("A"), "palpate-link.lock".to_owned()];
        let others = others.map(|name| file(&name, 25).0);
        fs::create_dir(folder.path().join(named("d"))).unwrap();
        sweep(folder.path(), now);
        assert!(!stale.exists() && young.exists() && held.exists());
        assert!(others.iter().all(|other| other.exists()) && folder.path().join(named("d")).exists());
        drop(lock);
        sweep(folder.path(), now);
        assert!(!held.exists() && young.exists());
        sweep(&folder.path().join("missing"), now);
    }

    #[cfg(unix)]
    #[test]
    fn sweep_follows_no_link() {
        let folder = tempfile::tempdir().unwrap();
        let precious = folder.path().join("precious");
        let file = File::create(&precious).unwrap();
        let now = SystemTime::now();
        file.set_modified(now - 2 * STALE_AFTER).unwrap();
        let (by_link, by_name) = (LockFile::path(folder.path(), "1"), LockFile::path(folder.path(), "2"));
        std::os::unix::fs::symlink(&precious, &by_link).unwrap();
        fs::hard_link(&precious, &by_name).unwrap();
        sweep(folder.path(), now);
        assert!(precious.exists() && by_name.exists() && fs::symlink_metadata(by_link).is_ok());
    }
}
