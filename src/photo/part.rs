//! The first part of an OpenEXR file with all its channels, as environment maps and products have them.

use std::path::Path;

use exr::meta::MetaData;
use exr::prelude::{ReadChannels as _, ReadLayers as _, read};

use super::{Format, guarded, plausible};
use crate::error::{Error, Result};

/// Named planes of one size.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ExrPart {
    /// Width and height of the data window, pixels.
    pub size: [usize; 2],
    /// (channel name, row-major values), in the file's order: by alphabet.
    pub planes: Vec<(String, Vec<f32>)>,
}

impl ExrPart {
    /// Reads the first part of an OpenEXR file.
    ///
    /// # Errors
    /// The file cannot be read, is no OpenEXR, is damaged, declares more pixels than its bytes can hold, or has
    /// channels that are deep or subsampled.
    pub fn read(path: &Path) -> Result<Self> {
        guarded(path, |mut opened| {
            if opened.format != Format::Exr {
                return Err(Error::input(format!(
                    "expected an OpenEXR file, found {:?}",
                    opened.format
                )));
            }
            let damaged = |cause| Error::input(format!("the EXR is damaged: {cause}"));
            let headers = MetaData::read_from_buffered(&mut opened.reader, false)
                .map_err(damaged)?
                .headers;
            for header in &headers {
                let size = header.layer_size;
                let pixels = (size.0 as u64).saturating_mul(size.1 as u64);
                let declared = pixels.saturating_mul(4 * header.channels.list.len() as u64);
                plausible(declared, opened.bytes)?;
                let block = header.max_block_pixel_size();
                let block = (block.0 as u64).saturating_mul(block.1 as u64);
                let declared = block.saturating_mul(header.channels.bytes_per_pixel as u64);
                plausible(declared, opened.bytes)?;
            }
            std::io::Seek::rewind(&mut opened.reader)
                .map_err(|cause| Error::input(format!("cannot read it: {cause}")))?;
            let image = read()
                .no_deep_data()
                .largest_resolution_level()
                .all_channels()
                .first_valid_layer()
                .all_attributes()
                .non_parallel()
                .from_buffered(opened.reader)
                .map_err(damaged)?;
            let layer = image.layer_data;
            let size = [layer.size.0, layer.size.1];
            let planes: Vec<(String, Vec<f32>)> = layer
                .channel_data
                .list
                .iter()
                .map(|c| {
                    let values = c.sample_data.values_as_f32().collect();
                    (c.name.to_string(), values)
                })
                .collect();
            let whole = size[0].saturating_mul(size[1]);
            if let Some((name, _)) = planes.iter().find(|(_, values)| values.len() != whole) {
                return Err(Error::input(format!(
                    "expected full-resolution channels, found the subsampled channel {name}"
                )));
            }
            Ok(Self { size, planes })
        })
    }
}
