//! The numbers behind a plot: a table in the page and a CSV to take away.

use std::fmt::Write as _;

use super::number::{fixed, short, write_decimals};

/// Rows shown in the page; the CSV has all.
const SHOWN_ROWS: usize = 40;

/// A value of a table.
#[derive(Clone, Debug, PartialEq)]
pub enum Cell {
    /// A number; missing if it is not finite.
    Number(f64),
    /// An angle or another number with a fixed count of decimals.
    Fixed(f64, usize),
    /// A word.
    Text(String),
}

/// A table with one row of headings.
#[derive(Clone, Debug, Default)]
pub struct Table {
    /// Column names as in this program's CSV files, so that a reader finds them again.
    pub columns: Vec<String>,
    /// Rows, each as long as `columns`.
    pub rows: Vec<Vec<Cell>>,
    /// What to know about it, e.g. that it is coarser than the image.
    pub note: String,
}

impl Cell {
    /// As the page shows it.
    pub fn shown(&self) -> String {
        match self {
            Self::Number(v) => short(*v, 4),
            Self::Fixed(v, decimals) => fixed(*v, *decimals),
            Self::Text(text) => text.clone(),
        }
    }

    fn write_csv(&self, out: &mut String) {
        match self {
            // About seven digits, those of an f32; the files beside the report have all.
            Self::Number(v) if v.is_finite() => {
                let single = *v as f32;
                let _ = if single.is_normal() {
                    write!(out, "{single}")
                } else {
                    write!(out, "{v:e}")
                };
            }
            Self::Fixed(v, decimals) if v.is_finite() => {
                write_decimals(*v, *decimals, out);
            }
            Self::Number(_) | Self::Fixed(..) => {}
            Self::Text(text) => write_csv_text(text, out),
        }
    }
}

impl Table {
    /// The rows that the page shows: all, or every k-th.
    pub fn shown_rows(&self) -> impl Iterator<Item = &Vec<Cell>> {
        self.rows.iter().step_by(self.step())
    }

    /// One row of this many is shown in the page.
    pub fn step(&self) -> usize {
        self.rows.len().div_ceil(SHOWN_ROWS).max(1)
    }

    /// The whole table as CSV.
    pub fn csv(&self) -> String {
        let mut out = String::new();
        for (i, column) in self.columns.iter().enumerate() {
            if i > 0 {
                out.push(',');
            }
            write_csv_text(column, &mut out);
        }
        out.push('\n');
        for row in &self.rows {
            for (i, cell) in row.iter().enumerate() {
                if i > 0 {
                    out.push(',');
                }
                cell.write_csv(&mut out);
            }
            out.push('\n');
        }
        out
    }

    /// The CSV as a `data:` URI for a download link.
    pub fn csv_uri(&self) -> String {
        data_uri(&self.csv())
    }
}

/// A CSV file as a `data:` URI.
pub fn data_uri(csv: &str) -> String {
    // Unreserved characters of RFC 3986 and the comma stay as they are.
    let stays = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '.' | '_' | '~' | ',');
    let mut out = String::with_capacity(csv.len() + csv.len() / 8 + 32);
    out.push_str("data:text/csv;charset=utf-8,");
    let mut rest = csv;
    while let Some((at, c)) = rest.char_indices().find(|(_, c)| !stays(*c)) {
        let (before, after) = rest.split_at(at);
        let (escaped, after) = after.split_at(c.len_utf8());
        out.push_str(before);
        for byte in escaped.bytes() {
            let _ = write!(out, "%{byte:02X}");
        }
        rest = after;
    }
    out.push_str(rest);
    out
}

/// A field of a CSV file, quoted if it must be.
pub fn write_csv_text(text: &str, out: &mut String) {
    if text.contains([',', '"', '\n', '\r']) {
        let _ = write!(out, "\"{}\"", text.replace('"', "\"\""));
    } else {
        out.push_str(text);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn csv_quotes_what_needs_it_and_leaves_missing_values_empty() {
        let table = Table {
            columns: vec!["alpha_deg".into(), "a,\"b\"".into()],
            rows: vec![
                vec![Cell::Fixed(-179.75, 2), Cell::Number(f64::NAN)],
                vec![Cell::Number(1.0 / 3.0), Cell::Text("x\ny".into())],
            ],
            note: String::new(),
        };
        assert_eq!(
            table.csv(),
            "alpha_deg,\"a,\"\"b\"\"\"\n-179.75,\n0.33333334,\"x\ny\"\n"
        );
        let uri = table.csv_uri();
        assert!(uri.starts_with("data:text/csv;charset=utf-8,alpha_deg,%22a,%22%22b"));
        assert!(!uri.contains(['"', '<', '\n', ' ']));
    }

    #[test]
    fn long_tables_are_thinned_in_the_page_only() {
        let table = Table {
            columns: vec!["i".into()],
            rows: (0..720).map(|i| vec![Cell::Number(f64::from(i))]).collect(),
            note: String::new(),
        };
        assert!(table.shown_rows().count() <= SHOWN_ROWS);
        assert_eq!(table.csv().lines().count(), 721);
    }
}
