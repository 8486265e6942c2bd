//! Interactions to evaluate: well-shaped, moderately strained, the same at every run.

use std::array::from_fn;

use piola_compiler::Measure;
use piola_runtime::element::{CAPACITY, InteractionBatch};

/// Interactions of one kind; together they stay in the second-level cache.
pub(crate) const COUNT: usize = 1024;

/// Vectors from the owner to the other corners, one after the other.
pub(crate) struct Samples<const C: usize> {
    pub(crate) reference: Vec<[f64; C]>,
    pub(crate) displacement: Vec<[f64; C]>,
    pub(crate) weight: Vec<f64>,
}

impl<const C: usize> Samples<C> {
    /// Corners up to a unit away, strains of some percent; neither short nor thin nor flat.
    pub(crate) fn new() -> Samples<C> {
        let mut state = 0x5eed + C as u64;
        let mut next = move || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        };
        let mut samples =
            Samples { reference: Vec::new(), displacement: Vec::new(), weight: Vec::new() };
        while samples.reference.len() < COUNT {
            let reference: [f64; C] = from_fn(|_| next());
            if measure(&reference).abs() > 0.2 {
                samples.reference.push(reference);
                samples.displacement.push(from_fn(|_| 0.03 * next()));
                samples.weight.push(1.0 + 0.5 * next());
            }
        }
        samples
    }

    /// In the form that elements take.
    pub(crate) fn batches<const K: usize>(&self) -> Vec<InteractionBatch> {
        let corners = |all: &[[f64; C]]| -> Vec<[f64; 3]> {
            all.iter().flat_map(|x| (0..K).map(|k| from_fn(|axis| x[3 * k + axis]))).collect()
        };
        let (reference, displacement) = (corners(&self.reference), corners(&self.displacement));
        let kind = [Measure::Length, Measure::Area, Measure::Volume][K - 1];
        let batch = |first: usize| {
            let len = CAPACITY.min(COUNT - first);
            let mut batch = InteractionBatch::new(kind, 3);
            let corners = |lane: usize| from_fn::<usize, K, _>(|k| (first + lane) * K + k);
            batch.gather::<K, 3>(len, &reference, &displacement, corners);
            batch.weight[..len].copy_from_slice(&self.weight[first..first + len]);
            batch
        };
        (0..COUNT).step_by(CAPACITY).map(batch).collect()
    }

    /// In the form that `foreign/kernels.c` reads: blocks of 8.
    pub(crate) fn blocks(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut put = |channel: &mut dyn FnMut(usize) -> f64, block: usize| {
            for lane in 8 * block..8 * block + 8 {
                bytes.extend_from_slice(&channel(lane).to_ne_bytes());
            }
        };
        for block in 0..COUNT / 8 {
            for c in 0..C {
                put(&mut |lane| self.reference[lane][c], block);
            }
            for c in 0..C {
                put(&mut |lane| self.displacement[lane][c], block);
            }
            put(&mut |lane| self.weight[lane], block);
        }
        bytes
    }
}

/// The measure of relative vectors, signed for volumes.
pub(crate) fn measure<const C: usize>(x: &[f64; C]) -> f64 {
    let cross = |p: usize, q: usize| {
        let entry = |r: usize, s: usize| x[p + r] * x[q + s] - x[p + s] * x[q + r];
        [entry(1, 2), entry(2, 0), entry(0, 1)]
    };
    match C {
        3 => x.iter().map(|x| x * x).sum::<f64>().sqrt(),
        6 => cross(0, 3).iter().map(|x| x * x).sum::<f64>().sqrt(),
        _ => cross(3, 6).iter().zip(x).map(|(normal, x)| normal * x).sum(),
    }
}
