//! Number, sum and products of points, from which their plane follows.

use nalgebra::{Matrix3, Vector3};

/// Moments of points about an origin near them: far from it products would lose the digits that matter.
///
/// Plain numbers, added in place: over all points of a scan that is several times as fast as sums of matrices.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Moments {
    /// Number of points, or the sum of their weights.
    pub(super) count: f64,
    sum: [f64; 3],
    /// Of x with x, y, z, of y with y, z, and of z with z.
    products: [f64; 6],
}

impl Moments {
    /// Adds a point, given from the origin \[length\].
    #[inline]
    pub(super) fn add(&mut self, point: [f64; 3]) {
        self.add_weighted(point, 1.0);
    }

    /// Adds as many points at one place as `weight` says.
    #[inline]
    pub(super) fn add_weighted(&mut self, [x, y, z]: [f64; 3], weight: f64) {
        let sum = [weight * x, weight * y, weight * z];
        let products = [sum[0] * x, sum[0] * y, sum[0] * z, sum[1] * y, sum[1] * z, sum[2] * z];
        self.join(&Self { count: weight, sum, products });
    }

    /// Adds the points of another sum about the same origin.
    #[inline]
    pub(super) fn join(&mut self, other: &Self) {
        self.count += other.count;
        self.sum.iter_mut().zip(other.sum).for_each(|(sum, more)| *sum += more);
        self.products.iter_mut().zip(other.products).for_each(|(sum, more)| *sum += more);
    }

    /// Sum of the points \[length\].
    pub(super) fn sum(&self) -> Vector3<f64> {
        self.sum.into()
    }

    /// Sum of the products of their distances from the mean \[length²\]; without points zero.
    pub(super) fn scatter(&self) -> Matrix3<f64> {
        let [xx, xy, xz, yy, yz, zz] = self.products;
        let products = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
        products - self.sum() * (self.sum() / self.count.max(f64::MIN_POSITIVE)).transpose()
    }
}
