//! The cloud of a call, and the part of it that is used.

use pyo3::prelude::*;

use super::{arrays, errors};
use crate::cloud::PointCloud;
use crate::error::{Error, Result};
use crate::picture::Picture;
use crate::viewpoints::Viewpoints;

/// What a call gives about the points, copied out of Python.
pub(super) struct Input {
    points: Vec<[f64; 3]>,
    viewpoints: Option<Viewpoints>,
    normals: Option<Vec<[f64; 3]>>,
    /// Rows that are used; all where there is no mask.
    foreground: Option<Vec<u32>>,
    pictures: Vec<Picture>,
}

impl Input {
    pub(super) fn new(
        points: &Bound<'_, PyAny>,
        viewpoints: Option<&Bound<'_, PyAny>>,
        normals: Option<&Bound<'_, PyAny>>,
        foreground: Option<&Bound<'_, PyAny>>,
        pictures: Vec<(Bound<'_, PyAny>, [[f64; 2]; 2])>,
    ) -> PyResult<Self> {
        let py = points.py();
        let points = arrays::points(points, "points")?;
        let picture = |(pose, corners): (Bound<'_, PyAny>, _)| {
            Picture::new(arrays::isometry(&pose, "pictures")?, corners)
                .map_err(|error| errors::exception(py, error))
        };
        Ok(Self {
            viewpoints: viewpoints.map(arrays::viewpoints).transpose()?,
            normals: normals.map(|value| arrays::points(value, "normals")).transpose()?,
            foreground: foreground
                .map(|mask| arrays::selected(mask, points.len(), "foreground"))
                .transpose()?,
            pictures: pictures.into_iter().map(picture).collect::<PyResult<_>>()?,
            points,
        })
    }

    /// The cloud, and for each of its points the row that it was given in, where that differs.
    pub(super) fn into_cloud(self) -> Result<(PointCloud, Option<Vec<u32>>)> {
        let Self { points, viewpoints, normals, foreground, pictures } = self;
        let len = points.len();
        let select = |what: &'static str, rows: Vec<[f64; 3]>| match &foreground {
            Some(_) if rows.len() != len => {
                Err(Error::LengthMismatch { what, expected: len, got: rows.len() })
            }
            Some(used) => Ok(used.iter().map(|&row| rows[row as usize]).collect()),
            None => Ok(rows),
        };
        let mut cloud = PointCloud::from_points(select("points", points)?)?.with_pictures(pictures);
        if let Some(mut viewpoints) = viewpoints {
            if let Some(used) = &foreground {
                viewpoints.check_len(len)?;
                viewpoints = viewpoints.of_points(used);
            }
            cloud = cloud.with_sensor_at(viewpoints)?;
        }
        if let Some(normals) = normals {
            cloud = cloud.with_normals(select("normals", normals)?)?;
        }
        Ok((cloud, foreground))
    }
}
