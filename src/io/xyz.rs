//! Text: XYZ, TXT, CSV, PTS; the rules stand at [`read`](super::read).

use std::fmt::Write;

use super::Scan;
use super::columns::{Kind, assemble, known_normals, list, roles, to_colors};
use super::table::parse_real;

pub(super) fn read(content: &[u8]) -> Result<Scan, String> {
    let content = content.strip_prefix(b"\xef\xbb\xbf").unwrap_or(content);
    let text = std::str::from_utf8(content).map_err(|error| format!("not a text file: {error}"))?;
    let mut header: Option<Header> = None;
    let mut rows: Option<Rows> = None;
    let mut count: Option<usize> = None;
    for (number, line) in (1..).zip(lines(text)) {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') || line.starts_with("//") {
            // A comment above the points may name the columns.
            let title = Header::of(line.trim_start_matches(['#', '/', ' ', '\t']));
            if rows.is_none() && roles(&title.names).is_some() {
                header = Some(title);
            }
            continue;
        }
        if rows.is_none() && header.is_none() && count.is_none() {
            count = line.parse().ok();
            if count.is_some() {
                continue;
            }
        }
        if rows.is_none() && !is_row(line, header.as_ref()) {
            if header.is_some() {
                return Err(unexpected(number, line));
            }
            header = Some(Header::of(line));
            continue;
        }
        if rows.is_none() {
            rows = Some(Rows::like(line, header.take())?);
        }
        if let Some(rows) = &mut rows {
            rows.push(number, line)?;
        }
    }
    let Some(rows) = rows else {
        let shown: String = text.trim().chars().take(40).collect();
        return Err(format!("expected rows of numbers x y z, found {shown:?}"));
    };
    let scan = rows.scan(count.is_some())?;
    match count {
        Some(count) if count != scan.points.len() => {
            Err(format!("the first line counts {count} points, the file holds {}", scan.points.len()))
        }
        _ => Ok(scan),
    }
}

/// Lines, whether they end with LF, CR and LF, or CR alone.
fn lines(text: &str) -> impl Iterator<Item = &str> {
    text.split('\n').flat_map(|line| line.strip_suffix('\r').unwrap_or(line).split('\r'))
}

/// The line that names the columns.
struct Header<'a> {
    names: Vec<&'a str>,
    delimiter: Option<char>,
}

impl<'a> Header<'a> {
    fn of(line: &'a str) -> Self {
        let delimiter = delimiter_of(line, None);
        let mut names = Vec::new();
        split(line, delimiter, &mut names);
        if delimiter.is_some() && names.last().is_some_and(|name| name.is_empty()) {
            names.pop();
        }
        Self { names, delimiter }
    }
}

/// A row without what follows a #: a comment, as NumPy takes it.
fn without_comment(row: &str) -> &str {
    row.split('#').next().unwrap_or(row).trim_end()
}

/// Whether a line is the first row: below names of the columns, or beginning with a number.
fn is_row(line: &str, header: Option<&Header>) -> bool {
    header.is_some_and(|header| roles(&header.names).is_some()) || {
        let Header { names: cells, .. } = Header::of(without_comment(line));
        cells.first().is_some_and(|cell| cell.replace(',', ".").parse::<f64>().is_ok())
    }
}

/// The numbers of the columns that are used.
struct Rows<'a> {
    names: Option<Vec<&'a str>>,
    delimiter: Option<char>,
    /// Cells of a row.
    width: usize,
    /// Columns that are used.
    used: Vec<usize>,
    numbers: Vec<f64>,
    /// Those of the row at hand, kept for its memory.
    cells: Vec<&'a str>,
}

impl<'a> Rows<'a> {
    /// None yet, of the form that `first` has.
    fn like(first: &'a str, header: Option<Header<'a>>) -> Result<Self, String> {
        let delimiter =
            delimiter_of(without_comment(first), header.as_ref().and_then(|header| header.delimiter));
        let names = header.map(|header| header.names);
        let mut rows =
            Self { names, delimiter, width: 0, used: Vec::new(), numbers: Vec::new(), cells: Vec::new() };
        rows.split(first);
        let found = rows.cells.len();
        rows.width = found;
        let Some(names) = &rows.names else {
            rows.width -= usize::from(rows.has_open_end());
            rows.used = (0..rows.width).collect();
            return Ok(rows);
        };
        rows.width = names.len();
        rows.used =
            roles(names).ok_or_else(|| format!("expected columns x y z, found {}", list(names)))?.used();
        if found != rows.width && !(found == rows.width + 1 && rows.has_open_end()) {
            let width = names.len();
            return Err(format!("the header names {width} columns ({}), the rows have {found}", list(names)));
        }
        Ok(rows)
    }

    fn split(&mut self, line: &'a str) {
        split(without_comment(line), self.delimiter, &mut self.cells);
    }

    /// Whether the row at hand ends with its delimiter.
    fn has_open_end(&self) -> bool {
        self.delimiter.is_some() && self.cells.last().is_some_and(|cell| cell.is_empty())
    }

    fn push(&mut self, number: usize, line: &'a str) -> Result<(), String> {
        self.split(line);
        if self.cells.len() == self.width + 1 && self.has_open_end() {
            self.cells.pop();
        }
        let found = self.cells.len();
        if found != self.width {
            return Err(format!("line {number}: {found} columns, but {} in the first row", self.width));
        }
        for &column in &self.used {
            let cell = self.cells[column];
            let parsed = match self.delimiter {
                Some(';') => parse_real(&cell.replace(',', ".")),
                _ => parse_real(cell),
            };
            self.numbers.push(parsed.ok_or_else(|| unexpected(number, line))?);
        }
        Ok(())
    }

    fn scan(self, is_counted: bool) -> Result<Scan, String> {
        let columns = |trio: [usize; 3]| -> Vec<[f64; 3]> {
            self.numbers.chunks_exact(self.used.len()).map(|row| trio.map(|column| row[column])).collect()
        };
        let Some(names) = &self.names else { return unnamed(self.width, is_counted, columns) };
        let used: Vec<&str> = self.used.iter().map(|&column| names[column]).collect();
        assemble(&used, |_| Kind::Real, columns)
    }
}

fn unexpected(number: usize, line: &str) -> String {
    let shown: String = line.chars().take(60).collect();
    format!("line {number}: expected a row of numbers, found {shown:?}")
}

/// The delimiter of a line, where it has it the `likely` one. `None`: blanks.
fn delimiter_of(line: &str, likely: Option<char>) -> Option<char> {
    likely.into_iter().chain([';', ',']).find(|delimiter| line.contains(*delimiter))
}

/// Takes a line apart. A quoted cell may hold the delimiter; blanks and quotes about a cell are no part of it.
fn split<'a>(line: &'a str, delimiter: Option<char>, cells: &mut Vec<&'a str>) {
    cells.clear();
    match delimiter {
        None => cells.extend(line.split_whitespace().map(bare)),
        Some(delimiter) if line.contains('"') => {
            cells.extend(line.split(outside_quotes(delimiter)).map(bare))
        }
        Some(delimiter) => cells.extend(line.split(delimiter).map(str::trim)),
    }
}

/// A cell without the blanks and quotes about it.
fn bare(cell: &str) -> &str {
    let cell = cell.trim();
    cell.strip_prefix('"').map_or(cell, |quoted| quoted.strip_suffix('"').unwrap_or(quoted).trim())
}

/// Tells the delimiters that part cells from those within quotes. A quote counts at the start of a cell only, and doubled
/// within one it stands for itself.
fn outside_quotes(delimiter: char) -> impl FnMut(char) -> bool {
    let (mut fresh, mut inside, mut closed) = (true, false, false);
    move |c| {
        let parts = c == delimiter && !inside;
        let quote = c == '"';
        (inside, closed) = (if quote { !inside && (fresh || closed) } else { inside }, quote && inside);
        fresh = parts || (fresh && c == ' ');
        parts
    }
}

/// Columns without names: x y z, then normals and colours in either order, told by their values. Normals are rows of
/// length 1; colours are whole numbers from 0 to 255 or any numbers from 0 to 1. Where the points are counted, as in PTS, the
/// intensity may stand between.
fn unnamed(
    width: usize,
    is_counted: bool,
    columns: impl Fn([usize; 3]) -> Vec<[f64; 3]>,
) -> Result<Scan, String> {
    let has_intensity = is_counted && [4, 7].contains(&width);
    if !has_intensity && ![3, 6, 9].contains(&width) {
        return Err(format!(
            "expected columns x y z, alone or with normals or colours (3, 6 or 9 columns), found {width}; \
             name them in a header line, such as x y z intensity"
        ));
    }
    let mut scan = Scan { points: columns([0, 1, 2]), ..Scan::default() };
    let (mut normals, mut colors) = (None, None);
    for first in (3 + usize::from(has_intensity)..width).step_by(3) {
        let trio = columns([first, first + 1, first + 2]);
        let finite = || trio.iter().filter(|row| row.iter().all(|x| x.is_finite()));
        let unit = |row: &[f64; 3]| (row.iter().map(|x| x * x).sum::<f64>().sqrt() - 1.0).abs() <= 0.01;
        let all = |test: fn(&f64) -> bool| finite().flatten().all(test);
        if normals.is_none() && finite().all(unit) {
            normals = Some(trio);
        } else if colors.is_none()
            && (all(|x| (0.0..=1.0).contains(x)) || all(|x| (0.0..=255.0).contains(x) && x.fract() == 0.0))
        {
            colors = Some(trio);
        } else {
            return Err(format!(
                "cannot tell what columns {} to {} are: neither unit normals nor colours from 0 to 255 or 0 to 1; \
                 name them in a header line",
                first + 1,
                first + 3
            ));
        }
    }
    scan.normals = normals.and_then(known_normals);
    scan.colors = colors.and_then(|values| to_colors(&values, Kind::Real));
    Ok(scan)
}

/// Columns under a header; with blanks the header is a comment, and left out where there is only x y z.
pub(super) fn write(scan: &Scan, delimiter: &str, header_start: &str) -> Vec<u8> {
    let mut names = vec!["x", "y", "z"];
    if scan.normals.is_some() {
        names.extend(["nx", "ny", "nz"]);
    }
    if scan.colors.is_some() {
        names.extend(["red", "green", "blue"]);
    }
    let mut text = String::new();
    if names.len() > 3 || header_start.is_empty() {
        text = format!("{header_start}{}\n", names.join(delimiter));
    }
    for (row, [x, y, z]) in scan.points.iter().enumerate() {
        // Writing to a string cannot fail. {:?} is the shortest text that reads back as the same number.
        let _ = write!(text, "{x:?}{delimiter}{y:?}{delimiter}{z:?}");
        if let Some([x, y, z]) = scan.normals.as_ref().and_then(|normals| normals.get(row)) {
            let _ = write!(text, "{delimiter}{x:?}{delimiter}{y:?}{delimiter}{z:?}");
        }
        if let Some([red, green, blue]) = scan.colors.as_ref().and_then(|colors| colors.get(row)) {
            let _ = write!(text, "{delimiter}{red}{delimiter}{green}{delimiter}{blue}");
        }
        text.push('\n');
    }
    text.into_bytes()
}
