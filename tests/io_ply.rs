//! PLY files: every encoding and type, what is skipped, what is refused.
#![cfg(feature = "io")]
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test may panic")]

use std::fmt::Write;

use proptest::prelude::*;
use sympose::Error;
use sympose::io::{self, Scan};

fn parse(content: &[u8]) -> Scan {
    io::parse(content, "part.ply").unwrap()
}

fn reason(content: &[u8]) -> String {
    match io::parse(content, "part.ply") {
        Err(Error::Format { path, reason }) => {
            assert_eq!(path.to_str(), Some("part.ply"));
            reason
        }
        other => panic!("expected Error::Format, got {other:?}"),
    }
}

/// A number in each of the types of PLY, in both byte orders.
fn stored(kind: &str, value: i8, big_endian: bool) -> Vec<u8> {
    macro_rules! bytes {
        ($T:ty) => {
            if big_endian {
                (value as $T).to_be_bytes().to_vec()
            } else {
                (value as $T).to_le_bytes().to_vec()
            }
        };
    }
    match kind {
        "char" | "int8" => bytes!(i8),
        "uchar" | "uint8" => bytes!(u8),
        "short" | "int16" => bytes!(i16),
        "ushort" | "uint16" => bytes!(u16),
        "int" | "int32" => bytes!(i32),
        "uint" | "uint32" => bytes!(u32),
        "float" | "float32" => bytes!(f32),
        "double" | "float64" => bytes!(f64),
        other => panic!("{other}"),
    }
}

const KINDS: [&str; 16] = [
    "char", "int8", "uchar", "uint8", "short", "int16", "ushort", "uint16", "int", "int32", "uint", "uint32",
    "float", "float32", "double", "float64",
];

proptest! {
    /// Any mix of types, with properties between and lists around the vertices, in all three encodings.
    #[test]
    fn reads_any_types_in_any_encoding(
        kinds in prop::array::uniform3(prop::sample::select(&KINDS[..])),
        extra in prop::sample::select(&KINDS[..]),
        rows in prop::collection::vec(prop::array::uniform3(0_i8..=127), 1..20),
        lists in prop::collection::vec(prop::collection::vec(0_i8..=127, 0..5), 0..4),
        encoding in prop::sample::select(&["ascii", "binary_little_endian", "binary_big_endian"][..]),
    ) {
        let mut header = format!("ply\nformat {encoding} 1.0\ncomment made by hand\nelement face {}\n", lists.len());
        header += "property list uchar short vertex_indices\nproperty uchar flag\n";
        write!(header, "element vertex {}\nproperty {} x\n", rows.len(), kinds[0]).unwrap();
        write!(header, "property {extra} scalar_Illuminance_(PCV)\nproperty {} y\n", kinds[1]).unwrap();
        write!(header, "property {} z\nelement tail 1\nproperty float q\nend_header\n", kinds[2]).unwrap();
        let mut file = header.into_bytes();
        if encoding == "ascii" {
            let mut text = String::new();
            for list in &lists {
                write!(text, "{} ", list.len()).unwrap();
                list.iter().for_each(|item| write!(text, "{item} ").unwrap());
                text += "1\r\n";
            }
            for [x, y, z] in &rows {
                writeln!(text, "{x} 7 {y}\t {z} ").unwrap();
            }
            file.extend((text + "0.5").into_bytes());
        } else {
            let big = encoding == "binary_big_endian";
            for list in &lists {
                file.push(u8::try_from(list.len()).unwrap());
                list.iter().for_each(|item| file.extend(stored("short", *item, big)));
                file.push(1);
            }
            for [x, y, z] in &rows {
                file.extend(stored(kinds[0], *x, big));
                file.extend(stored(extra, 7, big));
                file.extend(stored(kinds[1], *y, big));
                file.extend(stored(kinds[2], *z, big));
            }
            file.extend(stored("float", 1, big));
        }
        let scan = parse(&file);
        let expected: Vec<[f64; 3]> = rows.iter().map(|row| row.map(f64::from)).collect();
        let is_mesh = !lists.is_empty();
        prop_assert_eq!(scan, Scan { points: expected, is_mesh, ..Scan::default() });
        // One byte less and the last element is not whole.
        if encoding != "ascii" {
            prop_assert!(reason(&file[..file.len() - 1]).contains("truncated"));
        }
    }

    #[test]
    fn what_is_written_comes_back(
        points in prop::collection::vec(prop::array::uniform3(-1e9..1e9_f64), 1..30),
        normals in any::<bool>(),
        colors in any::<bool>(),
        single in any::<bool>(),
        viewpoint in prop::option::of(prop::array::uniform3(1.0..9.0_f64)),
    ) {
        let points: Vec<_> =
            points.into_iter().map(|p| if single { p.map(|x| f64::from(x as f32)) } else { p }).collect();
        let scan = Scan {
            normals: normals.then(|| points.iter().map(|_| [0.0, 0.0, -1.0]).collect()),
            colors: colors.then(|| (0..points.len()).map(|i| [i as u8, 0, 255]).collect()),
            viewpoint,
            points,
            is_mesh: false,
        };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("part.PLY");
        io::write(&path, &scan).unwrap();
        prop_assert_eq!(&io::read(&path).unwrap(), &scan);
        let real = if single { "float x" } else { "double x" };
        let content = std::fs::read(&path).unwrap();
        prop_assert!(String::from_utf8_lossy(&content[..120]).contains(real));
    }
}

const SMALL: &str = "ply\r\nformat ascii 1.0\r\nelement vertex 2\r\nproperty float x\r\nproperty float y\r\n\
                     property double z\r\nproperty float nx\r\nproperty float ny\r\nproperty float nz\r\n\
                     property ushort red\r\nproperty ushort green\r\nproperty ushort blue\r\n\
                     element camera 1\r\nproperty float view_px\r\nproperty float view_py\r\nproperty float view_pz\r\n\
                     end_header\r\n0.1 nan .5 0 0 1 65535 0 257\r\n1e3 -inf 5. 0 1 0 0 0 0\r\n1 2 3\r\n";

#[test]
fn normals_colors_viewpoint_and_nan_are_kept() {
    let scan = parse(SMALL.as_bytes());
    assert_eq!(scan.points[0][0], f64::from(0.1_f32));
    assert!(scan.points[0][1].is_nan());
    assert_eq!(scan.points[0][2], 0.5);
    assert_eq!(scan.points[1], [1000.0, f64::NEG_INFINITY, 5.0]);
    assert_eq!(scan.normals, Some(vec![[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]));
    assert_eq!(scan.colors, Some(vec![[255, 0, 1], [0, 0, 0]]));
    assert_eq!(scan.viewpoint, Some([1.0, 2.0, 3.0]));
    let none =
        parse(SMALL.replace("0 0 1 65535", "0 0 0 65535").replace("0 1 0 0 0 0", "0 0 0 0 0 0").as_bytes());
    assert_eq!(none.normals, None, "normals that are all zero are none");
    let origin = parse(SMALL.replace("1 2 3", "0 0 0").as_bytes());
    assert_eq!(origin.viewpoint, None, "a camera at the origin says nothing");
}

#[test]
fn the_cloud_leaves_out_what_is_not_finite() {
    let file = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                end_header\n0 0 0\nnan nan nan\n1 0 0\n";
    let cloud = parse(file.as_bytes()).into_cloud().unwrap();
    assert_eq!((cloud.len(), cloud.dropped()), (2, 1));
}

#[test]
fn damage_is_named() {
    let small = SMALL.replace("\r\n", "\n");
    for (from, to, expected) in [
        (
            "1e3 -inf",
            "1e3 what",
            "vertex 1: expected numbers for x, y, z, nx, ny, nz, red, green, blue, found \"1e3 what",
        ),
        ("-inf 5. ", "-inf ", "vertex 1: expected numbers"),
        ("-inf 5. ", "-inf 5. 6 ", "vertex 1: expected numbers"),
        ("65535 0 257", "65536 0 257", "vertex 0: expected numbers"),
        ("1 2 3\n", "", "truncated: the header announces 1 of element camera, the file holds 0"),
        ("vertex 2", "vertex 4", "truncated: the header announces 4 of element vertex, the file holds 3"),
        ("vertex 2", "vertex -2", "announces \"-2\" of vertex"),
        ("element vertex 2", "element vertices 2", "expected an element vertex, found vertices, camera"),
        ("property float y", "property float w", "expected columns x y z, found x, w, z"),
        ("property float y", "property half y", "unknown PLY type \"half\""),
        ("property float y", "propertys float y", "found \"propertys float y\""),
        ("format ascii 1.0\n", "", "no line format"),
        ("end_header\n", "", "found \"0.1 nan"),
    ] {
        assert!(small.contains(from));
        let found = reason(small.replacen(from, to, 1).as_bytes());
        // With a wrong count the row of the camera is read as a vertex, which is damage of another kind.
        let counted = to == "vertex 4" && found.contains("vertex 2: expected numbers");
        assert!(found.contains(expected) || counted, "{to:?}: {found}");
    }
    assert_eq!(reason(b"ply\nformat ascii 1.0\n"), "the PLY header ends without a line end_header");
}

#[test]
fn absurd_counts_are_refused_at_once() {
    let huge = usize::MAX;
    for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
        for count in [huge, huge / 24, 3_000_000_000] {
            for properties in ["property float x\nproperty float y\nproperty float z\n", ""] {
                let mut file =
                    format!("ply\nformat {format} 1.0\nelement vertex {count}\n{properties}end_header\n")
                        .into_bytes();
                file.extend([0; 24]);
                let found = reason(&file);
                assert!(found.contains("truncated") || found.contains("expected"), "{found}");
            }
        }
        let mut file = format!(
            "ply\nformat {format} 1.0\nelement face {huge}\nproperty list uint double i\nelement vertex 1\n\
             property float x\nproperty float y\nproperty float z\nend_header\n"
        )
        .into_bytes();
        file.extend([255; 40]);
        assert!(reason(&file).contains("face"), "{}", reason(&file));
        let text = String::from_utf8_lossy(&file).replace("\u{fffd}", "9");
        assert!(reason(text.as_bytes()).contains("face"));
    }
}

#[test]
fn lines_may_end_with_a_carriage_return_alone() {
    let text = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n\
                end_header\n1 2 3\n4 5 6\n";
    let expected = parse(text.as_bytes());
    assert_eq!(expected.points, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
    assert_eq!(parse(text.replace('\n', "\r").as_bytes()), expected);
    assert_eq!(parse(text.replace('\n', "\r\n").as_bytes()), expected);
}
