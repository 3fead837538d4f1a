//! The program of the user's that is started for events.

use crate::batch::Event;

/// Passes an event to the program that `[notify]` of the batch file names. Every event of a batch passes here once, after it is on
/// the disk. No program is started yet.
pub fn notify(_command: &[String], _event: &Event) {}
