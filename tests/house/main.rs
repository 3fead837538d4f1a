//! What the project asks of its own files.

mod book;
#[allow(dead_code, reason = "its parser is what is tested here")]
#[path = "../support/campaign.rs"]
mod campaign;
mod floors;
mod promises;
mod prose;
mod tiers;
mod words;
