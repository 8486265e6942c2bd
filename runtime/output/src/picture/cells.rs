//! A lattice body as deformed cells.
//!
//! Every point of a lattice stands for a cell of the spacing's size. The cell's corners move with
//! the mean of what the points around them say (their displacement and their displacement
//! gradient from differences along the axes), so that neighbouring cells share their corners and
//! the body looks like the solid it is. Large bodies are drawn in blocks of `k^d` points.

use std::collections::{HashMap, HashSet};

use super::motion::Motion;

/// Place of a cell on the lattice of blocks; the third is 0 in two dimensions.
type Key = [i64; 3];

/// The cells of a body.
pub(super) struct Cells {
    dimension: usize,
    /// Points per block along each axis.
    pub(super) block: usize,
    /// Edge of a block in the reference, in m.
    pub(super) size: f64,
    origin: [f64; 3],
    pub(super) cells: Vec<Cell>,
    index: HashMap<Key, usize>,
}

/// One cell: the mean over the points of its block.
pub(super) struct Cell {
    key: Key,
    reference: [f64; 3],
    current: [f64; 3],
    /// Columns of the deformation gradient.
    gradient: [[f64; 3]; 3],
    /// What its colour shows.
    pub(super) value: f64,
    /// Bit `s` tells whether a point of set `s` is in the block.
    pub(super) sets: u32,
    /// Whether all points of the block are held.
    held: bool,
}

/// A face of a cell with nothing before it, or a whole cell in two dimensions.
pub(super) struct Facet {
    /// Which cell.
    pub(super) cell: usize,
    /// Current positions of the corners, in m, around the face.
    pub(super) corners: [[f64; 3]; 4],
    /// Outward along this axis; `None` in two dimensions.
    pub(super) outward: Option<[f64; 3]>,
}

/// An edge of a cell in two dimensions, with what is beyond it.
pub(super) struct Edge {
    pub(super) cell: usize,
    pub(super) beyond: Option<usize>,
    /// Ends in the reference, in m.
    pub(super) reference: [[f64; 3]; 2],
    /// Ends in the current configuration, in m.
    pub(super) current: [[f64; 3]; 2],
}

impl Cells {
    /// Cells of a lattice of this spacing, coarse enough for at most `most` facets.
    pub(super) fn new(motion: &Motion, spacing: f64, most: usize) -> Cells {
        let d = motion.points.dimension as f64;
        let mut block = 1;
        loop {
            let there = Occupied::new(motion, spacing, block);
            // About half of the faces point away from the viewer.
            let facets = if d == 2.0 { there.n_places } else { there.n_exposed() / 2 };
            if facets <= most {
                let mut cells = Cells::of_blocks(motion, spacing, block);
                cells.find_gradients();
                return cells;
            }
            let ratio = facets as f64 / most as f64;
            block = (block as f64 * ratio.sqrt().min(libm::pow(ratio, 1.0 / (d - 1.0))))
                .ceil()
                .max(block as f64 + 1.0) as usize;
        }
    }

    fn of_blocks(motion: &Motion, spacing: f64, block: usize) -> Cells {
        let blocks = Blocks::new(motion, spacing, block);
        let mut cells: Vec<Cell> = Vec::new();
        let mut counts: Vec<f64> = Vec::new();
        let mut index: HashMap<Key, usize> = HashMap::new();
        for point in motion.finite_points() {
            let (reference, current) = (motion.reference(point), motion.current(point));
            let key = blocks.key(reference);
            let place = *index.entry(key).or_insert_with(|| {
                cells.push(Cell::empty(key));
                counts.push(0.0);
                cells.len() - 1
            });
            let cell = &mut cells[place];
            counts[place] += 1.0;
            for axis in 0..3 {
                cell.reference[axis] += reference[axis];
                cell.current[axis] += current[axis];
            }
            cell.value += motion.value(point);
            cell.sets |= motion.sets_of(point);
            cell.held &= motion.is_held(point);
        }
        for (cell, count) in cells.iter_mut().zip(counts) {
            cell.reference = cell.reference.map(|x| x / count);
            cell.current = cell.current.map(|x| x / count);
            cell.value /= count;
        }
        let Blocks { dimension, size, origin } = blocks;
        Cells { dimension, block, size, origin, cells, index }
    }

    /// Deformation gradients from differences between neighbouring cells; what is held moves as it is held, and
    /// says nothing of what is beside it.
    fn find_gradients(&mut self) {
        for place in 0..self.cells.len() {
            let held = self.cells[place].held;
            let mut columns = [0, 1, 2].map(|axis| self.column(place, axis, held));
            if held {
                self.complete(place, &mut columns);
            }
            for (axis, column) in columns.into_iter().enumerate() {
                if let Some(column) = column {
                    self.cells[place].gradient[axis] = column;
                }
            }
        }
    }

    /// A column of the deformation gradient at a cell, by its neighbours along an axis, or those that are held.
    fn column(&self, place: usize, axis: usize, of_held: bool) -> Option<[f64; 3]> {
        let beside = |step| {
            let other = self.neighbor(place, axis, step)?;
            (!of_held || self.cells[other].held).then_some(other)
        };
        let (before, after) = (beside(-1).unwrap_or(place), beside(1).unwrap_or(place));
        let (p, q) = (&self.cells[before], &self.cells[after]);
        let distance = q.reference[axis] - p.reference[axis];
        let is_known = before != after && distance > 0.0;
        is_known.then(|| difference(q.current, p.current).map(|x| x / distance))
    }

    /// Across a layer that is held and one cell thick nothing says how it turned: its normal turns with it.
    fn complete(&self, place: usize, columns: &mut [Option<[f64; 3]>; 3]) {
        let missing: Vec<usize> =
            (0..self.dimension).filter(|axis| columns[*axis].is_none()).collect();
        let [axis] = missing[..] else {
            missing.into_iter().for_each(|axis| columns[axis] = self.column(place, axis, false));
            return;
        };
        let [one, other] = [(axis + 1) % 3, (axis + 2) % 3].map(|axis| {
            let mut at_rest = [0.0; 3];
            at_rest[axis] = 1.0;
            columns[axis].unwrap_or(at_rest)
        });
        let normal = cross(one, other);
        let length = normal.iter().fold(0.0, |sum, x| sum + x * x).sqrt();
        if length > 0.0 {
            columns[axis] = Some(normal.map(|x| x / length));
        }
    }

    fn neighbor(&self, place: usize, axis: usize, step: i64) -> Option<usize> {
        let mut key = self.cells[place].key;
        key[axis] += step;
        self.index.get(&key).copied()
    }

    /// Everything to fill: whole cells in two dimensions, exposed faces in three.
    pub(super) fn facets(&self) -> Vec<Facet> {
        if self.dimension == 2 {
            let whole = |cell: usize| {
                let corner = |i, j| self.corner(cell, [i, j, 0]);
                let corners = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
                Facet { cell, corners, outward: None }
            };
            return (0..self.cells.len()).map(whole).collect();
        }
        self.exposed().map(|(cell, axis, side)| self.face(cell, axis, side)).collect()
    }

    /// Cells, axes and sides (0 or 1) without a neighbour.
    fn exposed(&self) -> impl Iterator<Item = (usize, usize, i64)> + '_ {
        let sides = |cell| (0..3).flat_map(move |axis| [(cell, axis, 0), (cell, axis, 1)]);
        (0..self.cells.len())
            .flat_map(sides)
            .filter(|&(cell, axis, side)| self.neighbor(cell, axis, 2 * side - 1).is_none())
    }

    fn face(&self, cell: usize, axis: usize, side: i64) -> Facet {
        let corner = |i: i64, j: i64| {
            let mut at = [0; 3];
            at[axis] = side;
            at[(axis + 1) % 3] = i;
            at[(axis + 2) % 3] = j;
            self.corner(cell, at)
        };
        let corners = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
        let normal = cross(difference(corners[2], corners[0]), difference(corners[3], corners[1]));
        let sign = (2 * side - 1) as f64;
        Facet { cell, corners, outward: Some(normal.map(|x| sign * x)) }
    }

    /// The edges of all cells in two dimensions.
    pub(super) fn edges(&self) -> Vec<Edge> {
        const SIDES: [(usize, i64, [[i64; 2]; 2]); 4] = [
            (0, -1, [[0, 0], [0, 1]]),
            (0, 1, [[1, 0], [1, 1]]),
            (1, -1, [[0, 0], [1, 0]]),
            (1, 1, [[0, 1], [1, 1]]),
        ];
        let edge = |cell: usize, (axis, step, ends): (usize, i64, [[i64; 2]; 2])| Edge {
            cell,
            beyond: self.neighbor(cell, axis, step),
            reference: ends.map(|[i, j]| self.reference_corner(cell, [i, j, 0])),
            current: ends.map(|[i, j]| self.corner(cell, [i, j, 0])),
        };
        let edges_of = |cell| SIDES.map(|side| edge(cell, side));
        (0..self.cells.len()).flat_map(edges_of).collect()
    }

    fn reference_corner(&self, cell: usize, at: [i64; 3]) -> [f64; 3] {
        let mut corner = [0.0; 3];
        for axis in 0..self.dimension {
            let steps = (self.cells[cell].key[axis] + at[axis]) as f64;
            corner[axis] = self.origin[axis] + steps * self.size;
        }
        corner
    }

    /// Current position of a corner: the mean of what the cells around it say, where some of them are held of
    /// what these say.
    fn corner(&self, cell: usize, at: [i64; 3]) -> [f64; 3] {
        let reference = self.reference_corner(cell, at);
        let mut around = Vec::with_capacity(8);
        let depth = if self.dimension == 3 { 2 } else { 1 };
        for (i, j, k) in (0..2)
            .flat_map(|i| (0..2).map(move |j| (i, j)))
            .flat_map(|(i, j)| (0..depth).map(move |k| (i, j, k)))
        {
            let mut key = self.cells[cell].key;
            for (axis, back) in [i, j, k].into_iter().enumerate().take(self.dimension) {
                key[axis] += at[axis] - back;
            }
            around.extend(self.index.get(&key).map(|&place| &self.cells[place]));
        }
        if around.iter().any(|cell| cell.held) {
            around.retain(|cell| cell.held);
        }
        let moved = around.iter().map(|cell| cell.carried(reference));
        let sum = moved.fold([0.0; 3], |sum, at| [0, 1, 2].map(|axis| sum[axis] + at[axis]));
        sum.map(|x| x / around.len() as f64)
    }
}

/// Where blocks are.
struct Blocks {
    dimension: usize,
    /// Edge of a block, in m.
    size: f64,
    origin: [f64; 3],
}

impl Blocks {
    fn new(motion: &Motion, spacing: f64, block: usize) -> Blocks {
        let (dimension, size) = (motion.points.dimension, spacing * block as f64);
        // Cells begin half a spacing before the first point.
        let origin = motion.reference_bounds().0.map(|x| x - 0.5 * spacing);
        Blocks { dimension, size, origin }
    }

    fn key(&self, reference: [f64; 3]) -> Key {
        let mut key = [0; 3];
        for axis in 0..self.dimension {
            key[axis] = ((reference[axis] - self.origin[axis]) / self.size).floor() as i64;
        }
        key
    }
}

/// Which blocks of a lattice have points: a bit each, so that a size can be tried on a large body.
struct Occupied {
    places: HashSet<Key>,
    /// In place of these, of boxes that are not nearly empty; the last axis fastest.
    bits: Vec<u64>,
    counts: [i64; 3],
    n_places: usize,
}

/// Most bits for each point.
const SPARSE: usize = 64;

impl Occupied {
    fn new(motion: &Motion, spacing: f64, block: usize) -> Occupied {
        let blocks = Blocks::new(motion, spacing, block);
        let counts = blocks.key(motion.reference_bounds().1).map(|last| last.saturating_add(1));
        let all = counts.iter().try_fold(1i64, |all, count| all.checked_mul(*count));
        let most = SPARSE * motion.points.n_points().max(1);
        let n_bits = all.and_then(|all| usize::try_from(all).ok()).filter(|all| *all <= most);
        let bits = vec![0; n_bits.map_or(0, |n| n.div_ceil(64))];
        let mut there = Occupied { places: HashSet::new(), bits, counts, n_places: 0 };
        for point in motion.finite_points() {
            there.put(blocks.key(motion.reference(point)));
        }
        there
    }

    fn put(&mut self, key: Key) {
        let is_new = match self.bit(key) {
            Some((word, bit)) => {
                let is_new = self.bits[word] & bit == 0;
                self.bits[word] |= bit;
                is_new
            }
            None => self.places.insert(key),
        };
        self.n_places += usize::from(is_new);
    }

    fn has(&self, key: Key) -> bool {
        match self.bit(key) {
            Some((word, bit)) => self.bits[word] & bit != 0,
            None => self.places.contains(&key),
        }
    }

    fn bit(&self, [x, y, z]: Key) -> Option<(usize, u64)> {
        let [a, b, c] = self.counts;
        let is_inside = !self.bits.is_empty()
            && (0..a).contains(&x)
            && (0..b).contains(&y)
            && (0..c).contains(&z);
        let place = || ((x * b + y) * c + z) as usize;
        is_inside.then(place).map(|place| (place / 64, 1 << (place % 64)))
    }

    /// How many faces of blocks have nothing before them.
    fn n_exposed(&self) -> usize {
        let of = |key: Key| {
            let sides = (0..3).flat_map(|axis| [(axis, -1), (axis, 1)]);
            let is_free = |(axis, step): &(usize, i64)| {
                let mut beside = key;
                beside[*axis] += step;
                !self.has(beside)
            };
            sides.filter(is_free).count()
        };
        let [_, b, c] = self.counts;
        let place = |word: usize, bit: u32| {
            let place = (64 * word) as i64 + i64::from(bit);
            [place / (b * c), place / c % b, place % c]
        };
        let of_bits = self.bits.iter().enumerate().flat_map(|(word, bits)| {
            (0..64).filter(move |bit| bits >> bit & 1 == 1).map(move |bit| of(place(word, bit)))
        });
        of_bits.chain(self.places.iter().map(|key| of(*key))).sum()
    }
}

impl Cell {
    fn empty(key: Key) -> Cell {
        let gradient = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let (reference, current) = ([0.0; 3], [0.0; 3]);
        Cell { key, reference, current, gradient, value: 0.0, sets: 0, held: true }
    }

    /// Where this cell's motion carries a reference position nearby.
    fn carried(&self, reference: [f64; 3]) -> [f64; 3] {
        let offset = difference(reference, self.reference);
        let mut at = self.current;
        for axis in 0..3 {
            for component in 0..3 {
                at[component] += self.gradient[axis][component] * offset[axis];
            }
        }
        at
    }
}

pub(super) fn difference(p: [f64; 3], q: [f64; 3]) -> [f64; 3] {
    [p[0] - q[0], p[1] - q[1], p[2] - q[2]]
}

pub(super) fn cross(p: [f64; 3], q: [f64; 3]) -> [f64; 3] {
    [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]]
}
