//! Short ways from text to models for the tests of this crate.

use crate::{Model, Setting, Values, check};

pub(crate) fn model(text: &str) -> Model {
    let ast = piola_grammar::parse(text).unwrap_or_else(|e| panic!("{e:#?}"));
    check(&ast).unwrap_or_else(|e| panic!("{e:#?}"))
}

pub(crate) fn codes(text: &str) -> Vec<&'static str> {
    let ast = piola_grammar::parse(text).unwrap_or_else(|e| panic!("{e:#?}"));
    check(&ast).map(|_| Vec::new()).unwrap_or_else(|e| e.iter().map(|d| d.code).collect())
}

pub(crate) fn values(model: &Model, dimension: usize, settings: &[(&str, f64)]) -> Values {
    let settings: Vec<_> =
        settings.iter().map(|(n, x)| (n.to_string(), Setting::Number(*x))).collect();
    model.values(dimension, &settings, Some(1.0)).unwrap()
}

pub(crate) const SETH_HILL: &str = include_str!("../../potentials/firooz2023.piola");
