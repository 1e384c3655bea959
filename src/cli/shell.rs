//! What a shell and `man` want to know of this program.

use std::path::{Path, PathBuf};

use clap::CommandFactory;
use clap_complete::Shell;
use flatlight::{Error, Result, files};

use super::{Arguments, Common, say};

/// Prints a completion script.
pub fn completions(shell: Shell) {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut Arguments::command(), "flatlight", &mut script);
    say::print(&String::from_utf8_lossy(&script));
}

/// Writes `flatlight.1` and a page for each command.
pub fn man(out: &Path, common: &Common) -> Result<()> {
    let _claim = files::claim(out)?;
    let mut command = Arguments::command();
    command.build();
    let mut pages = vec![("flatlight".to_owned(), command.clone())];
    for sub in command.get_subcommands().filter(|s| s.get_name() != "help") {
        pages.push((format!("flatlight-{}", sub.get_name()), sub.clone()));
    }
    let pages: Vec<(PathBuf, Vec<u8>)> = pages
        .into_iter()
        .map(|(name, command)| {
            let path = out.join(format!("{name}.1"));
            let mut page = Vec::new();
            let made = clap_mangen::Man::new(command).render(&mut page);
            made.map_err(|e| Error::write(&path, e))?;
            Ok((path, page))
        })
        .collect::<Result<_>>()?;
    files::write_together(&pages)?;
    say::result(
        common,
        &format!(
            "{} pages\nman {}",
            pages.len(),
            out.join("flatlight.1").display()
        ),
    );
    Ok(())
}
