//! Text files, and how a format is recognised.
#![cfg(feature = "io")]
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test may panic")]

use proptest::prelude::*;
use sympose::Error;
use sympose::io::{self, Format, Scan};

fn reason(content: &[u8], name: &str) -> String {
    match io::parse(content, name) {
        Err(Error::Format { reason, .. }) => reason,
        other => panic!("expected Error::Format, got {other:?}"),
    }
}

#[test]
fn delimiters_headers_and_comments() {
    let expected = Scan { points: vec![[1.0, 2.5, -3e2], [4.0, 5.0, 6.0]], ..Scan::default() };
    for text in [
        "1 2.5 -3e2\n4 5 6\n",
        "\u{feff}1\t2.5  -300\r\n\r\n4 5 6",
        "# a scan\n// of a part\n1,2.5,-300\n4, 5, 6\n",
        "x,y,z\n1,2.5,-300\n4,5,6 # the last\n",
        "X;Y;Z\n1;2,5;-300\n4;5;6\n",
        "\"z\",\"x\",\"time\",\"y\"\n-300,1,0,2.5\n# between\n6,4,0,5\n",
        "# x y z intensity\n1 2.5 -300 0\n4 5 6 0\n",
        "label,x,y,z\n\"a; \"\"b\"\", c\",1,2.5,-300\nbolt,4,5,6\n",
        "x,y,z,\n1,2.5,-300,\n4,5,6\n",
        "x,time,y,z\n1,,2.5,-300\n4,noon,5,6\n",
        "\"1\",\"2.5\", \"-300\"\n\"4\",\"5\",\"6\"\n",
        "x y z\r1 2.5 -300\r4 5 6\r",
    ] {
        assert_eq!(io::parse(text.as_bytes(), "part.txt").unwrap(), expected, "{text:?}");
    }
}

#[test]
fn further_columns_are_told_by_name_or_by_value() {
    let normals = Some(vec![[0.0, 0.0, 1.0], [0.6, 0.0, 0.8]]);
    let colors = Some(vec![[255, 0, 3], [0, 0, 0]]);
    for (text, with_normals, with_colors) in [
        ("1 2 3 0 0 1\n4 5 6 .6 0 .8\n", true, false),
        ("1 2 3 255 0 3\n4 5 6 0 0 0\n", false, true),
        ("1 2 3 255 0 3 0 0 1\n4 5 6 0 0 0 .6 0 .8\n", true, true),
        ("1 2 3 0 0 1 255 0 3\n4 5 6 .6 0 .8 0 0 0\n", true, true),
        ("x y z R G B Nx Ny Nz\n1 2 3 255 0 3 0 0 1\n4 5 6 0 0 0 .6 0 .8\n", true, true),
        ("# x y z normal_x normal_y normal_z\n1 2 3 0 0 1\n4 5 6 .6 0 .8\n", true, false),
    ] {
        let scan = io::parse(text.as_bytes(), "part.xyz").unwrap();
        assert_eq!(scan.normals, normals.clone().filter(|_| with_normals), "{text:?}");
        assert_eq!(scan.colors, colors.clone().filter(|_| with_colors), "{text:?}");
    }
    let fractions = io::parse(b"1 2 3 0 0.5 1\n4 5 6 0 0 0.25\n", "part.xyz").unwrap();
    assert_eq!(fractions.colors, Some(vec![[0, 128, 255], [0, 0, 64]]));
}

#[test]
fn a_first_line_may_count_the_points() {
    let points = vec![[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]];
    let colors = Some(vec![[255, 0, 3], [0, 0, 0]]);
    for (text, with_colors) in [
        ("2\n1 2 3\n4 5 6\n", false),
        ("# a scan\n2\n1 2 3 -731\n4 5 6 12.5\n", false),
        ("2\r\n1 2 3 -731 255 0 3\r\n4 5 6 12 0 0 0\r\n", true),
        ("2\n1 2 3 255 0 3\n4 5 6 0 0 0\n", true),
        ("2\nx,y,z,i,r,g,b\n1,2,3,7,255,0,3\n4,5,6,8,0,0,0\n", true),
    ] {
        let scan = io::parse(text.as_bytes(), "part.pts").unwrap();
        assert_eq!(scan.points, points, "{text:?}");
        assert_eq!(scan.colors, colors.clone().filter(|_| with_colors), "{text:?}");
    }
}

#[test]
fn damage_is_named() {
    for (text, expected) in [
        ("1 2 3\n4 5\n", "line 2: 2 columns, but 3 in the first row"),
        ("1 2 3\n4 five 6\n", "line 2: expected a row of numbers, found \"4 five 6\""),
        ("1,,2\n", "line 1: expected a row of numbers"),
        ("1,2,\n", "3, 6 or 9 columns), found 2"),
        ("x,y,z,label\n1,2,,a\n", "line 2: expected a row of numbers"),
        ("x,y,z,label\n1,2,3\n", "the header names 4 columns (x, y, z, label), the rows have 3"),
        ("1 2\n3 4\n", "3, 6 or 9 columns), found 2"),
        ("1 2 3 900 0 -1\n4 5 6 0 0 0\n", "cannot tell what columns 4 to 6 are"),
        ("x y z\n1 2 3 4\n", "the header names 3 columns (x, y, z), the rows have 4"),
        ("1 2 3 4\n5 6 7 8\n", "found 4; name them in a header line, such as x y z intensity"),
        ("3\n1 2 3\n4 5 6\n", "the first line counts 3 points, the file holds 2"),
        ("2\n1 2 3\n2\n4 5 6\n", "line 3: 1 columns, but 3 in the first row"),
        ("1\n2\n3\n", "3, 6 or 9 columns), found 1"),
        ("7\n", "expected rows of numbers x y z"),
        ("2\nwater\nO 1 2 3\nH 4 5 6\n", "line 3: expected a row of numbers, found \"O 1 2 3\""),
        ("a b c\n1 2 3\n", "expected columns x y z, found a, b, c"),
        ("hello\nworld\n", "line 2: expected a row of numbers"),
        ("# nothing here\n", "expected rows of numbers x y z"),
        ("\n \n", "expected rows of numbers x y z"),
        ("", "the file is empty"),
    ] {
        let found = reason(text.as_bytes(), "part.txt");
        assert!(found.contains(expected), "{text:?}: {found}");
    }
    assert!(reason(b"1 2 3\n\xff\xfe", "part.txt").contains("not a text file"));
}

#[test]
fn the_content_decides_before_the_suffix() {
    let ply =
        b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
                end_header\n1 2 3\n";
    let pcd = b"FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 1\nHEIGHT 1\nPOINTS 1\nDATA ascii\n1 2 3\n";
    for name in ["part", "part.ply", "part.pcd", "part.txt", "part.stl"] {
        assert_eq!(io::parse(ply, name).unwrap().points, [[1.0, 2.0, 3.0]]);
        assert_eq!(io::parse(pcd, name).unwrap().points, [[1.0, 2.0, 3.0]]);
    }
    assert!(reason(b"1 2 3\n", "part.ply").contains("not a PLY file; it starts with \"1 2 3"));
    assert!(reason(b"1 2 3\n", "part.pcd").contains("not a PCD file"));
    assert!(reason(b"solid cube\n", "part.stl").contains("not a point cloud of a known format"));
    assert!(reason(b"\x89PNG\r\n\x1a\n\0\0", "part").contains("not a point cloud of a known format"));
    assert!(reason(b"\x93NUMPY\x01\0", "part.npy").contains("Python"));
    assert!(reason(b"PK\x03\x04", "part.npz").contains("Python"));
}

#[test]
fn files_that_cannot_be_read_or_written() {
    let folder = tempfile::tempdir().unwrap();
    let missing = folder.path().join("none.ply");
    match io::read(&missing) {
        Err(Error::Io { path, source }) => {
            assert_eq!(path, missing);
            assert_eq!(source.kind(), std::io::ErrorKind::NotFound);
        }
        other => panic!("{other:?}"),
    }
    assert!(matches!(io::read(folder.path()), Err(Error::Io { .. })));
    let scan = Scan { points: vec![[0.0; 3]], ..Scan::default() };
    assert!(matches!(io::write(folder.path().join("no/such/folder.ply"), &scan), Err(Error::Io { .. })));
    assert!(matches!(io::write(folder.path().join("part.stl"), &scan), Err(Error::Format { .. })));
    assert!(matches!(Format::of("part"), Err(Error::Format { .. })));
    let empty = io::write(folder.path().join("part.ply"), &Scan::default());
    assert!(matches!(empty, Err(Error::InsufficientData { .. })));
    let uneven = Scan { normals: Some(vec![]), ..scan };
    assert!(matches!(
        io::write(folder.path().join("part.ply"), &uneven),
        Err(Error::LengthMismatch { what: "normals", expected: 1, got: 0 })
    ));
    assert!(matches!(uneven.into_cloud(), Err(Error::LengthMismatch { .. })));
}

#[cfg(unix)]
#[test]
fn an_endless_file_is_refused_unread() {
    assert!(matches!(io::read("/dev/zero"), Err(Error::Format { .. })));
}

proptest! {
    #[test]
    fn what_is_written_comes_back(
        points in prop::collection::vec(prop::array::uniform3(any::<f64>()), 1..30),
        normals in any::<bool>(),
        colors in any::<bool>(),
        suffix in prop::sample::select(&["xyz", "txt", "csv"][..]),
    ) {
        let scan = Scan {
            normals: normals.then(|| points.iter().map(|_| [0.0, 0.0, -1.0]).collect()),
            colors: colors.then(|| (0..points.len()).map(|i| [i as u8, 0, 255]).collect()),
            viewpoint: None,
            points,
            is_mesh: false,
        };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(format!("part.{suffix}"));
        io::write(&path, &scan).unwrap();
        let read = io::read(&path).unwrap();
        // NaN is equal to nothing: compare what is printed.
        prop_assert_eq!(format!("{read:?}"), format!("{scan:?}"));
    }
}
