//! What the project asks of its own files.

mod book;
mod promises;
mod prose;
mod tiers;
mod words;
