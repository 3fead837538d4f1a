//! Which program on which machine.

use jiff::ZonedDateTime;
use palpate_data::dataset::{Durability, Provenance};
use std::sync::OnceLock;

/// Commit that the program is built from. The library doesn't know it: it would be compiled again after every commit.
static COMMIT: OnceLock<Option<&str>> = OnceLock::new();

/// States the commit that the program is built from. The first statement counts.
pub fn built_from(commit: Option<&'static str>) {
    COMMIT.get_or_init(|| commit);
}

/// Version of the program, and the commit that it is built from if that is known.
pub(crate) fn version() -> String {
    let version = env!("CARGO_PKG_VERSION");
    commit().map_or_else(|| version.to_owned(), |commit| format!("{version} ({commit})"))
}

fn commit() -> Option<&'static str> {
    COMMIT.get().copied().flatten()
}

/// This program, on this machine, now.
pub(crate) fn session(durability: Durability) -> Provenance {
    Provenance {
        palpate: env!("CARGO_PKG_VERSION").to_owned(),
        commit: commit().map(str::to_owned),
        host: host(),
        system: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
        started: now(),
        durability,
        texts: Vec::new(),
        changes: Vec::new(),
        sound: None,
    }
}

/// Name of this machine.
#[cfg(unix)]
fn host() -> String {
    rustix::system::uname().nodename().to_string_lossy().into_owned()
}

/// Name of this machine.
#[cfg(not(unix))]
fn host() -> String {
    std::env::var("COMPUTERNAME").unwrap_or_default()
}

/// The time by the clock on the wall, with its zone. Nothing rests on it: it may be set back at any moment.
pub(crate) fn now() -> String {
    ZonedDateTime::now().to_string()
}
