//! Text: XYZ, TXT, CSV; the rules stand at [`read`](super::read).

use std::fmt::Write;

use super::Scan;
use super::columns::{Kind, assemble, known_normals, list, roles, to_colors};

pub(super) fn read(content: &[u8]) -> Result<Scan, String> {
    let content = content.strip_prefix(b"\xef\xbb\xbf").unwrap_or(content);
    let text = std::str::from_utf8(content).map_err(|error| format!("not a text file: {error}"))?;
    let mut names: Option<Vec<String>> = None;
    let mut delimiter = None;
    let mut width = 0;
    let mut numbers: Vec<f64> = Vec::new();
    for (number, line) in (1..).zip(text.lines()) {
        let line = line.trim();
        let comment = line.starts_with('#') || line.starts_with("//");
        if comment || line.is_empty() {
            // A comment above the points may name the columns.
            let title = split(line.trim_start_matches(['#', '/', ' ', '\t']));
            if numbers.is_empty() && roles(&title).is_some() {
                names = Some(title.into_iter().map(str::to_owned).collect());
            }
            continue;
        }
        if numbers.is_empty() {
            let title = split(line);
            if title.first().is_none_or(|token| token.replace(',', ".").parse::<f64>().is_err()) {
                if names.is_some() {
                    return Err(unexpected(number, line));
                }
                names = Some(title.into_iter().map(str::to_owned).collect());
                continue;
            }
            delimiter = delimiter_of(line);
        }
        let before = numbers.len();
        // As NumPy does, take what follows a # in a row for a comment.
        let row = line.split('#').next().unwrap_or(line);
        parse_row(row, delimiter, &mut numbers).ok_or_else(|| unexpected(number, line))?;
        let found = numbers.len() - before;
        if before == 0 {
            width = found;
        }
        if found != width {
            return Err(format!("line {number}: {found} columns, but {width} in the first row"));
        }
    }
    if numbers.is_empty() {
        let shown: String = text.trim().chars().take(40).collect();
        return Err(format!("expected rows of numbers x y z, found {shown:?}"));
    }
    let columns = |trio: [usize; 3]| -> Vec<[f64; 3]> {
        numbers.chunks_exact(width).map(|row| trio.map(|column| row[column])).collect()
    };
    match names {
        Some(names) if names.len() != width => {
            let names: Vec<&str> = names.iter().map(String::as_str).collect();
            Err(format!("the header names {} columns ({}), the rows have {width}", names.len(), list(&names)))
        }
        Some(names) => {
            let names: Vec<&str> = names.iter().map(String::as_str).collect();
            assemble(&names, |_| Kind::Real, columns)
        }
        None => unnamed(width, columns),
    }
}

fn unexpected(number: usize, line: &str) -> String {
    let shown: String = line.chars().take(60).collect();
    format!("line {number}: expected a row of numbers, found {shown:?}")
}

/// `None`: blanks.
fn delimiter_of(line: &str) -> Option<char> {
    [';', ','].into_iter().find(|delimiter| line.contains(*delimiter))
}

fn split(line: &str) -> Vec<&str> {
    match delimiter_of(line) {
        Some(delimiter) => line.split(delimiter).map(|token| token.trim().trim_matches('"')).collect(),
        None => line.split_whitespace().map(|token| token.trim_matches('"')).collect(),
    }
}

fn parse_row(row: &str, delimiter: Option<char>, numbers: &mut Vec<f64>) -> Option<()> {
    let mut push = |token: &str| {
        numbers.push(token.parse().ok()?);
        Some(())
    };
    match delimiter {
        None => row.split_whitespace().try_for_each(push),
        Some(';') => row.split(';').try_for_each(|token| push(&token.trim().replace(',', "."))),
        Some(delimiter) => row.split(delimiter).try_for_each(|token| push(token.trim())),
    }
}

/// Columns without names: x y z, then normals and colours in either order, told by their values. Normals are rows of
/// length 1; colours are whole numbers from 0 to 255 or any numbers from 0 to 1.
fn unnamed(width: usize, columns: impl Fn([usize; 3]) -> Vec<[f64; 3]>) -> Result<Scan, String> {
    if ![3, 6, 9].contains(&width) {
        return Err(format!(
            "expected columns x y z, alone or with normals or colours (3, 6 or 9 columns), found {width}"
        ));
    }
    let mut scan = Scan { points: columns([0, 1, 2]), ..Scan::default() };
    let (mut normals, mut colors) = (None, None);
    for first in (3..width).step_by(3) {
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
