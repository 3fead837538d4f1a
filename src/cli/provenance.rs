//! Which program on which machine.

use jiff::Zoned;
use palpate_data::dataset::{Durability, Provenance};

/// This program, on this machine, now.
pub(super) fn session(durability: Durability) -> Provenance {
    Provenance {
        palpate: env!("CARGO_PKG_VERSION").to_owned(),
        commit: option_env!("PALPATE_COMMIT").map(str::to_owned),
        host: gethostname::gethostname().to_string_lossy().into_owned(),
        system: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
        started: now(),
        durability,
        texts: Vec::new(),
        changes: Vec::new(),
    }
}

/// The time by the clock on the wall, with its zone. Nothing rests on it: it may be set back at any moment.
pub(super) fn now() -> String {
    Zoned::now().to_string()
}
