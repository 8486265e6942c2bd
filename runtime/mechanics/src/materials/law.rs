//! The laws of several materials as one: each place takes its own.

use std::cell::Cell;
use std::ops::Range;

use crate::kernel::{Variables, VariablesLaw};
use crate::pool::Pool;

/// The law of one material, and which of the variables of all it has, in its order.
pub struct MaterialLaw {
    /// The law.
    pub law: Box<dyn VariablesLaw>,
    /// For each of its variables its number among those of all materials.
    pub variables: Vec<usize>,
    /// Which of the fields of all materials are its own.
    pub fields: Range<usize>,
}

/// Laws by number: [`Variables::laws`] says which of them holds at a place. Where none is given the energy
/// is 0.
pub struct ByMaterial {
    n_variables: usize,
    /// How many fields all materials have; they are the last of what is given.
    n_fields: usize,
    laws: Vec<Option<MaterialLaw>>,
    rooms: Pool<Room>,
}

/// The places of one law, before it.
#[derive(Default)]
struct Room {
    places: Vec<usize>,
    current: Vec<f64>,
    change: Vec<f64>,
    given: Vec<f64>,
    direction: Vec<f64>,
    psi: Vec<f64>,
    out: Vec<f64>,
}

impl ByMaterial {
    /// `laws` has one of each material, and then those of interfaces; together they are functions of so
    /// many variables, and take so many fields.
    pub fn new(n_variables: usize, n_fields: usize, laws: Vec<Option<MaterialLaw>>) -> ByMaterial {
        for MaterialLaw { law, variables, fields } in laws.iter().flatten() {
            assert_eq!(law.n_variables(), variables.len(), "a number for each variable");
            assert!(variables.iter().all(|variable| *variable < n_variables));
            assert!(fields.end <= n_fields, "fields are among those of all");
        }
        ByMaterial { n_variables, n_fields, laws, rooms: Pool::new() }
    }

    /// The law of all places, where they have the same and it is a function of all variables
    /// in their order.
    fn of_all(&self, laws: &[u8]) -> Option<&dyn VariablesLaw> {
        let first = laws.first()?;
        let own = self.laws.get(usize::from(*first))?.as_ref()?;
        let MaterialLaw { law, variables, fields } = own;
        let alike = laws.iter().all(|law| law == first);
        let has_all =
            variables.iter().copied().eq(0..self.n_variables) && *fields == (0..self.n_fields);
        (alike && has_all).then_some(&**law)
    }

    /// Takes the places of each law together, and what comes out back to them: one number for each place
    /// in `psi`, one for each variable and place in `out`.
    fn each(
        &self,
        at: Variables<'_>,
        direction: &[f64],
        (psi, out): (&mut [f64], &mut [f64]),
        run: impl Fn(&dyn VariablesLaw, Variables<'_>, &[f64], &mut [f64], &mut [f64]),
    ) {
        psi.fill(0.0);
        out.fill(0.0);
        let mut room = self.rooms.take(Room::default);
        for (number, law) in self.laws.iter().enumerate() {
            let Some(MaterialLaw { law, variables, fields }) = law else { continue };
            let Room { places, current, change, given, direction: along, psi: own, out: parts } =
                &mut *room;
            places.clear();
            let of_law =
                |place: &usize| at.laws.get(*place).map_or(0, |law| usize::from(*law)) == number;
            places.extend((0..at.n).filter(of_law));
            let n = places.len();
            if n == 0 {
                continue;
            }
            gather(at.current, at.n, places, variables.iter().copied(), current);
            // What changes are of is either every variable or one for each place.
            match at.change.len() == at.current.len() {
                true => gather(at.change, at.n, places, variables.iter().copied(), change),
                false => gather(at.change, at.n, places, 0..at.change.len() / at.n, change),
            }
            let n_others = at.given.len() / at.n - self.n_fields;
            let known = (0..n_others).chain(fields.clone().map(|field| n_others + field));
            gather(at.given, at.n, places, known, given);
            if !direction.is_empty() {
                gather(direction, at.n, places, variables.iter().copied(), along);
            }
            own.resize(if psi.is_empty() { 0 } else { n }, 0.0);
            parts.resize(if out.is_empty() { 0 } else { n * variables.len() }, 0.0);
            let here = Variables { n, current, change, given, laws: &[] };
            run(&**law, here, along, own, parts);
            for (from, &place) in places.iter().enumerate() {
                if let Some(psi) = psi.get_mut(place) {
                    *psi = own[from];
                }
            }
            for (k, &variable) in variables.iter().enumerate().filter(|_| !parts.is_empty()) {
                for (from, &place) in places.iter().enumerate() {
                    out[variable * at.n + place] = parts[k * n + from];
                }
            }
        }
    }
}

/// `out` becomes what some places have of some variables.
fn gather(
    all: &[f64],
    n: usize,
    places: &[usize],
    variables: impl Iterator<Item = usize>,
    out: &mut Vec<f64>,
) {
    out.clear();
    for variable in variables {
        out.extend(places.iter().map(|place| all[variable * n + place]));
    }
}

impl VariablesLaw for ByMaterial {
    fn n_variables(&self) -> usize {
        self.n_variables
    }

    fn evaluate(&self, at: Variables<'_>, psi: &mut [f64], gradient: &mut [f64]) {
        if let Some(law) = self.of_all(at.laws) {
            return law.evaluate(at, psi, gradient);
        }
        self.each(at, &[], (psi, gradient), |law, at, _, psi, gradient| {
            law.evaluate(at, psi, gradient);
        });
    }

    fn product(&self, at: Variables<'_>, direction: &[f64], product: &mut [f64]) {
        if let Some(law) = self.of_all(at.laws) {
            return law.product(at, direction, product);
        }
        self.each(at, direction, (&mut [], product), |law, at, direction, _, product| {
            law.product(at, direction, product);
        });
    }

    fn stretch_across(&self, at: Variables<'_>, across: &mut [f64]) -> bool {
        // The laws of a body are all of sheets, or none is; where there is no law nothing gets thinner.
        let is_known = Cell::new(false);
        self.each(at, &[], (across, &mut []), |law, at, _, across, _| {
            is_known.set(is_known.get() | law.stretch_across(at, across));
        });
        across.iter_mut().filter(|across| **across == 0.0).for_each(|across| *across = 1.0);
        is_known.into_inner()
    }

    fn is_affine_beside(&self, is_fixed: &dyn Fn(usize) -> bool) -> bool {
        self.laws.iter().flatten().all(|MaterialLaw { law, variables, .. }| {
            // Integrals stand behind the length.
            law.is_affine_beside(&|k| is_fixed(variables[1 + k] - 1))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `factor*x^2/2` of one variable.
    struct Square(f64);

    impl VariablesLaw for Square {
        fn n_variables(&self) -> usize {
            1
        }

        fn evaluate(&self, at: Variables<'_>, psi: &mut [f64], gradient: &mut [f64]) {
            for p in 0..at.n {
                psi[p] = 0.5 * self.0 * at.current[p] * at.current[p];
                if !gradient.is_empty() {
                    gradient[p] = self.0 * at.current[p];
                }
            }
        }

        fn product(&self, at: Variables<'_>, direction: &[f64], product: &mut [f64]) {
            (0..at.n).for_each(|p| product[p] = self.0 * direction[p]);
        }
    }

    /// `x*y^2` of two variables.
    struct Mixed;

    impl VariablesLaw for Mixed {
        fn n_variables(&self) -> usize {
            2
        }

        fn evaluate(&self, at: Variables<'_>, psi: &mut [f64], gradient: &mut [f64]) {
            let (x, y) = at.current.split_at(at.n);
            for p in 0..at.n {
                psi[p] = x[p] * y[p] * y[p];
                (gradient[p], gradient[at.n + p]) = (y[p] * y[p], 2.0 * x[p] * y[p]);
            }
        }

        fn product(&self, _: Variables<'_>, _: &[f64], _: &mut [f64]) {}
    }

    #[test]
    fn variables_keep_the_order_of_their_law() {
        let law = |variables| Some(MaterialLaw { law: Box::new(Mixed), variables, fields: 0..0 });
        let both = ByMaterial::new(2, 0, vec![law(vec![0, 1]), law(vec![1, 0])]);
        let current = [2.0, 3.0];
        for (number, expected) in [(0, [18.0, 9.0, 12.0]), (1, [12.0, 12.0, 4.0])] {
            let at =
                Variables { n: 1, current: &current, change: &[], given: &[], laws: &[number] };
            let (mut psi, mut gradient) = ([f64::NAN], [f64::NAN; 2]);
            both.evaluate(at, &mut psi, &mut gradient);
            assert_eq!([psi[0], gradient[0], gradient[1]], expected);
        }
    }

    #[test]
    fn each_place_has_the_law_of_its_material() {
        let law = |factor, variable| {
            let (law, variables) = (Box::new(Square(factor)), vec![variable]);
            Some(MaterialLaw { law, variables, fields: 0..0 })
        };
        let both = ByMaterial::new(2, 0, vec![law(1.0, 0), law(10.0, 1), None]);
        let current = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0];
        let at =
            Variables { n: 4, current: &current, change: &[], given: &[], laws: &[0, 1, 0, 2] };
        let (mut psi, mut gradient) = ([f64::NAN; 4], [f64::NAN; 8]);
        both.evaluate(at, &mut psi, &mut gradient);
        assert_eq!(psi, [0.5, 180.0, 4.5, 0.0]);
        assert_eq!(gradient, [1.0, 0.0, 3.0, 0.0, 0.0, 60.0, 0.0, 0.0]);
        let mut product = [f64::NAN; 8];
        both.product(at, &[1.0; 8], &mut product);
        assert_eq!(product, [1.0, 0.0, 1.0, 0.0, 0.0, 10.0, 0.0, 0.0]);
        both.evaluate(at, &mut psi, &mut []);
        assert_eq!(psi, [0.5, 180.0, 4.5, 0.0]);
    }
}
