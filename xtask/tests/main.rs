//! Rules of the workspace.

mod dependencies;
mod imports;
mod packages;
mod wording;
