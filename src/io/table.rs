//! A table of typed columns in bytes: what binary PLY and PCD files hold, and what their text is brought to.

use std::borrow::Cow;

use super::Scan;
use super::columns::{Kind, assemble};

/// The type of one number in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

/// Runs `$body` with `$T` being the Rust type of a [`Scalar`].
macro_rules! with_type {
    ($scalar:expr, $T:ident => $body:expr) => {
        with_type!(@ $scalar, $T, $body, I8 i8, U8 u8, I16 i16, U16 u16, I32 i32, U32 u32, I64 i64, U64 u64, F32 f32, F64 f64)
    };
    (@ $scalar:expr, $T:ident, $body:expr, $($variant:ident $kind:ident),*) => {
        match $scalar {
            $(Scalar::$variant => {
                type $T = $kind;
                $body
            })*
        }
    };
}

#[allow(clippy::unnecessary_cast, reason = "of ten types one is the same already")]
impl Scalar {
    /// Bytes that one number takes.
    pub(super) fn size(self) -> usize {
        with_type!(self, T => size_of::<T>())
    }

    pub(super) fn kind(self) -> Kind {
        match self {
            Self::U8 => Kind::Byte,
            Self::F32 | Self::F64 => Kind::Real,
            _ => Kind::Whole,
        }
    }

    /// The number at the start of `bytes`; NaN when they end too early.
    pub(super) fn decode(self, bytes: &[u8], big_endian: bool) -> f64 {
        with_type!(self, T => match bytes.first_chunk() {
            Some(chunk) if big_endian => T::from_be_bytes(*chunk) as f64,
            Some(chunk) => T::from_le_bytes(*chunk) as f64,
            None => f64::NAN,
        })
    }

    /// Appends a written number as little-endian bytes; `None` when it is no number of this type.
    pub(super) fn encode(self, token: &str, bytes: &mut Vec<u8>) -> Option<()> {
        let value = parse_real(token)?;
        with_type!(self, T => {
            // Reals may overflow to infinity; whole numbers must arrive unchanged.
            let stored = value as T;
            if self.kind() != Kind::Real && stored as f64 != value {
                return None;
            }
            bytes.extend_from_slice(&stored.to_le_bytes());
        });
        Some(())
    }
}

/// A written number. Programs of Microsoft's C library write some kinds of NaN as `-nan(ind)` or `nan(snan)`.
pub(super) fn parse_real(token: &str) -> Option<f64> {
    let is_nan = || {
        let bare = token.trim_start_matches(['+', '-']).to_ascii_lowercase();
        bare.starts_with("nan(") && bare.ends_with(')')
    };
    token.parse().ok().or_else(|| is_nan().then_some(f64::NAN))
}

/// One number of each row: the first at byte `start`, the next `step` bytes further.
#[derive(Debug, Clone)]
pub(super) struct Field {
    pub(super) name: String,
    pub(super) scalar: Scalar,
    pub(super) start: usize,
    pub(super) step: usize,
}

/// Typed columns; every field lies within `bytes` for every row.
pub(super) struct Table<'a> {
    pub(super) bytes: Cow<'a, [u8]>,
    pub(super) big_endian: bool,
    pub(super) rows: usize,
    pub(super) fields: Vec<Field>,
}

impl Table<'_> {
    pub(super) fn names(&self) -> Vec<&str> {
        self.fields.iter().map(|field| field.name.as_str()).collect()
    }

    /// The bytes of a field from row to row, each slice beginning with the number.
    pub(super) fn cells(&self, field: &Field) -> impl Iterator<Item = &[u8]> {
        let (start, step) = (field.start, field.step);
        (0..self.rows).map(move |row| self.bytes.get(start + row * step..).unwrap_or(&[]))
    }

    pub(super) fn columns(&self, trio: [usize; 3]) -> Vec<[f64; 3]> {
        let mut rows = vec![[f64::NAN; 3]; self.rows];
        for (axis, index) in trio.into_iter().enumerate() {
            let field = &self.fields[index];
            for (row, cell) in rows.iter_mut().zip(self.cells(field)) {
                row[axis] = field.scalar.decode(cell, self.big_endian);
            }
        }
        rows
    }

    pub(super) fn scan(&self) -> Result<Scan, String> {
        assemble(&self.names(), |index| self.fields[index].scalar.kind(), |trio| self.columns(trio))
    }
}

/// Whether all numbers are floats that were widened, so that writing floats loses nothing.
pub(super) fn fits_f32<'a>(rows: impl IntoIterator<Item = &'a [f64; 3]>) -> bool {
    rows.into_iter().flatten().all(|x| x.is_nan() || f64::from(*x as f32) == *x)
}
