//! A lattice of nonlinear springs, one face held and the opposite one pulled; knows nothing of ranks but
//! which points it has.

use std::ops::Range;

/// Numbers a point.
pub(crate) const D: usize = 3;

/// A block of points `nx x ny x nz` at spacing 1; the points of a part, and those behind them that it sees.
pub(crate) struct Springs {
    /// Points in each direction.
    pub(crate) size: [usize; 3],
    /// The owned points.
    pub(crate) own: Range<usize>,
    /// Points of others that bonds of owned points reach, ascending.
    #[allow(dead_code)] // The serial solution has none.
    pub(crate) ghosts: Vec<u64>,
    /// Where the columns of each owned point begin; and all of them, ascending, with its own.
    pub(crate) starts: Vec<usize>,
    pub(crate) columns: Vec<u64>,
    /// The columns by their place in local arrays.
    pub(crate) places: Vec<usize>,
    /// How far the pulled face goes in x.
    pub(crate) pull: f64,
}

impl Springs {
    pub(crate) fn new(size: [usize; 3], horizon: f64, own: Range<usize>, pull: f64) -> Springs {
        let mut starts = vec![0];
        let mut columns = Vec::new();
        let reach = horizon as i64;
        for point in own.clone() {
            let at = position(size, point).map(|x| x as i64);
            for x in at[0] - reach..=at[0] + reach {
                for y in at[1] - reach..=at[1] + reach {
                    for z in at[2] - reach..=at[2] + reach {
                        let to = [x, y, z];
                        let inside = (0..3).all(|a| (0..size[a] as i64).contains(&to[a]));
                        let squared: i64 = (0..3).map(|a| (to[a] - at[a]) * (to[a] - at[a])).sum();
                        if inside && squared as f64 <= horizon * horizon {
                            columns.push(((x * size[1] as i64 + y) * size[2] as i64 + z) as u64);
                        }
                    }
                }
            }
            starts.push(columns.len());
        }
        let foreign = columns.iter().filter(|&&c| !own.contains(&(c as usize)));
        let mut ghosts: Vec<u64> = foreign.copied().collect();
        ghosts.sort_unstable();
        ghosts.dedup();
        let place = |&column: &u64| match own.contains(&(column as usize)) {
            true => column as usize - own.start,
            false => own.len() + ghosts.binary_search(&column).unwrap(),
        };
        let places = columns.iter().map(place).collect();
        Springs { size, own, ghosts, starts, columns, places, pull }
    }

    /// What a point's displacement is prescribed to be, where it is.
    fn prescribed(&self, point: usize) -> Option<[f64; D]> {
        match position(self.size, point)[0] {
            0 => Some([0.0; D]),
            x if x + 1 == self.size[0] => Some([self.pull, 0.0, 0.0]),
            _ => None,
        }
    }

    /// Force of the spring to a neighbour and its derivative by the neighbour's displacement.
    fn spring(&self, local: &[f64], i: usize, k: usize) -> ([f64; D], [[f64; D]; D]) {
        let (from, to) = (self.own.start + i, self.columns[k] as usize);
        let (here, there) = (position(self.size, from), position(self.size, to));
        let j = self.places[k];
        let rest: [f64; D] = std::array::from_fn(|a| there[a] as f64 - here[a] as f64);
        let now: [f64; D] = std::array::from_fn(|a| rest[a] + local[j * D + a] - local[i * D + a]);
        let norm = |v: [f64; D]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
        let (before, after) = (norm(rest), norm(now));
        let stretch = (after - before) / before;
        // Stiffer where it is stretched.
        let squared = stretch * stretch;
        let (force, slope) = (stretch + stretch * squared, (1.0 + 3.0 * squared) / before);
        let e = now.map(|x| x / after);
        let derivative = std::array::from_fn(|a| {
            std::array::from_fn(|b| {
                let identity = if a == b { 1.0 } else { 0.0 };
                slope * e[a] * e[b] + force / after * (identity - e[a] * e[b])
            })
        });
        (e.map(|x| force * x), derivative)
    }

    /// Minus the forces on owned points; `local` has owned points and ghosts.
    pub(crate) fn residual(&self, local: &[f64], r: &mut [f64]) {
        r.fill(0.0);
        for i in 0..self.own.len() {
            if let Some(value) = self.prescribed(self.own.start + i) {
                for a in 0..D {
                    r[i * D + a] = local[i * D + a] - value[a];
                }
                continue;
            }
            for k in self.starts[i]..self.starts[i + 1] {
                if self.places[k] != i {
                    let (force, _) = self.spring(local, i, k);
                    for a in 0..D {
                        r[i * D + a] -= force[a];
                    }
                }
            }
        }
    }

    /// The derivative of the residual; `blocks` are zero before.
    pub(crate) fn tangent(&self, local: &[f64], blocks: &mut [f64]) {
        for i in 0..self.own.len() {
            let range = self.starts[i]..self.starts[i + 1];
            let own = range.clone().find(|&k| self.places[k] == i).unwrap();
            if self.prescribed(self.own.start + i).is_some() {
                for a in 0..D {
                    blocks[(own * D + a) * D + a] = 1.0;
                }
                continue;
            }
            for k in range.filter(|&k| k != own) {
                let (_, derivative) = self.spring(local, i, k);
                for a in 0..D {
                    for b in 0..D {
                        blocks[(k * D + a) * D + b] -= derivative[a][b];
                        blocks[(own * D + a) * D + b] += derivative[a][b];
                    }
                }
            }
        }
    }

    /// A row of the blocks that [`tangent`](Springs::tangent) gives, as PETSc's side asks for it.
    #[allow(dead_code)] // The serial solution has no use for it.
    pub(crate) fn row(&self, blocks: &[f64], row: usize, values: &mut [f64]) {
        let range = self.starts[row]..self.starts[row + 1];
        let n = range.len();
        for (k, block) in blocks[range.start * D * D..range.end * D * D].chunks(D * D).enumerate() {
            for (at, x) in block.iter().enumerate() {
                values[(at / D * n + k) * D + at % D] = *x;
            }
        }
    }

    /// Three translations and three rotations, at owned points.
    #[allow(dead_code)] // The serial solution has no use for them.
    pub(crate) fn rigid_motions(&self) -> Vec<Vec<f64>> {
        let fields: [fn([f64; D]) -> [f64; D]; 6] = [
            |_| [1.0, 0.0, 0.0],
            |_| [0.0, 1.0, 0.0],
            |_| [0.0, 0.0, 1.0],
            |[x, y, _]| [-y, x, 0.0],
            |[_, y, z]| [0.0, -z, y],
            |[x, _, z]| [z, 0.0, -x],
        ];
        let at = |point| position(self.size, point).map(|x| x as f64);
        let fields = fields.into_iter();
        fields.map(|field| self.own.clone().flat_map(|point| field(at(point))).collect()).collect()
    }
}

/// Where a point is; those with equal x follow one another.
fn position(size: [usize; 3], point: usize) -> [usize; 3] {
    [point / (size[1] * size[2]), point / size[2] % size[1], point % size[2]]
}
