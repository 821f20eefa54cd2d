//! [`Picture`]: what a camera would have shown.

use nalgebra::{Isometry3, Point3, Vector3};

use crate::error::{Error, Result};

/// The field of view of a pinhole camera: all in front of it that falls within a rectangle.
///
/// ```
/// use sympose::Picture;
/// use sympose::nalgebra::{Isometry3, Vector3};
/// // 640 x 480 pixels, focal length 500 pixels, the principal point in the middle.
/// let picture = Picture::new(Isometry3::identity(), [[-0.64, -0.48], [0.64, 0.48]])?;
/// assert!(picture.shows(&Vector3::new(0.6, 0.0, 1.0)) && !picture.shows(&Vector3::new(0.7, 0.0, 1.0)));
/// # Ok::<(), sympose::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Picture {
    /// Pose of the camera, which looks along +z.
    world_from_camera: Isometry3<f64>,
    /// Least and largest x / z and y / z that it shows.
    corners: [[f64; 2]; 2],
}

impl Picture {
    /// Checks the numbers.
    ///
    /// # Errors
    /// [`Error::InvalidParameter`] for a pose or a corner that is not finite, and for corners that span no area.
    pub fn new(world_from_camera: Isometry3<f64>, corners: [[f64; 2]; 2]) -> Result<Self> {
        let [[left, top], [right, bottom]] = corners;
        let is_finite =
            world_from_camera.to_homogeneous().iter().chain(corners.as_flattened()).all(|x| x.is_finite());
        if is_finite && left < right && top < bottom {
            return Ok(Self { world_from_camera, corners });
        }
        Err(Error::InvalidParameter {
            name: "picture",
            value: format!("corners {corners:?} at {:?}", world_from_camera.translation.vector.as_slice()),
            expected: "a finite pose, and finite corners of which the first has the smaller coordinates",
        })
    }

    /// The same field of view, all in another frame.
    pub(crate) fn moved(&self, local_from_world: &Isometry3<f64>) -> Self {
        Self { world_from_camera: local_from_world * self.world_from_camera, ..*self }
    }

    /// Where the camera stands.
    #[must_use]
    pub fn center(&self) -> Vector3<f64> {
        self.world_from_camera.translation.vector
    }

    /// Whether a point lies in front of the camera and within the rectangle.
    #[must_use]
    pub fn shows(&self, point: &Vector3<f64>) -> bool {
        let local = self.world_from_camera.inverse_transform_point(&Point3::from(*point));
        let [lower, upper] = self.corners;
        let is_within = |axis: usize| {
            let slope = local[axis] / local.z;
            lower[axis] <= slope && slope <= upper[axis]
        };
        local.z > 0.0 && is_within(0) && is_within(1)
    }
}
