//! Light fields as EXR: float32, one channel per layer and colour, the axes in header attributes.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::Path;

use exr::prelude::{AttributeValue, LayerAttributes, Text};

use super::LightField;
use super::header::sort_attributes;
use crate::error::{Error, Result};
use crate::grid::Grid;
use crate::photo::ExrPart;
use crate::photo::rle_lines::{self, Picture, Plane};

/// One part of an EXR file: named float32 planes of one size.
#[derive(Clone, Debug, Default)]
pub struct Part<'a> {
    /// Name of the part.
    pub name: String,
    /// Width and height.
    pub size: [usize; 2],
    /// (channel name, row-major values).
    pub planes: Vec<(String, Cow<'a, [f32]>)>,
    /// Text attributes of the header.
    pub texts: Vec<(String, String)>,
    /// Number attributes of the header.
    pub numbers: Vec<(String, f32)>,
}

impl Part<'_> {
    /// The same, without a copy of its values.
    pub fn borrowed(&self) -> Part<'_> {
        let planes = self.planes.iter();
        Part {
            planes: planes
                .map(|(name, values)| (name.clone(), Cow::Borrowed(values.as_ref())))
                .collect(),
            name: self.name.clone(),
            texts: self.texts.clone(),
            numbers: self.numbers.clone(),
            ..*self
        }
    }
}

impl LightField {
    /// Reads `light_field.exr`.
    ///
    /// # Errors
    /// If the file cannot be read, or lacks one of the layers `mean`, `sigma` and `weight` of a channel.
    pub fn read(file: &Path) -> Result<Self> {
        let part = ExrPart::read(file)?;
        let grid = Grid {
            normals: part.size[1],
            locals: part.size[0],
        };
        let mut planes: BTreeMap<String, Vec<f32>> = part.planes.into_iter().collect();
        let channels: Vec<String> = planes
            .keys()
            .filter_map(|name| name.strip_prefix("mean.").map(String::from))
            .collect();
        let mut take = |layer: &str| -> Result<Vec<Vec<f32>>> {
            channels
                .iter()
                .map(|channel| {
                    let name = format!("{layer}.{channel}");
                    planes.remove(&name).ok_or_else(|| {
                        Error::input(format!("expected the plane {name}, found none")).file(file)
                    })
                })
                .collect()
        };
        let (mean, sigma, weight) = (take("mean")?, take("sigma")?, take("weight")?);
        if channels.is_empty() {
            return Err(Error::input(
                "expected a light field with the layers mean, sigma and weight, found none of them",
            )
            .file(file));
        }
        Ok(Self {
            grid,
            channels,
            mean,
            sigma,
            weight,
        })
    }

    /// The layers `mean`, `sigma` and `weight`, each with all channels.
    pub fn part(&self, name: &str) -> Part<'_> {
        let Grid { normals, locals } = self.grid;
        let layers = [
            ("mean", &self.mean),
            ("sigma", &self.sigma),
            ("weight", &self.weight),
        ];
        let planes = layers
            .iter()
            .flat_map(|(layer, values)| {
                self.channels
                    .iter()
                    .zip(values.iter())
                    .map(move |(c, v)| (format!("{layer}.{c}"), Cow::Borrowed(v.as_slice())))
            })
            .collect();
        let texts = [
            (
                "columns",
                "theta_o_local_deg = columnStartDeg + (j + 0.5) * columnStepDeg",
            ),
            ("rows", "alpha_deg = rowStartDeg + (i + 0.5) * rowStepDeg"),
            (
                "content",
                "reflected light field B(alpha, theta_o'); weight 0 = never seen",
            ),
        ];
        Part {
            name: name.into(),
            size: [locals, normals],
            planes,
            texts: texts.map(|(k, v)| (k.into(), v.into())).to_vec(),
            numbers: vec![
                ("columnStartDeg".into(), -90.0),
                ("columnStepDeg".into(), 180.0 / locals as f32),
                ("rowStartDeg".into(), -180.0),
                ("rowStepDeg".into(), 360.0 / normals as f32),
            ],
        }
    }
}

/// The bytes of an EXR file with the given parts, losslessly compressed.
///
/// # Errors
/// If a plane does not have its part's size, or a name cannot be written in EXR.
pub fn encode(parts: &[Part<'_>]) -> Result<Vec<u8>> {
    let mut pictures = Vec::with_capacity(parts.len());
    for part in parts {
        let [width, height] = part.size;
        let mut planes = Vec::with_capacity(part.planes.len());
        for (name, values) in &part.planes {
            if values.len() != width * height {
                return Err(Error::failed(format!(
                    "plane {name} of {}: expected {width} × {height} values, found {}",
                    part.name,
                    values.len()
                )));
            }
            planes.push((text(name)?, Plane::Whole(values.as_ref())));
        }
        let mut attributes = LayerAttributes::named(text(&part.name)?);
        for (key, value) in &part.texts {
            attributes
                .other
                .insert(text(key)?, AttributeValue::Text(text(value)?));
        }
        for (key, value) in &part.numbers {
            attributes
                .other
                .insert(text(key)?, AttributeValue::F32(*value));
        }
        // Most cells of a light field were never seen, and runs of zeros are all that there is to gain.
        pictures.push(Picture {
            size: part.size,
            attributes,
            planes,
        });
    }
    let mut bytes = rle_lines::encode(pictures)
        .map_err(|e| Error::failed(format!("the EXR file cannot be encoded: {e}")))?;
    sort_attributes(&mut bytes);
    Ok(bytes)
}

fn text(value: &str) -> Result<Text> {
    Text::new_or_none(value).ok_or_else(|| {
        Error::failed(format!(
            "the name {value:?} cannot be written in an EXR file"
        ))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_back() {
        let grid = Grid {
            normals: 8,
            locals: 5,
        };
        let mut field = LightField::empty(grid, vec!["R".into(), "560nm".into()]);
        for (k, v) in field.mean[1].iter_mut().enumerate() {
            *v = k as f32 * 0.1;
        }
        let bytes = encode(&[field.part("light field")]).expect("encodes");
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("x.exr");
        std::fs::write(&path, bytes).expect("writes");
        assert_eq!(
            LightField::read(&path).expect("reads").mean[0],
            field.mean[1]
        );
        let image = exr::prelude::read_first_flat_layer_from_file(&path).expect("reads");
        let layer = image.layer_data;
        assert_eq!(layer.channel_data.list.len(), 6);
        let name = Text::from("mean.560nm");
        let mean = layer
            .channel_data
            .list
            .iter()
            .find(|c| c.name == name)
            .expect("the channel is there");
        let values: Vec<f32> = mean.sample_data.values_as_f32().collect();
        assert_eq!(values, field.mean[1]);
        let start = layer.attributes.other.get(&Text::from("rowStartDeg"));
        assert_eq!(start, Some(&AttributeValue::F32(-180.0)));
    }
}
