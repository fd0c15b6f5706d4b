//! The workspace's own rules.

mod dependencies;
mod imports;
