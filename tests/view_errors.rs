//! Errors in the places of the views, measured on heights that are made from known ones.

use nalgebra::{Rotation3, Vector3};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use sympose::symmetry::surface::{Samples, Surface};
use sympose::symmetry::view_errors::{Looks, ViewErrors};

fn uniform(random: &mut ChaCha8Rng) -> f64 {
    random.next_u32() as f64 / u32::MAX as f64 - 0.5
}

/// About Gaussian.
fn normal(random: &mut ChaCha8Rng) -> f64 {
    (0..12).map(|_| uniform(random)).sum()
}

/// The faces of a cube with an edge of 1.
fn cube(random: &mut ChaCha8Rng) -> Surface {
    let mut samples = Samples::default();
    for face in 0..6 {
        let outward = Vector3::ith(face / 2, if face % 2 == 0 { 0.5 } else { -0.5 });
        for _ in 0..500 {
            let mut point = Vector3::from_fn(|_, _| uniform(random));
            point[face / 2] = outward[face / 2];
            samples.points.push(point);
            samples.normals.push(2.0 * outward);
        }
    }
    Surface::new(samples, true, 0.04, 0.2)
}

/// Heights of four measurements of each view at each point that it sees, about their common mean.
fn looks(
    surface: &Surface,
    errors: &[(Vector3<f64>, Vector3<f64>)],
    noise: f64,
    sees: impl Fn(usize, &Vector3<f64>) -> bool,
    random: &mut ChaCha8Rng,
) -> Looks {
    const COUNT: f64 = 4.0;
    let (mut counts, mut heights) = (Vec::new(), Vec::new());
    for (point, normal_there) in surface.samples().points.iter().zip(&surface.samples().normals) {
        let seen: Vec<Option<f64>> = errors
            .iter()
            .enumerate()
            .map(|(view, (shift, turn))| {
                let moved = Rotation3::new(*turn) * point + shift;
                let height = (moved - point).dot(normal_there) + noise / COUNT.sqrt() * normal(random);
                sees(view, normal_there).then_some(height)
            })
            .collect();
        let known = seen.iter().flatten();
        let mean = known.clone().sum::<f64>() / known.count().max(1) as f64;
        counts.extend(seen.iter().map(|height| if height.is_some() { COUNT as f32 } else { 0.0 }));
        heights
            .extend(seen.iter().map(|height| height.map_or(0.0, |height| (COUNT * (height - mean)) as f32)));
    }
    Looks { views: errors.len(), counts, heights }
}

/// Each view sees three faces.
fn from_corners(view: usize, normal: &Vector3<f64>) -> bool {
    let corner = Vector3::from_fn(|axis, _| if view >> axis & 1 == 0 { 1.0 } else { -1.0 });
    corner.dot(normal) > 0.0
}

#[test]
fn finds_errors_of_any_size_under_noise() {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let surface = cube(&mut random);
    for (shift, turn, noise) in
        [(0.002, 0.003, 0.001), (0.0005, 0.02, 0.001), (0.01, 0.0005, 0.002), (0.001, 0.001, 0.0)]
    {
        let errors: Vec<_> = (0..8)
            .map(|_| [shift, turn].map(|size| Vector3::from_fn(|_, _| size * normal(&mut random))))
            .map(|[shift, turn]| (shift, turn))
            .collect();
        let looks = looks(&surface, &errors, noise, from_corners, &mut random);
        let found = ViewErrors::measure(looks, &surface).spread.expect("views share faces");
        // About their mean, which no comparison shows.
        let spread = |errors: Vec<Vector3<f64>>| {
            let mean = errors.iter().sum::<Vector3<f64>>() / 8.0;
            (errors.iter().map(|error| (error - mean).norm_squared()).sum::<f64>() / 21.0).sqrt()
        };
        let shifted = spread(errors.iter().map(|error| error.0).collect());
        let turned = spread(errors.iter().map(|error| error.1).collect());
        assert!((found.shift / shifted - 1.0).abs() < 0.3, "shift {} for {shifted}", found.shift);
        assert!((found.turn / turned - 1.0).abs() < 0.3, "turn {} for {turned}", found.turn);
        // A part of the errors is left in it, since each view is compared with others that are off as well.
        let most = 1.1 * noise + 0.5 * shift.hypot(turn * surface.radius());
        assert!((0.9 * noise..most).contains(&found.noise), "noise {} for {noise}", found.noise);
    }
}

#[test]
fn noise_alone_is_no_error_of_the_views() {
    let mut random = ChaCha8Rng::seed_from_u64(2);
    let surface = cube(&mut random);
    let errors = vec![(Vector3::zeros(), Vector3::zeros()); 8];
    let looks = looks(&surface, &errors, 0.01, from_corners, &mut random);
    let found = ViewErrors::measure(looks, &surface).spread.expect("views share faces");
    // Thousands of measurements average to about 0.0002.
    assert!(found.shift < 0.0003 && found.turn < 0.0006, "{} {}", found.shift, found.turn);
    assert!((found.noise / 0.01 - 1.0).abs() < 0.1, "{}", found.noise);
}

#[test]
fn views_of_different_faces_say_nothing_of_each_other() {
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let surface = cube(&mut random);
    let errors = vec![(Vector3::zeros(), Vector3::zeros()); 2];
    let apart = |view: usize, normal: &Vector3<f64>| (normal.x + normal.y + normal.z > 0.0) == (view == 0);
    let looks = looks(&surface, &errors, 0.001, apart, &mut random);
    assert!(ViewErrors::measure(looks, &surface).spread.is_none());
}
