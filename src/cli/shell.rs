//! What a shell and `man` want to know of this program.

use std::path::Path;

use clap::CommandFactory;
use clap_complete::Shell;
use flatlight::{Error, Result};

use super::{Arguments, Common, file, say};

/// Prints a completion script.
pub fn completions(shell: Shell) {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut Arguments::command(), "flatlight", &mut script);
    print!("{}", String::from_utf8_lossy(&script));
}

/// Writes `flatlight.1` and a page for each command.
pub fn man(out: &Path, common: &Common) -> Result<()> {
    std::fs::create_dir_all(out).map_err(|e| Error::write(out, e))?;
    let mut command = Arguments::command();
    command.build();
    let mut pages = vec![("flatlight".to_owned(), command.clone())];
    for sub in command.get_subcommands().filter(|s| s.get_name() != "help") {
        pages.push((format!("flatlight-{}", sub.get_name()), sub.clone()));
    }
    for (name, command) in &pages {
        let path = out.join(format!("{name}.1"));
        let mut page = Vec::new();
        let made = clap_mangen::Man::new(command.clone()).render(&mut page);
        made.map_err(|e| Error::write(&path, e))?;
        file::write(&path, &page)?;
    }
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
