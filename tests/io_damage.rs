//! No bytes make a reader panic, hang, or claim more points than the file can hold.
#![cfg(feature = "io")]
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test may panic")]

use proptest::prelude::*;
use sympose::Error;
use sympose::io::{self, Scan};

/// One whole file of each format, with normals, colours, a viewpoint and lists.
fn files() -> Vec<(&'static str, Vec<u8>)> {
    let points: Vec<[f64; 3]> = (0..40).map(|i| [f64::from(i), f64::from(i * i), 0.5]).collect();
    let scan = Scan {
        normals: Some(vec![[0.0, 0.6, 0.8]; points.len()]),
        colors: Some(vec![[1, 2, 3]; points.len()]),
        viewpoint: Some([1.0, 2.0, 3.0]),
        points,
        is_mesh: false,
    };
    let folder = tempfile::tempdir().unwrap();
    let mut files = Vec::new();
    for name in ["part.ply", "part.pcd", "part.xyz", "part.csv"] {
        let path = folder.path().join(name);
        io::write(&path, &scan).unwrap();
        files.push((name, std::fs::read(path).unwrap()));
    }
    let faces = "element face 2\nproperty list uchar int vertex_indices\nelement vertex 2\nproperty float x\n\
                 property double y\nproperty short z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n\
                 end_header\n";
    let text = "3 0 1 1\n0\n1.5 2 3 4 5 6\n1 2 3 4 5 6\n";
    files.push(("part.ply", format!("ply\nformat ascii 1.0\n{faces}{text}").into_bytes()));
    let mut binary = format!("ply\nformat binary_big_endian 1.0\n{faces}").into_bytes();
    binary.extend([1, 0, 0, 0, 9, 0]);
    binary.extend([63; 34]);
    files.push(("part.ply", binary));
    let header = "VERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\nWIDTH 2\nHEIGHT 2\n\
                  VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 4\nDATA ";
    files.push(("part.pcd", format!("{header}ascii\n{}", "1 2 3 4.2e-40\n".repeat(4)).into_bytes()));
    let mut compressed = format!("{header}binary_compressed\n").into_bytes();
    compressed.extend(9_u32.to_le_bytes());
    compressed.extend(64_u32.to_le_bytes());
    compressed.extend([2, 63, 64, 65, 0b1110_0000, 51, 2, 0, 9]);
    files.push(("part.pcd", compressed));
    for (name, file) in &files {
        assert!(io::parse(file, name).is_ok(), "{name}: {:?}", io::parse(file, name));
    }
    files
}

fn check(content: &[u8], name: &str) -> Result<(), TestCaseError> {
    match io::parse(content, name) {
        Ok(scan) => {
            prop_assert!((1..=content.len()).contains(&scan.points.len()));
            for rows in [scan.normals.map(|n| n.len()), scan.colors.map(|c| c.len())] {
                prop_assert!(rows.is_none_or(|rows| rows == scan.points.len()));
            }
        }
        Err(Error::Format { reason, .. }) => prop_assert!(!reason.is_empty() && reason.len() < 2000),
        Err(other) => prop_assert!(false, "{other:?}"),
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1500))]

    #[test]
    fn mutated_files(
        file in prop::sample::select(files()),
        edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>(), 0_u8..5), 1..12),
    ) {
        let (name, mut content) = file;
        for (index, byte, kind) in edits {
            if content.is_empty() {
                break;
            }
            let at = index.index(content.len());
            match kind {
                0 => content[at] = byte,
                1 => content[at] ^= 1 << (byte % 8),
                2 => content.insert(at, byte),
                3 => content.truncate(content.len() - at.min(usize::from(byte))),
                _ => {
                    let end = content.len().min(at + usize::from(byte));
                    content.drain(at..end);
                }
            }
        }
        check(&content, name)?;
    }

    /// Numbers of the header replaced by extreme ones, where most of the danger lies.
    #[test]
    fn mutated_numbers(
        file in prop::sample::select(files()),
        index in any::<prop::sample::Index>(),
        number in prop::sample::select(
            &["0", "-1", "1", "7", "255", "65536", "4294967296", "18446744073709551615", "1e300", "nan", "inf", ""][..]
        ),
    ) {
        let (name, content) = file;
        let digits: Vec<usize> = (0..content.len()).filter(|i| content[*i].is_ascii_digit()).collect();
        let start = digits[index.index(digits.len())];
        let end = (start..content.len()).find(|i| !content[*i].is_ascii_digit()).unwrap_or(content.len());
        let mutated = [&content[..start], number.as_bytes(), &content[end..]].concat();
        check(&mutated, name)?;
    }

    #[test]
    fn random_bytes(content in prop::collection::vec(any::<u8>(), 1..300), name in "part(\\.(ply|pcd|xyz|csv))?") {
        check(&content, &name)?;
    }
}
