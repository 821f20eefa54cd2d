//! What the columns of a file mean: shared by the formats.

use std::collections::HashSet;

use super::Scan;

/// Which columns hold what.
pub(super) struct Roles {
    pub(super) points: [usize; 3],
    pub(super) normals: Option<[usize; 3]>,
    pub(super) colors: Option<[usize; 3]>,
}

impl Roles {
    /// The columns that hold something.
    pub(super) fn used(&self) -> Vec<usize> {
        [Some(self.points), self.normals, self.colors].into_iter().flatten().flatten().collect()
    }
}

/// How the numbers of a colour are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Kind {
    Byte,
    Whole,
    Real,
}

/// The first name that is given twice; `_` is that of padding.
pub(super) fn given_twice<'a>(names: &[&'a str]) -> Option<&'a str> {
    let mut seen = HashSet::new();
    names.iter().copied().find(|name| *name != "_" && !seen.insert(*name))
}

/// Finds the columns by the names that files use; case does not matter. `None`: no x, y and z.
pub(super) fn roles(names: &[&str]) -> Option<Roles> {
    let column = |wanted: &str| names.iter().position(|name| name.eq_ignore_ascii_case(wanted));
    let find = |variants: &[[&str; 3]]| {
        variants.iter().find_map(|[a, b, c]| Some([column(a)?, column(b)?, column(c)?]))
    };
    Some(Roles {
        points: find(&[["x", "y", "z"]])?,
        normals: find(&[
            ["nx", "ny", "nz"],
            ["normal_x", "normal_y", "normal_z"],
            ["normalx", "normaly", "normalz"],
        ]),
        colors: find(&[
            ["red", "green", "blue"],
            ["r", "g", "b"],
            ["diffuse_red", "diffuse_green", "diffuse_blue"],
        ]),
    })
}

/// Builds the scan from `column`, which gives a trio of columns; `kind` says how a column is stored.
pub(super) fn assemble(
    names: &[&str],
    kind: impl Fn(usize) -> Kind,
    columns: impl Fn([usize; 3]) -> Vec<[f64; 3]>,
) -> Result<Scan, String> {
    let Some(roles) = roles(names) else {
        return Err(format!("expected columns x y z, found {}", list(names)));
    };
    let colors = roles.colors.and_then(|trio| {
        let widest = trio.into_iter().map(&kind).max().unwrap_or(Kind::Real);
        to_colors(&columns(trio), widest)
    });
    Ok(Scan {
        points: columns(roles.points),
        normals: roles.normals.map(&columns).and_then(known_normals),
        colors,
        viewpoint: None,
        is_mesh: false,
    })
}

/// `None` for normals that are all zero or not finite, which is how some programs write none.
pub(super) fn known_normals(normals: Vec<[f64; 3]>) -> Option<Vec<[f64; 3]>> {
    normals.iter().flatten().any(|x| x.is_finite() && *x != 0.0).then_some(normals)
}

/// Bytes as they are, 16-bit numbers and reals from 0 to 1 scaled; `None` where the numbers are no colours.
pub(super) fn to_colors(values: &[[f64; 3]], kind: Kind) -> Option<Vec<[u8; 3]>> {
    let all = || values.iter().flatten();
    if !all().all(|v| (0.0..=65535.0).contains(v)) {
        return None;
    }
    let top = all().fold(0.0, |top: f64, v| top.max(*v));
    let convert: fn(f64) -> u8 = match kind {
        Kind::Real if top <= 1.0 => |v| (v * 255.0).round_ties_even() as u8,
        _ if top <= 255.0 => |v| v as u8,
        _ => |v| (v / 257.0) as u8,
    };
    Some(values.iter().map(|row| row.map(convert)).collect())
}

/// Names for an error message, cut where there are very many.
pub(super) fn list(names: &[&str]) -> String {
    let shown = names.iter().take(20).map(|name| name.chars().take(40).collect::<String>());
    let text = shown.collect::<Vec<_>>().join(", ");
    match names.len() {
        0 => "none".into(),
        1..=20 => text,
        more => format!("{text}, ... ({more} in all)"),
    }
}
