//! Which sign a node has beside rest, and whether it keeps it.

use super::side::{Id, Made, Side, Stop, Sum};
use crate::expression::{Comparison, Node};

impl Side<'_> {
    /// The sign of a linear combination on this side, with a guard where it may turn.
    pub(super) fn sign_of(&mut self, sum: &Sum) -> Made<i32> {
        if sum.is_empty() {
            return Ok(0);
        }
        let id = self.id_of(sum)?;
        let Some(k) = self.first(id, 0)? else { return Ok(0) };
        let [term] = self.nodes[id].series[k].as_slice() else { return Err(Stop::Lost) };
        if term.symbol.other.is_some() {
            return Err(Stop::Lost);
        }
        let mut sign = if term.exact.value.is_positive() { 1 } else { -1 };
        if k % 2 == 1 {
            self.is_sided = true;
            sign *= self.sign;
        }
        if !self.stays(id, k) {
            self.guard(id, k, sign)?;
        }
        Ok(sign)
    }

    /// Whether a polynomial has no other zero within reach.
    fn stays(&self, id: Id, k: usize) -> bool {
        let node = &self.nodes[id];
        let Some(degree) = node.degree.filter(|degree| *degree < self.n) else { return false };
        let size =
            |k: usize| node.series[k].iter().map(|t| t.exact.value.to_f64().abs()).sum::<f64>();
        let same =
            |k: &usize| node.series[*k].iter().all(|term| term.symbol == node.series[*k][0].symbol);
        let others = (k + 1..=degree).filter(|k| !node.series[*k].is_empty());
        let reach: f64 =
            others.clone().map(|i| size(i) * libm::ldexp(1.0, k as i32 - i as i32)).sum();
        others.clone().all(|i| same(&i) && node.series[i][0].symbol == node.series[k][0].symbol)
            && reach < size(k)
    }

    /// Asks at run time for the sign that a node of order `k` has beside rest.
    fn guard(&mut self, id: Id, k: usize, sign: i32) -> Made<()> {
        let Some(value) = self.rest(id, k)? else { return Ok(()) };
        let zero = self.target.number(0.0)?;
        // What is 0 at rest has its side there, too.
        let comparison = match (sign > 0, k > 0) {
            (true, false) => Comparison::Greater,
            (true, true) => Comparison::GreaterEqual,
            (false, false) => Comparison::Less,
            (false, true) => Comparison::LessEqual,
        };
        let holds = self.target.make(Node::Compare(comparison, value, zero))?;
        // A number that is compared with a number holds or does not, at any strain.
        if self.target.graph()[holds] != Node::Truth(true) {
            self.guards.push(holds);
        }
        Ok(())
    }
}
