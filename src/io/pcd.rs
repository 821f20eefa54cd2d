//! PCD 0.7, the format of PCL, and its older versions.

use std::borrow::Cow;

use super::Scan;
use super::columns::given_twice;
use super::lzf;
use super::ply::push_reals;
use super::table::{Field, Scalar, Table, fits_f32};
use crate::preprocess::{SensorPlaces, viewpoints_from_order};

/// A column of the header: `count` numbers a point.
struct Column {
    name: String,
    scalar: Scalar,
    count: usize,
}

struct Header {
    columns: Vec<Column>,
    points: usize,
    height: usize,
    /// Position of the sensor, then its orientation as w x y z.
    viewpoint: [f64; 7],
    encoding: String,
}

const DEFAULT_VIEWPOINT: [f64; 7] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0];

/// Reads ascii, binary and binary_compressed.
pub(super) fn read(content: &[u8]) -> Result<Scan, String> {
    let (header, body) = header(content)?;
    let table = match header.encoding.as_str() {
        "ascii" => header.text_rows(body)?,
        "binary" => header.rows(Cow::Borrowed(body), false)?,
        "binary_compressed" => header.rows(Cow::Owned(header.expand(body)?), true)?,
        other => return Err(format!("DATA {other}: expected ascii, binary or binary_compressed")),
    };
    let mut scan = table.scan()?;
    if scan.colors.is_none() {
        scan.colors = packed_colors(&table);
    }
    let [x, y, z, ..] = header.viewpoint;
    // Some programs write NaN for a sensor that they know nothing of.
    let known = [x, y, z].iter().all(|coordinate| coordinate.is_finite());
    let is_given = header.viewpoint != DEFAULT_VIEWPOINT;
    if known && (is_given || header.height > 1 && may_be_seen_from_origin(&scan.points)) {
        scan.viewpoint = Some([x, y, z]);
    }
    Ok(scan)
}

/// Whether the order of the points of an image does not tell that the sensor stood elsewhere than at the origin: programs that move
/// an image to another frame seldom move its VIEWPOINT, too.
fn may_be_seen_from_origin(points: &[[f64; 3]]) -> bool {
    /// Distance from the origin that matters [distance to the points].
    const AWAY: f64 = 0.1;
    let norm = |p: [f64; 3]| p.iter().map(|x| x * x).sum::<f64>().sqrt();
    let finite: Vec<[f64; 3]> = points.iter().copied().filter(|p| p.iter().all(|x| x.is_finite())).collect();
    let Ok(Some(SensorPlaces { places, .. })) = viewpoints_from_order(&finite) else { return true };
    let count = finite.len() as f64;
    let middle: [f64; 3] = std::array::from_fn(|i| finite.iter().map(|p| p[i]).sum::<f64>() / count);
    places.iter().all(|&place| norm(place) <= AWAY * norm(std::array::from_fn(|i| middle[i] - place[i])))
}

/// Splits off the header: lines of a keyword and its values, the last of them DATA.
fn header(content: &[u8]) -> Result<(Header, &[u8]), String> {
    let mut lines: Vec<(String, Vec<String>)> = Vec::new();
    let mut rest = content;
    while lines.last().is_none_or(|(key, _)| key != "DATA") {
        let end =
            rest.iter().position(|byte| *byte == b'\n').ok_or("the PCD header ends without a line DATA")?;
        let line = String::from_utf8_lossy(&rest[..end]);
        let mut words = line.split_ascii_whitespace().map(str::to_owned);
        if let Some(key) = words.next().filter(|key| !key.starts_with('#')) {
            lines.push((key, words.collect()));
        }
        rest = &rest[end + 1..];
    }
    let find = |key: &str| lines.iter().find(|(k, _)| k == key).map(|(_, values)| values.as_slice());
    let values = |key: &str| find(key).ok_or_else(|| format!("the PCD header has no line {key}"));
    let number = |key: &str| {
        let [value] = values(key)? else {
            return Err(format!("the PCD header has no single number in {key}"));
        };
        value.parse::<usize>().map_err(|_| format!("the PCD header has {key} {value:?}"))
    };
    let (names, sizes, types) = (values("FIELDS")?, values("SIZE")?, values("TYPE")?);
    let ones = vec!["1".to_owned(); names.len()];
    let counts = find("COUNT").unwrap_or(&ones);
    if [sizes.len(), types.len(), counts.len()] != [names.len(); 3] {
        return Err(format!(
            "the PCD header has {} FIELDS, {} in SIZE, {} in TYPE, {} in COUNT",
            names.len(),
            sizes.len(),
            types.len(),
            counts.len()
        ));
    }
    let fields: Vec<&str> = names.iter().map(String::as_str).collect();
    if let Some(name) = given_twice(&fields) {
        return Err(format!("the PCD header has field {name} twice"));
    }
    let columns = (0..names.len()).map(|i| {
        let count = counts[i].parse().map_err(|_| format!("the PCD header has COUNT {:?}", counts[i]))?;
        Ok(Column { name: names[i].clone(), scalar: scalar(&types[i], &sizes[i])?, count })
    });
    let columns = columns.collect::<Result<_, String>>()?;
    let (width, height, points) = (number("WIDTH")?, number("HEIGHT")?, number("POINTS")?);
    if width.checked_mul(height) != Some(points) {
        return Err(format!("the PCD header has WIDTH {width} x HEIGHT {height}, but POINTS {points}"));
    }
    let viewpoint = find("VIEWPOINT").map_or(Ok(DEFAULT_VIEWPOINT), |values| {
        let parsed: Result<Vec<f64>, _> = values.iter().map(|value| value.parse()).collect();
        parsed
            .ok()
            .and_then(|numbers| numbers.try_into().ok())
            .ok_or_else(|| format!("VIEWPOINT {}: expected tx ty tz qw qx qy qz", values.join(" ")))
    })?;
    let encoding = values("DATA")?.first().map(|word| word.to_lowercase()).unwrap_or_default();
    Ok((Header { columns, points, height, viewpoint, encoding }, rest))
}

fn scalar(kind: &str, size: &str) -> Result<Scalar, String> {
    Ok(match (kind.to_ascii_uppercase().as_str(), size) {
        ("I", "1") => Scalar::I8,
        ("U", "1") => Scalar::U8,
        ("I", "2") => Scalar::I16,
        ("U", "2") => Scalar::U16,
        ("I", "4") => Scalar::I32,
        ("U", "4") => Scalar::U32,
        ("I", "8") => Scalar::I64,
        ("U", "8") => Scalar::U64,
        ("F", "4") => Scalar::F32,
        ("F", "8") => Scalar::F64,
        _ => {
            return Err(format!(
                "the PCD header has TYPE {kind} SIZE {size}; expected I or U of 1, 2, 4, 8 or F of 4, 8"
            ));
        }
    })
}

impl Header {
    /// Bytes of one point.
    fn step(&self) -> Result<usize, String> {
        let sizes = self.columns.iter().map(|column| column.count.checked_mul(column.scalar.size()));
        sizes
            .into_iter()
            .try_fold(0_usize, |sum, size| sum.checked_add(size?))
            .ok_or_else(|| "the PCD header has an absurd COUNT".into())
    }

    /// Bytes of all points.
    fn size(&self) -> Result<usize, String> {
        let size = self.step()?.checked_mul(self.points);
        size.ok_or_else(|| format!("the PCD header has an absurd number of POINTS {}", self.points))
    }

    /// Bytes point by point or, with `by_column`, column by column.
    fn rows<'a>(&self, bytes: Cow<'a, [u8]>, by_column: bool) -> Result<Table<'a>, String> {
        let (step, size) = (self.step()?, self.size()?);
        if bytes.len() < size {
            let (points, got) = (self.points, bytes.len());
            return Err(format!(
                "truncated: the header announces {points} points of {step} bytes, which is {size}, the file holds {got}"
            ));
        }
        let mut offset = 0;
        let mut fields = Vec::new();
        for Column { name, scalar, count } in &self.columns {
            let width = count * scalar.size();
            if *count == 1 {
                let start = if by_column { offset * self.points } else { offset };
                let step = if by_column { width } else { step };
                fields.push(Field { name: name.clone(), scalar: *scalar, start, step });
            }
            offset += width;
        }
        Ok(Table { bytes, big_endian: false, rows: self.points, fields })
    }

    fn expand(&self, body: &[u8]) -> Result<Vec<u8>, String> {
        let sizes = body.split_first_chunk().and_then(|(compressed, rest)| {
            let (expanded, data) = rest.split_first_chunk()?;
            Some((u32::from_le_bytes(*compressed) as usize, u32::from_le_bytes(*expanded) as usize, data))
        });
        let (compressed, expanded, data) =
            sizes.ok_or("truncated: the sizes of the compressed data are missing")?;
        if expanded != self.size()? {
            return Err(format!(
                "the header announces {} points of {} bytes, the compressed data {expanded} bytes",
                self.points,
                self.step()?
            ));
        }
        let data = data.get(..compressed).ok_or_else(|| {
            format!(
                "truncated: {compressed} bytes of compressed data are announced, the file holds {}",
                data.len()
            )
        })?;
        lzf::expand(data, expanded).ok_or_else(|| "the compressed data is damaged".into())
    }

    fn text_rows(&self, body: &[u8]) -> Result<Table<'static>, String> {
        let mut bytes = Vec::new();
        let mut points = 0;
        for line in body.split(|byte| *byte == b'\n') {
            let line = String::from_utf8_lossy(line);
            let mut tokens = line.split_ascii_whitespace().peekable();
            if tokens.peek().is_none_or(|token| token.starts_with('#')) {
                continue;
            }
            let parsed: Option<()> = self.columns.iter().try_for_each(|column| {
                (0..column.count).try_for_each(|_| column.scalar.encode(tokens.next()?, &mut bytes))
            });
            if parsed.is_none() || tokens.next().is_some() {
                let names: Vec<_> = self.columns.iter().map(|column| column.name.as_str()).collect();
                let names = super::columns::list(&names);
                let shown: String = line.trim().chars().take(60).collect();
                return Err(format!("point {points}: expected numbers for {names}, found {shown:?}"));
            }
            points += 1;
        }
        if points != self.points {
            return Err(format!("the header announces {} points, the file holds {points}", self.points));
        }
        self.rows(Cow::Owned(bytes), false)
    }
}

/// Colours of the field rgb or rgba: four bytes in one float or integer, blue lowest.
fn packed_colors(table: &Table) -> Option<Vec<[u8; 3]>> {
    let packed = ["rgb", "rgba"].iter().find_map(|wanted| {
        table.fields.iter().find(|field| field.name == *wanted && field.scalar.size() == 4)
    })?;
    table
        .cells(packed)
        .map(|cell| cell.first_chunk().map(|[blue, green, red]| [*red, *green, *blue]))
        .collect()
}

/// Binary.
pub(super) fn write(scan: &Scan) -> Vec<u8> {
    let normals = scan.normals.as_deref();
    let single = fits_f32(scan.points.iter().chain(normals.into_iter().flatten()));
    let size = if single { " 4" } else { " 8" };
    let mut reals = 3;
    let mut fields = String::from(" x y z");
    if normals.is_some() {
        reals = 6;
        fields += " normal_x normal_y normal_z";
    }
    let (mut sizes, mut types, mut counts) = (size.repeat(reals), " F".repeat(reals), " 1".repeat(reals));
    if scan.colors.is_some() {
        fields += " rgb";
        sizes += " 4";
        types += " F";
        counts += " 1";
    }
    // A known sensor gets the quaternion -1 0 0 0, the same rotation as 1 0 0 0, so that it cannot be mistaken for the
    // default that means nothing when it stands at the origin.
    let viewpoint =
        scan.viewpoint.map_or("0 0 0 1 0 0 0".into(), |[x, y, z]| format!("{x:?} {y:?} {z:?} -1 0 0 0"));
    let count = scan.points.len();
    let header = format!(
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS{fields}\nSIZE{sizes}\nTYPE{types}\n\
         COUNT{counts}\nWIDTH {count}\nHEIGHT 1\nVIEWPOINT {viewpoint}\nPOINTS {count}\nDATA binary\n"
    );
    let mut bytes = header.into_bytes();
    for (row, point) in scan.points.iter().enumerate() {
        push_reals(&mut bytes, point, single);
        if let Some(normal) = normals.and_then(|normals| normals.get(row)) {
            push_reals(&mut bytes, normal, single);
        }
        if let Some([red, green, blue]) = scan.colors.as_ref().and_then(|colors| colors.get(row)) {
            bytes.extend_from_slice(&[*blue, *green, *red, 0]);
        }
    }
    bytes
}
