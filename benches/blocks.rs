//! What reading costs at the least: `cargo bench --bench blocks -- SET FIRST:LAST` reads the EXR photographs of a set with the exr crate, as
//! many at a time as there are threads (`RAYON_NUM_THREADS`), inflates the blocks or tiles that hold the scan lines FIRST to LAST − 1, and
//! does nothing with them. Prints the least of five times as JSON; `benches/peer/run.py --large --blocks` compares with it.

use std::error::Error;
use std::fs::File;
use std::io::BufReader;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::Instant;

use exr::block::reader::ChunksReader;
use rayon::prelude::*;

type Outcome<T> = Result<T, Box<dyn Error + Send + Sync>>;

fn main() -> Outcome<()> {
    // Without arguments, as `cargo bench` runs it among the others, there is nothing to read.
    let arguments: Vec<String> = std::env::args()
        .skip(1)
        .filter(|a| a != "--bench")
        .collect();
    let [folder, rows] = arguments.as_slice() else {
        return Ok(());
    };
    let (first, last) = rows.split_once(':').ok_or("expected FIRST:LAST")?;
    let rows: Range<usize> = first.parse()?..last.parse()?;
    let mut files: Vec<PathBuf> = std::fs::read_dir(Path::new(folder).join("views"))?
        .map(|entry| Ok(entry?.path()))
        .collect::<Outcome<_>>()?;
    files.sort();
    let (mut best, mut bytes) = (f64::INFINITY, 0);
    for _ in 0..5 {
        let start = Instant::now();
        let counts = files.par_iter().map(|file| inflated(file, &rows));
        bytes = counts.collect::<Outcome<Vec<usize>>>()?.iter().sum();
        best = best.min(start.elapsed().as_secs_f64());
    }
    println!(
        "{{\"seconds\": {best}, \"bytes\": {bytes}, \"threads\": {}}}",
        rayon::current_num_threads()
    );
    Ok(())
}

/// Bytes of the blocks that hold these rows, after inflating them.
fn inflated(file: &Path, rows: &Range<usize>) -> Outcome<usize> {
    let blocks = exr::block::read(BufReader::new(File::open(file)?), false)?;
    let chunks = blocks.filter_chunks(false, |_, _, block| {
        let top = block.pixel_position.1;
        block.level.0 == 0
            && block.level.1 == 0
            && top < rows.end
            && top + block.pixel_size.1 > rows.start
    })?;
    let mut bytes = 0;
    chunks.decompress_sequential(false, |_, block| {
        bytes += std::hint::black_box(&block.data).len();
        Ok(())
    })?;
    Ok(bytes)
}
