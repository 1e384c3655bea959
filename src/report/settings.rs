//! Single values out of the resolved capture and recipe, for words and captions.

/// The number at a path of keys, if it is there.
pub fn number_at(toml: &str, keys: &[&str]) -> Option<f64> {
    match value_at(toml, keys)? {
        toml::Value::Float(v) => Some(v),
        toml::Value::Integer(v) => Some(v as f64),
        _ => None,
    }
}

/// The text at a path of keys, if it is there.
pub fn text_at(toml: &str, keys: &[&str]) -> Option<String> {
    match value_at(toml, keys)? {
        toml::Value::String(v) => Some(v),
        _ => None,
    }
}

/// The switch at a path of keys, if it is there.
pub fn switch_at(toml: &str, keys: &[&str]) -> Option<bool> {
    value_at(toml, keys)?.as_bool()
}

fn value_at(toml: &str, keys: &[&str]) -> Option<toml::Value> {
    let mut value = toml::Value::Table(toml::from_str(toml).ok()?);
    for key in keys {
        value = value.get(key)?.clone();
    }
    Some(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_found_by_their_keys() {
        let text = "[object]\nshape = \"sphere\"\nradius = 0.05\n[camera]\ndistance = 2\n[recovery]\nnon_negative = true\n";
        assert_eq!(
            text_at(text, &["object", "shape"]).as_deref(),
            Some("sphere")
        );
        assert_eq!(number_at(text, &["object", "radius"]), Some(0.05));
        assert_eq!(number_at(text, &["camera", "distance"]), Some(2.0));
        assert_eq!(switch_at(text, &["recovery", "non_negative"]), Some(true));
        assert_eq!(number_at(text, &["camera", "focal_px"]), None);
        assert_eq!(number_at("not = [toml", &["not"]), None);
    }
}
