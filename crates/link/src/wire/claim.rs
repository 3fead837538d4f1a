//! Exclusive use of a real link. If two programs drove one stage, each program would move it during the other's press.
//!
//! The owner holds a lock on a file in the temporary folder. The system releases the lock when the owner ends for any reason. The
//! file stays, because its removal would take the lock from a program that has just opened it.

use super::{Link, program};
use palpate_core::quantity::hexadecimal;
use sha2::{Digest, Sha256};
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, Read, Seek, Write};
use std::net::IpAddr;
use std::path::{Path, PathBuf};

/// Number of attempts to open a lock file that was removed or replaced, for example by a cleaner of temporary folders.
const TRIES: usize = 10;

/// Largest length of a process number, in bytes.
const NUMBER_MOST: u64 = 10;

/// Real links that a rig uses exclusively, until this value is dropped. It is dropped after the drivers, and waits until their
/// programs end. A device is free for others when no program holds it any more.
#[derive(Debug, Default)]
pub struct Claims {
    claims: Vec<LinkClaim>,
}

/// Reason why a link can't be used.
#[derive(Debug, thiserror::Error)]
pub enum ClaimError {
    /// Another program uses the link.
    #[error("{link} is in use by another palpate{}: end it, or wait for it", of_process(*.process))]
    Held {
        /// Link in readable form.
        link: String,
        /// Number of the process that uses the link, if known.
        process: Option<u32>,
    },
    /// The owner of the link can't be determined.
    #[error("can't check whether {link} is in use: can't open its lock file {}: {source}; set TMPDIR to use another folder", .path.display())]
    Lock {
        /// Link in readable form.
        link: String,
        /// Lock file.
        path: PathBuf,
        /// Error of the system.
        source: io::Error,
    },
}

/// Claim of one link.
#[derive(Debug)]
struct LinkClaim {
    identity: String,
    /// Lock that ends with its owner for any reason.
    _lock: File,
}

impl Claims {
    /// Takes a link, if it is a real one. A link that is already taken for another role of the same rig stays taken. NI's devices
    /// are taken by [`Claims::take_ni`].
    ///
    /// # Errors
    /// Another program uses the link, or a lock file isn't possible.
    pub fn take(&mut self, link: &Link) -> Result<(), ClaimError> {
        match identity(link) {
            Some(identity) => self.take_in(&std::env::temp_dir(), identity, text(link)),
            None => Ok(()),
        }
    }

    /// Takes the NI devices of some physical channels, such as `Dev1/ai0:8`.
    ///
    /// # Errors
    /// Another program uses one of the devices, or a lock file isn't possible.
    pub fn take_ni(&mut self, physical: &str) -> Result<(), ClaimError> {
        for device in ni_devices(physical) {
            self.take_in(&std::env::temp_dir(), format!("daqmx {}", device.to_lowercase()), format!("daqmx {device}"))?;
        }
        Ok(())
    }

    fn take_in(&mut self, folder: &Path, identity: String, text: String) -> Result<(), ClaimError> {
        if self.claims.iter().any(|claim| claim.identity == identity) {
            return Ok(());
        }
        let path = folder.join(format!("palpate-link-{}.lock", hexadecimal(&Sha256::digest(&identity))));
        match lock(&path) {
            Ok(LockAttempt::Taken(file)) => self.claims.push(LinkClaim { identity, _lock: file }),
            Ok(LockAttempt::Held(process)) => return Err(ClaimError::Held { link: text, process }),
            Err(source) => return Err(ClaimError::Lock { link: text, path, source }),
        }
        Ok(())
    }
}

impl Drop for Claims {
    fn drop(&mut self) {
        program::wait_for_ends();
    }
}

/// Returns a text that is the same for all names of one link. `None` if the link isn't real, or if programs don't compete for
/// links of this kind.
fn identity(link: &Link) -> Option<String> {
    match link {
        Link::Sim | Link::Emulated(_) | Link::Daqmx(_) => None,
        Link::Serial { port, .. } => Some(format!("serial {}", serial_identity(port))),
        Link::Tcp { host, port } => Some(format!("tcp {} {port}", host_identity(host))),
        Link::Udp { host, port } => Some(format!("udp {} {port}", host_identity(host))),
        // a script in this folder isn't the script of the same name in another one
        Link::Process(command) => {
            let words = command.iter().map(|word| real_path(word).unwrap_or_else(|| word.clone()));
            Some(format!("process {:?}", words.collect::<Vec<_>>()))
        }
    }
}

/// An address may be written in several ways.
fn host_identity(host: &str) -> String {
    host.parse::<IpAddr>().map_or_else(|_| host.to_lowercase(), |address| address.to_string())
}

fn serial_identity(port: &str) -> String {
    let path = real_path(port).unwrap_or_else(|| port.to_owned());
    match path.strip_prefix("/dev/tty.") {
        Some(name) if cfg!(target_os = "macos") => format!("/dev/cu.{name}"), // both have the same link
        _ if cfg!(windows) => path.to_uppercase(),
        _ => path,
    }
}

/// Returns the file to which all links of a path lead.
fn real_path(path: &str) -> Option<String> {
    Some(fs::canonicalize(path).ok()?.to_string_lossy().into_owned())
}

fn ni_devices(physical: &str) -> impl Iterator<Item = &str> {
    physical.split(',').map(|channel| {
        let channel = channel.trim().trim_start_matches('/');
        channel.split_once('/').map_or(channel, |(device, _)| device)
    })
}

/// Text of a link for messages, without its speed. The speed doesn't affect who owns the link.
fn text(link: &Link) -> String {
    let text = link.to_string();
    text.split_once('?').map_or(text.clone(), |(place, _)| place.to_owned())
}

fn of_process(process: Option<u32>) -> String {
    process.map(|number| format!(" (process {number})")).unwrap_or_default()
}

/// Result of an attempt to lock.
#[derive(Debug)]
enum LockAttempt {
    Taken(File),
    /// Held by another process, with its process number.
    Held(Option<u32>),
}

fn lock(path: &Path) -> io::Result<LockAttempt> {
    for _ in 0..TRIES {
        let Some(mut file) = open(path)? else { continue };
        match file.try_lock() {
            Ok(()) if is_at(&file, path)? => {
                // only for other readers; a read-only file of another user is locked too
                let _ = sign(&mut file);
                return Ok(LockAttempt::Taken(file));
            }
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Ok(LockAttempt::Held(signed(&mut file))),
            Err(TryLockError::Error(error)) => return Err(error),
        }
    }
    Err(io::Error::other("it is replaced repeatedly"))
}

/// Opens a lock file, or creates it. Returns `None` if another program created or removed it at the same time. Every user can
/// write in temporary folders. So an existing file isn't opened in create mode, which Linux refuses for another user's file, and
/// links aren't followed.
fn open(path: &Path) -> io::Result<Option<File>> {
    let opened = match fs::symlink_metadata(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => make(path),
        Err(error) => Err(error),
        Ok(found) if !found.is_file() => Err(io::Error::other("it isn't a regular file")),
        Ok(_) => match OpenOptions::new().read(true).write(true).open(path) {
            // made by another user who hasn't given access yet, or can't: enough for a lock
            Err(error) if error.kind() == io::ErrorKind::PermissionDenied => File::open(path),
            opened => opened,
        },
    };
    match opened {
        Ok(file) => Ok(Some(file)),
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => Ok(None),
        Err(error) if error.kind() == io::ErrorKind::NotFound && path.parent().is_some_and(Path::is_dir) => Ok(None),
        Err(error) => Err(error),
    }
}

/// Creates a lock file that every user may open, for any default permissions of this user's files.
fn make(path: &Path) -> io::Result<File> {
    let file = OpenOptions::new().read(true).write(true).create_new(true).open(path)?;
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        file.set_permissions(fs::Permissions::from_mode(0o666))?;
    }
    Ok(file)
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

/// Returns `true`: on this system an open file can't be removed.
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

    fn tcp(host: &str, port: u16) -> Link {
        Link::Tcp { host: host.to_owned(), port }
    }

    fn serial(port: &str) -> Link {
        Link::parse(&format!("serial://{port}?baud=9600")).unwrap()
    }

    fn process(words: &[&str]) -> Link {
        Link::Process(words.iter().map(|word| (*word).to_owned()).collect())
    }

    fn taken(folder: &Path, link: &Link) -> Result<Claims, ClaimError> {
        let mut claims = Claims::default();
        claims.take_in(folder, identity(link).unwrap(), text(link))?;
        Ok(claims)
    }

    #[test]
    fn a_link_has_one_owner_until_that_is_dropped() {
        let folder = tempfile::tempdir().unwrap();
        let (link, other) = (serial("/dev/nothing0"), serial("/dev/nothing1"));
        for _ in 0..2 {
            let owner = taken(folder.path(), &link).unwrap();
            let text = taken(folder.path(), &link).unwrap_err().to_string();
            // on Windows nobody can read a locked file
            let process = if cfg!(windows) { String::new() } else { of_process(Some(std::process::id())) };
            let expected =
                format!("serial:///dev/nothing0 is in use by another palpate{process}: end it, or wait for it");
            assert_eq!(text, expected);
            taken(folder.path(), &other).unwrap();
            drop(owner);
        }
    }

    #[test]
    fn roles_of_one_rig_share_a_link() {
        let folder = tempfile::tempdir().unwrap();
        let mut claims = taken(folder.path(), &tcp("xps", 5001)).unwrap();
        for link in [tcp("XPS", 5001), tcp("xps", 5002)] {
            claims.take_in(folder.path(), identity(&link).unwrap(), text(&link)).unwrap();
        }
        assert_eq!(claims.claims.len(), 2);
    }

    #[test]
    fn simulated_link_is_not_claimed() {
        for link in [Link::Sim, Link::Daqmx(None)] {
            assert_eq!(identity(&link), None);
            Claims::default().take(&link).unwrap();
        }
    }

    #[test]
    fn link_is_the_same_in_every_notation() {
        let same = |one: &Link, other: &Link| identity(one) == identity(other);
        assert!(same(&tcp("Stage.Local", 1), &tcp("stage.local", 1)) && !same(&tcp("a", 1), &tcp("a", 2)));
        assert!(same(&tcp("::1", 1), &tcp("0:0:0:0:0:0:0:1", 1)));
        let udp = |host: &str| Link::Udp { host: host.to_owned(), port: 1 };
        assert!(same(&udp("Cell"), &udp("cell")) && !same(&udp("cell"), &tcp("cell", 1)));
        assert!(same(&serial("COM3"), &Link::parse("serial://COM3?baud=1200&parity=even").unwrap()));
        assert!(!same(&process(&["a b"]), &process(&["a", "b"])));
        assert_eq!(ni_devices("Dev1/ai0:3, /cDAQ1Mod2/ai1").collect::<Vec<_>>(), ["Dev1", "cDAQ1Mod2"]);
    }

    #[cfg(unix)]
    #[test]
    fn port_is_the_same_by_every_path() {
        let folder = tempfile::tempdir().unwrap();
        let (device, by_id) = (folder.path().join("ttyUSB0"), folder.path().join("usb-stage"));
        File::create(&device).unwrap();
        std::os::unix::fs::symlink(&device, &by_id).unwrap();
        let [device, by_id] = [device, by_id].map(|path| path.display().to_string());
        assert_eq!(identity(&serial(&device)), identity(&serial(&by_id)));
        assert_eq!(identity(&process(&["python3", &device])), identity(&process(&["python3", &by_id])));
    }

    #[test]
    fn missing_temporary_folder_is_named_with_advice() {
        let folder = tempfile::tempdir().unwrap();
        let missing = folder.path().join("missing");
        let text = taken(&missing, &tcp("stage", 1)).unwrap_err().to_string();
        assert!(text.contains(&missing.display().to_string()) && text.contains("TMPDIR"), "{text}");
    }

    #[cfg(unix)]
    #[test]
    fn lock_file_is_shared_by_all_users_and_nothing_else_is_written() {
        use std::os::unix::fs::{PermissionsExt, symlink};
        let folder = tempfile::tempdir().unwrap();
        drop(taken(folder.path(), &tcp("stage", 1)).unwrap());
        let path = fs::read_dir(folder.path()).unwrap().next().unwrap().unwrap().path();
        assert_eq!(path.metadata().unwrap().permissions().mode() & 0o777, 0o666);

        // a read-only handle holds the lock as well
        let held = File::open(&path).unwrap();
        held.try_lock().unwrap();
        taken(folder.path(), &tcp("stage", 1)).unwrap_err();
        drop(held);

        let precious = folder.path().join("precious");
        let tricks: [(&dyn Fn(), &str); 3] = [
            (&|| symlink(&precious, &path).unwrap(), "it isn't a regular file"),
            (&|| fs::hard_link(&precious, &path).unwrap(), "it is a hard link of another file"),
            (&|| fs::create_dir(&path).unwrap(), "it isn't a regular file"),
        ];
        for (trick, why) in tricks {
            fs::write(&precious, "precious").unwrap();
            fs::remove_file(&path).unwrap();
            trick();
            let text = taken(folder.path(), &tcp("stage", 1)).unwrap_err().to_string();
            assert!(text.contains(why), "{text}");
            assert_eq!(fs::read_to_string(&precious).unwrap(), "precious");
        }
    }

    #[cfg(unix)]
    #[test]
    fn lock_of_a_removed_file_does_not_count() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lock");
        let opened = open(&path).unwrap().unwrap();
        fs::remove_file(&path).unwrap();
        assert!(!is_at(&opened, &path).unwrap());
        File::create(&path).unwrap();
        assert!(!is_at(&opened, &path).unwrap());
        assert!(matches!(lock(&path).unwrap(), LockAttempt::Taken(_)));
    }
}
