//! The papers' way, as fast as the compiler can make it: textbook energies over hyper-dual numbers,
//! one pass per entry of the compact tangent, eight interactions side by side in the widest registers
//! of the machine.
//!
//! Of what num-dual offers this was the fastest. For n = 1 these took 2.4, 4.6 and 5.6 times as long
//! (bonds, triangles, tetrahedra): one interaction after the other; 9, 5 and 4 times: blocks of three
//! by three derivatives in one pass (`HyperDualSVec64<3, 3>`); 5, 9 and 11 times: a row in one pass
//! (`HyperDualSVec64<1, C>`); 8, 16 and 18 times: all in one pass (`Dual2SVec64<C>`). Numbers that
//! carry vectors ask at every operation whether they have any, and no compiler takes eight of them at
//! once.

use std::marker::PhantomData;

use num_dual::{DualNum, HyperDual64};
use piola_compiler::Measure;
use piola_runtime::element::{Contributions, Element, InteractionBatch, NonFiniteLane, Order};
use piola_runtime::geometry::packed;
use pulp::{Arch, Simd, WithSimd};

use crate::samples;

/// A strain as a function of the stretch.
pub(crate) trait Strain {
    /// Its exponent; 0 is the logarithm.
    const N: f64;
    /// `S(x)`.
    fn of(x: HyperDual64) -> HyperDual64;
}

macro_rules! strain {
    ($name:ident, $n:literal, $x:ident => $formula:expr) => {
        pub(crate) struct $name;
        impl Strain for $name {
            const N: f64 = $n;
            #[inline(always)]
            fn of($x: HyperDual64) -> HyperDual64 {
                $formula
            }
        }
    };
}
strain!(Linear, 1.0, x => x - 1.0);
strain!(Quadratic, 2.0, x => (x * x - 1.0) / 2.0);
strain!(Power, 2.7, x => (DualNum::powf(&x, 2.7) - 1.0) / 2.7);
strain!(Logarithm, 0.0, x => DualNum::ln(&x));

/// Interactions side by side.
pub(crate) const LANES: usize = 8;

type Channel = [f64; LANES];

/// Interactions: the relative vectors now, the measures at rest, the weights.
#[derive(Clone, Copy)]
pub(crate) struct Block<const C: usize> {
    x: [Channel; C],
    reference: Channel,
    weight: Channel,
}

impl<const C: usize> Block<C> {
    pub(crate) const EMPTY: Block<C> =
        Block { x: [[0.0; LANES]; C], reference: [0.0; LANES], weight: [0.0; LANES] };

    pub(crate) fn set(&mut self, lane: usize, x: &[f64; C], reference: f64, weight: f64) {
        for c in 0..C {
            self.x[c][lane] = x[c];
        }
        self.reference[lane] = reference;
        self.weight[lane] = weight;
    }
}

/// Energies with compact gradients and tangents.
#[derive(Clone, Copy)]
pub(crate) struct Results<const C: usize> {
    pub(crate) energy: Channel,
    pub(crate) gradient: [Channel; C],
    /// Entries `[row][column]` with `column <= row`.
    pub(crate) tangent: [[Channel; C]; C],
}

impl<const C: usize> Results<C> {
    pub(crate) const ZERO: Results<C> = Results {
        energy: [0.0; LANES],
        gradient: [[0.0; LANES]; C],
        tangent: [[[0.0; LANES]; C]; C],
    };
}

/// `weight/2 M S(m/M)^2` and its derivatives in the `C` components of the relative vectors, block by
/// block.
pub(crate) fn evaluate<S: Strain, const C: usize>(
    arch: Arch,
    blocks: &[Block<C>],
    out: &mut [Results<C>],
) {
    arch.dispatch(Passes::<S, C> { blocks, out, strain: PhantomData });
}

struct Passes<'a, S, const C: usize> {
    blocks: &'a [Block<C>],
    out: &'a mut [Results<C>],
    strain: PhantomData<S>,
}

impl<S: Strain, const C: usize> WithSimd for Passes<'_, S, C> {
    type Output = ();

    #[inline(always)]
    fn with_simd<R: Simd>(self, _: R) {
        // Copies that nobody else knows: what passes have in common is worked out once.
        for (&block, out) in self.blocks.iter().zip(self.out) {
            let block = &block;
            // The six passes of a bond share most of their work, and the compiler finds that.
            if C == 3 {
                lane_by_lane::<S, C>(block, out)
            } else {
                entry_by_entry::<S, C>(block, out)
            }
        }
    }
}

/// All passes of an interaction, in one loop over the interactions.
#[inline(always)]
fn lane_by_lane<S: Strain, const C: usize>(block: &Block<C>, out: &mut Results<C>) {
    for lane in 0..LANES {
        let mut dual = [HyperDual64::from_re(0.0); C];
        for c in 0..C {
            dual[c].re = block.x[c][lane];
        }
        for row in 0..C {
            dual[row].eps1 = 1.0;
            for column in 0..=row {
                dual[column].eps2 = 1.0;
                let energy = energy::<S, C>(&dual, block.reference[lane], block.weight[lane]);
                dual[column].eps2 = 0.0;
                out.tangent[row][column][lane] = energy.eps1eps2;
                if row == column {
                    out.gradient[row][lane] = energy.eps1;
                    out.energy[lane] = energy.re;
                }
            }
            dual[row].eps1 = 0.0;
        }
    }
}

/// A loop over the interactions for every pass.
#[inline(always)]
fn entry_by_entry<S: Strain, const C: usize>(block: &Block<C>, out: &mut Results<C>) {
    let (mut first, mut second) = ([0.0; C], [0.0; C]);
    for row in 0..C {
        first[row] = 1.0;
        for column in 0..=row {
            second[column] = 1.0;
            let passed = pass::<S, C>(block, [&first, &second]);
            second[column] = 0.0;
            out.tangent[row][column] = passed.both;
            if row == column {
                out.gradient[row] = passed.first;
                out.energy = passed.energy;
            }
        }
        first[row] = 0.0;
    }
}

/// What one pass gives: energies, derivatives in one component, second ones in two.
struct Passed {
    energy: Channel,
    first: Channel,
    both: Channel,
}

#[inline(always)]
fn pass<S: Strain, const C: usize>(block: &Block<C>, seeds: [&[f64; C]; 2]) -> Passed {
    let zero = [0.0; LANES];
    let mut out = Passed { energy: zero, first: zero, both: zero };
    for lane in 0..LANES {
        let mut dual = [HyperDual64::from_re(0.0); C];
        for c in 0..C {
            dual[c] = HyperDual64::new(block.x[c][lane], seeds[0][c], seeds[1][c], 0.0);
        }
        let energy = energy::<S, C>(&dual, block.reference[lane], block.weight[lane]);
        out.both[lane] = energy.eps1eps2;
        out.first[lane] = energy.eps1;
        out.energy[lane] = energy.re;
    }
    out
}

#[inline(always)]
fn energy<S: Strain, const C: usize>(
    x: &[HyperDual64; C],
    reference: f64,
    weight: f64,
) -> HyperDual64 {
    let (inverse, scale) = (1.0 / reference, 0.5 * weight * reference.abs());
    let strain = S::of(measure(x) * inverse);
    strain * strain * scale
}

/// An element that differentiates its energy in this way, whatever order it is asked for.
pub(crate) struct HyperDualElement<S, const C: usize> {
    measure: Measure,
    stiffness: f64,
    arch: Arch,
    strain: PhantomData<S>,
}

impl<S, const C: usize> HyperDualElement<S, C> {
    pub(crate) fn new(stiffness: f64) -> HyperDualElement<S, C> {
        let measure = Measure::ALL[C / 3 - 1];
        HyperDualElement { measure, stiffness, arch: Arch::new(), strain: PhantomData }
    }
}

impl<S: Strain + Send + Sync, const C: usize> Element for HyperDualElement<S, C> {
    fn measure(&self) -> Measure {
        self.measure
    }

    fn dimension(&self) -> usize {
        3
    }

    fn forbids_inversion(&self) -> bool {
        false
    }

    fn evaluate(
        &self,
        batch: &InteractionBatch,
        _: Order,
        out: &mut Contributions,
    ) -> Result<(), NonFiniteLane> {
        for start in (0..batch.padded_len()).step_by(LANES) {
            let mut block = Block::EMPTY;
            for lane in start..start + LANES {
                let at_rest: [f64; C] = std::array::from_fn(|c| batch.reference[c][lane]);
                let now = std::array::from_fn(|c| at_rest[c] + batch.displacement[c][lane]);
                let weight = self.stiffness * batch.weight[lane];
                block.set(lane - start, &now, samples::measure(&at_rest), weight);
            }
            let mut found = [Results::ZERO];
            evaluate::<S, C>(self.arch, &[block], &mut found);
            let [found] = &found;
            let lanes = start..start + LANES;
            out.energy[lanes.clone()].copy_from_slice(&found.energy);
            for row in 0..C {
                out.gradient[row][lanes.clone()].copy_from_slice(&found.gradient[row]);
                for column in 0..=row {
                    let to = &mut out.hessian[packed(C, column, row)];
                    to[lanes.clone()].copy_from_slice(&found.tangent[row][column]);
                }
            }
        }
        Ok(())
    }
}

/// `|xi|`, `|xi1 x xi2|` or `xi1.(xi2 x xi3)` (javili2020, Eq. (20)).
#[inline(always)]
pub(crate) fn measure<const C: usize>(x: &[HyperDual64; C]) -> HyperDual64 {
    match C {
        3 => (x[0] * x[0] + x[1] * x[1] + x[2] * x[2]).sqrt(),
        6 => {
            let c = cross(x, 0, 3);
            (c[0] * c[0] + c[1] * c[1] + c[2] * c[2]).sqrt()
        }
        _ => {
            let c = cross(x, 3, 6);
            x[0] * c[0] + x[1] * c[1] + x[2] * c[2]
        }
    }
}

#[inline(always)]
fn cross(x: &[HyperDual64], p: usize, q: usize) -> [HyperDual64; 3] {
    [
        x[p + 1] * x[q + 2] - x[p + 2] * x[q + 1],
        x[p + 2] * x[q] - x[p] * x[q + 2],
        x[p] * x[q + 1] - x[p + 1] * x[q],
    ]
}
