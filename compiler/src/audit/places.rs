//! Stretches where digits are lost if anywhere: around zeros of psi, psi', psi'', and where a program
//! changes its mind.

use super::SMALLEST;
use crate::expression::function::LOG1PMX_SERIES;
use crate::expression::interpret::Interpreter;
use crate::expression::{Function, Node, NodeId, Operator};
use crate::measure::Measure;
use crate::specialise::ScalarEnergy;

/// Of an energy with many zeros or guards, those nearest rest.
const MOST: usize = 12;

/// Halvings of an interval, also of one from a rounding below 0 to one above.
const HALVINGS: usize = 1200;

/// A property of an energy at a stretch, read off the interpreter.
type Read<'a> = &'a dyn Fn(&Interpreter<f64>) -> f64;

/// Stretches of an energy of bonds, triangles or tetrahedra of size 1 at rest, ascending.
pub(super) struct Grid<'a> {
    energy: &'a ScalarEnergy,
    stretches: Vec<f64>,
}

impl Grid<'_> {
    /// Forty in a decade from 1e-8 to 1e8, strains down to 1e-15, for volumes inverted ones.
    pub(super) fn new(energy: &ScalarEnergy) -> Grid<'_> {
        let mut stretches: Vec<f64> =
            (-320..=320).map(|k| libm::pow(10.0, f64::from(k) / 40.0)).collect();
        for decade in 1..=15 {
            let strain = libm::pow(10.0, -f64::from(decade));
            stretches.extend([1.0 - strain, 1.0 + strain]);
        }
        if energy.measure == Measure::Volume {
            let inverted: Vec<f64> = stretches.iter().map(|stretch| -stretch).collect();
            stretches.extend(inverted);
        }
        stretches.sort_by(f64::total_cmp);
        Grid { energy, stretches }
    }

    /// Stretches on both sides of every place where the program takes another way, one rounding apart and
    /// two: comparisons, the smaller and larger of two numbers, sizes and signs, seams of functions.
    pub(super) fn guards(&self) -> Vec<f64> {
        let mut found = Vec::new();
        for (_, node) in self.energy.graph.nodes() {
            match node {
                Node::Compare(_, x, y) | Node::Binary(Operator::Min | Operator::Max, x, y) => {
                    found.extend(self.switches(&|at| at.number(x) - at.number(y)));
                }
                Node::Unary(function, x) => {
                    for seam in seams(function) {
                        found.extend(self.switches(&|at| at.number(x) - seam));
                    }
                }
                _ => {}
            }
        }
        let found = nearest_rest(found);
        let around = |[low, high]: [f64; 2]| [low.next_down(), low, high, high.next_up()];
        // A third of them meets each reference, and 1 is exact.
        found.into_iter().flat_map(around).flat_map(|stretch| [stretch; 3]).collect()
    }

    /// Stretches around zeros of psi or a derivative: where it changes its sign, and where it is smallest,
    /// on a zero that it touches or as near as that.
    pub(super) fn zeros(&self, order: usize) -> Vec<f64> {
        let root: NodeId = self.energy.roots[order];
        let read: Read = &|at| at.number(root);
        let mut found = self.switches(read);
        found.extend(self.dips(read).into_iter().map(|stretch| [stretch, stretch]));
        let around = |[low, high]: [f64; 2]| {
            let far = [1e-12, 1e-8, 1e-6, 1e-4, 1e-2].into_iter();
            let far = far.flat_map(move |by| [low * (1.0 - by), high * (1.0 + by)]);
            [low, low, low, high, high, high].into_iter().chain(far)
        };
        nearest_rest(found).into_iter().flat_map(around).collect()
    }

    fn read(&self, stretch: f64, read: Read) -> f64 {
        let mut interpreter = Interpreter::<f64>::new();
        self.energy.run(&mut interpreter, &stretch, &1.0, &(stretch - 1.0));
        read(&interpreter)
    }

    /// Neighbouring stretches between which a number becomes negative, or no longer is.
    fn switches(&self, read: Read) -> Vec<[f64; 2]> {
        let is_negative = |stretch: f64| self.read(stretch, read) < 0.0;
        let mut found = Vec::new();
        let sides: Vec<bool> = self.stretches.iter().map(|stretch| is_negative(*stretch)).collect();
        for (pair, sides) in self.stretches.windows(2).zip(sides.windows(2)) {
            let (mut low, mut high) = (pair[0], pair[1]);
            if sides[0] == sides[1] {
                continue;
            }
            for _ in 0..HALVINGS {
                if low.next_up() >= high {
                    break;
                }
                let middle = 0.5 * (low + high);
                if is_negative(middle) == sides[0] { low = middle } else { high = middle }
            }
            // Numbers that underflow on the way have no digits to count.
            if low.abs().min(high.abs()) >= SMALLEST {
                found.push([low, high]);
            }
        }
        found
    }

    /// Where the size of a number is smaller than on both sides, by thirds of intervals of the grid.
    fn dips(&self, read: Read) -> Vec<f64> {
        let size = |stretch: f64| self.read(stretch, read).abs();
        let sizes: Vec<f64> = self.stretches.iter().map(|stretch| size(*stretch)).collect();
        let mut found = Vec::new();
        for (at, sizes) in self.stretches.windows(3).zip(sizes.windows(3)) {
            if !(sizes[0] > sizes[1] && sizes[1] <= sizes[2]) {
                continue;
            }
            let (mut low, mut high) = (at[0], at[2]);
            for _ in 0..100 {
                let third = (high - low) / 3.0;
                if size(low + third) < size(high - third) { high -= third } else { low += third }
            }
            // Steps of a plateau are none.
            let middle = 0.5 * (low + high);
            if size(middle) < 0.5 * sizes[0].min(sizes[2]) {
                found.push(middle);
            }
        }
        found
    }
}

/// Arguments at which a function changes the way in which it is worked out.
fn seams(function: Function) -> &'static [f64] {
    match function {
        Function::Abs | Function::Sign => &[0.0],
        Function::Log1pmx => &[-LOG1PMX_SERIES, LOG1PMX_SERIES],
        Function::Exp | Function::Expm1 => &[-708.0, 708.0],
        _ => &[],
    }
}

/// Those with the smallest strains, each once.
fn nearest_rest(mut found: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    found.sort_by(|[x, _], [y, _]| (x - 1.0).abs().total_cmp(&(y - 1.0).abs()));
    found.dedup();
    found.truncate(MOST);
    found
}
