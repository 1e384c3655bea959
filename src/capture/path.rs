//! Paths of a capture set: relative to its folder, and never out of it.

use std::path::{Component, Path, PathBuf};

/// The path without `.` parts, or why it is not acceptable as it is written.
pub(super) fn inside(text: &str) -> Result<PathBuf, String> {
    let mut path = PathBuf::new();
    for part in Path::new(text).components() {
        match part {
            Component::Normal(name) => path.push(name),
            Component::CurDir => {}
            Component::ParentDir => {
                return Err(format!(
                    "expected a path inside the capture's folder, found \"{text}\" with \"..\" in it"
                ));
            }
            Component::RootDir | Component::Prefix(_) => {
                return Err(format!(
                    "expected a path relative to the capture's folder, found the absolute \"{text}\""
                ));
            }
        }
    }
    if path.as_os_str().is_empty() {
        return Err("expected the path of a file, found an empty text".to_string());
    }
    Ok(path)
}

/// Whether `path` is a file that lies in `folder` after symbolic links are followed; if not, why.
pub(super) fn is_file_in(folder: &Path, path: &Path) -> Result<(), String> {
    let shown = path.display();
    let real = folder
        .join(path)
        .canonicalize()
        .map_err(|cause| format!("cannot find the file \"{shown}\": {cause}"))?;
    let home = folder
        .canonicalize()
        .map_err(|cause| format!("cannot find the capture's folder: {cause}"))?;
    if !real.starts_with(home) {
        return Err(format!(
            "\"{shown}\" is a link that leads out of the capture's folder"
        ));
    }
    if !real.is_file() {
        return Err(format!("expected \"{shown}\" to be a file, and it is not"));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_stay_inside() {
        assert_eq!(inside("./views/a.png").unwrap(), Path::new("views/a.png"));
        for bad in ["../a.png", "views/../../a.png", "/etc/passwd", "", "."] {
            assert!(inside(bad).is_err(), "{bad}");
        }
    }
}
