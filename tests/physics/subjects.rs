//! What the laws of mechanics are tried on: every potential of the library, with all its energies
//! switched on, on random clouds and small lattices that are strained by some 20 %.

use std::fs;

use crate::support::{Outcome, Random, SceneFolder, repository, to_csv};
use crate::witness::{Points, Weights, Witness};
use piola_compiler::{Model, Setting, Values, check};

/// A potential with parameter values.
pub(crate) struct Material {
    pub(crate) potential: &'static str,
    pub(crate) dimension: usize,
    /// Name, value in SI units, length exponent `k` of its unit J/m^k.
    pub(crate) parameters: Vec<(&'static str, f64, i32)>,
    /// Whether bonds, triangles and tetrahedra have an energy.
    pub(crate) modelled: [bool; 3],
}

/// Coefficients that give the three kinds of interaction energies of like size in [`bodies`].
const C: [f64; 3] = [1.3, 25.0, 700.0];

/// Every potential of the library in every dimension in which it is defined; the Seth-Hill family
/// with all its special exponents and a general one.
pub(crate) fn materials() -> Vec<Material> {
    let mut found = Vec::new();
    for entry in fs::read_dir(repository("potentials")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "piola") {
            let stem = path.file_stem().unwrap().to_str().unwrap();
            found.extend(of_the_library(stem));
        }
    }
    found.sort_by_key(|material| (material.potential, material.dimension));
    assert!(found.len() >= 18, "the library has potentials");
    found
}

fn of_the_library(name: &str) -> Vec<Material> {
    let three_kinds = |potential: &'static str, exponent: Option<f64>| {
        [2_usize, 3].map(|dimension| {
            let d = dimension as i32;
            let lengths = [2 * d + 1, 3 * d + 2, 4 * d + 3];
            let coefficients = ["C1", "C2", "C3"].into_iter().zip(C).zip(lengths);
            // In the plane there are no volumes to resist.
            let mut parameters: Vec<(&str, f64, i32)> =
                coefficients.take(dimension).map(|((name, c), k)| (name, c, k)).collect();
            parameters.extend(exponent.map(|n| ("n", n, 0)));
            let modelled = [true, true, dimension == 3];
            Material { potential, dimension, parameters, modelled }
        })
    };
    let bonds_in_space = |potential: &'static str| Material {
        potential,
        dimension: 3,
        parameters: vec![("K", 1.7, 3)],
        modelled: [true, false, false],
    };
    let bonds = |potential: &'static str, coefficient: &'static str, value: f64| {
        [2_usize, 3].map(|dimension| Material {
            potential,
            dimension,
            parameters: vec![(coefficient, value, 2 * dimension as i32 + 1)],
            modelled: [true, false, false],
        })
    };
    match name {
        "javili2020" => three_kinds("javili2020", None).into(),
        "javili2020_brittle" => three_kinds("javili2020_brittle", None).into(),
        "logarithmic" => three_kinds("logarithmic", None).into(),
        "firooz2023" => [-2.0, -1.0, 0.0, 0.5, 1.0, 2.0]
            .into_iter()
            .flat_map(|n| three_kinds("firooz2023", Some(n)))
            .collect(),
        "silling2000" => vec![bonds_in_space("silling2000")],
        "kelvin_voigt" => vec![bonds_in_space("kelvin_voigt")],
        "prototype_microelastic_brittle" => vec![bonds_in_space("prototype_microelastic_brittle")],
        // Bonds that remember: `runtime/tests/motion/states` tries them.
        "bilinear_softening"
        | "exponential_softening"
        | "micro_plastic"
        | "fatigue"
        | "standard_linear_solid" => Vec::new(),
        "miranda_modified_stretch" => vec![bonds_in_space("miranda_modified_stretch")],
        "miranda_modified_stretch_brittle" => {
            vec![bonds_in_space("miranda_modified_stretch_brittle")]
        }
        "tension_only" => bonds("tension_only", "C1", C[0]).into(),
        // As stiff at rest: psi'' = 2*alpha^2*D/L with alpha = 3, and 72*D/L.
        "morse" => bonds("morse", "D", C[0] / 18.0).into(),
        "lennard_jones" => bonds("lennard_jones", "D", C[0] / 72.0).into(),
        // Energies of deformation gradients: `gradients` tries them.
        _ if crate::gradients::MATERIALS.iter().any(|(known, _)| *known == name) => Vec::new(),
        // Bonds by their direction: `runtime/tests/mechanics/directions` tries them.
        "fibre_bonds" => Vec::new(),
        // Energies of several measures: `runtime/tests/mechanics/coupled` tries them.
        "harmonic_angles" => Vec::new(),
        // What points gather: `runtime/tests/states` tries it.
        "linear_peridynamic_solid" | "linear_peridynamic_solid_brittle" | "logarithmic_states" => {
            Vec::new()
        }
        _ => panic!("`{name}` is new in the library: say here how it is to be tried"),
    }
}

impl Material {
    /// For messages.
    pub(crate) fn label(&self) -> String {
        let exponent = self.parameters.iter().find(|p| p.0 == "n");
        let exponent = exponent.map(|n| format!(" n = {}", n.1)).unwrap_or_default();
        format!("{}{exponent} in {}D", self.potential, self.dimension)
    }

    /// How much it magnifies the rounding of a length, where that is more than a few roundings.
    pub(crate) fn magnification(&self) -> f64 {
        match self.potential {
            // psi'' has the fourteenth power.
            "lennard_jones" => 14.0,
            // Few bonds are left, pulled by some tenth: a rounding of the length is ten of the strain.
            "tension_only" => 10.0,
            _ => 1.0,
        }
    }

    pub(crate) fn model(&self) -> Model {
        let path = repository("potentials").join(format!("{}.piola", self.potential));
        let text = fs::read_to_string(path).unwrap();
        check(&piola_grammar::parse(&text).unwrap()).unwrap()
    }

    pub(crate) fn values(&self, model: &Model, horizon: f64) -> Values {
        let settings: Vec<(String, Setting)> = self
            .parameters
            .iter()
            .map(|(name, value, _)| (name.to_string(), Setting::Number(*value)))
            .collect();
        model.values(self.dimension, &settings, Some(horizon)).unwrap()
    }

    /// The table `parameters` of a scene whose unit of length is `1/scale` m.
    pub(crate) fn table(&self, scale: f64) -> String {
        let entry = |(name, value, lengths): &(&str, f64, i32)| {
            let power = (0..*lengths).fold(1.0, |power, _| power * scale);
            format!("{name} = {:?}", value / power)
        };
        let entries: Vec<String> = self.parameters.iter().map(entry).collect();
        format!("{{ {} }}", entries.join(", "))
    }
}

/// A body with the way its interactions reach and count, and a strained state.
pub(crate) struct Subject {
    pub(crate) label: &'static str,
    pub(crate) points: Points,
    pub(crate) horizon: f64,
    pub(crate) weights: Weights,
    pub(crate) u: Vec<f64>,
    /// How much the flattest clique magnifies rounding.
    pub(crate) magnification: f64,
}

/// Spacing of the points in m: not 1, so that a missing length shows.
const SPACING: f64 = 0.4;

/// Clouds and lattices in two or three dimensions, with all weights that suit them.
pub(crate) fn bodies(dimension: usize) -> Vec<Subject> {
    let (cloud, lattice): (&[usize], &[usize]) = match dimension {
        2 => (&[5, 4], &[5, 4]),
        _ => (&[3, 3, 2], &[3, 2, 3]),
    };
    // sqrt(2) spacings and a little more in space keep the number of tetrahedra small.
    let horizon = if dimension == 2 { 2.1 * SPACING } else { 1.5 * SPACING };
    let subject = |label, points: Points, weights, seed| {
        let (u, magnification) = strained(&points, horizon, seed);
        Subject { label, points, horizon, weights, u, magnification }
    };
    vec![
        subject("cloud, truncated", points(cloud, 0.25, 3), Weights::Truncated, 5),
        subject("cloud, volumes", points(cloud, 0.25, 8), Weights::Volumes, 6),
        subject("cloud, unit", points(cloud, 0.25, 9), Weights::Unit, 7),
        subject("lattice, uniform", points(lattice, 0.0, 1), Weights::Uniform, 8),
    ]
}

/// A lattice whose points are moved by up to `jitter` spacings, with volumes that vary by 3; the
/// lattice itself where that is 0. Last axis fastest.
fn points(counts: &[usize], jitter: f64, seed: u64) -> Points {
    let mut random = Random(seed);
    let dimension = counts.len();
    let total: usize = counts.iter().product();
    let volume = (0..dimension).fold(1.0, |product, _| product * SPACING);
    let mut points = Points {
        dimension,
        positions: Vec::new(),
        volumes: Vec::new(),
        spacing: (jitter == 0.0).then_some(SPACING),
    };
    for index in 0..total {
        let (mut rest, mut place) = (index, vec![0; dimension]);
        for axis in (0..dimension).rev() {
            place[axis] = rest % counts[axis];
            rest /= counts[axis];
        }
        for i in place {
            let noise = if jitter == 0.0 { 0.0 } else { jitter * SPACING * random.next() };
            points.positions.push(i as f64 * SPACING + noise);
        }
        let factor = if jitter == 0.0 { 1.0 } else { 1.0 + 0.5 * random.next() };
        points.volumes.push(volume * factor);
    }
    points
}

/// Displacements with a gradient of some 20 % and noise of some per cent of the spacing. Of several
/// random ones the first that keeps every measure above a third of its reference: nearly flat
/// triangles and tetrahedra of a cloud turn inside out easily. Also the body's magnification.
fn strained(points: &Points, horizon: f64, seed: u64) -> (Vec<f64>, f64) {
    let material = &of_the_library("javili2020")[points.dimension - 2];
    let model = material.model();
    let values = material.values(&model, horizon);
    let witness = Witness::new(points, horizon, Weights::Unit, &model, &values);
    let d = points.dimension;
    for attempt in 0..1000 {
        let mut random = Random(1000 * seed + attempt);
        let gradient = random.vector(d * d);
        let mut u = Vec::new();
        for position in points.positions.chunks_exact(d) {
            for row in 0..d {
                let linear: f64 = (0..d).map(|c| gradient[row * d + c] * position[c]).sum();
                u.push(0.2 * linear + 0.02 * SPACING * random.next());
            }
        }
        if witness.smallest_ratio(&u) > 1.0 / 3.0 {
            return (u, witness.magnification());
        }
    }
    panic!("no state without inversion was found");
}

impl Subject {
    /// Whether any bond is longer than at rest by a tenth.
    pub(crate) fn is_pulled(&self) -> bool {
        let d = self.points.dimension;
        let rest = &self.points.positions;
        let now: Vec<f64> = rest.iter().zip(&self.u).map(|(x, u)| x + u).collect();
        let length = |x: &[f64], i: usize, j: usize| {
            let square = (0..d)
                .map(|k| {
                    let change = x[i * d + k] - x[j * d + k];
                    change * change
                })
                .sum::<f64>();
            square.sqrt()
        };
        let n = self.points.volumes.len();
        let mut bonds = (0..n).flat_map(|i| (0..i).map(move |j| (i, j)));
        bonds.any(|(i, j)| {
            let reference = length(rest, i, j);
            reference < self.horizon && length(&now, i, j) > 1.1 * reference
        })
    }

    /// The scene of this body with coordinates and parameters in a unit of `1/scale` m.
    pub(crate) fn folder(&self, material: &Material, scale: f64) -> SceneFolder {
        let d = self.points.dimension;
        let header = ["x,y,volume", "x,y,z,volume"][d - 2];
        let volume_scale = (0..d).fold(1.0, |power, _| power * scale);
        let body = match self.points.spacing {
            None => "points = \"cloud.csv\"".to_string(),
            Some(spacing) => {
                let high: Vec<f64> = self.points.positions[self.points.positions.len() - d..]
                    .iter()
                    .map(|x| x * scale)
                    .collect();
                let (low, spacing) = (vec![0.0; d], spacing * scale);
                format!(
                    "box = [{low:?}, {high:?}]\nspacing = {spacing:?}\nnodes = \"corners-full\""
                )
            }
        };
        let folder = SceneFolder::new(&format!(
            "[body]\ndimension = {d}\n{body}\n\
             [horizon]\nradius = {:?}\nweights = \"{}\"\n\
             [material]\npotential = \"{}\"\nparameters = {}\n",
            self.horizon * scale,
            self.weights.key(),
            material.potential,
            material.table(scale)
        ));
        let rows = self.points.positions.chunks_exact(d).zip(&self.points.volumes);
        let row = |(x, v): (&[f64], &f64)| {
            x.iter().map(|x| x * scale).chain([v * volume_scale]).collect::<Vec<f64>>()
        };
        folder.file("cloud.csv", to_csv(header, &rows.flat_map(row).collect::<Vec<f64>>()));
        folder
    }

    /// `piola energy` of this body after a displacement in m, with a unit of length of `1/scale` m.
    pub(crate) fn energy(
        &self,
        folder: &SceneFolder,
        u: &[f64],
        scale: f64,
        more: &[&str],
    ) -> Outcome {
        let u: Vec<f64> = u.iter().map(|u| u * scale).collect();
        folder.energy(&to_csv(["u,v", "u,v,w"][self.points.dimension - 2], &u), more)
    }
}
