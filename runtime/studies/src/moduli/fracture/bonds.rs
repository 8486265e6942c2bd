//! Single interactions up to where they break.

use std::ops::Range;

use piola_compiler::{Criterion, NextState};
use piola_mechanics::kernel::{Batch, Law, Measure, Order, Outputs};

use super::LARGEST;
use crate::case::Compiled;

/// Strains that are tried of every decade.
const PER_DECADE: i32 = 20;

/// Even parts of the way to the threshold over which the force of a bond that remembers is summed, by two
/// points each: it may bend anywhere, and what a bend costs is less than 1e-7 of the work.
const PARTS: u32 = 4096;

/// A bond at its threshold.
#[derive(Clone, Copy)]
pub(super) struct Broken {
    pub(super) strain: f64,
    /// psi there, or the work that leads there.
    pub(super) energy: f64,
}

/// What one potential says of interactions.
#[derive(Clone)]
pub(super) struct Part<'a> {
    criteria: &'a [Criterion],
    next: &'a [NextState],
    law: Option<&'a dyn Law>,
    /// What is remembered at the start and the direction of a bond, as fields.
    fields: Vec<f64>,
    /// Which of them are that direction.
    directions: Range<usize>,
}

impl<'a> Part<'a> {
    pub(super) fn of(
        one: &'a Compiled,
        (fields, directions): (Vec<f64>, Range<usize>),
    ) -> Part<'a> {
        let element = one.elements.bond.as_ref();
        let law = element.and_then(|element| element.law()).map(|(law, _)| law);
        Part { criteria: &one.criteria, next: &one.next_states, law, fields, directions }
    }

    /// Whether anything depends on the direction of a bond.
    pub(super) fn sees_directions(&self) -> bool {
        !self.directions.is_empty()
    }

    /// Whether bonds have an energy.
    pub(super) fn has_law(&self) -> bool {
        self.law.is_some()
    }

    /// What an interaction of this measure remembers at a strain to which it comes with these fields.
    fn remember(&self, fields: &mut [f64], measure: Measure, reference: f64, strain: f64) {
        let at_once: Vec<f64> = fields.iter().copied().chain([0.0]).collect();
        for state in self.next.iter().filter(|state| state.measure() == measure) {
            let next = value(&state.next, (reference, strain), &at_once, Order::Energy);
            fields[state.field] = next;
        }
    }

    /// Whether interactions of this measure remember anything.
    pub(super) fn remembers(&self, measure: Measure) -> bool {
        self.next.iter().any(|state| state.measure() == measure)
    }

    /// Whether a bond breaks, or by its own condition a triangle or a tetrahedron.
    fn breaks(&self, measure: Measure, reference: f64, strain: f64) -> bool {
        let mut fields = self.fields.clone();
        self.remember(&mut fields, measure, reference, strain);
        let margin =
            |one: &Criterion| value(&one.margin, (reference, strain), &fields, Order::Energy);
        let mut own = self.criteria.iter().filter(|one| one.measure() == measure);
        own.any(|one| one.breaks(margin(one)))
    }

    /// psi at a strain; of a bond that remembers the work of its force on the way there.
    fn work(&self, length: f64, strain: f64) -> f64 {
        let Some(law) = self.law else { return 0.0 };
        if !self.remembers(Measure::Length) {
            return value(law, (length, strain), &self.fields, Order::Energy);
        }
        let mut fields = self.fields.clone();
        let part = strain / f64::from(PARTS);
        let gauss = [-0.5, 0.5].map(|side| 0.5 + side / libm::sqrt(3.0));
        let mut work = 0.0;
        for start in 0..PARTS {
            for place in gauss {
                let strain = part * (f64::from(start) + place);
                self.remember(&mut fields, Measure::Length, length, strain);
                work += 0.5 * part * length * value(law, (length, strain), &fields, Order::Force);
            }
        }
        work
    }
}

/// The same of bonds with this direction at rest, a unit vector.
pub(super) fn directed<'a>(parts: &[Part<'a>], direction: &[f64]) -> Vec<Part<'a>> {
    let mut parts = parts.to_vec();
    for part in parts.iter_mut().filter(|part| part.sees_directions()) {
        part.fields[part.directions.clone()].copy_from_slice(direction);
    }
    parts
}

/// The shortest length beyond rest at which a bond breaks, and what it takes to get there.
pub(super) fn broken(parts: &[Part<'_>], length: f64) -> Option<Broken> {
    let strain = threshold(parts, Measure::Length, length, 1.0)?;
    let energy = parts.iter().fold(0.0, |sum, part| sum + part.work(length, strain));
    Some(Broken { strain, energy })
}

/// The smallest change of a measure, in parts of its value at rest and towards one side (`1.0` or `-1.0`),
/// at which an interaction breaks by its own condition.
pub(super) fn threshold(
    parts: &[Part<'_>],
    measure: Measure,
    reference: f64,
    side: f64,
) -> Option<f64> {
    let breaks = |size: f64| parts.iter().any(|part| part.breaks(measure, reference, side * size));
    let decades = -14 * PER_DECADE..=PER_DECADE;
    let sizes = decades.map(|k| libm::pow(10.0, f64::from(k) / f64::from(PER_DECADE)));
    let mut low = 0.0;
    let mut high = None;
    for size in sizes.take_while(|size| 1.0 + size <= LARGEST) {
        if breaks(size) {
            high = Some(size);
            break;
        }
        low = size;
    }
    let mut high = high?;
    loop {
        let middle = low + 0.5 * (high - low);
        if middle <= low || middle >= high {
            break;
        }
        if breaks(middle) { high = middle } else { low = middle }
    }
    Some(side * high)
}

/// The energy of a law or, for forces, its derivative by the measure.
fn value(law: &dyn Law, (reference, strain): (f64, f64), fields: &[f64], order: Order) -> f64 {
    let [mut psi, mut dpsi] = [0.0; 2];
    let batch = Batch {
        measure: &[reference * (1.0 + strain)],
        reference: &[reference],
        change: &[strain],
        fields: &fields[..law.fields().len()],
    };
    let (of_psi, of_dpsi) = (std::slice::from_mut(&mut psi), std::slice::from_mut(&mut dpsi));
    law.evaluate(batch, order, Outputs { psi: of_psi, dpsi: of_dpsi, d2psi: &mut [] });
    if order == Order::Force { dpsi } else { psi }
}
