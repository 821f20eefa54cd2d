//! PLY, ascii and binary. An own reader, since `ply-rs-bw` refuses NaN in text and the punctuation that CloudCompare
//! puts into property names.

use std::borrow::Cow;

use super::Scan;
use super::columns::given_twice;
use super::table::{Field, Scalar, Table, fits_f32};

/// What the header may call the encoding.
const FORMATS: &str = "ascii, binary_little_endian or binary_big_endian 1.0";

#[derive(Clone, Copy, PartialEq, Eq)]
enum Encoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

struct Property {
    name: String,
    scalar: Scalar,
    /// Type of the number of items, where the property is a list.
    length: Option<Scalar>,
}

struct Element {
    name: String,
    count: usize,
    properties: Vec<Property>,
}

/// Reads the vertices. All elements are walked through, so that a truncated file is noticed.
pub(super) fn read(content: &[u8]) -> Result<Scan, String> {
    // Lines end as the first one does; in files of old Macs with CR alone.
    let alone = content.starts_with(b"ply\r") && !content.starts_with(b"ply\r\n");
    let end = if alone { b'\r' } else { b'\n' };
    let mut rest = content;
    let (encoding, elements) = header(&mut rest, end)?;
    let mut scan = None;
    let mut viewpoint = None;
    let mut is_mesh = false;
    for element in &elements {
        let table = match encoding {
            Encoding::Ascii => text_rows(element, &mut rest, end)?,
            _ if element.properties.iter().any(|p| p.length.is_some()) => {
                list_rows(element, encoding == Encoding::BigEndian, &mut rest)?
            }
            _ => fixed_rows(element, encoding == Encoding::BigEndian, &mut rest)?,
        };
        match element.name.as_str() {
            "vertex" => scan = Some(table.scan()?),
            "camera" => viewpoint = sensor(&table),
            "face" | "tristrips" => is_mesh |= element.count > 0,
            _ => {}
        }
    }
    let names = || elements.iter().map(|element| element.name.as_str()).collect::<Vec<_>>();
    let scan =
        scan.ok_or_else(|| format!("expected an element vertex, found {}", super::columns::list(&names())))?;
    Ok(Scan { viewpoint, is_mesh, ..scan })
}

/// Position of the sensor in the `camera` element that PCL writes; at the origin it says nothing.
fn sensor(table: &Table) -> Option<[f64; 3]> {
    let names = table.names();
    let column = |wanted: &str| names.iter().position(|name| *name == wanted);
    let trio = [column("view_px")?, column("view_py")?, column("view_pz")?];
    let [position] = table.columns(trio)[..] else { return None };
    (position.iter().all(|x| x.is_finite()) && position != [0.0; 3]).then_some(position)
}

fn header(rest: &mut &[u8], end: u8) -> Result<(Encoding, Vec<Element>), String> {
    let mut encoding = None;
    let mut elements: Vec<Element> = Vec::new();
    loop {
        let line = next_line(rest, end).ok_or("the PLY header ends without a line end_header")?;
        let line = String::from_utf8_lossy(line);
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        match (words.as_slice(), elements.last_mut()) {
            (["ply"] | ["comment" | "obj_info", ..] | [], _) => {}
            (["format", "ascii", "1.0"], _) => encoding = Some(Encoding::Ascii),
            (["format", "binary_little_endian", "1.0"], _) => encoding = Some(Encoding::LittleEndian),
            (["format", "binary_big_endian", "1.0"], _) => encoding = Some(Encoding::BigEndian),
            (["format", kind, version], _) => {
                return Err(format!("the PLY header has format {kind} {version}; expected {FORMATS}"));
            }
            (["element", name, count], _) => {
                let count =
                    count.parse().map_err(|_| format!("the PLY header announces {count:?} of {name}"))?;
                elements.push(Element { name: (*name).to_owned(), count, properties: Vec::new() });
            }
            (["property", "list", length, kind, name], Some(element)) => element.properties.push(Property {
                name: (*name).to_owned(),
                scalar: scalar(kind)?,
                length: Some(scalar(length)?),
            }),
            (["property", kind, name], Some(element)) => element.properties.push(Property {
                name: (*name).to_owned(),
                scalar: scalar(kind)?,
                length: None,
            }),
            (["end_header"], _) => break,
            _ => {
                let shown: String = line.trim().chars().take(60).collect();
                return Err(format!("expected a line of a PLY header, found {shown:?}"));
            }
        }
    }
    let names: Vec<&str> = elements.iter().map(|element| element.name.as_str()).collect();
    if let Some(name) = given_twice(&names) {
        return Err(format!("the PLY header has element {name} twice"));
    }
    for element in &elements {
        let names: Vec<&str> = element.properties.iter().map(|property| property.name.as_str()).collect();
        if let Some(name) = given_twice(&names) {
            return Err(format!("the PLY header has property {name} of element {} twice", element.name));
        }
    }
    let encoding =
        encoding.ok_or_else(|| format!("the PLY header has no line format; expected {FORMATS}"))?;
    Ok((encoding, elements))
}

fn scalar(name: &str) -> Result<Scalar, String> {
    Ok(match name {
        "char" | "int8" => Scalar::I8,
        "uchar" | "uint8" => Scalar::U8,
        "short" | "int16" => Scalar::I16,
        "ushort" | "uint16" => Scalar::U16,
        "int" | "int32" => Scalar::I32,
        "uint" | "uint32" => Scalar::U32,
        "float" | "float32" => Scalar::F32,
        "double" | "float64" => Scalar::F64,
        other => {
            return Err(format!("unknown PLY type {other:?}; expected char ... double, or int8 ... float64"));
        }
    })
}

impl Element {
    /// The scalar properties, packed one after the other, and the bytes that a row of them takes.
    fn fields(&self) -> (Vec<Field>, usize) {
        let scalars = || self.properties.iter().filter(|property| property.length.is_none());
        let step = scalars().map(|property| property.scalar.size()).sum();
        let mut start = 0;
        let fields = scalars().map(|property| {
            let field = Field { name: property.name.clone(), scalar: property.scalar, start, step };
            start += property.scalar.size();
            field
        });
        (fields.collect(), step)
    }

    fn truncated(&self, row: usize) -> String {
        format!(
            "truncated: the header announces {} of element {}, the file holds {row}",
            self.count, self.name
        )
    }
}

fn fixed_rows<'a>(element: &Element, big_endian: bool, rest: &mut &'a [u8]) -> Result<Table<'a>, String> {
    let (fields, step) = element.fields();
    let taken = element.count.checked_mul(step).and_then(|size| rest.split_at_checked(size));
    let (bytes, after) = taken.ok_or_else(|| element.truncated(rest.len() / step.max(1)))?;
    *rest = after;
    Ok(Table { bytes: Cow::Borrowed(bytes), big_endian, rows: element.count, fields })
}

/// Rows with lists have no fixed size: the scalars are copied out, the lists passed over.
fn list_rows(element: &Element, big_endian: bool, rest: &mut &[u8]) -> Result<Table<'static>, String> {
    let mut bytes = Vec::new();
    for row in 0..element.count {
        for property in &element.properties {
            let mut take = |size: usize| {
                let (taken, after) = rest.split_at_checked(size).ok_or_else(|| element.truncated(row))?;
                *rest = after;
                Ok::<_, String>(taken)
            };
            match property.length {
                None => bytes.extend_from_slice(take(property.scalar.size())?),
                Some(length) => {
                    let count = length.decode(take(length.size())?, big_endian);
                    if count < 0.0 || count.fract() != 0.0 {
                        return Err(format!("{} {row}: {} has {count} items", element.name, property.name));
                    }
                    take((count as usize).saturating_mul(property.scalar.size()))?;
                }
            }
        }
    }
    Ok(Table { bytes: Cow::Owned(bytes), big_endian, rows: element.count, fields: element.fields().0 })
}

fn text_rows(element: &Element, rest: &mut &[u8], end: u8) -> Result<Table<'static>, String> {
    let mut bytes = Vec::new();
    for row in 0..element.count {
        let line = next_line(rest, end).ok_or_else(|| element.truncated(row))?;
        let line = String::from_utf8_lossy(line);
        let mut tokens = line.split_ascii_whitespace();
        let parsed: Option<()> = element.properties.iter().try_for_each(|property| match property.length {
            None => property.scalar.encode(tokens.next()?, &mut bytes),
            Some(_) => match tokens.next()?.parse().ok()? {
                0 => Some(()),
                items => tokens.nth(items - 1).map(|_: &str| ()),
            },
        });
        if parsed.is_none() || tokens.next().is_some() {
            let names: Vec<_> = element.properties.iter().map(|property| property.name.as_str()).collect();
            let (names, shown) =
                (super::columns::list(&names), line.trim().chars().take(60).collect::<String>());
            return Err(format!("{} {row}: expected numbers for {names}, found {shown:?}", element.name));
        }
    }
    Ok(Table { bytes: Cow::Owned(bytes), big_endian: false, rows: element.count, fields: element.fields().0 })
}

/// Takes a line without its `end`; `None` at the end of the file.
fn next_line<'a>(rest: &mut &'a [u8], end: u8) -> Option<&'a [u8]> {
    if rest.is_empty() {
        return None;
    }
    let (line, after) = match rest.iter().position(|byte| *byte == end) {
        Some(end) => (&rest[..end], &rest[end + 1..]),
        None => (*rest, &rest[rest.len()..]),
    };
    *rest = after;
    Some(line)
}

/// Binary, little endian.
pub(super) fn write(scan: &Scan) -> Vec<u8> {
    let normals = scan.normals.as_deref();
    let single = fits_f32(scan.points.iter().chain(normals.into_iter().flatten()));
    let real = if single { "float" } else { "double" };
    let mut header = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\n\
         property {real} x\nproperty {real} y\nproperty {real} z\n",
        scan.points.len()
    );
    if normals.is_some() {
        header += &format!("property {real} nx\nproperty {real} ny\nproperty {real} nz\n");
    }
    if scan.colors.is_some() {
        header += "property uchar red\nproperty uchar green\nproperty uchar blue\n";
    }
    if scan.viewpoint.is_some() {
        header +=
            "element camera 1\nproperty double view_px\nproperty double view_py\nproperty double view_pz\n";
    }
    let mut bytes = (header + "end_header\n").into_bytes();
    for (row, point) in scan.points.iter().enumerate() {
        push_reals(&mut bytes, point, single);
        if let Some(normal) = normals.and_then(|normals| normals.get(row)) {
            push_reals(&mut bytes, normal, single);
        }
        if let Some(color) = scan.colors.as_ref().and_then(|colors| colors.get(row)) {
            bytes.extend_from_slice(color);
        }
    }
    if let Some(viewpoint) = &scan.viewpoint {
        push_reals(&mut bytes, viewpoint, false);
    }
    bytes
}

/// Appends numbers as little-endian floats or doubles.
pub(super) fn push_reals(bytes: &mut Vec<u8>, values: &[f64; 3], single: bool) {
    for value in values {
        if single {
            bytes.extend_from_slice(&(*value as f32).to_le_bytes());
        } else {
            bytes.extend_from_slice(&value.to_le_bytes());
        }
    }
}
