//! Two elements of one kind of interaction as one.

use super::batch::{Contributions, InteractionBatch};
use super::{Element, NonFiniteLane, Order};
use crate::geometry::packed_len;
use crate::interaction::n_neighbors;
use crate::kernel::Measure;
use crate::pool::Pool;

/// The sum of two energies of the same interactions, for instance of an area alone and of an area with its
/// sides.
pub struct SumElement {
    first: Box<dyn Element>,
    second: Box<dyn Element>,
    argument: String,
    rooms: Pool<Contributions>,
}

impl SumElement {
    /// The sum of two elements of one measure and dimension.
    pub fn new(first: Box<dyn Element>, second: Box<dyn Element>) -> SumElement {
        assert_eq!(first.measure(), second.measure(), "elements of one kind");
        let argument = format!("{}) + psi({}", first.argument(), second.argument());
        SumElement { first, second, argument, rooms: Pool::new() }
    }
}

impl Element for SumElement {
    fn measure(&self) -> Measure {
        self.first.measure()
    }

    fn argument(&self) -> &str {
        &self.argument
    }

    fn dimension(&self) -> usize {
        self.first.dimension()
    }

    fn forbids_inversion(&self) -> bool {
        self.first.forbids_inversion() || self.second.forbids_inversion()
    }

    fn n_fields(&self) -> usize {
        self.first.n_fields().max(self.second.n_fields())
    }

    fn provide(&self) {
        self.rooms.provide(|| Contributions::new(self.measure(), self.dimension()));
        self.first.provide();
        self.second.provide();
    }

    fn evaluate(
        &self,
        batch: &InteractionBatch,
        order: Order,
        out: &mut Contributions,
    ) -> Result<(), NonFiniteLane> {
        self.first.evaluate(batch, order, out)?;
        let (measure, dimension) = (self.measure(), self.dimension());
        let mut other = self.rooms.take(|| Contributions::new(measure, dimension));
        self.second.evaluate(batch, order, &mut other)?;
        let (coordinates, n) = (n_neighbors(measure) * dimension, batch.len());
        let add = |sum: &mut [f64], part: &[f64]| {
            sum[..n].iter_mut().zip(&part[..n]).for_each(|(sum, part)| *sum += part);
        };
        if order.has_energy() {
            add(&mut out.energy, &other.energy);
        }
        if order != Order::Energy {
            let channels = out.gradient[..coordinates].iter_mut().zip(&other.gradient);
            channels.for_each(|(sum, part)| add(sum, part));
        }
        if order == Order::Tangent {
            let channels = out.hessian[..packed_len(coordinates)].iter_mut().zip(&other.hessian);
            channels.for_each(|(sum, part)| add(sum, part));
        }
        Ok(())
    }
}
