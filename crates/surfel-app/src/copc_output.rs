//! Checks of the options for writing COPC files and shards of them.

use crate::render_options::SplatOptions;
use crate::values::Part;
use std::path::Path;
use surfel_io::ShowPath as _;
use surfel_load::Error;
use surfel_load::levels::is_shard;

/// Checks the options for writing a COPC file or a shard of one. Options for splats and text output don't apply. The
/// name of a shard must end in `.shard`.
///
/// # Errors
/// [`Error::Usage`] if an option doesn't apply, or the name is wrong.
pub fn check_copc(output: &Path, options: &SplatOptions, ascii: bool, shard: Option<Part>) -> Result<(), Error> {
    check_shard(output, shard)?;
    let mut allowed = SplatOptions { force: options.force, memory: options.memory, ..SplatOptions::default() };
    allowed.convert.columns.clone_from(&options.convert.columns);
    if ascii || *options != allowed {
        let what = "takes the points as they are, so that no flag on splats, colours or choice goes with it";
        return Err(Error::Usage(format!("-o {}: {what}", output.shown())));
    }
    Ok(())
}

/// Checks that the output's extension is `.shard` if and only if a shard is written.
///
/// # Errors
/// [`Error::Usage`] if it isn't.
pub fn check_shard(output: &Path, shard: Option<Part>) -> Result<(), Error> {
    let name = output.shown();
    match shard {
        Some(part) if !is_shard(output) => Err(Error::Usage(format!(
            "-o {name}: --shard {}/{} writes a name that ends in .shard\n  help: `surfel convert *.shard -o \
             OUT.copc.laz` combines all shards",
            part.index(),
            part.count()
        ))),
        None if is_shard(output) => {
            let what = "is the name of a shard, expected --shard I/N, or a cluster's variables that state it";
            Err(Error::Usage(format!("-o {name}: {what}")))
        }
        _ => Ok(()),
    }
}
