//! Files of a run folder. Each is a regular file with one name, opened without following a link.
//!
//! A link planted by an attacker could redirect a write to outside the folder, and so could a second name of a file. Both are
//! refused with an error that names the file. The folder itself may be a link.

use std::fs::{self, File, Metadata, OpenOptions, TryLockError};
use std::io::{self, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};

/// Opens a file for reading.
///
/// # Errors
/// An error of the operating system, or [`ErrorKind::InvalidInput`] if it isn't a regular file with one name.
pub fn open(path: &Path) -> io::Result<File> {
    opened(path, OpenOptions::new().read(true))
}

/// Opens a file for reading and appending.
///
/// # Errors
/// The same as for [`open`].
pub(crate) fn open_to_append(path: &Path) -> io::Result<File> {
    opened(path, OpenOptions::new().read(true).append(true))
}

/// Whether a path leads to an open file; `None` if it leads to nothing. Systems other than Unix have no number that the standard
/// library can compare: there the answer is yes if there is anything.
///
/// # Errors
/// An error of the operating system.
pub(super) fn is_at(path: &Path, file: &File) -> io::Result<Option<bool>> {
    match path.symlink_metadata() {
        Ok(named) => Ok(Some(is_same(&named, &file.metadata()?))),
        Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => Ok(None),
        Err(error) => Err(error),
    }
}

/// Opens a file for appending, and creates it if it doesn't exist.
///
/// # Errors
/// The same as for [`open`].
pub(crate) fn open_or_create(path: &Path) -> io::Result<File> {
    match open_to_append(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => {
            OpenOptions::new().append(true).create_new(true).open(path)
        }
        opened => opened,
    }
}

/// Reads a text of at most `most_bytes` bytes. If the text is longer, one byte more than this is read.
///
/// # Errors
/// The same as for [`open`], or the text isn't UTF-8.
pub fn read_text(path: &Path, most_bytes: u64) -> io::Result<String> {
    let mut text = String::new();
    open(path)?.take(most_bytes + 1).read_to_string(&mut text)?;
    Ok(text)
}

/// Checks whether a path is free, or is a regular file with one name.
///
/// # Errors
/// An error of the operating system, or the kind of object that is at the path.
pub fn check_replaceable(path: &Path) -> io::Result<()> {
    match path.symlink_metadata() {
        Ok(found) => check(path, &found),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(()),
        Err(error) => Err(error),
    }
}

/// Checks that a file can be written. Its path and the path of its temporary file must be free, or contain a regular file with
/// one name.
///
/// # Errors
/// Returns the errors of [`check_replaceable`].
pub(super) fn check_place(path: &Path) -> io::Result<()> {
    check_replaceable(path)?;
    check_replaceable(&beside(path))
}

/// Path at which a file is written before it is renamed to its final path.
fn beside(path: &Path) -> PathBuf {
    path.with_file_name(format!(".{}.new", path.file_name().unwrap_or_default().to_string_lossy()))
}

/// Advice for an error from a file of a run.
pub(super) fn advice(why: &io::Error) -> &'static str {
    match why.kind() {
        ErrorKind::InvalidInput => "remove it, or replace it by a copy of the file; nothing was changed",
        _ => {
            "free disk space or correct the permissions, then continue with `palpate resume`: acknowledged presses are stored"
        }
    }
}

/// A file being written. It is written next to its final path, then renamed, so it is replaced completely or not at all.
pub(crate) struct Draft {
    out: io::BufWriter<File>,
    beside: PathBuf,
    path: PathBuf,
}

impl Draft {
    /// Begins to write a file for a path. Removes drafts that a killed program left next to the path.
    ///
    /// # Errors
    /// An error of the operating system, or the path is something other than a regular file with one name.
    pub(crate) fn new(path: &Path) -> io::Result<Draft> {
        check_place(path)?;
        let beside = beside(path);
        match fs::remove_file(&beside) {
            Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
            _ => {}
        }
        Ok(Draft { out: io::BufWriter::new(File::create_new(&beside)?), beside, path: path.to_owned() })
    }

    /// Appends text to the draft.
    ///
    /// # Errors
    /// An error of the operating system.
    pub(crate) fn write(&mut self, text: &str) -> io::Result<()> {
        self.out.write_all(text.as_bytes())
    }

    /// Renames the draft to its final path.
    ///
    /// # Errors
    /// An error of the operating system.
    pub(crate) fn publish(mut self) -> io::Result<()> {
        self.out.flush()?;
        fs::rename(&self.beside, &self.path)
    }
}

/// Locks a draft, a file or a folder, unless it is locked or gone. The system releases the lock when the program ends for any
/// reason. On Windows a folder has no handle, and a locked file can't be read: nothing is locked there, and what a killed program
/// left stays.
pub(super) fn lock_draft(draft: &Path) -> io::Result<Option<Option<File>>> {
    if cfg!(not(unix)) {
        return Ok(Some(None));
    }
    let file = match File::open(draft) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        opened => opened?,
    };
    match file.try_lock() {
        Ok(()) => {}
        Err(TryLockError::WouldBlock) => return Ok(None),
        // on a disk without locks no program removes a draft
        Err(TryLockError::Error(error)) if error.kind() == ErrorKind::Unsupported => return Ok(Some(None)),
        Err(TryLockError::Error(error)) => return Err(error),
    }
    Ok((is_at(draft, &file)? == Some(true)).then_some(Some(file)))
}

/// Removes the drafts of files that killed programs left in a folder. What can't be read or removed stays.
fn remove_left(folder: &Path) {
    let is_draft =
        |name: &str| name.strip_prefix(".palpate-").and_then(|rest| rest.strip_suffix(".new")).is_some_and(is_number);
    for entry in fs::read_dir(folder).into_iter().flatten().filter_map(Result::ok) {
        if is_draft(&entry.file_name().to_string_lossy())
            && entry.file_type().is_ok_and(|kind| kind.is_file())
            && let Ok(Some(Some(_lock))) = lock_draft(&entry.path())
        {
            let _ = fs::remove_file(entry.path());
        }
    }
}

pub(super) fn is_number(text: &str) -> bool {
    !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit())
}

/// Replaces a file's content completely or not at all, once the content is on the disk. Keeps the permissions of the replaced
/// file. The content is first written next to the file, under a name of this program's own.
///
/// # Errors
/// An error of the operating system; no draft is then left next to the file.
pub fn place(path: &Path, content: impl AsRef<[u8]>) -> io::Result<()> {
    let beside = path.with_file_name(format!(".palpate-{}.new", std::process::id()));
    remove_left(path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new(".")));
    let mut file = File::create_new(&beside)?; // the file there belongs to somebody
    let mut fill = || {
        let removed = || io::Error::other("another program removed the draft");
        let _lock = lock_draft(&beside)?.ok_or_else(removed)?;
        match fs::metadata(path) {
            Ok(before) => file.set_permissions(before.permissions())?,
            Err(error) if error.kind() == ErrorKind::NotFound => {}
            Err(error) => return Err(error),
        }
        file.write_all(content.as_ref())?;
        file.sync_all()?;
        fs::rename(&beside, path)
    };
    let placed = fill();
    if placed.is_err() {
        let _ = fs::remove_file(&beside); // the first error is the one to report
    }
    placed
}

/// Opens a regular file with one name. Then checks again that the opened file is the file at this path.
fn opened(path: &Path, options: &OpenOptions) -> io::Result<File> {
    check(path, &path.symlink_metadata()?)?; // reading a pipe would block
    let file = options.open(path)?;
    let (named, held) = (path.symlink_metadata()?, file.metadata()?);
    check(path, &named)?;
    if !is_same(&named, &held) {
        return Err(invalid(path, "was replaced while it was opened"));
    }
    Ok(file)
}

fn check(path: &Path, found: &Metadata) -> io::Result<()> {
    let kind = found.file_type();
    if kind.is_symlink() {
        return Err(invalid(path, "is a link"));
    }
    if !kind.is_file() {
        return Err(invalid(path, if kind.is_dir() { "is a folder" } else { "isn't a regular file" }));
    }
    match names(found) {
        1 | 0 => Ok(()), // 0: removed by another program meanwhile
        count => Err(invalid(path, &format!("has {count} names (hard links)"))),
    }
}

fn invalid(path: &Path, is: &str) -> io::Error {
    let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
    io::Error::new(ErrorKind::InvalidInput, format!("{name} {is}: expected a regular file with one name"))
}

#[cfg(unix)]
fn names(found: &Metadata) -> u64 {
    std::os::unix::fs::MetadataExt::nlink(found)
}

#[cfg(unix)]
fn is_same(named: &Metadata, held: &Metadata) -> bool {
    use std::os::unix::fs::MetadataExt as _;
    (named.dev(), named.ino()) == (held.dev(), held.ino())
}

/// Number of a file's names: always 1. On Windows it would need other system calls, and creating links there requires a special
/// right.
#[cfg(not(unix))]
fn names(_: &Metadata) -> u64 {
    1
}

#[cfg(not(unix))]
fn is_same(_: &Metadata, _: &Metadata) -> bool {
    true
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    #[test]
    fn links_and_second_names_are_refused_by_name_and_nothing_outside_changes() {
        let folder = tempfile::tempdir().unwrap();
        let (outside, inside) = (folder.path().join("outside"), folder.path().join("inside"));
        fs::write(&outside, "kept").unwrap();
        let plant_link = || symlink(&outside, &inside).unwrap();
        let plant_name = || fs::hard_link(&outside, &inside).unwrap();
        for (plant, is) in [(&plant_link as &dyn Fn(), "inside is a link"), (&plant_name, "inside has 2 names")] {
            plant();
            let draft = || Draft::new(&inside).map(drop);
            let left_over = || Draft::new(&folder.path().join("nside")).map(drop);
            for refused in
                [open(&inside).map(drop), open_to_append(&inside).map(drop), open_or_create(&inside).map(drop), draft()]
            {
                let error = refused.unwrap_err();
                assert_eq!(error.kind(), ErrorKind::InvalidInput);
                assert!(error.to_string().starts_with(is), "{error}");
            }
            fs::rename(&inside, folder.path().join(".nside.new")).unwrap();
            assert!(left_over().unwrap_err().to_string().starts_with(".nside.new"));
            fs::remove_file(folder.path().join(".nside.new")).unwrap();
            assert_eq!(fs::read_to_string(&outside).unwrap(), "kept");
        }
    }

    #[test]
    fn drafts_of_files_that_killed_programs_left_are_removed_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        for name in [".palpate-4000000.new", ".palpate-1.new", ".palpate-x.new", "palpate-1.new", ".mine.new"] {
            fs::write(path(name), "half").unwrap();
        }
        fs::create_dir(path(".palpate-2.new")).unwrap();
        let held = lock_draft(&path(".palpate-1.new")).unwrap();
        assert!(held.is_some());
        place(&path("a.palpate"), "whole").unwrap();
        assert!(!path(".palpate-4000000.new").exists());
        for name in [".palpate-1.new", ".palpate-x.new", "palpate-1.new", ".mine.new", ".palpate-2.new", "a.palpate"] {
            assert!(path(name).exists(), "{name}");
        }
    }

    #[test]
    fn leftover_temporary_file_is_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csv");
        fs::write(folder.path().join(".a.csv.new"), "half").unwrap();
        let mut draft = Draft::new(&path).unwrap();
        draft.write("whole").unwrap();
        draft.publish().unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "whole");
        assert!(!folder.path().join(".a.csv.new").exists());
    }
}
