//! Derivatives by `F` of numbers made of tensors, and what tensors change by in a direction `H`.

use super::NotInTensors;
use super::algebra::{
    Algebra, Factor, Invariant, Made, Number, Tensor, Term, depends, transposed, transposed_word,
};
use crate::differentiate::derivative_by;
use crate::expression::{Input, Node, NodeId, Operator};

impl Algebra {
    /// `dpsi/dF = sum_k dpsi/dI_k dI_k/dF`
    pub(crate) fn stress(&mut self, psi: NodeId) -> Made {
        let mut stress = Vec::new();
        for number in 0..self.invariants.len() {
            let one = self.graph.number(1.0)?;
            let slope = derivative_by(&mut self.graph, psi, &|_, input| {
                Ok((input == Input::Variable(number as u8)).then_some(one))
            })?;
            let Some(slope) = slope else { continue };
            let gradient = self.gradient(number)?;
            let part = self.scaled(&gradient, slope)?;
            stress = self.sum(&stress, &part)?;
        }
        Ok(stress)
    }

    /// `dI/dF` of the invariant with this number.
    fn gradient(&mut self, number: usize) -> Made {
        match self.invariants[number].clone() {
            // Not an input of psi.
            Invariant::JacobianRate => Ok(Vec::new()),
            Invariant::Jacobian => {
                let gradient = self.letters(vec![Factor::GradientTransposed])?;
                let (inverse, jacobian) = (self.inverse(&gradient)?, self.jacobian()?);
                self.scaled(&inverse, jacobian)
            }
            Invariant::Trace(word) => {
                let unit = self.letters(Vec::new())?;
                self.adjoint_of_word(&word, &unit)
            }
            Invariant::Determinant(tensor) => {
                let inverse = self.inverse(&transposed(&tensor))?;
                let determinant = self.invariant(Invariant::Determinant(tensor.clone()))?;
                let outer = self.scaled(&inverse, determinant)?;
                self.adjoint(&tensor, &outer)
            }
            Invariant::OfStretch(function) => {
                let slope = self.over_stretch(function)?;
                let function = self.of_stretch(slope)?;
                let gradient = self.letters(vec![Factor::Gradient])?;
                self.product(&gradient, &function)
            }
        }
    }

    /// `h'(s)/s`: `d tr(h(U)) = tr(h'(U) U^-1 dC)/2`.
    fn over_stretch(&mut self, function: NodeId) -> Number {
        let one = self.graph.number(1.0)?;
        let slope = derivative_by(&mut self.graph, function, &|_, input| {
            Ok((input == Input::Stretch(0)).then_some(one))
        })?;
        let slope = slope.map_or_else(|| self.graph.number(0.0), Ok)?;
        let stretch = self.graph.input(Input::Stretch(0))?;
        Ok(self.graph.divide(slope, stretch)?)
    }

    /// A function of `U` as a tensor, with what does not vary in front.
    fn of_stretch(&mut self, function: NodeId) -> Made {
        let of_stretch = |algebra: &Algebra, node| {
            depends(algebra.graph.graph(), node, |input| input == Input::Stretch(0))
        };
        let one = self.graph.number(1.0)?;
        let (mut front, mut rest) = (one, one);
        let mut wanted = vec![(function, false)];
        while let Some((node, divides)) = wanted.pop() {
            match self.graph.graph()[node] {
                Node::Binary(Operator::Multiply, x, y) => {
                    wanted.extend([(y, divides), (x, divides)]);
                }
                Node::Binary(Operator::Divide, x, y) => {
                    wanted.extend([(y, !divides), (x, divides)]);
                }
                _ => {
                    let part = if of_stretch(self, node) { &mut rest } else { &mut front };
                    *part = match divides {
                        true => self.graph.divide(*part, node)?,
                        false => self.graph.multiply(*part, node)?,
                    };
                }
            }
        }
        let stretch = self.graph.input(Input::Stretch(0))?;
        let cancelled =
            self.graph.graph()[rest] == Node::Binary(Operator::Divide, stretch, stretch);
        let word = match cancelled || !of_stretch(self, rest) {
            true => Vec::new(),
            false => vec![Factor::OfStretch(rest)],
        };
        let tensor = self.letters(word)?;
        self.scaled(&tensor, front)
    }

    /// What `B : dA` makes of `dF`.
    fn adjoint(&mut self, tensor: &Tensor, outer: &Tensor) -> Made {
        let mut sum = Vec::new();
        for Term { coefficient, word } in tensor {
            let outer = self.scaled(outer, *coefficient)?;
            let part = self.adjoint_of_word(word, &outer)?;
            sum = self.sum(&sum, &part)?;
        }
        Ok(sum)
    }

    fn adjoint_of_word(&mut self, word: &[Factor], outer: &Tensor) -> Made {
        let mut sum = Vec::new();
        for (k, factor) in word.iter().enumerate() {
            let before = self.letters(transposed_word(&word[..k]))?;
            let behind = self.letters(transposed_word(&word[k + 1..]))?;
            let outer = self.product(&before, outer)?;
            let outer = self.product(&outer, &behind)?;
            let part = self.adjoint_of_factor(factor, &outer)?;
            sum = self.sum(&sum, &part)?;
        }
        Ok(sum)
    }

    fn adjoint_of_factor(&mut self, factor: &Factor, outer: &Tensor) -> Made {
        match factor {
            Factor::Gradient => Ok(outer.clone()),
            Factor::GradientTransposed => Ok(transposed(outer)),
            Factor::CauchyGreen | Factor::Strain => {
                let symmetric = self.symmetric(outer)?;
                let gradient = self.letters(vec![Factor::Gradient])?;
                let once = self.product(&gradient, &symmetric)?;
                if *factor == Factor::Strain { Ok(once) } else { self.scaled_by(&once, 2.0) }
            }
            Factor::Inverse(inner) => {
                // B : d(A^-1) = -(A^-T B A^-T) : dA
                let inverse = self.inverse(&transposed(inner))?;
                let outer = self.product(&inverse, outer)?;
                let outer = self.product(&outer, &inverse)?;
                let outer = self.scaled_by(&outer, -1.0)?;
                self.adjoint(inner, &outer)
            }
            Factor::Deviator(inner) => {
                let outer = self.deviator(outer)?;
                self.adjoint_of_word(inner, &outer)
            }
            Factor::Dyad(_) => Ok(Vec::new()),
            // Only traces of functions of `U` are numbers, and directions are in no energy.
            Factor::OfStretch(_)
            | Factor::Direction
            | Factor::DirectionTransposed
            | Factor::CauchyGreenRate
            | Factor::StrainRate
            | Factor::OfStretchRate(_) => Err(NotInTensors::TooLong),
        }
    }

    /// What a tensor changes by where `F` changes by `H`.
    pub(crate) fn rate(&mut self, tensor: &Tensor) -> Made {
        let mut sum = Vec::new();
        for Term { coefficient, word } in tensor {
            if let Some(rate) = self.rate_of_number(*coefficient)? {
                sum = self.sum(&sum, &vec![Term { coefficient: rate, word: word.clone() }])?;
            }
            let rate = self.rate_of_word(word)?;
            let part = self.scaled(&rate, *coefficient)?;
            sum = self.sum(&sum, &part)?;
        }
        Ok(sum)
    }

    fn rate_of_word(&mut self, word: &[Factor]) -> Made {
        let mut sum = Vec::new();
        for (k, factor) in word.iter().enumerate() {
            let (before, behind) =
                (self.letters(word[..k].to_vec())?, self.letters(word[k + 1..].to_vec())?);
            let rate = self.rate_of_factor(factor)?;
            let part = self.product(&before, &rate)?;
            let part = self.product(&part, &behind)?;
            sum = self.sum(&sum, &part)?;
        }
        Ok(sum)
    }

    fn rate_of_factor(&mut self, factor: &Factor) -> Made {
        let letter = match factor {
            Factor::Gradient => Factor::Direction,
            Factor::GradientTransposed => Factor::DirectionTransposed,
            Factor::CauchyGreen => Factor::CauchyGreenRate,
            Factor::Strain => Factor::StrainRate,
            Factor::OfStretch(function) => Factor::OfStretchRate(*function),
            Factor::Inverse(inner) => {
                let rate = self.rate(inner)?;
                let inverse = self.letters(vec![factor.clone()])?;
                let product = self.product(&inverse, &rate)?;
                let product = self.product(&product, &inverse)?;
                return self.scaled_by(&product, -1.0);
            }
            Factor::Deviator(inner) => {
                let rate = self.rate_of_word(inner)?;
                return self.deviator(&rate);
            }
            Factor::Dyad(_)
            | Factor::Direction
            | Factor::DirectionTransposed
            | Factor::CauchyGreenRate
            | Factor::StrainRate
            | Factor::OfStretchRate(_) => return Ok(Vec::new()),
        };
        self.letters(vec![letter])
    }

    /// What a number changes by, nothing where it does not vary.
    pub(super) fn rate_of_number(
        &mut self,
        number: NodeId,
    ) -> Result<Option<NodeId>, NotInTensors> {
        let mut rates = Vec::new();
        for k in 0..self.invariants.len() {
            let input = Input::Variable(k as u8);
            let varies = depends(self.graph.graph(), number, |known| known == input);
            rates.push(if varies { Some(self.rate_of_invariant(k)?) } else { None });
        }
        let rate = derivative_by(&mut self.graph, number, &|_, input| match input {
            Input::Variable(k) => Ok(rates.get(usize::from(k)).copied().flatten()),
            _ => Ok(None),
        })?;
        Ok(rate)
    }

    fn rate_of_invariant(&mut self, number: usize) -> Number {
        match self.invariants[number].clone() {
            Invariant::Jacobian => self.invariant(Invariant::JacobianRate),
            Invariant::Trace(word) => {
                let rate = self.rate_of_word(&word)?;
                self.trace(&rate)
            }
            Invariant::Determinant(tensor) => {
                let (inverse, rate) = (self.inverse(&tensor)?, self.rate(&tensor)?);
                let product = self.product(&inverse, &rate)?;
                let trace = self.trace(&product)?;
                let determinant = self.invariant(Invariant::Determinant(tensor))?;
                Ok(self.graph.multiply(determinant, trace)?)
            }
            Invariant::OfStretch(function) => {
                let slope = self.over_stretch(function)?;
                let slope = self.of_stretch(slope)?;
                let rate = self.letters(vec![Factor::CauchyGreenRate])?;
                let product = self.product(&slope, &rate)?;
                let half = self.scaled_by(&product, 0.5)?;
                self.trace(&half)
            }
            Invariant::JacobianRate => Ok(self.graph.number(0.0)?),
        }
    }
}
