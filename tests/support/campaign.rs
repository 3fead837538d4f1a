//! How much a campaign does: the environment variable `PALPATE_TESTS` says it, and no build profile.
//!
//! - not set, or `quick`: a second or so of each campaign
//! - `full`: all of it
//! - a number: that multiple of `full`. `0.2` is a sample of a fifth, `20` a long campaign

use std::sync::LazyLock;

/// The variable, and what it may be.
const VARIABLE: &str = "PALPATE_TESTS";
const VALUES: &str = "`quick` (the default), `full`, or a multiple of full: `0.2` for a fifth, `20` for twenty times";

/// How much of the campaigns is wanted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Tier {
    Quick,
    /// Of all that a campaign does, so many times as much.
    Share(f64),
}

impl Tier {
    /// What the variable asks for, where it is set.
    pub fn parse(value: Option<&str>) -> Result<Tier, String> {
        match value {
            None | Some("quick") => Ok(Tier::Quick),
            Some("full") => Ok(Tier::Share(1.0)),
            Some(number) => match number.parse::<f64>() {
                Ok(share) if share.is_finite() && share > 0.0 => Ok(Tier::Share(share)),
                _ => Err(format!("{VARIABLE} is {number:?}, but it takes {VALUES}")),
            },
        }
    }

    /// How many of something are tried: a multiple is rounded up, and never fewer than in the smaller of the two tiers.
    pub fn size(self, quick: usize, full: usize) -> usize {
        match self {
            Tier::Quick => quick,
            Tier::Share(share) => ((full as f64 * share).ceil() as usize).max(quick.min(full)),
        }
    }

    /// Each so-many-th of something is tried, and never fewer than in the rarer of the two tiers.
    pub fn every(self, quick: usize, full: usize) -> usize {
        match self {
            Tier::Quick => quick,
            Tier::Share(share) => ((full as f64 / share).round() as usize).clamp(1, quick.max(full)),
        }
    }
}

/// What this run of the tests is asked for.
pub fn tier() -> Tier {
    static TIER: LazyLock<Result<Tier, String>> = LazyLock::new(|| {
        let value = std::env::var_os(VARIABLE).map(|value| value.to_string_lossy().into_owned());
        Tier::parse(value.as_deref())
    });
    TIER.clone().unwrap_or_else(|wrong| panic!("{wrong}"))
}

/// How many of something are tried, by default and in the full tier.
pub fn size(quick: usize, full: usize) -> usize {
    tier().size(quick, full)
}

/// Each so-many-th of something is tried, by default and in the full tier.
pub fn every(quick: usize, full: usize) -> usize {
    tier().every(quick, full)
}

/// Whether little is wanted, which is the default.
pub fn is_quick() -> bool {
    tier() == Tier::Quick
}
