//! What cameras say about places, of a plate with a hole.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use nalgebra::Vector3;
use sympose::symmetry::visibility::{Seen, Visibility};

/// A square plate of side 1 at z = 0 with a hole of side 0.2 in its middle, seen from above.
fn plate() -> Visibility {
    let at = |i: i32| f64::from(i) / 200.0;
    let lattice = (-100..100).flat_map(|i| (-100..100).map(move |j| Vector3::new(at(i), at(j), 0.0)));
    let points: Vec<Vector3<f64>> = lattice.filter(|p| p.x.abs() > 0.1 || p.y.abs() > 0.1).collect();
    Visibility::new(points.len(), |i| points[i], &[Vector3::new(0.0, 0.0, 2.0)], |_| 0, |_| true).unwrap()
}

fn seen(place: [f64; 3], normal: Option<[f64; 3]>) -> Seen {
    let normal = normal.map(Vector3::from);
    plate().seen(&Vector3::from(place), normal.as_ref(), 0.02, |_| false)
}

#[test]
fn space_before_a_surface_is_free_and_behind_it_hidden() {
    assert_eq!(seen([0.3, 0.0, 0.3], None), Seen::Free);
    assert_eq!(seen([0.3, 0.0, -0.3], None), Seen::Hidden);
    assert_eq!(seen([0.3, 0.0, 0.01], None), Seen::Hidden, "within the margin");
}

#[test]
fn a_return_is_missing_in_a_hole_but_not_from_a_surface_at_a_grazing_angle() {
    let hole = [0.0, 0.0, 0.0];
    assert_eq!(seen(hole, None), Seen::Missing);
    assert_eq!(seen(hole, Some([0.0, 0.0, 1.0])), Seen::Missing);
    assert_eq!(seen(hole, Some([0.8, 0.0, 0.6])), Seen::Missing);
    assert_eq!(seen(hole, Some([1.0, 0.0, 0.1])), Seen::Hidden);
    // What was measured behind it shows at any angle that nothing is there.
    assert_eq!(seen([0.3, 0.0, 0.3], Some([1.0, 0.0, 0.1])), Seen::Free);
}
