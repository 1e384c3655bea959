// Shared by the targets: a scratch folder of the process, and panics that decoders raise and the library contains
// are no findings, unlike those that reach this place.

use std::panic::{AssertUnwindSafe, catch_unwind, set_hook};
use std::path::PathBuf;
use std::sync::{Mutex, Once};

static START: Once = Once::new();
static LAST: Mutex<String> = Mutex::new(String::new());

pub fn run(body: flatlight_fuzz::Body, bytes: &[u8]) {
    let folder = scratch();
    START.call_once(|| {
        std::fs::create_dir_all(&folder).expect("a scratch folder");
        let photo = include_bytes!("seeds/photo_png/grey8.png");
        std::fs::write(folder.join("a.png"), photo).expect("a scratch file");
        set_hook(Box::new(|panic| {
            if let Ok(mut last) = LAST.lock() {
                *last = format!("{panic}\n{}", std::backtrace::Backtrace::force_capture());
            }
        }));
    });
    if catch_unwind(AssertUnwindSafe(|| body(bytes, &folder))).is_err() {
        eprintln!(
            "{}",
            LAST.lock()
                .map_or_else(|_| String::new(), |last| last.clone())
        );
        std::process::abort();
    }
}

/// In memory where the system has such a place.
fn scratch() -> PathBuf {
    let memory = PathBuf::from("/dev/shm");
    let base = if memory.is_dir() {
        memory
    } else {
        std::env::temp_dir()
    };
    base.join(format!("flatlight-fuzz-{}", std::process::id()))
}
