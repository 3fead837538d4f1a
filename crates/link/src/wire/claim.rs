//! Exclusive use of a real device. If two programs drove one stage, each program would move it during the other's press.
//!
//! A claim is a lock of what a link opens ([`opened`]), in a file of the temporary folder ([`lock_file`]).

use super::lock_file::{self, LockAttempt, LockFile};
use super::opened::{ni_device, ni_devices, opened, started};
use super::{Link, program};
use std::io;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// Real devices that a rig uses exclusively, until this value is dropped. It is dropped after the drivers, and waits until their
/// programs end. A device is free for others when no program holds it any more.
#[derive(Debug, Default)]
pub struct Claims {
    claims: Vec<Claim>,
}

/// Reason why a link can't be used.
#[derive(Debug, thiserror::Error)]
pub enum ClaimError {
    /// Another program uses the device.
    #[error("{link} is in use by another palpate{}: end it, or wait for it{advice}", of_process(*.process))]
    Held {
        /// Link in readable form.
        link: String,
        /// Number of the process that uses the device, if known.
        process: Option<u32>,
        /// What else to do, if the lock may be of another device.
        advice: &'static str,
    },
    /// Two roles of the rig name one serial port differently.
    #[error(
        "{link} and {other} are one port: if both roles are one device, write the same `link` for both; otherwise correct one"
    )]
    Twice {
        /// Link in readable form.
        link: String,
        /// The other name of the port.
        other: String,
    },
    /// The owner of the device can't be determined.
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

/// What to do if a program drives another device than the other palpate's, though nothing in its command differs.
const OF_PROGRAM: &str = "; if this program drives another device, state in its command what differs, such as the port";

/// Claim of one device.
#[derive(Debug)]
struct Claim {
    /// What is claimed, the same text for every name of the device.
    opened: String,
    /// Link in readable form.
    link: String,
    _lock: LockFile,
}

impl Claims {
    /// Takes what a link opens, if that is a real device that only one program can use. A device that is already taken for another
    /// role of the same rig stays taken. The program of a stage is taken by [`Claims::take_program`], NI's devices by
    /// [`Claims::take_ni`].
    ///
    /// # Errors
    /// Another program uses the device, the rig has another name for its serial port, or a lock file isn't possible.
    pub fn take(&mut self, link: &Link) -> Result<(), ClaimError> {
        self.take_link_in(&std::env::temp_dir(), link)
    }

    /// Takes the program of a stage: the same command drives the same stage.
    ///
    /// # Errors
    /// Another palpate has started this program, or a lock file isn't possible.
    pub fn take_program(&mut self, command: &[String]) -> Result<(), ClaimError> {
        let opened = started(command, std::env::var_os("PATH").as_deref());
        let link = Link::Process(command.to_owned()).to_string();
        self.take_in(&std::env::temp_dir(), opened, link, OF_PROGRAM)
    }

    /// Takes the NI devices of some physical channels, such as `Dev1/ai0:8`.
    ///
    /// # Errors
    /// Another program uses one of the devices, or a lock file isn't possible.
    pub fn take_ni(&mut self, physical: &str) -> Result<(), ClaimError> {
        for device in ni_devices(physical) {
            self.take_in(&std::env::temp_dir(), ni_device(device), format!("daqmx {device}"), "")?;
        }
        Ok(())
    }

    fn take_link_in(&mut self, folder: &Path, link: &Link) -> Result<(), ClaimError> {
        let Some(opened) = opened(link) else { return Ok(()) };
        let text = text(link);
        let same = self.claims.iter().find(|claim| claim.opened == opened && claim.link != text);
        if let (Link::Serial { .. }, Some(same)) = (link, same) {
            return Err(ClaimError::Twice { link: text, other: same.link.clone() });
        }
        self.take_in(folder, opened, text, "")
    }

    fn take_in(&mut self, folder: &Path, opened: String, link: String, advice: &'static str) -> Result<(), ClaimError> {
        if self.claims.iter().any(|claim| claim.opened == opened) {
            return Ok(());
        }
        if self.claims.is_empty() {
            lock_file::sweep(folder, SystemTime::now());
        }
        let path = LockFile::path(folder, &opened);
        match LockFile::take(&path) {
            Ok(LockAttempt::Taken(lock)) => self.claims.push(Claim { opened, link, _lock: lock }),
            Ok(LockAttempt::Held(process)) => return Err(ClaimError::Held { link, process, advice }),
            Err(source) => return Err(ClaimError::Lock { link, path, source }),
        }
        Ok(())
    }
}

impl Drop for Claims {
    fn drop(&mut self) {
        program::wait_for_ends();
    }
}

/// Text of a link for messages, without its speed. The speed doesn't affect who owns the link.
fn text(link: &Link) -> String {
    let text = link.to_string();
    text.split_once('?').map_or(text.clone(), |(place, _)| place.to_owned())
}

fn of_process(process: Option<u32>) -> String {
    process.map(|number| format!(" (process {number})")).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::{self, File};

    fn tcp(host: &str, port: u16) -> Link {
        Link::Tcp { host: host.to_owned(), port }
    }

    fn serial(port: &str) -> Link {
        Link::parse(&format!("serial://{port}?baud=9600")).unwrap()
    }

    fn taken(folder: &Path, link: &Link) -> Result<Claims, ClaimError> {
        let mut claims = Claims::default();
        claims.take_link_in(folder, link)?;
        Ok(claims)
    }

    /// Process in the message of a refusal. On Windows nobody can read a locked file.
    fn us() -> String {
        if cfg!(windows) { String::new() } else { of_process(Some(std::process::id())) }
    }

    #[test]
    fn a_device_has_one_owner_until_that_is_dropped() {
        let folder = tempfile::tempdir().unwrap();
        let (link, other) = (serial("/dev/nothing0"), serial("/dev/nothing1"));
        for _ in 0..2 {
            let owner = taken(folder.path(), &link).unwrap();
            let text = taken(folder.path(), &link).unwrap_err().to_string();
            let expected =
                format!("serial:///dev/nothing0 is in use by another palpate{}: end it, or wait for it", us());
            assert_eq!(text, expected);
            taken(folder.path(), &other).unwrap();
            drop(owner);
            assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "no file outlives its owner");
        }
    }

    #[test]
    fn a_stage_program_has_one_owner_with_a_way_out() {
        let folder = tempfile::tempdir().unwrap();
        let take =
            |claims: &mut Claims| claims.take_in(folder.path(), "program".into(), "process stage".into(), OF_PROGRAM);
        let mut owner = Claims::default();
        take(&mut owner).unwrap();
        assert_eq!(
            take(&mut Claims::default()).unwrap_err().to_string(),
            format!(
                "process stage is in use by another palpate{}: end it, or wait for it; if this program drives another device, \
                 state in its command what differs, such as the port",
                us()
            )
        );
    }

    #[test]
    fn roles_of_one_rig_share_a_device() {
        let folder = tempfile::tempdir().unwrap();
        let mut claims = taken(folder.path(), &tcp("localhost", 5001)).unwrap();
        for link in [tcp("127.0.0.1", 5001), tcp("localhost", 5002)] {
            claims.take_link_in(folder.path(), &link).unwrap();
        }
        assert_eq!(claims.claims.len(), 2);
        taken(folder.path(), &tcp("127.0.0.1", 5002)).unwrap_err();
    }

    #[cfg(unix)]
    #[test]
    fn one_port_with_two_names_is_refused_in_one_rig_and_in_two() {
        let folder = tempfile::tempdir().unwrap();
        let by_id = folder.path().join("usb-stage");
        std::os::unix::fs::symlink("/dev/null", &by_id).unwrap();
        let by_id = by_id.display().to_string();
        let mut claims = taken(folder.path(), &serial("/dev/null")).unwrap();
        claims.take_link_in(folder.path(), &serial("/dev/null")).unwrap();
        assert_eq!(
            claims.take_link_in(folder.path(), &serial(&by_id)).unwrap_err().to_string(),
            format!(
                "serial://{by_id} and serial:///dev/null are one port: if both roles are one device, write the same `link` for \
                 both; otherwise correct one"
            )
        );
        let text = taken(folder.path(), &serial(&by_id)).unwrap_err().to_string();
        assert_eq!(text, format!("serial://{by_id} is in use by another palpate{}: end it, or wait for it", us()));
    }

    #[test]
    fn what_programs_share_is_not_claimed() {
        let folder = tempfile::tempdir().unwrap();
        let thermometer = Link::Process(vec!["python3".to_owned(), "temperature.py".to_owned()]);
        for link in [Link::Sim, Link::Daqmx(None), thermometer] {
            taken(folder.path(), &link).unwrap();
            assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "{link}");
        }
    }

    #[test]
    fn files_of_earlier_versions_are_removed_after_a_day() {
        let folder = tempfile::tempdir().unwrap();
        let old = LockFile::path(folder.path(), "process python3 thermometer.py");
        let day = std::time::Duration::from_secs(25 * 3600);
        File::create(&old).unwrap().set_modified(SystemTime::now() - day).unwrap();
        let _owner = taken(folder.path(), &tcp("stage", 1)).unwrap();
        assert!(!old.exists());
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
        let owner = taken(folder.path(), &tcp("stage", 1)).unwrap();
        let path = fs::read_dir(folder.path()).unwrap().next().unwrap().unwrap().path();
        assert_eq!(path.metadata().unwrap().permissions().mode() & 0o777, 0o666);
        drop(owner);

        // a read-only handle holds the lock as well
        fs::write(&path, "").unwrap();
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
}
