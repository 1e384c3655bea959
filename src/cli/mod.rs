//! Arguments, progress bars, printing: the only place that prints.

mod batch;
mod check;
mod compare;
mod export;
mod init;
mod paper;
mod prefilter;
mod probe;
mod progress;
mod report;
mod run;
mod say;
mod shell;
mod simulate;
mod validate;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Args, Parser, Subcommand};
use flatlight::{Error, Result};

/// Photographs of a cylinder or a sphere in; measurements of light and material out.
#[derive(Debug, Parser)]
#[command(version, about, max_term_width = 100)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    common: Common,
}

/// What every command takes.
#[derive(Args, Clone, Debug)]
struct Common {
    /// Number of threads; default: one per processor
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Print nothing but results and errors
    #[arg(long, global = true)]
    quiet: bool,
    /// Warnings become failures
    #[arg(long, global = true)]
    strict: bool,
    /// Form of what is printed
    #[arg(long, global = true, value_enum, default_value_t, value_name = "FORM")]
    log: say::Log,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// The whole pipeline: photos in, products and report out
    #[command(
        after_help = "Example:\n  flatlight run pipelines/lighting.toml --capture testdata/phong32-two-suns --out out/\n  then open out/report.html"
    )]
    Run {
        /// What to do: a recipe, as those in pipelines/
        recipe: PathBuf,
        /// What was shot: a folder with a capture.toml, or that file
        #[arg(long)]
        capture: PathBuf,
        /// Folder for the products; made if it does not exist
        #[arg(long)]
        out: PathBuf,
        /// Write into the folder although it holds something else
        #[arg(long)]
        force: bool,
    },
    /// One recipe on every capture set below a folder: a run each, one summary table, one report
    #[command(
        after_help = "Example:\n  flatlight batch sets/ pipelines/lighting.toml --out results/\n  then open results/report.html; results/summary.csv has a row for every set\n\n\
Sets that were finished stay as they are: interrupt and go on at will. A set that fails does not stop the others. Exit code 0: every set gave a \
result; 1: some failed, and the table and the last lines say which and why; 2: nothing could be begun."
    )]
    Batch {
        /// Folder with capture sets below it: folders with a capture.toml, at any depth
        folder: PathBuf,
        /// What to do with each: a recipe, as those in pipelines/
        recipe: PathBuf,
        /// Folder for summary.csv, report.html and a folder of products for each set; default: beside DIR, its name and the recipe's joined by -
        #[arg(long)]
        out: Option<PathBuf>,
        /// Sets worked on at the same time, each taking up to some hundred megabytes; default: one per thread
        #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
        jobs: Option<u16>,
        /// Write into a set's folder although it holds something else
        #[arg(long)]
        force: bool,
    },
    /// Write a first capture.toml for a folder of photos, from their headers; says what is left to fill in
    #[command(after_help = "Example:\n  flatlight init my-photos/\n  flatlight check my-photos/")]
    Init {
        /// The folder that holds the photos
        folder: PathBuf,
    },
    /// Everything wrong with a capture set, at once, before any long work
    #[command(after_help = "Example:\n  flatlight check testdata/phong32-sun")]
    Check {
        /// A folder with a capture.toml, or that file
        capture: PathBuf,
    },
    /// Directions of the lights that a mirror ball shows, as CSV: for plane_roll_deg and orbit_deg of a sphere in its place
    #[command(
        after_help = "Example:\n  flatlight probe ball/ > lights.csv\n  flatlight probe ball/ --views    [[view]] tables for the capture.toml of the sphere in the ball's place\n\nlight_deg is the angle from the optical axis to the light, in the plane of plane_roll_deg; orbit_deg = −light_deg counts\ncamera directions from the light, so that photos by several lights of one fixed camera become views of one light at 0°.\nCarry sigma_deg over too, as orbit_sigma_deg under [camera]: how well those angles are known goes into all error bars."
    )]
    Probe {
        /// A folder with the capture.toml of the ball's photos, or that file
        capture: PathBuf,
        /// Print [[view]] tables instead of CSV
        #[arg(long)]
        views: bool,
    },
    /// Two products of the same kind: factor, error, where, and whether within the error bars
    Compare(compare::Arguments),
    /// Results for other programs: Mitsuba, Blender, MERL tables, NumPy, ASTM-style tables
    Export(export::Arguments),
    /// The report again, from what a run left in its folder
    #[command(after_help = "Example:\n  flatlight report out/\n  then open out/report.html")]
    Report {
        /// The folder that `flatlight run` wrote
        run: PathBuf,
    },
    /// A synthetic capture set with its truth, with a real camera's faults
    #[command(
        after_help = "Example:\n  flatlight simulate pipelines/simulate.toml --out set/\n  flatlight run set/recipe.toml --capture set/ --out out/"
    )]
    Simulate {
        /// What to simulate: a recipe, as pipelines/simulate.toml
        recipe: PathBuf,
        /// Folder for the set; made if it does not exist
        #[arg(long)]
        out: PathBuf,
        /// Replace a capture set that the folder holds
        #[arg(long)]
        force: bool,
    },
    /// Every equation and figure of the theory, recomputed, on one page
    #[command(
        after_help = "Example:\n  flatlight paper --out paper/\n  then open paper/paper.html; paper/paper.csv holds the same numbers"
    )]
    Paper {
        /// Folder for paper.html and paper.csv; made if it does not exist
        #[arg(long)]
        out: PathBuf,
    },
    /// Environment map prefiltering: the light field of a planar environment as a table, an image, or an
    /// object in front of a camera
    Prefilter(prefilter::Arguments),
    /// Many seeded synthetic recoveries: error, bias, interval coverage, ratio to the Cramér–Rao bound
    #[command(
        after_help = "Example:\n  flatlight validate pipelines/validate.toml --out out/\n  then open out/report.html\n\nFinished cells stay in out/cells and are not computed again: interrupt and go on at will."
    )]
    Validate {
        /// The studies: a recipe like pipelines/validate.toml
        recipe: PathBuf,
        /// Folder for the tables, the report and the finished cells
        #[arg(long)]
        out: PathBuf,
        /// All of the recipe, not only its default size
        #[arg(long)]
        full: bool,
    },
    /// Print a completion script for a shell
    #[command(
        after_help = "Example:\n  flatlight completions bash > ~/.local/share/bash-completion/completions/flatlight"
    )]
    Completions {
        /// Which shell
        shell: clap_complete::Shell,
    },
    /// Write manual pages, one for the program and one for each command
    #[command(after_help = "Example:\n  flatlight man --out man/\n  man man/flatlight.1")]
    Man {
        /// Folder for the pages; made if it does not exist
        #[arg(long)]
        out: PathBuf,
    },
}

/// Runs the command line; errors go to stderr, results to stdout.
pub fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let result = threads(arguments.common.threads).and_then(|()| match &arguments.command {
        Command::Run {
            recipe,
            capture,
            out,
            force,
            // By one of the workers: else they and the one that waits for them wake each other up for every small piece of work.
        } => rayon::scope(|_| run::run(recipe, capture, out, *force, &arguments.common)),
        Command::Batch {
            folder,
            recipe,
            out,
            jobs,
            force,
        } => batch::run(
            folder,
            recipe,
            out.as_deref(),
            *jobs,
            *force,
            &arguments.common,
        ),
        Command::Init { folder } => init::run(folder, &arguments.common),
        Command::Check { capture } => check::run(capture, &arguments.common),
        Command::Probe { capture, views } => probe::run(capture, *views, &arguments.common),
        Command::Compare(wanted) => compare::compare(wanted, &arguments.common),
        Command::Export(wanted) => export::run(wanted, &arguments.common),
        Command::Completions { shell } => {
            shell::completions(*shell);
            Ok(())
        }
        Command::Man { out } => shell::man(out, &arguments.common),
        Command::Report { run } => report::run(run, &arguments.common),
        Command::Simulate { recipe, out, force } => {
            simulate::run(recipe, out, *force, &arguments.common)
        }
        Command::Paper { out } => paper::paper(out, &arguments.common),
        Command::Prefilter(wanted) => prefilter::prefilter(wanted, &arguments.common),
        Command::Validate { recipe, out, full } => {
            validate::validate(recipe, out, *full, &arguments.common)
        }
    });
    match result.and_then(|()| say::printed()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            say::error(arguments.common.log, &error);
            ExitCode::from(error.exit_code())
        }
    }
}

/// Starts the workers: so many, or one for each processor, with the stack of a main thread.
fn threads(count: Option<u16>) -> Result<()> {
    const STACK: usize = 8 << 20;
    rayon::ThreadPoolBuilder::new()
        .num_threads(usize::from(count.unwrap_or(0)))
        .stack_size(STACK)
        .build_global()
        .map_err(|e| Error::failed(format!("cannot start the threads: {e}")))
}
