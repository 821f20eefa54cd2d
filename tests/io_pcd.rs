//! PCD files: every encoding and type, the viewpoint, what is refused.
#![cfg(feature = "io")]
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test may panic")]

use proptest::prelude::*;
use sympose::Error;
use sympose::io::{self, Scan};

fn parse(content: &[u8]) -> Scan {
    io::parse(content, "part.pcd").unwrap()
}

fn reason(content: &[u8]) -> String {
    match io::parse(content, "part.pcd") {
        Err(Error::Format { reason, .. }) => reason,
        other => panic!("expected Error::Format, got {other:?}"),
    }
}

fn stored(kind: (&str, usize), value: i8) -> Vec<u8> {
    match kind {
        ("I", 1) => value.to_le_bytes().to_vec(),
        ("U", 1) => (value as u8).to_le_bytes().to_vec(),
        ("I", 2) => i16::from(value).to_le_bytes().to_vec(),
        ("U", 2) => (value as u16).to_le_bytes().to_vec(),
        ("I", 4) => i32::from(value).to_le_bytes().to_vec(),
        ("U", 4) => (value as u32).to_le_bytes().to_vec(),
        ("I", 8) => i64::from(value).to_le_bytes().to_vec(),
        ("U", 8) => (value as u64).to_le_bytes().to_vec(),
        ("F", 4) => f32::from(value).to_le_bytes().to_vec(),
        ("F", 8) => f64::from(value).to_le_bytes().to_vec(),
        other => panic!("{other:?}"),
    }
}

const KINDS: [(&str, usize); 10] =
    [("I", 1), ("U", 1), ("I", 2), ("U", 2), ("I", 4), ("U", 4), ("I", 8), ("U", 8), ("F", 4), ("F", 8)];

/// A greedy LZF compressor: back-references to the longest of the last matches, literals else.
fn compress(input: &[u8]) -> Vec<u8> {
    let mut output = Vec::new();
    let mut literals: Vec<u8> = Vec::new();
    let flush = |literals: &mut Vec<u8>, output: &mut Vec<u8>| {
        for run in literals.chunks(32) {
            output.push(run.len() as u8 - 1);
            output.extend(run);
        }
        literals.clear();
    };
    let mut at = 0;
    while at < input.len() {
        let longest = (at.saturating_sub(8192)..at)
            .map(|from| {
                let length =
                    (0..264.min(input.len() - at)).take_while(|i| input[from + i] == input[at + i]).count();
                (length, from)
            })
            .max();
        match longest {
            Some((length, from)) if length >= 3 => {
                flush(&mut literals, &mut output);
                let distance = at - from - 1;
                let short = length - 2;
                output.push(((short.min(7) << 5) | (distance >> 8)) as u8);
                if short >= 7 {
                    output.push((short - 7) as u8);
                }
                output.push(distance as u8);
                at += length;
            }
            _ => {
                literals.push(input[at]);
                at += 1;
            }
        }
    }
    flush(&mut literals, &mut output);
    output
}

proptest! {
    /// Any mix of types with a field of several numbers between, in all three encodings.
    #[test]
    fn reads_any_types_in_any_encoding(
        kinds in prop::array::uniform4(prop::sample::select(&KINDS[..])),
        count in 0_usize..4,
        rows in prop::collection::vec(prop::array::uniform3(0_i8..=127), 1..40),
        encoding in prop::sample::select(&["ascii", "binary", "binary_compressed"][..]),
    ) {
        let [x, extra, y, z] = kinds;
        let points = rows.len();
        let mut file = format!(
            "# .PCD v0.7\nVERSION 0.7\nFIELDS x histogram y z\nSIZE {} {} {} {}\nTYPE {} {} {} {}\nCOUNT 1 {count} 1 1\n\
             WIDTH {points}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {points}\nDATA {encoding}\n",
            x.1, extra.1, y.1, z.1, x.0, extra.0, y.0, z.0
        )
        .into_bytes();
        let row = |[a, b, c]: &[i8; 3]| [stored(x, *a), stored(extra, 7).repeat(count), stored(y, *b), stored(z, *c)];
        match encoding {
            "ascii" => rows.iter().for_each(|[x, y, z]| {
                file.extend(format!(" {x}\t{}{y}  {z}\r\n", "7 ".repeat(count)).into_bytes());
            }),
            "binary" => rows.iter().for_each(|r| file.extend(row(r).concat())),
            _ => {
                let columns: Vec<u8> =
                    (0..4).flat_map(|column| rows.iter().flat_map(move |r| row(r)[column].clone())).collect();
                let packed = compress(&columns);
                file.extend(u32::try_from(packed.len()).unwrap().to_le_bytes());
                file.extend(u32::try_from(columns.len()).unwrap().to_le_bytes());
                file.extend(packed);
            }
        }
        let expected: Vec<[f64; 3]> = rows.iter().map(|row| row.map(f64::from)).collect();
        prop_assert_eq!(parse(&file), Scan { points: expected, ..Scan::default() });
        if encoding != "ascii" {
            let found = reason(&file[..file.len() - 1]);
            prop_assert!(found.contains("truncated"), "{}", found);
        }
    }

    #[test]
    fn what_is_written_comes_back(
        points in prop::collection::vec(prop::array::uniform3(-1e9..1e9_f64), 1..30),
        normals in any::<bool>(),
        colors in any::<bool>(),
        single in any::<bool>(),
        viewpoint in prop::option::of(prop::array::uniform3(-9.0..9.0_f64)),
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
        let path = folder.path().join("part.pcd");
        io::write(&path, &scan).unwrap();
        prop_assert_eq!(io::read(&path).unwrap(), scan);
    }
}

#[test]
fn a_sensor_at_the_origin_survives_writing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("part.pcd");
    let mut scan = Scan { points: vec![[1.0, 2.0, 3.0]], viewpoint: Some([0.0; 3]), ..Scan::default() };
    io::write(&path, &scan).unwrap();
    assert_eq!(io::read(&path).unwrap(), scan);
    scan.viewpoint = None;
    io::write(&path, &scan).unwrap();
    assert_eq!(io::read(&path).unwrap(), scan);
}

const SMALL: &str = "VERSION .7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nWIDTH 2\nHEIGHT 1\n\
                     VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\nDATA ascii\n0.1 nan nan 66051\n1 2 3 4278190335\n";

#[test]
fn an_organised_cloud_has_its_sensor_at_the_origin() {
    let scan = parse(SMALL.as_bytes());
    assert_eq!(scan.points[0][0], f64::from(0.1_f32));
    assert!(scan.points[0][1].is_nan());
    assert_eq!(scan.colors, Some(vec![[1, 2, 3], [0, 0, 255]]));
    assert_eq!(scan.viewpoint, None);
    let organised = SMALL.replace("WIDTH 2\nHEIGHT 1", "WIDTH 1\nHEIGHT 2");
    assert_eq!(parse(organised.as_bytes()).viewpoint, Some([0.0; 3]));
    let moved = SMALL.replace("VIEWPOINT 0 0 0", "VIEWPOINT 0.5 -1 2e3");
    assert_eq!(parse(moved.as_bytes()).viewpoint, Some([0.5, -1.0, 2000.0]));
    let turned = SMALL.replace("1 0 0 0\nPOINTS", "0 1 0 0\nPOINTS");
    assert_eq!(parse(turned.as_bytes()).viewpoint, Some([0.0; 3]));
    let unknown = SMALL.replace("VIEWPOINT 0 0 0 1 0 0 0", "VIEWPOINT nan nan nan nan nan nan nan");
    assert_eq!(parse(unknown.as_bytes()).viewpoint, None);
    let silent = SMALL.replace("VIEWPOINT 0 0 0 1 0 0 0\n", "");
    assert_eq!(parse(silent.as_bytes()).viewpoint, None);
}

#[test]
fn damage_is_named() {
    for (from, to, expected) in [
        ("POINTS 2", "POINTS 3", "WIDTH 2 x HEIGHT 1, but POINTS 3"),
        ("WIDTH 2\nHEIGHT 1", "WIDTH 1\nHEIGHT 1", "WIDTH 1 x HEIGHT 1, but POINTS 2"),
        ("1 2 3 4278190335\n", "", "announces 2 points, the file holds 1"),
        ("1 2 3 4278190335\n", "1 2 3 4\n5 6 7 8\n", "announces 2 points, the file holds 3"),
        ("1 2 3 ", "1 2 ", "point 1: expected numbers for x, y, z, rgb, found \"1 2 4278190335\""),
        ("1 2 3 ", "1 2 3 4 ", "point 1: expected numbers"),
        ("1 2 3 ", "1 two 3 ", "point 1: expected numbers"),
        ("FIELDS x y z", "FIELDS x y w", "expected columns x y z, found x, y, w, rgb"),
        ("TYPE F F F U", "TYPE F F F", "4 FIELDS, 4 in SIZE, 3 in TYPE"),
        ("SIZE 4 4 4 4", "SIZE 4 4 2 4", "TYPE F SIZE 2"),
        ("DATA ascii", "DATA zipped", "DATA zipped: expected ascii, binary or binary_compressed"),
        ("HEIGHT 1\n", "", "no line HEIGHT"),
        ("VIEWPOINT 0 0 0", "VIEWPOINT 0 0", "VIEWPOINT 0 0 1 0 0 0: expected tx ty tz qw qx qy qz"),
        ("VIEWPOINT 0 0 0", "VIEWPOINT 0 here 0", "expected tx ty tz qw qx qy qz"),
        ("DATA ascii\n", "", "without a line DATA"),
    ] {
        assert!(SMALL.contains(from));
        let found = reason(SMALL.replacen(from, to, 1).as_bytes());
        assert!(found.contains(expected), "{to:?}: {found}");
    }
}

#[test]
fn absurd_counts_are_refused_at_once() {
    for encoding in ["ascii", "binary", "binary_compressed"] {
        for (count, points) in
            [("1", usize::MAX), ("1", 3_000_000_000), ("99999999999999999", 2), ("0", usize::MAX)]
        {
            let mut file = format!(
                "FIELDS x y z k\nSIZE 4 4 4 8\nTYPE F F F F\nCOUNT 1 1 1 {count}\nWIDTH {points}\nHEIGHT 1\n\
                 POINTS {points}\nDATA {encoding}\n"
            )
            .into_bytes();
            file.extend([255; 40]);
            reason(&file);
        }
    }
    // The compressed data may not claim more than it can hold either.
    let points = 100_000_000_u32;
    let header = format!(
        "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH {points}\nHEIGHT 1\nPOINTS {points}\nDATA binary_compressed\n"
    );
    let mut file = header.into_bytes();
    file.extend(10_u32.to_le_bytes());
    file.extend((12 * points).to_le_bytes());
    file.extend([0; 10]);
    assert_eq!(reason(&file), "the compressed data is damaged");
}
