//! Symmetric 3x3 eigenvectors in closed form, good for every matrix: distinct, double, triple and zero eigenvalues.

use nalgebra::{Matrix3, Vector3};

/// Unit eigenvector of the smallest eigenvalue of a symmetric, finite matrix, and the eigenvalues in ascending order.
///
/// First the extreme eigenvalue that stands alone, a simple root of the characteristic polynomial, and its eigenvector
/// (by cross products of rows, which is well conditioned for it); then the other two in the plane normal to it, as a 2x2
/// problem. With a repeated smallest eigenvalue some unit vector of its space comes out: never NaN.
pub(crate) fn smallest_eigenvector(matrix: &Matrix3<f64>) -> (Vector3<f64>, [f64; 3]) {
    let scale = matrix.amax();
    if scale < f64::MIN_POSITIVE {
        return (Vector3::z(), [0.0; 3]);
    }
    let a = matrix * scale.recip();
    let mean = a.trace() / 3.0;
    let b = a - Matrix3::from_diagonal_element(mean);
    let spread = (b.norm_squared() / 6.0).sqrt();
    if spread < 1e-15 {
        return (Vector3::z(), [scale * mean; 3]);
    }
    let half_det = (0.5 * b.determinant() / (spread * spread * spread)).clamp(-1.0, 1.0);
    // The eigenvalue farther from the middle one stands alone: the largest for a positive determinant.
    let alone_is_largest = half_det >= 0.0;
    let root = largest_root(half_det.abs());
    let value = mean + spread * if alone_is_largest { root } else { -root };
    let alone = null_direction(&(a - Matrix3::from_diagonal_element(value)));
    let (u, v) = complement(&alone);
    let (au, av) = (a * u, a * v);
    let (uu, uv, vv) = (u.dot(&au), u.dot(&av), v.dot(&av));
    let (low, high, lower) = smaller_of_two(uu, uv, vv);
    let own = alone.dot(&(a * alone));
    let (vector, values) = if alone_is_largest {
        (u * lower[0] + v * lower[1], [low, high, own])
    } else {
        (alone, [own, low, high])
    };
    (vector.normalize(), values.map(|x| x * scale))
}

/// Largest root of t^3 - 3 t - 2 h for `h` in [0, 1]: 2 cos(acos(h) / 3), in [sqrt(3), 2].
///
/// It is simple, so that two of Halley's steps from a parabola through its ends (0.004 beside it at most) leave nothing but
/// rounding, and take less time than the cosines.
fn largest_root(h: f64) -> f64 {
    const AT_ZERO: f64 = 1.732_050_807_568_877_2;
    const SLOPE: f64 = 1.0 / 3.0;
    let start = AT_ZERO + h * (SLOPE + h * (2.0 - AT_ZERO - SLOPE));
    let step = |t: f64| {
        let value = (t * t - 3.0) * t - 2.0 * h;
        let slope = 3.0 * (t * t - 1.0);
        t - value * slope / (slope * slope - 3.0 * t * value)
    };
    step(step(start))
}

/// Unit vector that a matrix of rank two maps to zero: the longest cross product of two of its rows.
fn null_direction(m: &Matrix3<f64>) -> Vector3<f64> {
    let rows = [m.row(0).transpose(), m.row(1).transpose(), m.row(2).transpose()];
    let crosses = [rows[0].cross(&rows[1]), rows[1].cross(&rows[2]), rows[2].cross(&rows[0])];
    let longest = crosses
        .iter()
        .fold(crosses[0], |best, c| if c.norm_squared() > best.norm_squared() { *c } else { best });
    longest.try_normalize(f64::MIN_POSITIVE).unwrap_or_else(Vector3::z)
}

/// Two unit vectors that make an orthonormal basis with the given one.
fn complement(w: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let u = if w.x.abs() > w.y.abs() { Vector3::new(-w.z, 0.0, w.x) } else { Vector3::new(0.0, w.z, -w.y) };
    let u = u.normalize();
    (u, w.cross(&u))
}

/// Eigenvalues of `[[a, b], [b, c]]`, ascending, and the unit eigenvector of the smaller one.
fn smaller_of_two(a: f64, b: f64, c: f64) -> (f64, f64, [f64; 2]) {
    let half = 0.5 * (c - a);
    let root = (half * half + b * b).sqrt();
    let middle = 0.5 * (a + c);
    // Of the two equivalent forms of the eigenvector, the one without cancellation.
    let (x, y) = if half >= 0.0 { (half + root, -b) } else { (-b, root - half) };
    let length = (x * x + y * y).sqrt();
    let vector = if length > 0.0 { [x / length, y / length] } else { [1.0, 0.0] };
    (middle - root, middle + root, vector)
}
