//! How the program reaches a device: the roles of a rig as traits, and the links that carry bytes.
//!
//! | module | what it is |
//! |---|---|
//! | [`device`] | the roles as traits: stage, load cell, array |
//! | [`time`] | tokio's time, or the virtual time of a simulated run |
//! | [`wire`] | links: how bytes get there and back; NI's functions as a table |

pub mod device;
pub mod time;
pub mod wire;
