//! Averaging depth along the rays of a sensor.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

mod scenes;

use proptest::prelude::*;
use sympose::preprocess::{noise_along_rays, smooth_along_rays};

use scenes::{Random, with_threads};

/// Where the sensor stands: it sees the plane z = 0 under 45 degrees.
const EYE: [f64; 3] = [-2.0, 0.0, 2.0];

/// Rows and columns of its picture.
const SIZE: u32 = 120;

/// The points of a picture of the plane z = 0, as far as `is_there` in x and y: as they are, and with uniform noise
/// along the rays.
fn picture(noise: f64, is_there: impl Fn(f64, f64) -> bool) -> Vec<[[f64; 3]; 2]> {
    let mut random = Random(1);
    let mut points = Vec::new();
    for i in 0..SIZE * SIZE {
        let [right, up] = [i % SIZE, i / SIZE].map(|pixel| 0.5 * (f64::from(pixel) / f64::from(SIZE) - 0.5));
        // Ahead (1, 0, -1), right (0, 1, 0), up (1, 0, 1), all of length 1.
        let half = f64::sqrt(0.5);
        let ray = [half * (1.0 + up), right, half * (up - 1.0)];
        let distance = -EYE[2] / ray[2];
        let on_ray = |distance: f64| std::array::from_fn(|axis| EYE[axis] + distance * ray[axis]);
        let point: [f64; 3] = on_ray(distance);
        if is_there(point[0], point[1]) {
            points.push([point, on_ray(distance + noise * random.uniform(-0.5, 0.5))]);
        }
    }
    points
}

fn smoothed(points: &[[[f64; 3]; 2]]) -> Vec<[f64; 3]> {
    let noisy: Vec<[f64; 3]> = points.iter().map(|[_, noisy]| *noisy).collect();
    smooth_along_rays(&noisy, &[EYE], |_| 0, 13).unwrap()
}

fn root_mean_square(heights: impl Iterator<Item = f64> + Clone) -> f64 {
    (heights.clone().map(|z| z * z).sum::<f64>() / heights.count() as f64).sqrt()
}

fn distance([a, b]: [[f64; 3]; 2]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

#[test]
fn neighbouring_rays_have_half_the_noise_of_one() {
    let points = picture(0.1, |_, _| true);
    let before = root_mean_square(points.iter().map(|[_, noisy]| noisy[2]));
    let after = root_mean_square(smoothed(&points).iter().map(|p| p[2]));
    assert!(after < 0.55 * before, "{after} off the plane, {before} before");
}

/// The mean of the points in space around an edge lies above the plane, since noise carries them beyond it and up.
#[test]
fn a_blade_does_not_bend_up_beyond_its_edge() {
    let points = picture(0.3, |x, _| x < 0.2);
    let beyond = |rows: &[[f64; 3]]| rows.iter().filter(|p| p[0] > 0.24).count();
    let noisy: Vec<[f64; 3]> = points.iter().map(|[_, noisy]| *noisy).collect();
    let smooth = smoothed(&points);
    assert!(beyond(&noisy) > 50, "the noise carries {} points beyond", beyond(&noisy));
    assert!(4 * beyond(&smooth) < beyond(&noisy), "{} of {}", beyond(&smooth), beyond(&noisy));
    // Where in the picture a point is does not hang on its noise.
    let at_edge = || points.iter().zip(&smooth).filter(|([true_point, _], _)| true_point[0] > 0.15);
    let count = at_edge().count() as f64;
    let measured = at_edge().map(|([_, noisy], _)| noisy[2]).sum::<f64>() / count;
    let mean = at_edge().map(|(_, smooth)| smooth[2]).sum::<f64>() / count;
    assert!((mean - measured).abs() < 0.003, "the edge is {} off", mean - measured);
}

#[test]
fn every_point_stays_on_its_ray() {
    let points = picture(0.1, |_, y| y < 0.1);
    for ([true_point, _], smooth) in points.iter().zip(smoothed(&points)) {
        let [near, far, between] = [[EYE, *true_point], [EYE, smooth], [*true_point, smooth]].map(distance);
        assert!(((near - far).abs() - between).abs() < 1e-12);
    }
}

/// At an edge several rays are the farthest of the neighbours; which of them is found hangs on rounding.
#[test]
fn a_rounding_error_changes_nothing_but_the_last_digits() {
    let points = picture(0.1, |x, y| x + 0.3 * y < 0.2);
    let far = 4e6;
    let moved: Vec<[f64; 3]> = points.iter().map(|[_, noisy]| noisy.map(|x| x + far)).collect();
    let moved = smooth_along_rays(&moved, &[EYE.map(|x| x + far)], |_| 0, 13).unwrap();
    for (near, far_away) in smoothed(&points).into_iter().zip(moved) {
        let off = distance([near, far_away.map(|x| x - far)]);
        assert!(off < 1e-6, "{off}");
    }
}

#[test]
fn the_noise_is_that_of_the_rays_however_dense_they_are() {
    let points = picture(0.1, |x, y| x + 0.3 * y < 0.2);
    let noisy: Vec<[f64; 3]> = points.iter().map(|[_, noisy]| *noisy).collect();
    // That of numbers drawn evenly from an interval of this length.
    let truth = 0.1 / f64::sqrt(12.0);
    for step in [1, 7] {
        let thinned: Vec<[f64; 3]> = noisy.iter().step_by(step).copied().collect();
        let noise = noise_along_rays(&thinned, &[EYE], |_| 0, 13).unwrap();
        assert!((noise / truth - 1.0).abs() < 0.25, "{noise} of {truth} for every {step}th ray");
    }
    // The place that saw most of the points counts, and too few of them tell nothing.
    let fullest = noise_along_rays(&noisy, &[[9.0; 3], EYE], |i| usize::from(i >= 40), 13).unwrap();
    assert!((fullest / truth - 1.0).abs() < 0.25, "{fullest}");
    assert_eq!(noise_along_rays(&noisy[..90], &[EYE], |_| 0, 13).unwrap(), 0.0);
    assert_eq!(noise_along_rays(&noisy, &[], |_| 0, 13).unwrap(), 0.0);
    assert!(noise_along_rays(&noisy, &[EYE], |_| 0, 0).is_err());
}

#[test]
fn the_bytes_are_the_same_at_any_number_of_threads() {
    let points = picture(0.1, |_, y| y < 0.1);
    let [one, three] = [1, 3].map(|threads| with_threads(threads, || smoothed(&points)));
    assert_eq!(one, three);
}

#[test]
fn a_step_between_two_surfaces_stays_sharp() {
    let mut points = picture(0.02, |_, _| true);
    // What is right of the middle lies twice as far away as the rest.
    for [_, noisy] in points.iter_mut().filter(|[_, noisy]| noisy[1] > 0.0) {
        *noisy = std::array::from_fn(|axis| EYE[axis] + 2.0 * (noisy[axis] - EYE[axis]));
    }
    for smooth in smoothed(&points) {
        let (near, far) = (smooth[2], smooth[2] + EYE[2]);
        assert!(near.abs() < 0.02 || far.abs() < 0.04, "{smooth:?} lies between the surfaces");
    }
}

#[test]
fn a_stray_return_is_not_pulled_onto_the_surface() {
    let mut points = picture(0.02, |_, _| true);
    let stray = points.len() / 2 + 60;
    points[stray][1] = std::array::from_fn(|axis| 0.7 * points[stray][0][axis] + 0.3 * EYE[axis]);
    let smooth = smoothed(&points);
    assert_eq!(smooth[stray], points[stray][1]);
    // Nor does it pull the points around it.
    let beside = smooth[stray + 1][2];
    assert!(beside.abs() < 0.01, "{beside}");
}

#[test]
fn views_are_smoothed_apart_and_small_ones_not_at_all() {
    let first = picture(0.05, |x, _| x < 0.0);
    let noisy: Vec<[f64; 3]> = first.iter().map(|[_, noisy]| *noisy).collect();
    let alone = smooth_along_rays(&noisy, &[EYE], |_| 0, 9).unwrap();
    // The same points again, seen from elsewhere, and forty from a third place.
    let other = [0.5, 0.3, 2.5];
    let count = noisy.len();
    let all: Vec<[f64; 3]> = noisy.iter().chain(&noisy).chain(&noisy[..40]).copied().collect();
    let place_of = |i: usize| (i / count).min(2);
    let smooth = smooth_along_rays(&all, &[EYE, other, [9.0; 3]], place_of, 9).unwrap();
    assert_eq!(smooth[..count], alone);
    assert_ne!(smooth[count..2 * count], alone);
    assert_eq!(smooth[2 * count..], noisy[..40]);
    // Nor are points of a place that there is not.
    assert_eq!(smooth_along_rays(&noisy, &[EYE], |_| 1, 9).unwrap(), noisy);
}

#[test]
fn nothing_and_bad_input_are_handled() {
    assert!(smooth_along_rays(&[], &[EYE], |_| 0, 9).unwrap().is_empty());
    let identical = vec![[1.0, 2.0, 3.0]; 500];
    assert_eq!(smooth_along_rays(&identical, &[EYE], |_| 0, 9).unwrap(), identical);
    // A point in the sensor has no ray.
    let within = vec![EYE; 500];
    assert_eq!(smooth_along_rays(&within, &[EYE], |_| 0, 9).unwrap(), within);
    // All on one ray, or on one line of the picture.
    let ray: Vec<[f64; 3]> = (1..500).map(|i| [0.0, 0.0, 0.01 * f64::from(i)]).collect();
    assert_eq!(smooth_along_rays(&ray, &[[0.0; 3]], |_| 0, 9).unwrap(), ray);
    let line: Vec<[f64; 3]> =
        (1..500).map(|i| [1.0 + 0.1 * f64::from(i % 7), 0.0, 0.01 * f64::from(i)]).collect();
    assert_eq!(smooth_along_rays(&line, &[[0.0; 3]], |_| 0, 9).unwrap(), line);
    assert!(smooth_along_rays(&ray, &[[0.0; 3]], |_| 0, 0).is_err());
    assert!(smooth_along_rays(&vec![[f64::NAN; 3]; 500], &[EYE], |_| 0, 9).is_err());
}

proptest! {
    #[test]
    fn no_point_is_moved_off_its_ray_or_made_infinite(
        points in prop::collection::vec(prop::array::uniform3(-1.0f64..1.0), 72..300),
        k in 1_usize..20,
    ) {
        let eye = [0.1, 0.2, 0.3];
        let smooth = smooth_along_rays(&points, &[eye], |_| 0, k).unwrap();
        for (before, after) in points.iter().zip(&smooth) {
            let [near, far, between] = [[eye, *before], [eye, *after], [*before, *after]].map(distance);
            prop_assert!(far <= 2.0 * near + 1e-12);
            prop_assert!(((near - far).abs() - between).abs() < 1e-9 * (1.0 + far));
        }
    }
}
