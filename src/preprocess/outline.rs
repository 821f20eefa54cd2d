//! Outline of points in a plane: convex hull, reach in every direction, and whether it looks like a part's own.

use std::f64::consts::TAU;

/// Points in a plane.
pub(crate) type Flat = [f64; 2];

/// Directions in which the reach from the middle is kept; divisible by most small orders.
const SECTORS: usize = 120;

/// Convex hull of points in a plane, and how far the points reach from its middle in every direction.
pub(crate) struct Outline {
    /// Corners, counterclockwise.
    corners: Vec<Flat>,
    /// For each edge the unit vector across it, inward, and the height of the edge along that vector.
    inward: Vec<(Flat, f64)>,
    /// Centroid of the hull.
    pub(crate) middle: Flat,
    /// Distance from the middle to the nearest edge \[length\].
    inscribed: f64,
    /// Largest distance of a point from the middle for each sector of directions; 0 where there is none.
    pub(crate) reach: Vec<f64>,
}

impl Outline {
    /// `None` for points without an area.
    pub(crate) fn new(points: &[Flat]) -> Option<Self> {
        let corners = convex_hull(points);
        let (area, middle) = area_and_centroid(&corners);
        if area <= 0.0 {
            return None;
        }
        let inward = edges(&corners).filter_map(|(a, b)| {
            let length = distance(a, b);
            let across = [(a[1] - b[1]) / length, (b[0] - a[0]) / length];
            (length > 0.0).then_some((across, dot(across, a)))
        });
        let inward: Vec<(Flat, f64)> = inward.collect();
        let inscribed =
            inward.iter().map(|(across, height)| dot(*across, middle) - height).fold(f64::INFINITY, f64::min);
        Some(Self { reach: reach(points, middle), inward, corners, middle, inscribed })
    }

    /// Half the mean width of the hull \[length\].
    pub(crate) fn radius(&self) -> f64 {
        // The perimeter of a convex curve is pi times its mean width (Cauchy).
        edges(&self.corners).map(|(a, b)| distance(a, b)).sum::<f64>() / TAU
    }

    /// Whether `p` lies in the hull, or less than `margin` \[length\] outside one of its edges.
    pub(crate) fn contains(&self, p: Flat, margin: f64) -> bool {
        // Most points of a part lie amid the outline, where no edge needs to be looked at.
        let within = self.inscribed + margin;
        within > 0.0 && distance_sq(p, self.middle) <= within * within
            || self.inward.iter().all(|(across, height)| dot(*across, p) - height >= -margin)
    }

    /// Unit direction in the middle of each sector.
    pub(crate) fn directions() -> impl Iterator<Item = Flat> {
        (0..SECTORS).map(|sector| {
            let (sin, cos) = (TAU * (sector as f64 + 0.5) / SECTORS as f64).sin_cos();
            [cos, sin]
        })
    }

    /// Distance from the middle to the hull in the direction of each sector \[length\].
    pub(crate) fn hull_reach(&self) -> Vec<f64> {
        let m = self.middle;
        Self::directions()
            .map(|[cos, sin]| {
                edges(&self.corners)
                    .filter_map(|(a, b)| {
                        // The edge lies at n . x = n . a with the outward normal n; the ray meets it at t.
                        let n = [b[1] - a[1], a[0] - b[0]];
                        let toward = n[0] * cos + n[1] * sin;
                        (toward > 0.0).then(|| (n[0] * (a[0] - m[0]) + n[1] * (a[1] - m[1])) / toward)
                    })
                    .fold(f64::INFINITY, f64::min)
            })
            .collect()
    }

    /// Reach of other points from the middle of this outline.
    pub(crate) fn reach_of(&self, points: &[Flat]) -> Vec<f64> {
        reach(points, self.middle)
    }

    /// The smallest change of the reach under a rotation by 1/n of a turn, n from 2 on \[share of the mean reach\].
    ///
    /// The median over the directions is taken, so that a hidden stretch of the outline does not count.
    pub(crate) fn asymmetry(&self) -> f64 {
        const LARGEST_ORDER: usize = 12;
        let mean = self.reach.iter().sum::<f64>() / SECTORS as f64;
        let at = |x: f64| {
            let (low, part) = (x.floor(), x - x.floor());
            let index = low as usize % SECTORS;
            (1.0 - part) * self.reach[index] + part * self.reach[(index + 1) % SECTORS]
        };
        (2..=LARGEST_ORDER)
            .map(|n| {
                let shift = SECTORS as f64 / n as f64;
                let mut changes: Vec<f64> =
                    (0..SECTORS).map(|i| (at(i as f64 + shift) - self.reach[i]).abs()).collect();
                *changes.select_nth_unstable_by(SECTORS / 2, f64::total_cmp).1 / mean
            })
            .fold(f64::INFINITY, f64::min)
    }

    /// Share of its tightest bounding rectangle that the hull fills; one for a rectangle, pi / 4 for a circle.
    ///
    /// One side of it lies along an edge of the hull: one of the longer ones, where there are very many.
    pub(crate) fn rectangularity(&self) -> f64 {
        const LOOKED_AT: usize = 256;
        let (area, _) = area_and_centroid(&self.corners);
        let mut sides: Vec<(Flat, Flat)> = edges(&self.corners).collect();
        sides.sort_by(|(a, b), (c, d)| distance_sq(*c, *d).total_cmp(&distance_sq(*a, *b)));
        let smallest = (sides.into_iter().take(LOOKED_AT))
            .filter_map(|(a, b)| {
                let length = distance(a, b);
                let u = [(b[0] - a[0]) / length, (b[1] - a[1]) / length];
                let span = |direction: Flat| {
                    let (low, high) = self
                        .corners
                        .iter()
                        .map(|p| p[0] * direction[0] + p[1] * direction[1])
                        .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)));
                    high - low
                };
                (length > 0.0).then(|| span(u) * span([-u[1], u[0]]))
            })
            .fold(f64::INFINITY, f64::min);
        area / smallest
    }
}

/// Middle of the smallest circle about `points`; from any `start`, steps of 1/(i+1) toward the farthest point converge to
/// it (Badoiu and Clarkson 2003), with an error below a radius divided by their number. Only corners of the hull are ever
/// the farthest.
pub(crate) fn enclosing_middle(points: &[Flat], start: Flat) -> Flat {
    const STEPS: u32 = 400;
    let corners = convex_hull(points);
    let mut middle = start;
    for i in 1..=STEPS {
        let farther = |(far, most): (Flat, f64), p: &Flat| {
            let distance_sq = distance_sq(*p, middle);
            if distance_sq >= most { (*p, distance_sq) } else { (far, most) }
        };
        let (far, _) = corners.iter().fold((middle, 0.0), farther);
        let step = 1.0 / f64::from(i + 1);
        middle = [middle[0] + step * (far[0] - middle[0]), middle[1] + step * (far[1] - middle[1])];
    }
    middle
}

fn dot(a: Flat, b: Flat) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

fn distance_sq(a: Flat, b: Flat) -> f64 {
    (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2)
}

pub(crate) fn distance(a: Flat, b: Flat) -> f64 {
    distance_sq(a, b).sqrt()
}

fn reach(points: &[Flat], middle: Flat) -> Vec<f64> {
    let mut reach = vec![0_f64; SECTORS];
    for p in points {
        let (x, y) = (p[0] - middle[0], p[1] - middle[1]);
        let turn = (y.atan2(x) / TAU).rem_euclid(1.0);
        let sector = ((turn * SECTORS as f64) as usize).min(SECTORS - 1);
        reach[sector] = reach[sector].max(distance(*p, middle));
    }
    reach
}

/// Andrew's monotone chain.
fn convex_hull(points: &[Flat]) -> Vec<Flat> {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let half = |points: &mut dyn Iterator<Item = &Flat>| {
        let mut chain: Vec<Flat> = Vec::new();
        for p in points {
            while let [.., a, b] = chain[..]
                && cross(a, b, *p) <= 0.0
            {
                chain.pop();
            }
            chain.push(*p);
        }
        chain.pop();
        chain
    };
    let mut corners = half(&mut sorted.iter());
    corners.extend(half(&mut sorted.iter().rev()));
    corners
}

fn edges(corners: &[Flat]) -> impl Iterator<Item = (Flat, Flat)> + '_ {
    corners.iter().copied().zip(corners.iter().copied().cycle().skip(1))
}

/// Twice the area of the triangle, positive when it runs counterclockwise.
fn cross(a: Flat, b: Flat, p: Flat) -> f64 {
    (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])
}

fn area_and_centroid(corners: &[Flat]) -> (f64, Flat) {
    let Some(&origin) = corners.first() else { return (0.0, [0.0; 2]) };
    let (mut area, mut x, mut y) = (0.0, 0.0, 0.0);
    for (a, b) in edges(corners) {
        let part = 0.5 * cross(origin, a, b);
        area += part;
        x += part * (a[0] + b[0] - 2.0 * origin[0]) / 3.0;
        y += part * (a[1] + b[1] - 2.0 * origin[1]) / 3.0;
    }
    if area > 0.0 { (area, [origin[0] + x / area, origin[1] + y / area]) } else { (0.0, origin) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(inside: impl Fn(f64, f64) -> bool) -> Vec<Flat> {
        let at = |i: i32| 0.02 * f64::from(i) - 2.0;
        (0..200).flat_map(|i| (0..200).map(move |j| [at(i), at(j)])).filter(|p| inside(p[0], p[1])).collect()
    }

    #[test]
    fn a_disc_a_rectangle_and_a_trapezoid_are_told_apart() -> Result<(), &'static str> {
        let disc = Outline::new(&grid(|x, y| x.hypot(y) < 1.0)).ok_or("no outline")?;
        assert!((disc.radius() - 1.0).abs() < 0.02 && disc.asymmetry() < 0.03, "{}", disc.asymmetry());
        assert!((disc.rectangularity() - std::f64::consts::FRAC_PI_4).abs() < 0.03);
        let rectangle = Outline::new(&grid(|x, y| x.abs() < 0.9 && y.abs() < 0.6)).ok_or("no outline")?;
        assert!(rectangle.asymmetry() < 0.03 && rectangle.rectangularity() > 0.99);
        let trapezoid =
            Outline::new(&grid(|x, y| y.abs() < 0.8 && x.abs() < 1.0 + 0.7 * y)).ok_or("no outline")?;
        assert!(trapezoid.asymmetry() > 0.06 && trapezoid.rectangularity() < 0.9);
        assert!(trapezoid.contains([0.0, 0.7], 0.0) && !trapezoid.contains([0.9, -0.7], 0.0));
        assert!(Outline::new(&[[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]]).is_none());
        Ok(())
    }

    #[test]
    fn the_middle_of_a_gear_is_found_though_a_quarter_of_it_is_missing() {
        let radius = |angle: f64| if (11.0 * angle).sin() > 0.0 { 1.0 } else { 0.7 };
        let angles = (0..2000).map(|i| f64::from(i) / 2000.0 * 1.5 * std::f64::consts::PI);
        let outline: Vec<Flat> =
            angles.map(|t| [3.0 + radius(t) * t.cos(), radius(t) * t.sin() - 2.0]).collect();
        let middle = enclosing_middle(&outline, outline[0]);
        assert!(distance(middle, [3.0, -2.0]) < 0.005, "{middle:?}");
        assert!(distance(enclosing_middle(&[[1.0, 1.0]; 3], [1.0, 1.0]), [1.0, 1.0]) < 1e-12);
    }
}
