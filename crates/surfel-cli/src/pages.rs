//! Shell completions and the manual page.

use crate::args;
use crate::failure::Failure;
use crate::stdout;
use clap_complete::Shell;

pub(crate) fn completions(shell: Shell) -> Result<(), Failure> {
    let mut bytes = Vec::new();
    clap_complete::generate(shell, &mut args::command(), "surfel", &mut bytes);
    stdout::result(&bytes)
}

/// Prints the manual page of the program, followed by the pages of its commands.
pub(crate) fn man() -> Result<(), Failure> {
    let mut command = args::command();
    command.build();
    let mut bytes = Vec::new();
    let failed = |e: std::io::Error| Failure::other(format!("can't write the manual page: {e}"));
    clap_mangen::Man::new(command.clone()).render(&mut bytes).map_err(failed)?;
    for sub in command.get_subcommands().filter(|s| s.get_name() != "help") {
        let name = format!("surfel {}", sub.get_name());
        bytes.extend(format!(".SH \"{}\"\n", name.to_uppercase()).bytes());
        let man = clap_mangen::Man::new(sub.clone().display_name(name.clone()).bin_name(name));
        man.render_synopsis_section(&mut bytes).map_err(failed)?;
        man.render_description_section(&mut bytes).map_err(failed)?;
        man.render_options_section(&mut bytes).map_err(failed)?;
    }
    stdout::result(&bytes)
}
