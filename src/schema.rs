//! The JSON schema of an [`Estimate`], shared with the Python package: its names, and `"schema_version": 1`.
//!
//! Serialising an [`Estimate`] writes everything; [`Estimate::summary`] leaves out the arrays that have a row for each
//! point or angle. Those may be missing when read, and are then empty. Unknown names are ignored.
//!
//! - `pose` is 4x4, row by row; `axis`, `center` and `quaternion` (x y z w) repeat it in other words.
//! - Numbers that are not finite are `null`: in `covariance` an infinite variance.
//! - Every number is written so that it reads back as the same one; a reader in Rust needs `serde_json` with its feature
//!   `float_roundtrip` for that.

use std::borrow::Cow;
use std::collections::BTreeMap;

use nalgebra::{Isometry3, Quaternion, Rotation3, Translation3, UnitQuaternion};
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::error::shown;
use crate::result::{Candidate, Diagnostic, Estimate, FreeDirection};
use crate::symmetry::order::Order;

/// The version of the schema that is written, and the only one that is read.
pub const SCHEMA_VERSION: u32 = 1;

/// How far the quaternion may be from unit length and from the rotation in `pose`.
const ROTATION_TOLERANCE: f64 = 1e-6;

type Rows<'a, T> = Option<Cow<'a, [T]>>;

/// The schema: an estimate as it stands in JSON.
#[derive(Serialize, Deserialize)]
struct Document<'a> {
    // First, so that a file of another version is refused before anything in it is.
    schema_version: Version,
    pose: [[f64; 4]; 4],
    axis: [f64; 3],
    center: [f64; 3],
    quaternion: [f64; 4],
    order: Order,
    score: f64,
    explained: f64,
    covariance: [[Option<f64>; 6]; 6],
    unobservable: Cow<'a, [FreeDirection]>,
    warnings: Cow<'a, [String]>,
    ground: Option<[f64; 4]>,
    candidates: Cow<'a, [Candidate]>,
    timings: Cow<'a, BTreeMap<String, f64>>,
    diagnostics: BTreeMap<String, Figure>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    match_curve: Rows<'a, [f64; 2]>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    points: Rows<'a, [f64; 3]>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    normals: Rows<'a, [f64; 3]>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    inliers: Rows<'a, u32>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    point_of_inlier: Rows<'a, u32>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    completed: Rows<'a, [f64; 3]>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    completed_sector: Rows<'a, u32>,
}

/// [`SCHEMA_VERSION`], or an error.
struct Version;

impl Serialize for Version {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        SCHEMA_VERSION.serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Version {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        match u64::deserialize(deserializer)? {
            found if found == u64::from(SCHEMA_VERSION) => Ok(Self),
            found => Err(D::Error::custom(format!(
                "schema_version {found}: this version of sympose reads {SCHEMA_VERSION}"
            ))),
        }
    }
}

/// A [`Diagnostic`] whose numbers may be missing.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum Figure {
    Flag(bool),
    Number(f64),
    Text(String),
    Series(Vec<Option<f64>>),
    NotFinite,
}

impl From<&Diagnostic> for Figure {
    fn from(diagnostic: &Diagnostic) -> Self {
        match diagnostic {
            Diagnostic::Flag(flag) => Self::Flag(*flag),
            Diagnostic::Number(number) => finite(*number).map_or(Self::NotFinite, Self::Number),
            Diagnostic::Text(text) => Self::Text(text.clone()),
            Diagnostic::Series(series) => Self::Series(series.iter().copied().map(finite).collect()),
        }
    }
}

impl From<Figure> for Diagnostic {
    fn from(figure: Figure) -> Self {
        match figure {
            Figure::Flag(flag) => Self::Flag(flag),
            Figure::Number(number) => Self::Number(number),
            Figure::Text(text) => Self::Text(text),
            Figure::Series(series) => {
                Self::Series(series.into_iter().map(|number| number.unwrap_or(f64::NAN)).collect())
            }
            Figure::NotFinite => Self::Number(f64::NAN),
        }
    }
}

fn finite(number: f64) -> Option<f64> {
    number.is_finite().then_some(number)
}

impl<'a> Document<'a> {
    fn new(estimate: &'a Estimate, full: bool) -> Self {
        let pose = estimate.world_from_object.to_homogeneous();
        let column = |column: usize| std::array::from_fn(|row| pose[(row, column)]);
        let q = estimate.world_from_object.rotation.coords;
        let kept = |rows: &'a Vec<[f64; 3]>| full.then(|| Cow::from(rows));
        let indices = |rows: &'a Vec<u32>| full.then(|| Cow::from(rows));
        Self {
            schema_version: Version,
            pose: std::array::from_fn(|row| std::array::from_fn(|column| pose[(row, column)])),
            axis: column(2),
            center: column(3),
            quaternion: [q.x, q.y, q.z, q.w],
            order: estimate.order,
            score: estimate.score,
            explained: estimate.explained,
            covariance: estimate.covariance.map(|row| row.map(finite)),
            unobservable: Cow::from(&estimate.unobservable),
            warnings: Cow::from(&estimate.warnings),
            ground: estimate.ground,
            candidates: Cow::from(&estimate.candidates),
            timings: Cow::Borrowed(&estimate.timings),
            diagnostics: estimate.diagnostics.iter().map(|(name, d)| (name.clone(), d.into())).collect(),
            match_curve: full.then(|| Cow::from(&estimate.match_curve)),
            points: kept(&estimate.points),
            normals: kept(&estimate.normals),
            inliers: indices(&estimate.inliers),
            point_of_inlier: indices(&estimate.point_of_inlier),
            completed: kept(&estimate.completed),
            completed_sector: indices(&estimate.completed_sector),
        }
    }

    /// Arrays that belong together must have the same number of rows.
    fn check_lengths(&self) -> Result<(), String> {
        fn length<T: Clone>(rows: &Rows<T>) -> usize {
            rows.as_ref().map_or(0, |rows| rows.len())
        }
        for (one, other, first, second) in [
            ("points", "normals", length(&self.points), length(&self.normals)),
            ("inliers", "point_of_inlier", length(&self.inliers), length(&self.point_of_inlier)),
            ("completed", "completed_sector", length(&self.completed), length(&self.completed_sector)),
        ] {
            if first != second {
                return Err(format!("{one} has {first} rows, but {other} {second}"));
            }
        }
        Ok(())
    }

    /// The pose, from the quaternion, which unlike the matrix has one number too many only.
    fn world_from_object(&self) -> Result<Isometry3<f64>, String> {
        let [x, y, z, w] = self.quaternion;
        let quaternion = Quaternion::new(w, x, y, z);
        let norm = quaternion.norm();
        if (norm - 1.0).abs() > ROTATION_TOLERANCE || !norm.is_finite() {
            return Err(format!(
                "quaternion {:?}: expected unit length, found {}",
                self.quaternion,
                shown(norm)
            ));
        }
        // Taken as it is: scaling it again would change its last bits.
        let rotation = UnitQuaternion::new_unchecked(quaternion);
        let matrix = Rotation3::from(rotation);
        let agree = |row: usize, column: usize| {
            (self.pose[row][column] - matrix[(row, column)]).abs() <= 10.0 * ROTATION_TOLERANCE
        };
        if !(0..3).all(|row| (0..3).all(|column| agree(row, column))) || self.pose[3] != [0.0, 0.0, 0.0, 1.0]
        {
            return Err("pose is no rigid motion, or contradicts quaternion".into());
        }
        let [x, y, z] = [0, 1, 2].map(|row| self.pose[row][3]);
        Ok(Isometry3::from_parts(Translation3::new(x, y, z), rotation))
    }
}

impl Serialize for Estimate {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        Document::new(self, true).serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Estimate {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let document = Document::deserialize(deserializer)?;
        document.check_lengths().map_err(D::Error::custom)?;
        if document.order == Order::Auto {
            return Err(D::Error::custom(
                "order = auto: expected the order that was found, a whole number from 2 or \"continuous\"",
            ));
        }
        let rows = |rows: Rows<[f64; 3]>| rows.unwrap_or_default().into_owned();
        let indices = |rows: Rows<u32>| rows.unwrap_or_default().into_owned();
        Ok(Self {
            world_from_object: document.world_from_object().map_err(D::Error::custom)?,
            order: document.order,
            score: document.score,
            explained: document.explained,
            covariance: document.covariance.map(|row| row.map(|number| number.unwrap_or(f64::INFINITY))),
            unobservable: document.unobservable.into_owned(),
            warnings: document.warnings.into_owned(),
            points: rows(document.points),
            normals: rows(document.normals),
            inliers: indices(document.inliers),
            point_of_inlier: indices(document.point_of_inlier),
            completed: rows(document.completed),
            completed_sector: indices(document.completed_sector),
            ground: document.ground,
            match_curve: document.match_curve.unwrap_or_default().into_owned(),
            candidates: document.candidates.into_owned(),
            timings: document.timings.into_owned(),
            diagnostics: document
                .diagnostics
                .into_iter()
                .map(|(name, figure)| (name, figure.into()))
                .collect(),
        })
    }
}

/// An estimate without its long arrays; see [`Estimate::summary`].
pub struct Summary<'a>(&'a Estimate);

impl Serialize for Summary<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        Document::new(self.0, false).serialize(serializer)
    }
}

impl Estimate {
    /// What is serialised of an estimate that only a few kilobytes are wanted of: all but `points`, `normals`,
    /// `inliers`, `point_of_inlier`, `completed`, `completed_sector` and `match_curve`.
    #[must_use]
    pub fn summary(&self) -> Summary<'_> {
        Summary(self)
    }
}
