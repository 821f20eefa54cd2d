//! LZF, the compression of `binary_compressed` PCD files.

/// Expands `input` to exactly `size` bytes; `None` when it is damaged or of another size.
///
/// A token is a control byte c: below 32 it announces c + 1 literal bytes; else its three upper bits (7: plus the next
/// byte) are a length less 2, and its five lower bits with one more byte a distance back into the output, less 1.
pub(super) fn expand(input: &[u8], size: usize) -> Option<Vec<u8>> {
    // Three bytes give at most 264, so a lying size cannot make this allocate without limit.
    if size / 264 > input.len() {
        return None;
    }
    let mut output = Vec::with_capacity(size);
    let mut rest = input;
    while let Some((control, after)) = rest.split_first() {
        let control = usize::from(*control);
        rest = after;
        if control < 32 {
            let (literal, after) = rest.split_at_checked(control + 1)?;
            output.extend_from_slice(literal);
            rest = after;
        } else {
            let mut length = (control >> 5) + 2;
            if length == 9 {
                let (more, after) = rest.split_first()?;
                length += usize::from(*more);
                rest = after;
            }
            let (low, after) = rest.split_first()?;
            rest = after;
            let distance = (((control & 31) << 8) | usize::from(*low)) + 1;
            let start = output.len().checked_sub(distance)?;
            // Source and target may overlap: a distance of 1 repeats the last byte.
            for at in start..start + length {
                output.push(output[at]);
            }
        }
        if output.len() > size {
            return None;
        }
    }
    (output.len() == size).then_some(output)
}
