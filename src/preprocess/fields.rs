//! Where sensors looked, as far as what they measured spans it.

use std::cmp::Ordering;

use nalgebra::Vector3;

use super::outline::{Flat, Outline};
use crate::directions::tangents;

/// The fields of view of some sensors.
pub(crate) struct Fields(Vec<Field>);

/// The field of view of one sensor: the hull of the directions in which it measured.
struct Field {
    sensor: Vector3<f64>,
    forward: Vector3<f64>,
    axes: [Vector3<f64>; 2],
    outline: Outline,
}

impl Fields {
    /// Of the sensors from which the points were seen, where known.
    pub(crate) fn new(points: &[[f64; 3]], sensors: &[Option<[f64; 3]>]) -> Self {
        let seen = points.iter().zip(sensors).filter_map(|(point, sensor)| Some(((*sensor)?, *point)));
        let mut seen: Vec<([f64; 3], [f64; 3])> = seen.collect();
        seen.sort_by(|a, b| a.partial_cmp(b).unwrap_or(Ordering::Equal));
        let field = |of_one: &[([f64; 3], [f64; 3])]| {
            let sensor = Vector3::from(of_one.first()?.0);
            Field::new(sensor, of_one.iter().map(|(_, point)| Vector3::from(*point) - sensor))
        };
        Self(seen.chunk_by(|a, b| a.0 == b.0).filter_map(field).collect())
    }

    /// Whether `place` lies in one of them, hidden or not; in any case where none is known.
    pub(crate) fn show(&self, place: &Vector3<f64>) -> bool {
        self.0.is_empty() || self.0.iter().any(|field| field.shows(place))
    }
}

impl Field {
    /// `None` where the rays lie in a plane or go to all sides.
    fn new(sensor: Vector3<f64>, rays: impl Iterator<Item = Vector3<f64>> + Clone) -> Option<Self> {
        let sum: Vector3<f64> = rays.clone().filter_map(|ray| ray.try_normalize(0.0)).sum();
        let forward = sum.try_normalize(0.0)?;
        let axes = tangents(&forward);
        let flat: Option<Vec<Flat>> = rays.map(|ray| flattened(&ray, &forward, &axes)).collect();
        Some(Self { sensor, forward, axes, outline: Outline::new(&flat?)? })
    }

    fn shows(&self, place: &Vector3<f64>) -> bool {
        let ray = place - self.sensor;
        flattened(&ray, &self.forward, &self.axes).is_some_and(|p| self.outline.contains(p, 0.0))
    }
}

/// Slopes of a ray against `forward`; `None` where it does not go forward.
fn flattened(ray: &Vector3<f64>, forward: &Vector3<f64>, axes: &[Vector3<f64>; 2]) -> Option<Flat> {
    let depth = ray.dot(forward);
    (depth > 0.05 * ray.norm()).then(|| axes.map(|axis| axis.dot(ray) / depth))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_field_of_view_is_what_the_rays_span() {
        let sheet = |z: f64| {
            let place = |i: u32| 0.2 * f64::from(i) - 1.0;
            (0..121).map(move |i| [place(i % 11), place(i / 11), z]).collect::<Vec<_>>()
        };
        let fields = Fields::new(&sheet(2.0), &[Some([0.0; 3]); 121]);
        let shows = |x: f64, y: f64, z: f64| fields.show(&Vector3::new(x, y, z));
        assert!(shows(0.4, 0.4, 1.0) && shows(1.9, -1.9, 4.0));
        assert!(!shows(0.6, 0.0, 1.0) && !shows(0.0, 0.0, -1.0));
        // Whose place is not known may look anywhere, and so may one that measures in all directions.
        assert!(Fields::new(&sheet(2.0), &[None; 121]).show(&Vector3::new(5.0, 0.0, 1.0)));
        assert!(Fields::new(&sheet(0.0), &[Some([0.0; 3]); 121]).show(&Vector3::new(0.0, 0.0, 1.0)));
    }
}
