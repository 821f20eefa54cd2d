//! The order of a rotational symmetry.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// The largest discrete order that may be declared.
pub const MAX_ORDER: u32 = 360;

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

fn invalid(value: &str) -> Error {
    Error::InvalidParameter {
        name: "order",
        value: value.to_owned(),
        expected: "an integer from 2 to 360, \"continuous\" for a surface of revolution, or \"auto\"",
    }
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

#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum Written {
    Number(i64),
    Text(String),
}

impl Serialize for Order {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        match self {
            Self::Cyclic(n) => Written::Number(i64::from(*n)).serialize(serializer),
            other => Written::Text(other.to_string()).serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for Order {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        let text = match Written::deserialize(deserializer)? {
            Written::Number(n) => n.to_string(),
            Written::Text(text) => text,
        };
        text.parse().map_err(serde::de::Error::custom)
    }
}
