//! Tensors as sums of products of letters, such as `2*F*C - tr(C)*F`, and the numbers made of them.

use super::NotInTensors;
use super::monomial::Sums;
use crate::expression::{ExprGraph, Input, Node, NodeId, Operator, TooManyNodes};
use crate::simplify::Simplifier;

/// Most terms of a tensor, and most invariants.
const MAX_TERMS: usize = 64;

/// Most letters of a product.
const MAX_LETTERS: usize = 32;

/// A letter of a product of tensors.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Factor {
    /// `F`
    Gradient,
    /// `F'`
    GradientTransposed,
    /// `C = F' F`
    CauchyGreen,
    /// `E = (C - I)/2`
    Strain,
    /// A dyad of a vector of numbers that do not vary, by its number.
    Dyad(usize),
    /// A function of `U`, by what it makes of a principal stretch.
    OfStretch(NodeId),
    /// The direction `H` that `F` changes in.
    Direction,
    /// `H'`
    DirectionTransposed,
    /// What `C` changes by in that direction.
    CauchyGreenRate,
    /// What `E` changes by in that direction.
    StrainRate,
    /// What a function of `U` changes by in that direction.
    OfStretchRate(NodeId),
    /// Its coefficients do not vary.
    Inverse(Tensor),
    /// The deviator of a product.
    Deviator(Word),
}

/// A product of letters; without any it is the unit tensor.
pub(crate) type Word = Vec<Factor>;

/// A number times a product.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Term {
    pub(crate) coefficient: NodeId,
    pub(crate) word: Word,
}

/// A sum of terms, each product once.
pub(crate) type Tensor = Vec<Term>;

/// A number made of tensors, an input of the graph of numbers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Invariant {
    /// `J = det F`
    Jacobian,
    /// What `J` changes by in the direction `H`.
    JacobianRate,
    Trace(Word),
    /// Of a tensor whose coefficients do not vary.
    Determinant(Tensor),
    /// The trace of a function of `U`.
    OfStretch(NodeId),
}

/// Operations on tensors and numbers of one potential.
#[derive(Clone, Debug)]
pub(crate) struct Algebra {
    pub(crate) dimension: usize,
    /// Numbers; [`Input::Variable`] is an invariant by its number, [`Input::Stretch`] a principal stretch.
    pub(crate) graph: Simplifier,
    pub(crate) invariants: Vec<Invariant>,
    /// The vectors of dyads.
    pub(crate) vectors: Vec<Vec<NodeId>>,
}

/// A tensor, or why there is none.
pub(crate) type Made = Result<Tensor, NotInTensors>;

/// A number, or why there is none.
pub(crate) type Number = Result<NodeId, NotInTensors>;

impl Algebra {
    pub(crate) fn new(dimension: usize) -> Algebra {
        Algebra { dimension, graph: Simplifier::new(), invariants: Vec::new(), vectors: Vec::new() }
    }

    /// A product with the coefficient 1.
    pub(crate) fn letters(&mut self, word: Word) -> Made {
        Ok(vec![Term { coefficient: self.graph.number(1.0)?, word: shortened(word) }])
    }

    pub(crate) fn dyad(&mut self, vector: Vec<NodeId>) -> Made {
        let known = self.vectors.iter().position(|known| *known == vector);
        let number = known.unwrap_or(self.vectors.len());
        if known.is_none() {
            self.vectors.push(vector);
        }
        self.letters(vec![Factor::Dyad(number)])
    }

    pub(crate) fn sum(&mut self, x: &Tensor, y: &Tensor) -> Made {
        let mut sum = x.clone();
        for Term { coefficient, word } in y {
            match sum.iter_mut().find(|term| term.word == *word) {
                Some(term) => term.coefficient = self.added(term.coefficient, *coefficient)?,
                None => sum.push(Term { coefficient: *coefficient, word: word.clone() }),
            }
        }
        let graph = self.graph.graph();
        sum.retain(|term| graph.as_number(term.coefficient) != Some(0.0));
        if sum.len() > MAX_TERMS {
            return Err(NotInTensors::TooLong);
        }
        Ok(sum)
    }

    fn added(&mut self, x: NodeId, y: NodeId) -> Result<NodeId, TooManyNodes> {
        if x != y {
            return self.graph.add(x, y);
        }
        let two = self.graph.number(2.0)?;
        self.graph.multiply(two, x)
    }

    pub(crate) fn scaled(&mut self, x: &Tensor, by: NodeId) -> Made {
        let mut scaled = x.clone();
        for term in &mut scaled {
            term.coefficient = self.graph.multiply(by, term.coefficient)?;
        }
        let graph = self.graph.graph();
        scaled.retain(|term| graph.as_number(term.coefficient) != Some(0.0));
        Ok(scaled)
    }

    pub(crate) fn scaled_by(&mut self, x: &Tensor, by: f64) -> Made {
        let by = self.graph.number(by)?;
        self.scaled(x, by)
    }

    pub(crate) fn product(&mut self, x: &Tensor, y: &Tensor) -> Made {
        let mut product = Vec::new();
        for left in x {
            for right in y {
                let coefficient = self.graph.multiply(left.coefficient, right.coefficient)?;
                let word = shortened([left.word.clone(), right.word.clone()].concat());
                if word.len() > MAX_LETTERS {
                    return Err(NotInTensors::TooLong);
                }
                product = self.sum(&product, &vec![Term { coefficient, word }])?;
            }
        }
        Ok(product)
    }

    /// Coefficients over the numbers they are multiplied with: `A^-1`.
    pub(crate) fn inverse(&mut self, x: &Tensor) -> Made {
        if let [Term { coefficient, word }] = &x[..] {
            let one = self.graph.number(1.0)?;
            let coefficient = self.graph.divide(one, *coefficient)?;
            let mut inverse = Vec::new();
            for factor in word.iter().rev() {
                match factor {
                    Factor::Inverse(inner) if inner.len() == 1 => {
                        inverse.extend(inner[0].word.clone());
                    }
                    _ => inverse.push(Factor::Inverse(self.letters(vec![factor.clone()])?)),
                }
            }
            return Ok(vec![Term { coefficient, word: shortened(inverse) }]);
        }
        self.refuse_varying(x)?;
        self.letters(vec![Factor::Inverse(x.clone())])
    }

    pub(crate) fn deviator(&mut self, x: &Tensor) -> Made {
        let mut deviator = Vec::new();
        for Term { coefficient, word } in x.iter().filter(|term| !term.word.is_empty()) {
            let word = match &word[..] {
                [Factor::Deviator(_)] => word.clone(),
                _ => vec![Factor::Deviator(word.clone())],
            };
            deviator = self.sum(&deviator, &vec![Term { coefficient: *coefficient, word }])?;
        }
        Ok(deviator)
    }

    /// `(A + A')/2`
    pub(crate) fn symmetric(&mut self, x: &Tensor) -> Made {
        let mut symmetric = Vec::new();
        for term in x {
            let other = Term { word: transposed_word(&term.word), ..term.clone() };
            if other.word == term.word {
                symmetric = self.sum(&symmetric, &vec![other])?;
            } else {
                let twice = vec![term.clone(), other];
                let half = self.scaled_by(&twice, 0.5)?;
                symmetric = self.sum(&symmetric, &half)?;
            }
        }
        Ok(symmetric)
    }

    pub(crate) fn trace(&mut self, x: &Tensor) -> Number {
        let mut sum = self.graph.number(0.0)?;
        // Products of which one is another, turned around, have one trace.
        let mut turned: Tensor = Vec::new();
        for Term { coefficient, word } in x {
            let word = least_turned(word);
            turned = self.sum(&turned, &vec![Term { coefficient: *coefficient, word }])?;
        }
        for Term { coefficient, word } in turned {
            let trace = match &word[..] {
                [] => self.graph.number(self.dimension as f64)?,
                [Factor::Deviator(_)] => continue,
                _ => self.invariant(Invariant::Trace(word))?,
            };
            let part = self.graph.multiply(coefficient, trace)?;
            sum = self.graph.add(sum, part)?;
        }
        Ok(sum)
    }

    pub(crate) fn determinant(&mut self, x: &Tensor) -> Number {
        let [Term { coefficient, word }] = &x[..] else {
            if x.is_empty() {
                return Ok(self.graph.number(0.0)?);
            }
            self.refuse_varying(x)?;
            return self.invariant(Invariant::Determinant(x.clone()));
        };
        let mut product = self.graph.power(*coefficient, self.dimension as f64)?;
        for factor in word {
            let determinant = match factor {
                Factor::Gradient | Factor::GradientTransposed => self.jacobian()?,
                Factor::CauchyGreen => {
                    let jacobian = self.jacobian()?;
                    self.graph.power(jacobian, 2.0)?
                }
                Factor::Dyad(_) => self.graph.number(0.0)?,
                Factor::Inverse(inner) => {
                    let inner = self.determinant(&inner.clone())?;
                    self.graph.power(inner, -1.0)?
                }
                _ => {
                    let letter = self.letters(vec![factor.clone()])?;
                    self.invariant(Invariant::Determinant(letter))?
                }
            };
            product = self.graph.multiply(product, determinant)?;
        }
        Ok(product)
    }

    pub(crate) fn jacobian(&mut self) -> Number {
        self.invariant(Invariant::Jacobian)
    }

    /// The trace of a function of `U`.
    pub(crate) fn trace_of_stretch(&mut self, function: NodeId) -> Number {
        if depends(self.graph.graph(), function, |input| input == Input::Stretch(0)) {
            return self.invariant(Invariant::OfStretch(function));
        }
        let d = self.graph.number(self.dimension as f64)?;
        Ok(self.graph.multiply(d, function)?)
    }

    pub(crate) fn invariant(&mut self, invariant: Invariant) -> Number {
        let known = self.invariants.iter().position(|known| *known == invariant);
        let number = known.unwrap_or(self.invariants.len());
        if number >= 2 * MAX_TERMS {
            return Err(NotInTensors::TooLong);
        }
        if known.is_none() {
            self.invariants.push(invariant);
        }
        Ok(self.graph.input(Input::Variable(number as u8))?)
    }

    /// An operation on numbers.
    pub(crate) fn operation(&mut self, operator: Operator, x: NodeId, y: NodeId) -> Number {
        Ok(self.graph.make(Node::Binary(operator, x, y))?)
    }

    /// Whether a node is `J`.
    pub(crate) fn is_jacobian(&self, node: NodeId) -> bool {
        let Node::Input(Input::Variable(k)) = self.graph.graph()[node] else { return false };
        self.invariants[usize::from(k)] == Invariant::Jacobian
    }

    /// The same tensor with its coefficients as sums of products, in which some nodes stay.
    pub(crate) fn tidied(&mut self, mut tensor: Tensor, kept: &[NodeId]) -> Made {
        for term in tensor.iter_mut().filter(|term| !kept.contains(&term.coefficient)) {
            let sums = Sums {
                graph: self.graph.graph(),
                is_named: &|node| kept.contains(&node),
                is_multiplied_out: &|node| self.is_jacobian(node),
                are_numbers_multiplied_out: true,
            };
            let monomials = sums.terms_of(term.coefficient);
            let mut sum = self.graph.number(0.0)?;
            for monomial in monomials {
                let part = monomial.node(&mut self.graph)?;
                sum = self.graph.add(sum, part)?;
            }
            term.coefficient = sum;
        }
        let graph = self.graph.graph();
        tensor.retain(|term| graph.as_number(term.coefficient) != Some(0.0));
        Ok(tensor)
    }

    fn refuse_varying(&self, x: &Tensor) -> Result<(), NotInTensors> {
        let varies = |term: &Term| {
            let invariant = |input| matches!(input, Input::Variable(_));
            depends(self.graph.graph(), term.coefficient, invariant)
        };
        if x.iter().any(varies) { Err(NotInTensors::VaryingSum) } else { Ok(()) }
    }
}

/// Whether a node needs one of these inputs.
pub(crate) fn depends(graph: &ExprGraph, root: NodeId, on: impl Fn(Input) -> bool) -> bool {
    let needed = graph.reachable(&[root]);
    graph
        .nodes()
        .any(|(id, node)| matches!(node, Node::Input(input) if needed[id.0 as usize] && on(input)))
}

pub(crate) fn transposed(x: &Tensor) -> Tensor {
    let transpose = |term: &Term| Term { word: transposed_word(&term.word), ..term.clone() };
    x.iter().map(transpose).collect()
}

pub(crate) fn transposed_word(word: &[Factor]) -> Word {
    let transpose = |factor: &Factor| match factor {
        Factor::Gradient => Factor::GradientTransposed,
        Factor::GradientTransposed => Factor::Gradient,
        Factor::Direction => Factor::DirectionTransposed,
        Factor::DirectionTransposed => Factor::Direction,
        Factor::Inverse(inner) => Factor::Inverse(transposed(inner)),
        Factor::Deviator(inner) => Factor::Deviator(transposed_word(inner)),
        symmetric => symmetric.clone(),
    };
    word.iter().rev().map(transpose).collect()
}

/// The only letter of which a letter is the inverse.
pub(crate) fn inverted(factor: &Factor) -> Option<&Factor> {
    let Factor::Inverse(inner) = factor else { return None };
    match &inner[..] {
        [Term { word, .. }] if word.len() == 1 => word.first(),
        _ => None,
    }
}

/// A product in which `F' F` is `C` and no letter stands beside its inverse.
fn shortened(word: Word) -> Word {
    let mut short: Word = Vec::new();
    for factor in word {
        short.push(factor);
        while let [.., x, y] = &short[..] {
            let with = match (x, y) {
                (Factor::GradientTransposed, Factor::Gradient) => Some(Factor::CauchyGreen),
                _ if inverted(x) == Some(y) || inverted(y) == Some(x) => None,
                _ => break,
            };
            short.truncate(short.len() - 2);
            short.extend(with);
        }
    }
    short
}

/// The first in order of all products with the same trace: those turned around and transposed.
fn least_turned(word: &[Factor]) -> Word {
    let turned = |word: Word| -> Vec<Word> {
        let turn = |k| shortened([&word[k..], &word[..k]].concat());
        (0..word.len()).map(turn).collect()
    };
    let all = [turned(word.to_vec()), turned(transposed_word(word))].concat();
    all.into_iter().min_by_key(|word| (word.len(), word.clone())).unwrap_or_default()
}
