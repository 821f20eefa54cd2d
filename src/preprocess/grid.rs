//! The occupied cells of a uniform grid, numbered in Morton order without sorting.
//!
//! The three indices of a cell are interleaved to one Morton key. The keys that occur are marked in a bitmap, and the
//! number of a cell is its rank among the marked bits: the order of the keys, although nothing is sorted. When the
//! key space is too large for one bitmap, the leading bits are replaced by their rank and the next bits follow, so
//! that every bitmap stays at a few bytes a point.

use rayon::prelude::*;

use super::{CHUNK, finite_bounds};
use crate::error::{Error, Result, shown};
use crate::validate::positive;

/// Bits of a cell index along one axis: three of them fit a 64-bit key.
const AXIS_BITS: u32 = 21;

/// Memory of the bitmaps of all threads that mark cells, at most, unless one alone takes more \[bytes a point\].
const MARKING: usize = 16;

/// An edge with which a grid over these points is sure to be possible \[length\].
pub(crate) fn sure_cell(points: &[[f64; 3]]) -> Result<f64> {
    let [lower, upper] = finite_bounds(points)?;
    let extent = (0..3).map(|axis| upper[axis] - lower[axis]).fold(0.0, f64::max);
    Ok((2.0 * extent / f64::from(1 << AXIS_BITS)).max(f64::MIN_POSITIVE))
}

/// A grid over the bounding box of a cloud, its origin the lower corner of the box minus half a cell.
pub(crate) struct Grid {
    origin: [f64; 3],
    size: f64,
    cells_per_axis: [i64; 3],
    interleave: Interleave,
    levels: Vec<Level>,
    /// Number of occupied cells.
    pub(crate) len: usize,
    /// For each point its cell; cells are numbered in Morton order.
    pub(crate) cell_of: Vec<u32>,
}

impl Grid {
    /// Assigns every point to its cell; `name` is the parameter that `size` came from.
    pub(crate) fn new(points: &[[f64; 3]], size: f64, name: &'static str) -> Result<Self> {
        positive(name, size)?;
        let [lower, upper] = finite_bounds(points)?;
        let origin: [f64; 3] = std::array::from_fn(|axis| lower[axis] - 0.5 * size);
        let extent = (0..3).map(|axis| upper[axis] - origin[axis]).fold(0.0, f64::max);
        let most = f64::from(1 << AXIS_BITS);
        // (An extent that overflows to infinity is refused as well.)
        if extent / size >= most {
            return Err(Error::InvalidParameter {
                name,
                value: format!(
                    "{} (a cloud of extent {} needs at least {})",
                    shown(size),
                    shown(extent),
                    shown(1.000_001 * extent / most)
                ),
                expected: "fewer than 2^21 cells along each axis; enlarge it, or remove far outliers first",
            });
        }
        let cells_per_axis = std::array::from_fn(|axis| ((upper[axis] - origin[axis]) / size) as i64 + 1);
        let interleave = Interleave::new(cells_per_axis);
        let mut grid = Self {
            origin,
            size,
            cells_per_axis,
            interleave,
            levels: Vec::new(),
            len: usize::from(!points.is_empty()),
            cell_of: vec![0; points.len()],
        };
        grid.number(points);
        Ok(grid)
    }

    /// Indices of the cell of a position; outside the grid's box, of a cell outside it or at its edge.
    pub(crate) fn indices(&self, point: &[f64; 3]) -> [i64; 3] {
        // The origin lies below every point, so truncation is the floor.
        std::array::from_fn(|axis| ((point[axis] - self.origin[axis]) / self.size) as i64)
    }

    /// Morton key of a cell, of the nearest one in the box for one that is outside.
    pub(crate) fn key(&self, indices: [i64; 3]) -> u64 {
        self.interleave.key(std::array::from_fn(|axis| indices[axis].clamp(0, self.cells_per_axis[axis] - 1)))
    }

    /// Number of the cell with these indices, if it is occupied.
    pub(crate) fn find(&self, indices: [i64; 3]) -> Option<u32> {
        if (0..3).any(|axis| !self.holds(axis, indices[axis])) {
            return None;
        }
        self.find_key(self.interleave.key(indices))
    }

    /// Numbers of the occupied ones of the 27 cells around one, itself first, then by how many of its axes they lie
    /// beside it.
    pub(crate) fn around(&self, cell: [i64; 3]) -> impl Iterator<Item = u32> {
        // What an index adds to a key is needed nine times.
        let parts: [[Option<u64>; 3]; 3] = std::array::from_fn(|axis| {
            [-1, 0, 1].map(|step| {
                let index = cell[axis].saturating_add(step);
                self.holds(axis, index).then(|| self.interleave.part(axis, index))
            })
        });
        let key = move |[x, y, z]: &[usize; 3]| Some(parts[0][*x]? | parts[1][*y]? | parts[2][*z]?);
        AROUND.iter().filter_map(move |steps| self.find_key(key(steps)?))
    }

    /// Whether the grid has cells with this index along an axis.
    fn holds(&self, axis: usize, index: i64) -> bool {
        (0..self.cells_per_axis[axis]).contains(&index)
    }

    fn find_key(&self, key: u64) -> Option<u32> {
        self.levels.iter().try_fold(0, |rank, level| level.find(level.code(rank, key)))
    }

    fn number(&mut self, points: &[[f64; 3]]) {
        // One bit of the bitmap costs an eighth of a byte: 5 bits beyond log2(N) are 4 bytes a point.
        let width = (bit_length(points.len() as u64) + 5).clamp(12, 32);
        let mut cell_of = std::mem::take(&mut self.cell_of);
        let mut left = self.interleave.bits;
        while left > 0 && self.len > 0 {
            let known = bit_length(self.len as u64 - 1);
            let bits = left.min(width - known);
            left -= bits;
            let mut level = Level::new(bits, left, self.len);
            // A bitmap for each thread: were one shared, its cache lines would travel at every mark. Few threads suffice, memory is
            // what they wait for.
            let affordable = MARKING * points.len() / level.bytes();
            let shares = rayon::current_num_threads().min(affordable).max(1);
            let share = points.len().div_ceil(shares).max(CHUNK);
            let bitmaps =
                cell_of.par_chunks_mut(share).zip(points.par_chunks(share)).map(|(cells, points)| {
                    let mut marks = level.marks();
                    for (cell, point) in cells.iter_mut().zip(points) {
                        // A code has at most `width` bits, so that it fits where the number of the cell will be.
                        let code = level.code(*cell, self.interleave.key(self.indices(point)));
                        marks[code >> 6] |= 1 << (code & 63);
                        *cell = code as u32;
                    }
                    marks
                });
            level.count(&bitmaps.collect::<Vec<_>>());
            self.len = level.marked();
            cell_of.par_iter_mut().with_min_len(CHUNK).for_each(|cell| *cell = level.rank(*cell as usize));
            self.levels.push(level);
        }
        self.cell_of = cell_of;
    }
}

/// Points of each cell in ascending order: those of cell `c` are `points[offsets[c]..offsets[c + 1]]`.
pub(crate) fn members(cell_of: &[u32], cells: usize) -> (Vec<u32>, Vec<u32>) {
    let mut starts = vec![0_u32; cells + 1];
    for &cell in cell_of {
        starts[cell as usize + 1] += 1;
    }
    for cell in 0..cells {
        starts[cell + 1] += starts[cell];
    }
    let mut next = starts.clone();
    let mut points = vec![0; cell_of.len()];
    for (point, &cell) in (0_u32..).zip(cell_of) {
        let slot = &mut next[cell as usize];
        points[*slot as usize] = point;
        *slot += 1;
    }
    (starts, points)
}

/// The 27 steps to a neighbouring cell, each plus one.
const AROUND: [[usize; 3]; 27] = {
    let mut steps = [[0; 3]; 27];
    let mut count = 0;
    let mut beside = 0;
    while beside <= 3 {
        let mut i = 0;
        while i < 27 {
            let step = [i / 9, i / 3 % 3, i % 3];
            if (step[0] != 1) as usize + (step[1] != 1) as usize + (step[2] != 1) as usize == beside {
                steps[count] = step;
                count += 1;
            }
            i += 1;
        }
        beside += 1;
    }
    steps
};

/// Number of bits needed to write `value`.
fn bit_length(value: u64) -> u32 {
    u64::BITS - value.leading_zeros()
}

/// Interleaves the bits of three indices, lowest first, leaving out bits that no index of the grid uses.
struct Interleave {
    /// Bits of a key.
    bits: u32,
    /// For each axis and each byte of its index, the byte spread over the key.
    tables: Vec<[[u64; 256]; 3]>,
}

impl Interleave {
    fn new(cells_per_axis: [i64; 3]) -> Self {
        let lengths = cells_per_axis.map(|n| bit_length(n.max(1) as u64 - 1));
        let mut position = [[0; AXIS_BITS as usize]; 3];
        let mut bits = 0;
        for bit in 0..AXIS_BITS {
            for axis in 0..3 {
                if bit < lengths[axis] {
                    position[axis][bit as usize] = bits;
                    bits += 1;
                }
            }
        }
        let bytes = lengths.iter().max().map_or(0, |&most| most.div_ceil(8));
        let spread = |axis: usize, byte: u32, value: usize| {
            let used =
                (8 * byte..lengths[axis].min(8 * byte + 8)).filter(|bit| value >> (bit - 8 * byte) & 1 == 1);
            used.map(|bit| 1_u64 << position[axis][bit as usize]).sum()
        };
        let table = |byte| std::array::from_fn(|axis| std::array::from_fn(|value| spread(axis, byte, value)));
        Self { bits, tables: (0..bytes).map(table).collect() }
    }

    fn key(&self, indices: [i64; 3]) -> u64 {
        self.part(0, indices[0]) | self.part(1, indices[1]) | self.part(2, indices[2])
    }

    /// What the index along one axis adds to a key.
    fn part(&self, axis: usize, index: i64) -> u64 {
        let bytes = self.tables.iter().enumerate();
        bytes.fold(0, |part, (byte, table)| part | table[axis][(index >> (8 * byte)) as usize & 0xff])
    }
}

/// One bitmap of the hierarchy: it refines the cells found so far by the next `bits` bits of the key.
struct Level {
    bits: u32,
    shift: u32,
    /// Cells found so far.
    coarse: usize,
    words: Vec<Word>,
}

/// 64 marks, and the number of marks in all words before.
#[derive(Clone, Copy)]
struct Word {
    marks: u64,
    before: u32,
}

impl Level {
    fn new(bits: u32, shift: u32, coarse: usize) -> Self {
        Self { bits, shift, coarse, words: Vec::new() }
    }

    /// A bitmap for the codes of this level, without marks.
    fn marks(&self) -> Vec<u64> {
        vec![0; (self.coarse << self.bits).div_ceil(64)]
    }

    /// Size of a bitmap \[bytes\].
    fn bytes(&self) -> usize {
        (self.coarse << self.bits).div_ceil(8)
    }

    /// Takes what is marked in any of the bitmaps.
    fn count(&mut self, bitmaps: &[Vec<u64>]) {
        let mut before = 0;
        let word = |index| {
            let marks = bitmaps.iter().fold(0, |all, bitmap| all | bitmap[index]);
            let word = Word { marks, before };
            before += marks.count_ones();
            word
        };
        self.words = (0..bitmaps.first().map_or(0, Vec::len)).map(word).collect();
    }

    fn marked(&self) -> usize {
        self.words.last().map_or(0, |word| word.before as usize + word.marks.count_ones() as usize)
    }

    fn code(&self, coarse: u32, key: u64) -> usize {
        let mask = (1_u64 << self.bits) - 1;
        (coarse as usize) << self.bits | (key >> self.shift & mask) as usize
    }

    /// Rank of a marked code.
    fn rank(&self, code: usize) -> u32 {
        let word = self.words[code >> 6];
        word.before + (word.marks & ((1 << (code & 63)) - 1)).count_ones()
    }

    fn find(&self, code: usize) -> Option<u32> {
        let word = self.words[code >> 6];
        (word.marks >> (code & 63) & 1 == 1).then(|| self.rank(code))
    }
}
