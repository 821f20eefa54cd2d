//! Reading and writing scans: PLY, PCD and plain text (XYZ, TXT, CSV, PTS).
//!
//! The format is recognised by content first, then by suffix. Of a mesh the vertices are read. Points that are not
//! finite, as in organised clouds, are kept; [`PointCloud::from_points`] leaves them out later.
//!
//! - PLY: ascii and binary of both endians, all scalar types; unknown properties and elements are skipped. The position
//!   in PCL's `camera` element is the viewpoint unless it is the origin.
//! - PCD: ascii, binary and binary_compressed. The position in VIEWPOINT is that of the sensor. The default
//!   `0 0 0 1 0 0 0` also stands in clouds that have none, so it counts as a sensor at the origin only where the cloud is
//!   organised (HEIGHT > 1), that is an image of one sensor, and the order of its points does not tell that this stood
//!   elsewhere. One that is not finite is unknown.
//! - Text: one point a line; see [`read`].

mod columns;
mod lzf;
mod pcd;
mod ply;
mod table;
mod xyz;

use std::fs::File;
use std::io::Read;
use std::path::Path;

use crate::cloud::PointCloud;
use crate::error::{Error, Result};

/// What a file says about a scan, in the unit and frame of the file.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Scan {
    /// Points, one row each; a coordinate may be NaN.
    pub points: Vec<[f64; 3]>,
    /// Normals, a row for each point.
    pub normals: Option<Vec<[f64; 3]>>,
    /// Colours (red, green, blue), a row for each point.
    pub colors: Option<Vec<[u8; 3]>>,
    /// Where the sensor stood.
    pub viewpoint: Option<[f64; 3]>,
    /// Whether the points are the vertices of a mesh: those of a CAD model lie where its edges meet, not all over its surface.
    pub is_mesh: bool,
}

impl Scan {
    /// The cloud with its normals and viewpoint; colours play no part in a pose.
    ///
    /// # Errors
    /// Those of [`PointCloud::from_points`], and [`Error::LengthMismatch`] when there is not one normal for each point.
    pub fn into_cloud(self) -> Result<PointCloud> {
        let mut cloud = PointCloud::from_points(self.points)?;
        if let Some(normals) = self.normals {
            cloud = cloud.with_normals(normals)?;
        }
        match self.viewpoint {
            Some(viewpoint) => cloud.with_viewpoints([viewpoint]),
            None => Ok(cloud),
        }
    }
}

/// A format that can be read and written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Format {
    /// Polygon file format.
    Ply,
    /// Point cloud data, the format of PCL.
    Pcd,
    /// Columns parted by blanks.
    Xyz,
    /// Columns parted by commas, under a header.
    Csv,
}

impl Format {
    /// The format in which [`write()`] writes a file of this name.
    ///
    /// # Errors
    /// [`Error::Format`] for a suffix other than .ply, .pcd, .xyz, .txt or .csv.
    pub fn of(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        match suffix(path).as_str() {
            "ply" => Ok(Self::Ply),
            "pcd" => Ok(Self::Pcd),
            "xyz" | "txt" => Ok(Self::Xyz),
            "csv" => Ok(Self::Csv),
            other => {
                Err(bad(path, format!("cannot write {other:?}; expected .ply, .pcd, .xyz, .txt or .csv")))
            }
        }
    }

    /// Whether a file of this format says that the sensor stood at `viewpoint`.
    #[must_use]
    pub fn holds_viewpoint(self, viewpoint: [f64; 3]) -> bool {
        match self {
            Self::Ply => viewpoint != [0.0; 3],
            Self::Pcd => true,
            Self::Xyz | Self::Csv => false,
        }
    }
}

/// Reads a scan.
///
/// Text holds one point a line, in columns parted by blanks, tabs, commas or semicolons (with semicolons, a comma is a
/// decimal comma). Lines that start with `#` or `//` are comments. A header line, also as a comment, names the columns:
/// x y z, nx ny nz or normal_x normal_y normal_z, r g b or red green blue, in any order; others are ignored, and may hold
/// text or nothing. Without a header there are 3, 6 or 9 columns: x y z, then normals or colours or both, told by their
/// values. Cells may be quoted; what is empty after the last delimiter of a line is no column. A first line that is one
/// whole number counts the points, as in PTS; then there may be 4 or 7 columns without a header, of which the fourth is the
/// intensity.
///
/// ```
/// # let folder = tempfile::tempdir().unwrap();
/// # let path = folder.path().join("part.ply");
/// use sympose::io::{self, Scan};
/// io::write(&path, &Scan { points: vec![[0.0, 0.0, 1.0], [0.0, 2.0, 1.0]], ..Scan::default() })?;
/// let cloud = io::read(&path)?.into_cloud()?;
/// assert_eq!(cloud.len(), 2);
/// # Ok::<(), sympose::Error>(())
/// ```
///
/// # Errors
/// [`Error::Io`] when the file is missing or cannot be read; [`Error::Format`] when it is empty, truncated, or of another
/// kind, with what was found and what was expected.
pub fn read(path: impl AsRef<Path>) -> Result<Scan> {
    let path = path.as_ref();
    let io_error = |source| Error::Io { path: path.to_owned(), source };
    let mut file = File::open(path).map_err(io_error)?;
    // The start alone decides, so that an endless or huge foreign file is refused before it is read.
    let mut content = Vec::with_capacity(START);
    file.by_ref().take(START as u64).read_to_end(&mut content).map_err(io_error)?;
    let reader = recognise(&content, path).map_err(|reason| bad(path, reason))?;
    file.read_to_end(&mut content).map_err(io_error)?;
    finish(reader, &content, path)
}

/// Reads a scan that is already in memory; `name` gives the suffix, and the file's name in error messages.
///
/// # Errors
/// [`Error::Format`] as for [`read`].
pub fn parse(content: &[u8], name: impl AsRef<Path>) -> Result<Scan> {
    let name = name.as_ref();
    let start = content.get(..START).unwrap_or(content);
    let reader = recognise(start, name).map_err(|reason| bad(name, reason))?;
    finish(reader, content, name)
}

/// Writes a scan in the format that the suffix names; an existing file is replaced.
///
/// Nothing is rounded: PLY (binary, little endian) and PCD (binary) hold float where every number fits into one, else
/// double; text has as many digits as it takes. A viewpoint is kept by PCD, and by PLY unless it is the origin.
///
/// # Errors
/// [`Error::Format`] for an unknown suffix, [`Error::InsufficientData`] when there is no point,
/// [`Error::LengthMismatch`] when there is not one normal and colour for each point, [`Error::Io`] when the file cannot be
/// written.
pub fn write(path: impl AsRef<Path>, scan: &Scan) -> Result<()> {
    let path = path.as_ref();
    let format = Format::of(path)?;
    let expected = scan.points.len();
    if expected == 0 {
        let hint = "there is no point to write";
        return Err(Error::InsufficientData { stage: "write", needed: 1, got: 0, hint });
    }
    let rows =
        [("normals", scan.normals.as_ref().map(Vec::len)), ("colors", scan.colors.as_ref().map(Vec::len))];
    for (what, got) in rows {
        if let Some(got) = got.filter(|got| *got != expected) {
            return Err(Error::LengthMismatch { what, expected, got });
        }
    }
    let content = match format {
        Format::Ply => ply::write(scan),
        Format::Pcd => pcd::write(scan),
        Format::Xyz => xyz::write(scan, " ", "# "),
        Format::Csv => xyz::write(scan, ",", ""),
    };
    std::fs::write(path, content).map_err(|source| Error::Io { path: path.to_owned(), source })
}

/// Bytes from which a format is recognised.
const START: usize = 4096;

type Reader = fn(&[u8]) -> Result<Scan, String>;

fn recognise(start: &[u8], path: &Path) -> Result<Reader, String> {
    let suffix = suffix(path);
    let begins = String::from_utf8_lossy(&start[..start.len().min(16)]);
    let mut first_words = start.split(|b| *b == b'\n').map(|line| line.split(u8::is_ascii_whitespace).next());
    if start.is_empty() {
        Err("the file is empty".into())
    } else if start.starts_with(b"ply\n") || start.starts_with(b"ply\r") {
        Ok(ply::read)
    } else if start.starts_with(b"# .PCD") || first_words.any(|word| word == Some(b"FIELDS")) {
        Ok(pcd::read)
    } else if suffix == "ply" || suffix == "pcd" {
        Err(format!("not a {} file; it starts with {begins:?}", suffix.to_uppercase()))
    } else if start.starts_with(b"\x93NUMPY") || start.starts_with(b"PK\x03\x04") {
        Err("a NumPy array or an archive, which only the Python package reads; convert it to PLY".into())
    } else if !["", "xyz", "xyzn", "xyzrgb", "txt", "csv", "pts", "asc", "tsv"].contains(&suffix.as_str())
        || start.contains(&0)
    {
        let known = "PLY, PCD, XYZ, TXT, CSV or PTS";
        Err(format!("not a point cloud of a known format ({known}); it starts with {begins:?}"))
    } else {
        Ok(xyz::read)
    }
}

fn finish(reader: Reader, content: &[u8], path: &Path) -> Result<Scan> {
    match reader(content) {
        Ok(scan) if scan.points.is_empty() => Err(bad(path, "the file holds no points".into())),
        Ok(scan) => Ok(scan),
        Err(reason) => Err(bad(path, reason)),
    }
}

fn suffix(path: &Path) -> String {
    path.extension().map(|suffix| suffix.to_string_lossy().to_lowercase()).unwrap_or_default()
}

fn bad(path: &Path, reason: String) -> Error {
    Error::Format { path: path.to_owned(), reason }
}
