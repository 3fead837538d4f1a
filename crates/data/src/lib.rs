//! Files of palpate: what a recipe asks for, what a run recorded, and whether a sensor is accepted.
//!
//! | module | what it is |
//! |---|---|
//! | [`recipe`] | a recipe, and its plan on a rig |
//! | [`dataset`] | the journal, which is the record, and the tables that are views of it |
//! | [`acceptance`] | a rule, what was measured, the one verdict |

#![forbid(unsafe_code)]

pub mod acceptance;
pub mod dataset;
pub mod recipe;
