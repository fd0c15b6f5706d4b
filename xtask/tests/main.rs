//! Rules of the workspace.

mod dependencies;
mod functions;
mod imports;
mod packages;
mod wording;
