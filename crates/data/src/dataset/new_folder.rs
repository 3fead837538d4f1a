//! A new folder of a run or a batch, which appears complete by one rename.

use super::DatasetError;
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
    let draft = new_draft(parent, name)?;
    let made = fill(&draft).and_then(|()| sync_folder(&draft)).and_then(|()| publish(&draft, out, parent, name));
    let path = made.inspect_err(|_| _ = fs::remove_dir_all(&draft))?;
    sync_folder(parent)?;
    Ok(path)
}

/// Creates an empty folder next to the final one, with a name that isn't mistaken for a run's. The folder of a killed program is
/// left unchanged, because another program may be working in it.
fn new_draft(parent: &Path, name: &str) -> Result<PathBuf, DatasetError> {
    let process = std::process::id();
    for number in 1..=NAMES_MAX {
        let draft = parent.join(format!(".{name}.{process}-{number}.new"));
        match fs::create_dir(&draft) {
            Ok(()) => return Ok(draft),
            Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
            Err(error) => return Err(DatasetError::io("making", draft)(error)),
        }
    }
    Err(DatasetError::Exists { path: parent.join(format!(".{name}.{process}.new")) })
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
    fn a_folder_is_a_hidden_draft_until_all_of_it_is_there() {
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
}
