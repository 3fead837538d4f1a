//! The files of a run folder: each is a regular file with one name, opened without following a link.
//!
//! A link that somebody planted could lead a write out of the folder, and so could a second name of a file. Both are refused by
//! name. The folder itself may be a link.

use std::fs::{self, File, Metadata, OpenOptions};
use std::io::{self, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};

/// Opens a file to be read.
///
/// # Errors
/// The operating system's, or [`ErrorKind::InvalidInput`] for what isn't a regular file with one name.
pub fn open(path: &Path) -> io::Result<File> {
    opened(path, OpenOptions::new().read(true))
}

/// Opens a file to be added to.
///
/// # Errors
/// As of [`open`].
pub fn open_to_append(path: &Path) -> io::Result<File> {
    opened(path, OpenOptions::new().append(true))
}

/// Opens a file to be added to, and makes it if it isn't there.
///
/// # Errors
/// As of [`open`].
pub fn open_or_create(path: &Path) -> io::Result<File> {
    match open_to_append(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => {
            OpenOptions::new().append(true).create_new(true).open(path)
        }
        opened => opened,
    }
}

/// Reads a text of so many bytes at most; of a longer one as many and one more.
///
/// # Errors
/// As of [`open`], or what isn't UTF-8.
pub fn read_text(path: &Path, most_bytes: u64) -> io::Result<String> {
    let mut text = String::new();
    open(path)?.take(most_bytes + 1).read_to_string(&mut text)?;
    Ok(text)
}

/// Whether a path holds nothing, or a regular file with one name.
///
/// # Errors
/// The operating system's, or what it is instead.
pub fn check_replaceable(path: &Path) -> io::Result<()> {
    match path.symlink_metadata() {
        Ok(found) => check(path, &found),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(()),
        Err(error) => Err(error),
    }
}

/// Whether a file can be written: its place and the one beside it hold nothing, or a regular file with one name.
///
/// # Errors
/// As of [`check_replaceable`].
pub(super) fn check_place(path: &Path) -> io::Result<()> {
    check_replaceable(path)?;
    check_replaceable(&beside(path))
}

/// Where a file is written before it is renamed to its place.
fn beside(path: &Path) -> PathBuf {
    path.with_file_name(format!(".{}.new", path.file_name().unwrap_or_default().to_string_lossy()))
}

/// What to do about an error that came back from a file of a run.
pub(super) fn advice(why: &io::Error) -> &'static str {
    match why.kind() {
        ErrorKind::InvalidInput => "remove it, or replace it by a copy of the file; nothing was changed",
        _ => {
            "free disk space or correct the permissions, then continue with `palpate resume`: acknowledged presses are stored"
        }
    }
}

/// A file on its way: written beside its place, then renamed there, whole or not at all.
pub struct Draft {
    out: io::BufWriter<File>,
    beside: PathBuf,
    path: PathBuf,
}

impl Draft {
    /// Begins to write what is to stand at a path. What a killed program left beside it is removed.
    ///
    /// # Errors
    /// The operating system's, or a place that holds something other than a regular file with one name.
    pub fn new(path: &Path) -> io::Result<Draft> {
        check_place(path)?;
        let beside = beside(path);
        match fs::remove_file(&beside) {
            Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
            _ => {}
        }
        Ok(Draft { out: io::BufWriter::new(File::create_new(&beside)?), beside, path: path.to_owned() })
    }

    /// Adds to it.
    ///
    /// # Errors
    /// The operating system's.
    pub fn write(&mut self, text: &str) -> io::Result<()> {
        self.out.write_all(text.as_bytes())
    }

    /// Puts it in its place.
    ///
    /// # Errors
    /// The operating system's.
    pub fn publish(mut self) -> io::Result<()> {
        self.out.flush()?;
        fs::rename(&self.beside, &self.path)
    }
}

/// Puts a content in a file's place when it is on the disk, whole or not at all, with the permissions of the file that it replaces. It
/// is written beside it first, under a name of this program's own.
///
/// # Errors
/// The operating system's; nothing is left beside the place then.
pub fn place(path: &Path, content: impl AsRef<[u8]>) -> io::Result<()> {
    let beside = path.with_file_name(format!(".palpate-{}.new", std::process::id()));
    let mut file = File::create_new(&beside)?; // what lies there is somebody's
    let permitted = match fs::metadata(path) {
        Ok(before) => file.set_permissions(before.permissions()),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(()),
        Err(error) => Err(error),
    };
    let placed = permitted
        .and_then(|()| file.write_all(content.as_ref()))
        .and_then(|()| file.sync_all())
        .and_then(|()| fs::rename(&beside, path));
    if placed.is_err() {
        let _ = fs::remove_file(&beside); // the first error is the one to report
    }
    placed
}

/// Opens what is a regular file with one name, and looks again whether it is that file which was opened.
fn opened(path: &Path, options: &OpenOptions) -> io::Result<File> {
    check(path, &path.symlink_metadata()?)?; // a pipe would be waited for
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

/// Windows counts a file's names only for who opens it by other means; making links needs a right of its own there.
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
    fn what_a_killed_program_left_beside_a_file_is_replaced() {
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
