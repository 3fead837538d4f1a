//! What the project asks of its own files.

mod floors;
mod promises;
mod words;
