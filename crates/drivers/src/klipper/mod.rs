//! Klipper: a 3D printer as a stage, by Moonraker's JSON-RPC over HTTP. Based on Klipper's status reference and G-code documents, and
//! Moonraker's API documents.
//!
//! A printer finishes each motion. A motion begins 0.25 s after it was queued, and a stop of the firmware would lose the position. So each
//! script is one motion and `M400`: its answer comes when the motion has ended. A stop sends nothing.

mod moonraker;
mod stage;

pub use stage::Klipper;

#[cfg(test)]
mod tests;
