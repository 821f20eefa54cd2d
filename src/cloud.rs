//! [`PointCloud`]: the only way in. Checks, drops what is not finite, and shifts to a local origin.

use std::collections::HashMap;

use crate::error::{Error, Result};

/// Coordinates beyond this magnitude would overflow when squared and summed.
const LARGEST_COORDINATE: f64 = 1e100;

/// Where the sensor stood when it measured the points, in local coordinates.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Viewpoints {
    /// Its places, none twice; empty when they are unknown.
    pub(crate) places: Vec<[f64; 3]>,
    /// For each point its place; empty where all points have the first one.
    place_of: Vec<u32>,
}

impl Viewpoints {
    /// Number of the place that point `index` was seen from; 0 where none is known.
    #[inline]
    pub(crate) fn place_of(&self, index: usize) -> usize {
        self.place_of.get(index).map_or(0, |&place| place as usize)
    }

    fn of_each(viewpoints: impl Iterator<Item = [f64; 3]>) -> Self {
        let mut known: HashMap<[u64; 3], u32> = HashMap::new();
        let mut found = Self::default();
        let mut last = None;
        for viewpoint in viewpoints {
            // Scans come view by view, so that the same place mostly follows itself.
            let place = match last {
                Some((same, place)) if same == viewpoint => place,
                _ => *known.entry(viewpoint.map(f64::to_bits)).or_insert_with(|| {
                    found.places.push(viewpoint);
                    found.places.len() as u32 - 1
                }),
            };
            last = Some((viewpoint, place));
            found.place_of.push(place);
        }
        found
    }
}

/// A validated cloud: finite points about a local origin, with optional viewpoints and normals.
///
/// Points with a NaN or infinite coordinate (usual in organised depth clouds) are left out and counted; indices in
/// results always refer to the points as given.
///
/// ```
/// use sympose::PointCloud;
/// let cloud = PointCloud::from_points(vec![[4e6, 0.0, 1.0], [4e6, f64::NAN, 1.0]])?;
/// assert_eq!((cloud.len(), cloud.dropped()), (1, 1));
/// assert_eq!(cloud.origin(), [4e6, 0.0, 1.0]);
/// # Ok::<(), sympose::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct PointCloud {
    points: Vec<[f64; 3]>,
    input_index: Vec<u32>,
    input_len: usize,
    origin: [f64; 3],
    viewpoints: Viewpoints,
    normals: Option<Vec<[f64; 3]>>,
}

impl PointCloud {
    /// Takes points in world coordinates, in any unit.
    ///
    /// # Errors
    /// [`Error::InsufficientData`] when there is no point, [`Error::NonFinite`] when none is finite,
    /// [`Error::InvalidParameter`] when a coordinate exceeds 1e100 in magnitude or there are more than 2^32 - 1 points.
    pub fn from_points(points: Vec<[f64; 3]>) -> Result<Self> {
        let input_len = points.len();
        if input_len == 0 {
            return Err(Error::InsufficientData {
                stage: "input",
                needed: 1,
                got: 0,
                hint: "the cloud is empty; check the file or the region of interest",
            });
        }
        if u32::try_from(input_len).is_err() {
            return Err(Error::InvalidParameter {
                name: "points",
                value: format!("{input_len} rows"),
                expected: "at most 4,294,967,295 points",
            });
        }
        let finite = |p: &[f64; 3]| p.iter().all(|x| x.is_finite());
        let mut lower = [f64::INFINITY; 3];
        let mut upper = [f64::NEG_INFINITY; 3];
        for p in points.iter().filter(|p| finite(p)) {
            for axis in 0..3 {
                lower[axis] = lower[axis].min(p[axis]);
                upper[axis] = upper[axis].max(p[axis]);
            }
        }
        if lower[0] > upper[0] {
            return Err(Error::NonFinite { count: input_len, total: input_len });
        }
        if let Some(x) = lower.iter().chain(&upper).find(|x| x.abs() > LARGEST_COORDINATE) {
            return Err(Error::InvalidParameter {
                name: "points",
                value: format!("a coordinate of {x:e}"),
                expected: "coordinates of at most 1e100 in magnitude",
            });
        }
        let origin = std::array::from_fn(|axis| 0.5 * lower[axis] + 0.5 * upper[axis]);
        let mut local = Vec::with_capacity(input_len);
        let mut input_index = Vec::with_capacity(input_len);
        for (index, p) in (0u32..).zip(points) {
            if finite(&p) {
                local.push(std::array::from_fn(|axis| p[axis] - origin[axis]));
                input_index.push(index);
            }
        }
        Ok(Self {
            points: local,
            input_index,
            input_len,
            origin,
            viewpoints: Viewpoints::default(),
            normals: None,
        })
    }

    /// Says where the sensor stood: one position for all points, or one for each point as given (world coordinates).
    ///
    /// A viewpoint orients normals and tells free space. Rows of dropped points are ignored.
    ///
    /// # Errors
    /// [`Error::LengthMismatch`] unless there is one row or one for each input point; [`Error::NonFinite`] when the
    /// viewpoint of a finite point is not finite.
    pub fn with_viewpoints(mut self, viewpoints: impl AsRef<[[f64; 3]]>) -> Result<Self> {
        let viewpoints = viewpoints.as_ref();
        let local = |v: &[f64; 3]| std::array::from_fn(|axis| v[axis] - self.origin[axis]);
        let found = match viewpoints {
            [one] if self.input_len != 1 => Viewpoints { places: vec![local(one)], place_of: Vec::new() },
            many => {
                self.check_rows("viewpoints", many.len())?;
                Viewpoints::of_each(self.input_index.iter().map(|&i| local(&many[i as usize])))
            }
        };
        let is_bad = |place: &[f64; 3]| place.iter().any(|x| !x.is_finite());
        if found.places.iter().any(is_bad) {
            let total = found.place_of.len().max(1);
            let count = (0..total).filter(|&i| is_bad(&found.places[found.place_of(i)])).count();
            return Err(Error::NonFinite { count, total });
        }
        self.viewpoints = found;
        Ok(self)
    }

    /// Gives a normal for each input point (world frame, any length but zero, oriented or not).
    ///
    /// Normals that are zero or not finite are taken as missing and estimated.
    ///
    /// # Errors
    /// [`Error::LengthMismatch`] unless there is one row for each input point.
    pub fn with_normals(mut self, normals: impl AsRef<[[f64; 3]]>) -> Result<Self> {
        let normals = normals.as_ref();
        self.check_rows("normals", normals.len())?;
        let unit = |n: [f64; 3]| {
            let length = n.iter().map(|x| x * x).sum::<f64>().sqrt();
            if length.is_normal() { n.map(|x| x / length) } else { [0.0; 3] }
        };
        self.normals = Some(self.input_index.iter().map(|&i| unit(normals[i as usize])).collect());
        Ok(self)
    }

    fn check_rows(&self, what: &'static str, got: usize) -> Result<()> {
        if got == self.input_len {
            Ok(())
        } else {
            Err(Error::LengthMismatch { what, expected: self.input_len, got })
        }
    }

    /// Number of finite points.
    #[must_use]
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Always false: a cloud without a finite point is an error.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// Number of input points that were left out because a coordinate was NaN or infinite.
    #[must_use]
    pub fn dropped(&self) -> usize {
        self.input_len - self.points.len()
    }

    /// World position of the local origin: the middle of the bounding box.
    #[must_use]
    pub fn origin(&self) -> [f64; 3] {
        self.origin
    }

    /// The finite points, relative to [`PointCloud::origin`].
    #[must_use]
    pub fn local_points(&self) -> &[[f64; 3]] {
        &self.points
    }

    /// For each finite point its row in the input.
    #[must_use]
    pub fn input_index(&self) -> &[u32] {
        &self.input_index
    }

    /// Unit normals of the finite points as given, zero where missing.
    #[must_use]
    pub fn normals(&self) -> Option<&[[f64; 3]]> {
        self.normals.as_deref()
    }

    /// Whether the sensor position of the points is known.
    #[must_use]
    pub fn has_viewpoints(&self) -> bool {
        !self.viewpoints.places.is_empty()
    }

    pub(crate) fn viewpoints(&self) -> &Viewpoints {
        &self.viewpoints
    }
}
