//! Values for looking at a potential that no scene gives values to yet.

use crate::model::Model;
use crate::specialise::Form;
use crate::values::Setting;

impl Model {
    /// Adds the value 1 for every parameter without default and gives back their names: for looking
    /// at derivatives any value serves.
    pub fn fill_with_one(
        &self,
        dimension: usize,
        settings: &mut Vec<(String, Setting)>,
    ) -> Vec<String> {
        let Some(variant) = self.variant(dimension) else { return Vec::new() };
        let mut filled = Vec::new();
        for (parameter, default) in self.parameters().iter().zip(&variant.defaults) {
            if default.is_none() && !settings.iter().any(|(name, _)| *name == parameter.name) {
                settings.push((parameter.name.clone(), Setting::Number(1.0)));
                filled.push(parameter.name.clone());
            }
        }
        filled
    }

    /// Sets parameters with the default 0 to 1 where that brings back energies that would be
    /// dropped: a check must look at every energy. Gives back their names.
    pub fn switch_on(
        &self,
        dimension: usize,
        settings: &mut Vec<(String, Setting)>,
        horizon: Option<f64>,
    ) -> Vec<String> {
        let dropped = |settings: &[(String, Setting)]| {
            let values = self.values(dimension, settings, horizon).ok()?;
            let gradient = self.specialise_gradient(&values, Form::Textbook).ok()?.1;
            let coupled = self.coupled().into_iter().map(|clique| {
                let made = self.specialise_coupled(&values, clique, Form::Textbook).ok()?;
                Some(made.1.len())
            });
            let coupled: usize = coupled.sum::<Option<usize>>()?;
            let gathered = self.dropped_of_gathered(&values).ok()?;
            Some(self.specialise(&values).ok()?.dropped.len() + gradient.len() + coupled + gathered)
        };
        let Some(variant) = self.variant(dimension) else { return Vec::new() };
        let mut switched = Vec::new();
        for (parameter, default) in self.parameters().iter().zip(&variant.defaults) {
            if *default != Some(0.0) || settings.iter().any(|(name, _)| *name == parameter.name) {
                continue;
            }
            let before = dropped(settings);
            settings.push((parameter.name.clone(), Setting::Number(1.0)));
            if before.is_some() && dropped(settings) < before {
                switched.push(parameter.name.clone());
            } else {
                settings.pop();
            }
        }
        switched
    }
}
