//! The order of a rotational symmetry.

use serde::de::Visitor;
use serde::{Deserialize, Serialize};

use crate::directions::GOLDEN_ANGLE;
use crate::error::{Error, Result};

/// The largest discrete order that may be declared.
pub const MAX_ORDER: u32 = 360;

const EXPECTED: &str =
    "a whole number from 2 to 360, \"continuous\" for a surface of revolution, or \"auto\"";

/// Order of the symmetry about the axis.
///
/// In JSON and TOML: `"auto"`, an integer, or `"continuous"`.
///
/// ```
/// use sympose::Order;
/// assert_eq!("5".parse::<Order>()?, Order::Cyclic(5));
/// assert!("1".parse::<Order>().is_err());
/// # Ok::<(), sympose::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Order {
    /// Found from the data.
    #[default]
    Auto,
    /// The part looks the same after every turn by 360/n degrees; n >= 2.
    Cyclic(u32),
    /// A surface of revolution.
    Continuous,
}

impl Order {
    /// Refuses orders that are no symmetry.
    ///
    /// # Errors
    /// [`Error::InvalidParameter`] for a cyclic order below 2 or beyond [`MAX_ORDER`].
    pub fn validate(self) -> Result<Self> {
        match self {
            Self::Cyclic(n) if !(2..=MAX_ORDER).contains(&n) => Err(invalid(&n.to_string())),
            order => Ok(order),
        }
    }
}

/// Rotation angles of a symmetry, each with a weight.
#[derive(Debug, Clone, PartialEq)]
pub struct Turns(Vec<(f64, f64)>);

impl Turns {
    /// Rotations for finding the axis, at most `max` of them.
    ///
    /// k and n - k give nearly the same equations, so half of the group suffices; k = n/2 counts half, since it pairs
    /// each couple of points twice. A continuous symmetry takes multiples of the golden angle.
    #[must_use]
    pub fn half(order: Order, max: usize) -> Self {
        match order {
            Order::Cyclic(n) => {
                let weight = |k: u32| if 2 * k == n { 0.5 } else { 1.0 };
                Self(chosen(n, n / 2, max).map(|k| (angle(k, n), weight(k))).collect())
            }
            Order::Continuous | Order::Auto => Self::golden(max),
        }
    }

    /// All rotations but the identity, at most `max` of them.
    #[must_use]
    pub fn all(order: Order, max: usize) -> Self {
        match order {
            Order::Cyclic(n) => {
                Self(chosen(n, n.saturating_sub(1), max).map(|k| (angle(k, n), 1.0)).collect())
            }
            Order::Continuous | Order::Auto => Self::golden(max),
        }
    }

    /// One rotation by `angle` \[rad\].
    #[must_use]
    pub fn single(angle: f64) -> Self {
        Self(vec![(angle, 1.0)])
    }

    /// Multiples of the golden angle alias with no discrete order.
    fn golden(count: usize) -> Self {
        Self((1..=count).map(|k| ((GOLDEN_ANGLE * k as f64) % std::f64::consts::TAU, 1.0)).collect())
    }

    /// Angle \[rad\] and weight of each rotation.
    pub fn iter(&self) -> impl Iterator<Item = (f64, f64)> + '_ {
        self.0.iter().copied()
    }

    /// Angles \[rad\].
    pub fn angles(&self) -> impl Iterator<Item = f64> + '_ {
        self.0.iter().map(|(angle, _)| *angle)
    }

    /// Number of rotations.
    #[must_use]
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

/// Angle of `k` times the smallest rotation of order `n` \[rad\].
fn angle(k: u32, n: u32) -> f64 {
    std::f64::consts::TAU * f64::from(k) / f64::from(n)
}

/// At most `max` of the multiples 1 to `count` of the smallest rotation of order `n`, ascending. Those that generate the whole
/// group come first: a part of lower order may map to itself under all the others.
fn chosen(n: u32, count: u32, max: usize) -> impl Iterator<Item = u32> {
    let (generating, others): (Vec<u32>, Vec<u32>) = (1..=count).partition(|&k| gcd(k, n) == 1);
    let mut chosen: Vec<u32> = spread(&generating, max.max(1)).collect();
    chosen.extend(spread(&others, max.saturating_sub(chosen.len())));
    chosen.sort_unstable();
    chosen.into_iter()
}

/// At most `max` of the values, evenly spread, the last one included.
fn spread(values: &[u32], max: usize) -> impl Iterator<Item = u32> + '_ {
    let taken = values.len().min(max);
    (1..=taken).map(move |i| values[i * values.len() / taken - 1])
}

/// Greatest common divisor.
pub(crate) fn gcd(a: u32, b: u32) -> u32 {
    if b == 0 { a } else { gcd(b, a % b) }
}

fn invalid(value: &str) -> Error {
    Error::InvalidParameter { name: "order", value: value.to_owned(), expected: EXPECTED }
}

impl std::fmt::Display for Order {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::Cyclic(n) => write!(f, "{n}"),
            Self::Continuous => f.write_str("continuous"),
        }
    }
}

impl std::str::FromStr for Order {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        match text.trim() {
            "auto" => Ok(Self::Auto),
            "continuous" => Ok(Self::Continuous),
            number => Self::Cyclic(number.parse().map_err(|_| invalid(text))?).validate(),
        }
    }
}

impl Serialize for Order {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        match self {
            Self::Cyclic(n) => serializer.serialize_u32(*n),
            other => serializer.collect_str(other),
        }
    }
}

impl<'de> Deserialize<'de> for Order {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        deserializer.deserialize_any(Written)
    }
}

/// Takes an order as it is written, and names what is none.
struct Written;

impl Visitor<'_> for Written {
    type Value = Order;

    fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(EXPECTED)
    }

    fn visit_str<E: serde::de::Error>(self, text: &str) -> std::result::Result<Order, E> {
        text.parse().map_err(E::custom)
    }

    fn visit_i64<E: serde::de::Error>(self, number: i64) -> std::result::Result<Order, E> {
        self.visit_str(&number.to_string())
    }

    fn visit_u64<E: serde::de::Error>(self, number: u64) -> std::result::Result<Order, E> {
        self.visit_str(&number.to_string())
    }

    fn visit_f64<E: serde::de::Error>(self, number: f64) -> std::result::Result<Order, E> {
        // With its point, which tells 5.0 from 5.
        Err(E::custom(invalid(&format!("{number:?}"))))
    }

    fn visit_bool<E: serde::de::Error>(self, flag: bool) -> std::result::Result<Order, E> {
        Err(E::custom(invalid(&flag.to_string())))
    }
}
