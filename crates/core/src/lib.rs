//! What every part of palpate speaks of: quantities with units, and the mechanics of an elastic cover.
//!
//! | module | what it is |
//! |---|---|
//! | [`quantity`] | the vocabulary, with units and frames |
//! | [`mechanics`] | linear elasticity: what a taxel reads of a load |
//! | [`algebra`] | small matrices |
//! | [`parallel`] | work on all processors |

#![forbid(unsafe_code)]

pub mod algebra;
pub mod mechanics;
pub mod parallel;
pub mod quantity;
