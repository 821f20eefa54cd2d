//! Of the points around a cell the nearest to a query, chosen by their distances in single precision where that leaves no
//! doubt.

use super::block::{Block, SLACK};

/// A neighbour of a query.
#[derive(Clone, Copy)]
pub(super) struct Near {
    /// Index into the points.
    pub(super) index: u32,
    /// Where it lies from the query \[length\].
    pub(super) offset: [f64; 3],
}

impl Near {
    pub(super) fn new(index: u32, point: &[f64; 3], query: &[f64; 3]) -> Self {
        Self { index, offset: std::array::from_fn(|axis| point[axis] - query[axis]) }
    }

    /// Squared distance from the query [length squared].
    #[inline]
    pub(super) fn distance_sq(&self) -> f64 {
        let [x, y, z] = self.offset;
        x * x + y * y + z * z
    }
}

/// The points around a cell, and those of them that are the nearest to the last query.
pub(super) struct Selection {
    pub(super) block: Block,
    /// Neighbours of the last query.
    pub(super) found: Vec<Near>,
    /// Squared distances from the query, right to within [`SLACK`] [edges, squared].
    rough_sq: Vec<f32>,
    /// Places in the block of those that come into question.
    near: Vec<u32>,
    /// Those near as one number each: the bits of the rough square (not negative, so in order) above the place.
    keys: Vec<u64>,
    /// The same in double precision, with the index of the point between them, for those that are hardly apart.
    exact_keys: Vec<(u64, u32, u32)>,
}

impl Selection {
    pub(super) fn new(edge: f64) -> Self {
        Self {
            block: Block::new(edge),
            found: Vec::new(),
            rough_sq: Vec::new(),
            near: Vec::new(),
            keys: Vec::new(),
            exact_keys: Vec::new(),
        }
    }

    /// Looks how far the points are from `query`, roughly.
    pub(super) fn measure(&mut self, query: &[f64; 3]) {
        self.block.rough_distances_sq(query, &mut self.rough_sq);
        self.near.resize(self.rough_sq.len(), 0);
    }

    /// Finds the `k` nearest of these points to the `query` measured, if as many lie within a bound that is not beyond an
    /// edge; returns the squared distance to the farthest of them, or hardly more [length squared].
    pub(super) fn k_nearest(
        &mut self,
        query: &[f64; 3],
        k: usize,
        bound_sq: f64,
        nearest_first: bool,
    ) -> Option<f64> {
        let scale_sq = self.block.edge.recip().powi(2);
        let bound = (bound_sq * scale_sq) as f32;
        let count = self.come_within(bound + SLACK);
        if count < k {
            return None;
        }
        match self.select_roughly(k, count, nearest_first) {
            Some(farthest) if farthest <= bound - SLACK => {
                let block = &self.block;
                self.found.clear();
                self.found.extend(self.keys[..k].iter().map(|&key| block.found(key as u32, query)));
                Some(f64::from(farthest + SLACK) / scale_sq)
            }
            // All that are within the bound passed, and some that are just beyond.
            _ => Some(self.select_exactly(query, k, count, nearest_first)).filter(|sq| *sq <= bound_sq),
        }
    }

    /// Puts those that are roughly within a bound in front; their number.
    fn come_within(&mut self, bound: f32) -> usize {
        // Every place is written and only those that pass are kept: no branch to mispredict.
        let mut count = 0;
        for (place, &rough_sq) in (0..).zip(&self.rough_sq) {
            self.near[count] = place;
            count += usize::from(rough_sq <= bound);
        }
        count
    }

    /// Brings the keys of the `k` nearest of the first `count` to the front; the rough square of the farthest of them, or
    /// `None` where rounding may decide which they are, or their order where that is asked for.
    fn select_roughly(&mut self, k: usize, count: usize, nearest_first: bool) -> Option<f32> {
        let key = |&place: &u32| u64::from(self.rough_sq[place as usize].to_bits()) << 32 | u64::from(place);
        self.keys.clear();
        self.keys.extend(self.near[..count].iter().map(key));
        let keys = &mut self.keys[..];
        let rough_sq = |key: u64| f32::from_bits((key >> 32) as u32);
        let are_apart = |less: u64, more: u64| rough_sq(more) - rough_sq(less) > 2.0 * SLACK;
        if nearest_first {
            keys.sort_unstable();
            let ordered = keys.windows(2).take(k).all(|pair| are_apart(pair[0], pair[1]));
            return ordered.then(|| rough_sq(keys[k - 1]));
        }
        if count > k {
            keys.select_nth_unstable(k);
        }
        let farthest = keys[..k].iter().copied().fold(0, u64::max);
        keys.get(k).is_none_or(|next| are_apart(farthest, *next)).then(|| rough_sq(farthest))
    }

    /// Finds the `k` nearest of the first `count` by their exact distances, ties by index; the square of the largest.
    fn select_exactly(&mut self, query: &[f64; 3], k: usize, count: usize, nearest_first: bool) -> f64 {
        let block = &self.block;
        self.exact_keys.clear();
        self.exact_keys.extend(self.near[..count].iter().map(|&place| {
            let found = block.found(place, query);
            (found.distance_sq().to_bits(), found.index, place)
        }));
        if nearest_first {
            self.exact_keys.sort_unstable();
        } else {
            self.exact_keys.select_nth_unstable(k - 1);
        }
        self.found.clear();
        self.found.extend(self.exact_keys[..k].iter().map(|&(.., place)| block.found(place, query)));
        self.found.iter().map(Near::distance_sq).fold(0.0, f64::max)
    }
}
