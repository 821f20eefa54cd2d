//! What cameras say about places, of a plate with a hole.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use sympose::Picture;
use sympose::symmetry::visibility::{Seen, Visibility};

/// Points of a square of side 1 at z = 0.
fn square() -> impl Iterator<Item = Vector3<f64>> {
    let at = |i: i32| f64::from(i) / 200.0;
    (-100..100).flat_map(move |i| (-100..100).map(move |j| Vector3::new(at(i), at(j), 0.0)))
}

/// What views of level points see, each of which comes with the number of the place that it was seen from.
fn views(points: &[(usize, Vector3<f64>)], places: &[Vector3<f64>], pictures: &[Picture]) -> Visibility {
    let up = |_| Some(Vector3::z());
    Visibility::new(points.len(), |i| points[i].1, places, |i| [points[i].0], up, pictures).unwrap()
}

/// What one view from above sees of level points.
fn view_from_above(points: impl Iterator<Item = Vector3<f64>>) -> Visibility {
    let points: Vec<(usize, Vector3<f64>)> = points.map(|p| (0, p)).collect();
    views(&points, &[Vector3::new(0.0, 0.0, 2.0)], &[])
}

/// A square plate of side 1 at z = 0 with a hole of side 0.2 in its middle, seen from above.
fn plate() -> Visibility {
    view_from_above(square().filter(|p| p.x.abs() > 0.1 || p.y.abs() > 0.1))
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

#[test]
fn a_gap_in_a_narrow_bar_shows_though_the_view_is_mostly_empty() {
    let is_of_cross = |p: &Vector3<f64>| p.x.abs().min(p.y.abs()) < 0.02;
    let cross = view_from_above(square().filter(is_of_cross).filter(|p| (p.x - 0.3).abs() > 0.03));
    let look = |x: f64| cross.seen(&Vector3::new(x, 0.0, 0.0), None, 0.02, |_| false);
    assert_eq!(look(0.3), Seen::Missing);
    assert_eq!(look(0.2), Seen::Hidden, "it was measured");
}

/// The plate without its hole, each half of it seen from above by the places that `sees` tells.
fn halves(sees: [[bool; 2]; 2], pictures: &[Picture]) -> Visibility {
    let places = [Vector3::new(0.3, 0.0, 2.0), Vector3::new(-0.3, 0.0, 2.0)];
    let seen_from = |place: usize| square().filter(move |p| sees[place][usize::from(p.x >= 0.0)]);
    let points: Vec<(usize, Vector3<f64>)> =
        [0, 1].into_iter().flat_map(|place| seen_from(place).map(move |p| (place, p))).collect();
    views(&points, &places, pictures)
}

#[test]
fn beside_all_that_any_view_measured_a_return_is_missing() {
    let look =
        |visibility: Visibility, x: f64| visibility.seen(&Vector3::new(x, 0.0, 0.0), None, 0.02, |_| false);
    let whole = [[true, true]; 2];
    assert_eq!(look(halves(whole, &[]), 0.7), Seen::Missing);
    assert_eq!(look(halves(whole, &[]), 2.0), Seen::Hidden, "farther than can be supposed");
    assert_eq!(look(halves([[true, false], [false, true]], &[]), 0.7), Seen::Hidden, "each was cut off");
    assert_eq!(look(halves([[true, true], [false, false]], &[]), 0.7), Seen::Hidden, "a single view");
}

/// A plate with a hole, seen from above by two places; one of them lost all returns of a square of side `lost`.
fn plate_with_lost_returns(lost: f64) -> Visibility {
    let is_in_hole = |p: &Vector3<f64>| (p.x - 0.25).abs() < 0.1 && p.y.abs() < 0.1;
    let plate: Vec<Vector3<f64>> = square().filter(|p| !is_in_hole(p)).collect();
    let places = [Vector3::new(0.3, 0.0, 2.0), Vector3::new(-0.3, 0.0, 2.0)];
    let is_lost = |p: &Vector3<f64>| (p.x + 0.25).abs() < 0.5 * lost && (p.y - 0.25).abs() < 0.5 * lost;
    let kept = plate.iter().filter(|p| !is_lost(p));
    let points: Vec<(usize, Vector3<f64>)> =
        kept.map(|p| (0, *p)).chain(plate.iter().map(|p| (1, *p))).collect();
    views(&points, &places, &[])
}

fn look(visibility: &Visibility, place: [f64; 3]) -> Seen {
    visibility.seen(&Vector3::from(place), None, 0.02, |_| false)
}

#[test]
fn a_return_from_a_surface_that_another_view_measured_was_lost_however_few_are() {
    // The ray of the first place goes on through what it lost.
    let behind = [-0.36, 0.29, -0.4];
    let few = plate_with_lost_returns(0.24);
    assert!(few.dropout == 0.0 && !few.shows_details, "{}", few.dropout);
    assert_eq!(look(&few, [-0.25, 0.25, 0.0]), Seen::Hidden);
    assert_eq!(look(&few, behind), Seen::Hidden);
}

#[test]
fn where_many_returns_are_lost_two_views_must_miss_one() {
    // Both look through the hole at the first place, only one of them at the second.
    let (in_hole, below) = ([0.25, 0.0, 0.0], [0.25, 0.0, -1.0]);
    let none = plate_with_lost_returns(0.0);
    assert!(none.dropout == 0.0);
    assert_eq!(look(&none, in_hole), Seen::Missing);
    assert_eq!(look(&none, below), Seen::Missing);
    let many = plate_with_lost_returns(0.45);
    assert!(many.dropout > 0.05, "{}", many.dropout);
    assert_eq!(look(&many, in_hole), Seen::Missing);
    assert_eq!(look(&many, below), Seen::Hidden);
}

#[test]
fn a_known_picture_tells_where_a_single_view_saw_nothing() {
    // Looks down: +z of the camera is -z of the world.
    let down = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    let camera = Isometry3::from_parts(Vector3::new(0.3, 0.0, 2.0).into(), down);
    let picture = |right: f64| Picture::new(camera, [[-0.5, -0.5], [right, 0.5]]).unwrap();
    let look = |right: f64, x: f64| {
        let visibility = halves([[true, true], [false, false]], &[picture(right)]);
        visibility.seen(&Vector3::new(x, 0.0, 0.0), None, 0.02, |_| false)
    };
    assert_eq!(look(0.5, 0.7), Seen::Missing);
    assert_eq!(look(0.15, 0.7), Seen::Hidden, "out of the picture");
    assert_eq!(look(0.5, -0.6), Seen::Missing);
    assert_eq!(look(0.5, -0.8), Seen::Hidden, "out of the picture on the other side");
}

#[test]
fn nothing_is_below_the_support() {
    let standing = || plate().supported_by([0.0, 0.0, 1.0, 0.5], 0.1);
    let look = |z: f64| standing().seen(&Vector3::new(0.3, 0.0, z), None, 0.02, |_| false);
    assert_eq!(look(-0.59), Seen::Hidden);
    assert_eq!(look(-0.61), Seen::Free);
}

#[test]
fn a_picture_without_an_area_is_refused() {
    let of = |corners| Picture::new(Isometry3::identity(), corners);
    assert!(of([[0.5, -0.5], [-0.5, 0.5]]).is_err() && of([[f64::NAN, -0.5], [0.5, 0.5]]).is_err());
    let error = of([[0.0, 0.0], [0.0, 1.0]]).unwrap_err().to_string();
    assert!(error.contains("picture") && error.contains("corners"), "{error}");
}

/// A ball of radius 1 with a hole at its top, seen from far above by a sensor that gets returns where the cosine to the normal is
/// at least `least`.
fn ball(least: f64) -> Visibility {
    let at = |i: i32| f64::from(i) / 200.0;
    let lattice = (-200..200).flat_map(|i| (-200..200).map(move |j| (at(i), at(j))));
    let points: Vec<Vector3<f64>> = lattice
        .map(|(x, y)| (x, y, 1.0 - x * x - y * y))
        .filter(|(x, y, z_sq)| *z_sq >= least * least && x.hypot(*y) > 0.05)
        .map(|(x, y, z_sq)| Vector3::new(x, y, z_sq.sqrt()))
        .collect();
    let place = [Vector3::new(0.0, 0.0, 50.0)];
    Visibility::new(points.len(), |i| points[i], &place, |_| [0], |i| Some(points[i]), &[]).unwrap()
}

#[test]
fn a_surface_steeper_than_all_that_was_measured_may_be_anywhere() {
    let tilted = |cosine: f64| Vector3::new((1.0 - cosine * cosine).sqrt(), 0.0, cosine);
    let seen = |ball: &Visibility, place: [f64; 3], cosine: f64| {
        ball.seen(&Vector3::from(place), Some(&tilted(cosine)), 0.02, |_| false)
    };
    let (hole, above) = ([0.0, 0.0, 1.0], [0.3, 0.0, 1.3]);
    let [sees_all, sees_half] = [0.01, 0.5].map(ball);
    assert!((0.45..0.55).contains(&sees_half.grazing), "{}", sees_half.grazing);
    for (place, said) in [(hole, Seen::Missing), (above, Seen::Free)] {
        assert_eq!(seen(&sees_all, place, 0.8), said);
        assert_eq!(seen(&sees_all, place, 0.4), said);
        assert_eq!(seen(&sees_half, place, 0.8), said);
        assert_eq!(seen(&sees_half, place, 0.4), Seen::Hidden);
    }
}

#[test]
fn where_cameras_agree_on_no_point_nothing_is_known_but_what_lies_before_points_is_free() {
    let fused = plate().fused();
    assert_eq!(look(&plate(), [0.0, 0.0, 0.0]), Seen::Missing);
    assert_eq!(look(&fused, [0.0, 0.0, 0.0]), Seen::Hidden);
    assert_eq!(look(&fused, [0.3, 0.0, 0.3]), Seen::Free);
}

#[test]
fn a_point_that_two_places_saw_is_lost_by_neither() {
    let places = [Vector3::new(0.3, 0.0, 2.0), Vector3::new(-0.3, 0.0, 2.0)];
    let points: Vec<Vector3<f64>> = square().collect();
    let up = |_| Some(Vector3::z());
    let seen_by = |track: fn(usize) -> Vec<usize>| {
        Visibility::new(points.len(), |i| points[i], &places, track, up, &[]).unwrap()
    };
    // In turn, as if each place had measured a half of the points, anywhere.
    let alone = seen_by(|i| vec![i / 200 % 40 / 20]);
    assert!(alone.dropout > 0.3 && !alone.shows_details, "{}", alone.dropout);
    let both = seen_by(|i| if i / 200 % 40 / 20 == 0 { vec![0, 1] } else { vec![1, 0] });
    assert!(both.dropout == 0.0 && both.shows_details, "{}", both.dropout);
}
