//! [`PointCloud`]: the only way in. Checks, drops what is not finite, and shifts to a local origin.

use std::sync::Arc;

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::no_return::{crowded_places, far_level, usual_box};
use crate::picture::Picture;
use crate::preprocess::{CHUNK, SensorPlaces, check_finite, finite_bounds, viewpoints_from_order};
use crate::viewpoints::Viewpoints;

/// Squares of coordinates beyond this magnitude would overflow in the single precision of the lookups.
pub(crate) const LARGEST_COORDINATE: f64 = 1e18;

/// Squares of distances within a cloud smaller than this would vanish in that single precision.
const SMALLEST_EXTENT: f64 = 1e-18;

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
    points: Arc<Vec<[f64; 3]>>,
    input_index: Arc<Vec<u32>>,
    input_len: usize,
    far: usize,
    coinciding: usize,
    origin: [f64; 3],
    viewpoints: Viewpoints,
    normals: Option<Vec<[f64; 3]>>,
    pictures: Vec<Picture>,
}

impl PointCloud {
    /// Takes points in world coordinates, in any unit.
    ///
    /// # Errors
    /// [`Error::InsufficientData`] when there is no point, [`Error::NonFinite`] when none is finite,
    /// [`Error::InvalidParameter`] when a coordinate exceeds 1e18 in magnitude, when points that do not all coincide span less
    /// than 1e-18 along every axis, or when there are more than 2^32 - 1 points.
    pub fn from_points(mut points: Vec<[f64; 3]>) -> Result<Self> {
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
        let mut input_index: Vec<u32> = (0..input_len as u32).collect();
        if check_finite(&points).is_err() {
            leave_out(&mut points, &mut input_index, |p| p.iter().any(|x| !x.is_finite()));
        }
        if points.is_empty() {
            return Err(Error::NonFinite { count: input_len, total: input_len });
        }
        let crowded = crowded_places(&points);
        let is_crowded = |p: &[f64; 3]| crowded.contains(p);
        let mut coinciding = 0;
        if !crowded.is_empty() && !points.iter().all(is_crowded) {
            coinciding = leave_out(&mut points, &mut input_index, is_crowded);
        }
        let mut bounds = finite_bounds(&points)?;
        if let Some((axis, level)) = far_level(&points, bounds) {
            coinciding += leave_out(&mut points, &mut input_index, |p| p[axis] == level);
            bounds = finite_bounds(&points)?;
        }
        let mut far = 0;
        if let Some([least, most]) = usual_box(&points, bounds) {
            let is_unusual = |p: &[f64; 3]| !(0..3).all(|axis| (least[axis]..=most[axis]).contains(&p[axis]));
            far = leave_out(&mut points, &mut input_index, is_unusual);
            bounds = finite_bounds(&points)?;
        }
        if let Some(x) = bounds.as_flattened().iter().find(|x| x.abs() > LARGEST_COORDINATE) {
            return Err(Error::InvalidParameter {
                name: "points",
                value: format!("a coordinate of {x:e}"),
                expected: "coordinates of at most 1e18 in magnitude",
            });
        }
        let [lower, upper] = bounds;
        let extent = (0..3).map(|axis| upper[axis] - lower[axis]).fold(0.0, f64::max);
        // Points at one place are refused by name where a surface is wanted.
        if extent > 0.0 && extent < SMALLEST_EXTENT {
            return Err(Error::InvalidParameter {
                name: "points",
                value: format!("an extent of {extent:e}"),
                expected: "points that span at least 1e-18; give them in a smaller unit",
            });
        }
        let origin = std::array::from_fn(|axis| 0.5 * lower[axis] + 0.5 * upper[axis]);
        points.par_iter_mut().with_min_len(CHUNK).for_each(|p| {
            *p = [p[0] - origin[0], p[1] - origin[1], p[2] - origin[2]];
        });
        Ok(Self {
            points: Arc::new(points),
            input_index: Arc::new(input_index),
            input_len,
            far,
            coinciding,
            origin,
            viewpoints: Viewpoints::default(),
            normals: None,
            pictures: Vec::new(),
        })
    }

    /// Says where the sensor stood: one position for all points, or one for each point as given (world coordinates).
    ///
    /// A viewpoint orients normals and tells free space. Rows of dropped points are ignored.
    ///
    /// # Errors
    /// [`Error::LengthMismatch`] unless there is one row or one for each input point; [`Error::InvalidParameter`] when
    /// the viewpoint of a finite point is not finite, or beyond 1e18 in magnitude.
    pub fn with_viewpoints(self, viewpoints: impl AsRef<[[f64; 3]]>) -> Result<Self> {
        self.with_sensor_at(Viewpoints::of_rows(viewpoints.as_ref()))
    }

    /// [`PointCloud::with_viewpoints`] with places that points share.
    ///
    /// # Errors
    /// Those of [`PointCloud::with_viewpoints`].
    pub fn with_sensor_at(mut self, viewpoints: Viewpoints) -> Result<Self> {
        viewpoints.check_len(self.input_len)?;
        let is_whole = self.len() == self.input_len;
        let mut found = if is_whole { viewpoints } else { viewpoints.of_points(&self.input_index) };
        found.check_finite()?;
        for place in &mut found.places {
            *place = std::array::from_fn(|axis| place[axis] - self.origin[axis]);
        }
        self.viewpoints = found;
        Ok(self)
    }

    /// Says what the cameras would have shown (world coordinates): where one got no return, nothing is likely to be. Each
    /// counts for the points seen from where it stands, by [`PointCloud::with_viewpoints`]; without it, the points tell how
    /// far a camera saw where several of them show the part.
    #[must_use]
    pub fn with_pictures(self, pictures: Vec<Picture>) -> Self {
        Self { pictures, ..self }
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

    /// Finds out where the sensor stood from the order of the points ([`viewpoints_from_order`]); `None` where it does not tell.
    #[must_use]
    pub fn with_viewpoints_from_order(&self) -> Option<Self> {
        // The points are finite: there is no error.
        let SensorPlaces { places, place_of, .. } = viewpoints_from_order(&self.points).ok()??;
        Some(Self { viewpoints: Viewpoints::of_places(places, place_of), ..self.clone() })
    }

    fn check_rows(&self, what: &'static str, got: usize) -> Result<()> {
        if got == self.input_len {
            Ok(())
        } else {
            Err(Error::LengthMismatch { what, expected: self.input_len, got })
        }
    }

    /// Number of points that are used: all but those [dropped](PointCloud::dropped) and those too [far](PointCloud::far) away.
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
        self.input_len - self.points.len() - self.far - self.coinciding
    }

    /// Number of input points that were left out because some coordinate lies farther from the median than a hundred
    /// interquartile ranges, of the coordinate that is spread most: a number that stands for no return, or a wild one. They would
    /// take all resolution from the rest.
    #[must_use]
    pub fn far(&self) -> usize {
        self.far
    }

    /// Number of input points that were left out because they share one place, or a few places: a sensor that writes zeros where
    /// it gets no return. No surface has a hundredth of its points at one place. Or they share one value of a coordinate,
    /// farther from all others than these are apart: a sensor that writes -9999 for the height, and the place beside it.
    #[must_use]
    pub fn coinciding(&self) -> usize {
        self.coinciding
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

    pub(crate) fn pictures(&self) -> &[Picture] {
        &self.pictures
    }

    pub(crate) fn viewpoints(&self) -> &Viewpoints {
        &self.viewpoints
    }
}

/// Leaves out points, and their indices; returns how many.
fn leave_out(
    points: &mut Vec<[f64; 3]>,
    input_index: &mut Vec<u32>,
    is_out: impl Fn(&[f64; 3]) -> bool,
) -> usize {
    let before = points.len();
    let mut rows = points.iter();
    input_index.retain(|_| !rows.next().is_some_and(&is_out));
    points.retain(|p| !is_out(p));
    before - points.len()
}
