//! A simulated rig, at the level of the wire: an emulator takes bytes, asks the scene, and answers with bytes.
//!
//! | module | what it is |
//! |---|---|
//! | [`scene`] | the physics of a simulated rig, pure, advanced in closed form |
//! | [`emulator`] | one for each wire protocol; never sees a driver |

#![forbid(unsafe_code)]

pub mod emulator;
pub mod scene;
