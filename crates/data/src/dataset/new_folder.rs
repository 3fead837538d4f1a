//! A new folder of a run or a batch, which appears complete by one rename.

use super::journal::JOURNAL;
use super::{DatasetError, files};
use std::fs::{self, File};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// Largest number of names that are tried for a new folder: `name`, `name-2`, ...
const NAMES_MAX: usize = 100_000;

/// Creates a folder at `out`, or under `runs/` with the first free name: `name`, `name-2`, ... `fill` writes its content to a
/// draft. The complete folder then appears by one rename.
///
/// # Errors
/// The folder already exists or can't be created, or an error of `fill`. No draft is then left.
pub fn make_folder(
    out: Option<&Path>,
    name: &str,
    fill: impl FnOnce(&Path) -> Result<(), DatasetError>,
) -> Result<PathBuf, DatasetError> {
    let parent = match out {
        Some(out) => out.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new(".")),
        None => Path::new("runs"),
    };
    if parent.is_file() {
        return Err(DatasetError::NoFolder { path: parent.to_owned() });
    }
    if let Some(out) = out.filter(|out| out.symlink_metadata().is_ok()) {
        return Err(DatasetError::Exists { path: out.to_owned() });
    }
    make_folders(parent)?;
    remove_left(parent);
    let (draft, _lock) = new_draft(parent, name)?;
    let made = fill(&draft).and_then(|()| sync_folder(&draft)).and_then(|()| publish(&draft, out, parent, name));
    let path = made.inspect_err(|_| _ = fs::remove_dir_all(&draft))?;
    sync_folder(parent)?;
    Ok(path)
}

/// Creates an empty folder next to the final one, with a name that isn't mistaken for a run's, and locks it for this program.
fn new_draft(parent: &Path, name: &str) -> Result<(PathBuf, Option<File>), DatasetError> {
    let process = std::process::id();
    for number in 1..=NAMES_MAX {
        let draft = parent.join(format!(".{name}.{process}-{number}.new"));
        match fs::create_dir(&draft) {
            Ok(()) => match files::lock_draft(&draft) {
                Ok(None) => {} // another program took it for an abandoned one
                Ok(Some(lock)) => return Ok((draft, lock)),
                Err(error) => {
                    let _ = fs::remove_dir(&draft); // the first error is the one to report
                    return Err(DatasetError::io("locking", draft)(error));
                }
            },
            Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
            Err(error) => return Err(DatasetError::io("making", draft)(error)),
        }
    }
    Err(DatasetError::Exists { path: parent.join(format!(".{name}.{process}.new")) })
}

/// Removes the drafts of runs and batches that killed programs left in a folder. What can't be read or removed stays.
fn remove_left(parent: &Path) {
    let entries = fs::read_dir(parent).into_iter().flatten().filter_map(Result::ok);
    let is_folder = |entry: &fs::DirEntry| entry.file_type().is_ok_and(|kind| kind.is_dir());
    for entry in entries.filter(|entry| is_draft(&entry.file_name().to_string_lossy()) && is_folder(entry)) {
        let draft = entry.path();
        // the journal is the first file in it
        let is_empty = || fs::read_dir(&draft).is_ok_and(|mut entries| entries.next().is_none());
        if let Ok(Some(Some(_lock))) = files::lock_draft(&draft)
            && (draft.join(JOURNAL).is_file() || is_empty())
        {
            let _ = fs::remove_dir_all(&draft);
        }
    }
}

/// Whether a name is that of a draft: `.name.process-number.new`.
fn is_draft(name: &str) -> bool {
    let inner = name.strip_prefix('.').and_then(|rest| rest.strip_suffix(".new"));
    let numbers = inner.and_then(|inner| inner.rsplit_once('.')).and_then(|(_, numbers)| numbers.split_once('-'));
    numbers.is_some_and(|(process, number)| files::is_number(process) && files::is_number(number))
}

/// Renames the draft to its final path. A folder that isn't empty is never replaced, because the system refuses this.
fn publish(draft: &Path, out: Option<&Path>, parent: &Path, name: &str) -> Result<PathBuf, DatasetError> {
    if let Some(out) = out {
        fs::rename(draft, out).map_err(DatasetError::io("renaming to", out))?;
        return Ok(out.to_owned());
    }
    for number in 1..=NAMES_MAX {
        let path = parent.join(if number == 1 { name.to_owned() } else { format!("{name}-{number}") });
        if path.symlink_metadata().is_ok() {
            continue;
        }
        match fs::rename(draft, &path) {
            Ok(()) => return Ok(path),
            Err(_) if path.exists() => continue, // another run was faster
            Err(error) => return Err(DatasetError::io("renaming to", path)(error)),
        }
    }
    Err(DatasetError::Exists { path: parent.join(name) })
}

/// Creates a folder and its parent folders, and syncs each to disk.
fn make_folders(path: &Path) -> Result<(), DatasetError> {
    let missing: Vec<&Path> =
        path.ancestors().take_while(|path| !path.as_os_str().is_empty() && !path.exists()).collect();
    fs::create_dir_all(path).map_err(DatasetError::io("making", path))?;
    for made in missing {
        sync_folder(made.parent().filter(|above| !above.as_os_str().is_empty()).unwrap_or(Path::new(".")))?;
    }
    Ok(())
}

/// Syncs a folder to disk, which makes a rename in it permanent. On Windows folders have no handles and this isn't necessary.
fn sync_folder(path: &Path) -> Result<(), DatasetError> {
    if cfg!(unix) {
        File::open(path).and_then(|folder| folder.sync_all()).map_err(DatasetError::io("flushing", path))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn run_folder_is_a_hidden_draft_until_complete() {
        let home = tempfile::tempdir().unwrap();
        let names = || {
            let entries = fs::read_dir(home.path()).unwrap().map(|entry| entry.unwrap().file_name());
            entries.map(|name| name.to_string_lossy().into_owned()).collect::<Vec<String>>()
        };
        let fill = |draft: &Path| {
            fs::write(draft.join("a"), "all of it").unwrap();
            let there = names();
            assert!(there.len() == 1 && there[0].starts_with('.') && there[0].ends_with(".new"), "{there:?}");
            Ok(())
        };
        let out = home.path().join("run");
        assert_eq!(make_folder(Some(&out), "name", fill).unwrap(), out);
        assert_eq!(
            (names(), fs::read_to_string(out.join("a")).unwrap()),
            (vec!["run".to_owned()], "all of it".to_owned())
        );
        let unfilled = |draft: &Path| Err(DatasetError::Missing { path: draft.to_owned() });
        make_folder(Some(&home.path().join("other")), "name", unfilled).unwrap_err();
        assert_eq!(names(), ["run"], "nothing is left of one that can't be filled");
    }

    #[cfg(unix)]
    #[test]
    fn drafts_that_killed_programs_left_are_removed_and_nothing_else() {
        let home = tempfile::tempdir().unwrap();
        let folder = |name: &str, file: Option<&str>| {
            fs::create_dir(home.path().join(name)).unwrap();
            file.into_iter().for_each(|file| fs::write(home.path().join(name).join(file), "text").unwrap());
        };
        folder(".run.4000000-1.new", Some(JOURNAL));
        folder(".a.b.12-3.new", None);
        let kept = [".run.7-2.new", ".mine.new", ".x.1-.new", "run.1-1.new", ".held.9-1.new", ".file.1-1.new", "aim"];
        folder(kept[0], Some("somebody's"));
        kept[1..5].iter().for_each(|name| folder(name, Some(JOURNAL)));
        fs::write(home.path().join(kept[5]), "text").unwrap();
        folder(kept[6], Some(JOURNAL));
        std::os::unix::fs::symlink(home.path().join("aim"), home.path().join(".link.1-1.new")).unwrap();
        let held = files::lock_draft(&home.path().join(".held.9-1.new")).unwrap();
        assert!(held.is_some());
        let fill = |draft: &Path| {
            assert!(files::lock_draft(draft).unwrap().is_none(), "a draft in use is locked");
            fs::write(draft.join("a"), "").map_err(DatasetError::io("writing", draft))
        };
        make_folder(Some(&home.path().join("new")), "name", fill).unwrap();
        let mut left: Vec<String> =
            fs::read_dir(home.path()).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        left.sort();
        let mut expected = [kept.as_slice(), &[".link.1-1.new", "new"]].concat();
        expected.sort_unstable();
        assert_eq!(left, expected);
        assert!(home.path().join("aim").join(JOURNAL).is_file());
    }
}
