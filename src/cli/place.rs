use std::fs;
use std::io::{self, Write};
use std::path::Path;

/// Puts a text in a file's place, whole or not at all: it is written to `beside` first, which must be free, and flushed. A file that
/// was there leaves its permissions.
pub fn place(path: &Path, beside: &Path, text: &str) -> io::Result<()> {
    let mut file = fs::File::create_new(beside)?; // what lies there is somebody's
    let permitted = || match fs::metadata(path) {
        Ok(before) => file.set_permissions(before.permissions()),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        Err(error) => Err(error),
    };
    let written = permitted()
        .and_then(|()| file.write_all(text.as_bytes()))
        .and_then(|()| file.sync_all())
        .and_then(|()| fs::rename(beside, path));
    if written.is_err() {
        let _ = fs::remove_file(beside); // the first error is the one to tell
    }
    written
}
