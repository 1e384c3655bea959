//! What a folder shows: its files, without what the time that the stages took makes of them, and without what is not yet a product.

use std::collections::BTreeMap;
use std::path::Path;

/// Every file below a folder by its path, whole; hidden ones are left out.
pub fn contents(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    walk(folder, "", &mut found);
    found
}

fn walk(folder: &Path, above: &str, found: &mut BTreeMap<String, Vec<u8>>) {
    let Ok(entries) = std::fs::read_dir(folder) else {
        return;
    };
    for entry in entries {
        let entry = entry.expect("an entry");
        let name = entry.file_name().to_string_lossy().into_owned();
        if name.starts_with('.') {
            continue;
        }
        let whole = format!("{above}{name}");
        if entry.path().is_dir() {
            walk(&entry.path(), &format!("{whole}/"), found);
        } else {
            let bytes = std::fs::read(entry.path()).expect("reads");
            found.insert(whole, timeless(&name, bytes));
        }
    }
}

/// The file without the stages' seconds, and without hashes of files that hold such.
fn timeless(name: &str, bytes: Vec<u8>) -> Vec<u8> {
    if name.ends_with(".json") {
        let mut value: serde_json::Value = serde_json::from_slice(&bytes).expect("JSON, whole");
        if let Some(object) = value.as_object_mut() {
            object.remove("stage_seconds");
            if let Some(products) = object.get_mut("products").and_then(|p| p.as_object_mut()) {
                products.retain(|name, _| {
                    !["report.html", "summary.json", "run.json"].contains(&name.as_str())
                });
            }
        }
        return value.to_string().into_bytes();
    }
    if name.ends_with(".html") {
        let text = String::from_utf8(bytes).expect("UTF-8");
        assert!(text.trim_end().ends_with("</html>"), "the page is whole");
        let Some((before, rest)) = text.split_once("<caption>Time per stage</caption>") else {
            return text.into_bytes();
        };
        let (_, after) = rest.split_once("</table>").expect("its end");
        return format!("{before}{after}").into_bytes();
    }
    bytes
}

/// Names of what is hidden in a folder and below it.
pub fn hidden(folder: &Path) -> Vec<String> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).into_iter().flatten() {
        let entry = entry.expect("an entry");
        let name = entry.file_name().to_string_lossy().into_owned();
        if name.starts_with('.') {
            found.push(name);
        } else if entry.path().is_dir() {
            found.extend(hidden(&entry.path()));
        }
    }
    found
}
