//! control
mod task;
pub use task::{Branch, Level, Task};
