//! Size of a campaign: the environment variable `PALPATE_TESTS` states it, independent of the build profile.
//!
//! - not set, or `quick`: a second or so of each campaign
//! - `full`: all of it
//! - a number: that multiple of `full`. `0.2` is a sample of a fifth, `20` a long campaign

use std::sync::LazyLock;

/// The variable, and its values.
const VARIABLE: &str = "PALPATE_TESTS";
const VALUES: &str = "`quick` (the default), `full`, or a multiple of full: `0.2` for a fifth, `20` for twenty times";

/// Size of the campaigns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Tier {
    Quick,
    /// This multiple of the full campaign.
    Share(f64),
}

impl Tier {
    /// The variable's value, if it is set.
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

    /// Number of trials: a multiple is rounded up, and never less than in the smaller of the two tiers.
    pub fn size(self, quick: usize, full: usize) -> usize {
        match self {
            Tier::Quick => quick,
            Tier::Share(share) => ((full as f64 * share).ceil() as usize).max(quick.min(full)),
        }
    }

    /// Step between trials, and never more than in the rarer of the two tiers.
    pub fn every(self, quick: usize, full: usize) -> usize {
        match self {
            Tier::Quick => quick,
            Tier::Share(share) => ((full as f64 / share).round() as usize).clamp(1, quick.max(full)),
        }
    }
}

/// The size for this run of the tests.
pub fn tier() -> Tier {
    static TIER: LazyLock<Result<Tier, String>> = LazyLock::new(|| {
        let value = std::env::var_os(VARIABLE).map(|value| value.to_string_lossy().into_owned());
        Tier::parse(value.as_deref())
    });
    TIER.clone().unwrap_or_else(|wrong| panic!("{wrong}"))
}

/// Number of trials, by default and in the full tier.
pub fn size(quick: usize, full: usize) -> usize {
    tier().size(quick, full)
}

/// Step between trials, by default and in the full tier.
pub fn every(quick: usize, full: usize) -> usize {
    tier().every(quick, full)
}

/// Whether the campaigns are small, which is the default.
pub fn is_quick() -> bool {
    tier() == Tier::Quick
}
