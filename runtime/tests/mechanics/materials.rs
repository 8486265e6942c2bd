//! Bodies of several materials: energies against sums over all interactions one by one, derivatives of
//! these energies against each other, and the reference clouds.

use std::path::Path;
use std::sync::Arc;

use piola_compiler::{Form, Level, Mode, check_text};
use piola_runtime::assembly::{DiscreteEnergy, Elements, Laws};
use piola_runtime::body::Body;
use piola_runtime::case::{Case, Library};
use piola_runtime::energy::{Energy, Wanted};
use piola_runtime::kernel::{Law, Measure};
use piola_runtime::materials::{Interface, Materials};
use piola_runtime::matrix::BlockMatrix;
use piola_runtime::neighborhood::Neighborhood;
use piola_runtime::weights::Weights;
use serde_json::Value;

use crate::common::{cloud, displacements, distance, lattice, norm, numbers, reference};

/// Affine in the measure, and not.
const POTENTIALS: [&str; 2] = ["C*M*(m/M - 1)^2", "C*M*((m/M)^2 - 1)^2*(m/M)"];

/// The energies of one law, of every measure that a body has.
fn elements(psi: &str, c: f64, level: Level, d: usize) -> Elements {
    let of = |symbol: &str| {
        let own = psi.replace('C', &format!("{c:?}"));
        let own = own.replace('m', symbol).replace('M', &symbol.to_uppercase());
        format!("psi({symbol}) = {own}\n")
    };
    let measures = if d == 2 { vec!["l", "a"] } else { vec!["l", "a", "v"] };
    let all: String = measures.into_iter().map(of).collect();
    let (_, model) = check_text(&format!("potential p\n{all}")).unwrap();
    let values = model.values(d, &[], None).unwrap();
    let mut laws = Laws::default();
    for kernel in model.compile(&values, Mode::Jit(level), Form::Accurate).unwrap().kernels {
        let place = match kernel.measure() {
            Measure::Length => &mut laws.bond,
            Measure::Area => &mut laws.triangle,
            Measure::Volume => &mut laws.tetrahedron,
        };
        *place = Some(Box::new(kernel) as Box<dyn Law>);
    }
    laws.into_elements(d)
}

/// What the laws of a body have for `C`: those of three materials, and of an interface.
const C: [f64; 4] = [2.0, 11.0, 0.5, 7.0];

/// A third of the points from the left, the upper ones of the others, and the rest.
fn materials(body: &Body, interfaces: Vec<Interface>) -> Materials {
    let extent = |axis: usize| {
        let all = (0..body.n_points()).map(|point| body.position(point)[axis]);
        all.clone().fold(f64::NEG_INFINITY, f64::max) - all.fold(f64::INFINITY, f64::min)
    };
    let low = |axis: usize| {
        let all = (0..body.n_points()).map(|point| body.position(point)[axis]);
        all.fold(f64::INFINITY, f64::min)
    };
    let part = |point: usize, axis: usize| (body.position(point)[axis] - low(axis)) / extent(axis);
    let of = |point: usize| match (part(point, 0) < 0.4, part(point, 1) > 0.5) {
        (true, _) => 0,
        (_, true) => 1,
        _ => 2,
    };
    Materials::new((0..body.n_points()).map(of).collect(), interfaces).with_laws(4)
}

fn rules() -> [Vec<Interface>; 2] {
    let own = Interface::Law { between: [1, 2], law: 3 };
    [vec![], vec![Interface::As { counts: 0, as_material: 1 }, own]]
}

/// What `C` is for an interaction, from the materials of its corners: a second writing of the rules.
fn coefficient(corners: &[u8], has_rules: bool) -> f64 {
    let mut corners = corners.to_vec();
    let has = |corners: &[u8], m: u8| corners.contains(&m);
    if has_rules {
        let two = has(&corners, 1) && has(&corners, 2) && !has(&corners, 0);
        if two {
            return C[3];
        }
        if has(&corners, 1) {
            corners.iter_mut().filter(|m| **m == 0).for_each(|m| *m = 1);
        }
    }
    corners.iter().map(|m| C[usize::from(*m)]).sum::<f64>() / corners.len() as f64
}

fn determinant(x: &[Vec<f64>]) -> f64 {
    match x.len() {
        2 => x[0][0] * x[1][1] - x[0][1] * x[1][0],
        _ => (0..3)
            .map(|c| {
                let [p, q] = [(c + 1) % 3, (c + 2) % 3];
                x[0][c] * (x[1][p] * x[2][q] - x[1][q] * x[2][p])
            })
            .sum(),
    }
}

/// The measure of some points: length, area, volume; with its sign where it has one.
fn measure(x: &[Vec<f64>]) -> f64 {
    let from: Vec<Vec<f64>> =
        x[1..].iter().map(|y| y.iter().zip(&x[0]).map(|(y, x)| y - x).collect()).collect();
    let d = x[0].len();
    if from.len() == d {
        return determinant(&from);
    }
    let dot = |p: &[f64], q: &[f64]| p.iter().zip(q).map(|(p, q)| p * q).sum::<f64>();
    match &from[..] {
        [p] => dot(p, p).sqrt(),
        [p, q] => (dot(p, p) * dot(q, q) - dot(p, q) * dot(p, q)).max(0.0).sqrt(),
        _ => unreachable!("three vectors have a determinant"),
    }
}

/// The energy of all cliques, one by one.
fn by_hand(
    body: &Body,
    (horizon, psi): (f64, usize),
    (materials, has_rules): (&Materials, bool),
    u: &[f64],
) -> f64 {
    let (n, d) = (body.n_points(), body.dimension());
    let rest = |i: usize| body.position(i).to_vec();
    let now = |i: usize| -> Vec<f64> { (0..d).map(|c| rest(i)[c] + u[i * d + c]).collect() };
    let near = |i: usize, j: usize| measure(&[rest(i), rest(j)]) <= horizon * (1.0 + 1e-6);
    let mut total = 0.0;
    let mut add = |points: &[usize]| {
        let at = |place: &dyn Fn(usize) -> Vec<f64>| {
            measure(&points.iter().map(|i| place(*i)).collect::<Vec<_>>())
        };
        let (big, small) = (at(&rest), at(&now));
        let (reference, current) = (big.abs(), small * big.signum());
        if reference < 1e-9 {
            return;
        }
        let x = current / reference;
        let strain =
            if psi == 0 { (x - 1.0) * (x - 1.0) } else { (x * x - 1.0) * (x * x - 1.0) * x };
        let corners: Vec<u8> = points.iter().map(|i| materials.of(*i)).collect();
        let orders = [1.0, 2.0, 6.0][points.len() - 2];
        let weight: f64 = points.iter().map(|i| body.volumes()[*i]).product::<f64>() * orders;
        total += weight * coefficient(&corners, has_rules) * reference * strain;
    };
    for i in 0..n {
        for j in (i + 1..n).filter(|&j| near(i, j)) {
            add(&[i, j]);
            for k in (j + 1..n).filter(|&k| near(i, k) && near(j, k)) {
                add(&[i, j, k]);
                if d == 3 {
                    let all = (k + 1..n).filter(|&l| near(i, l) && near(j, l) && near(k, l));
                    all.for_each(|l| add(&[i, j, k, l]));
                }
            }
        }
    }
    total
}

/// Lattices, along rows where laws are affine, and clouds.
fn bodies() -> [(Arc<Body>, f64); 4] {
    [
        (lattice(&[0.0, 0.0], &[30, 24], 1.0), 2.1),
        (lattice(&[0.0, 0.0, 0.0], &[12, 15, 4], 1.0), 1.5),
        (cloud(&[8, 7], 1.0, 3), 2.1),
        (cloud(&[5, 4, 4], 1.0, 5), 1.5),
    ]
}

fn energy(
    (body, horizon): &(Arc<Body>, f64),
    (psi, level): (&str, Level),
    materials: &Materials,
) -> DiscreteEnergy {
    let elements = C.map(|c| elements(psi, c, level, body.dimension())).into_iter().collect();
    let neighborhood = Arc::new(Neighborhood::new(body, *horizon).unwrap());
    let materials = Some(Arc::new(materials.clone()));
    DiscreteEnergy::of_materials(
        Arc::clone(body),
        neighborhood,
        Weights::Volumes,
        materials,
        elements,
    )
    .unwrap()
}

#[test]
fn interactions_take_what_their_corners_are_made_of() {
    for of_body in &bodies() {
        let (body, horizon) = of_body;
        let u = displacements(body, 0.02, 7);
        for (has_rules, interfaces) in [false, true].into_iter().zip(rules()) {
            let materials = materials(body, interfaces);
            for (number, psi) in POTENTIALS.into_iter().enumerate() {
                let expected = by_hand(body, (*horizon, number), (&materials, has_rules), &u);
                for level in [Level::Fast, Level::Strict] {
                    let energy = energy(of_body, (psi, level), &materials);
                    let on_rows = level == Level::Fast && number == 0 && body.spacing().is_some();
                    assert_eq!(!energy.along_rows().is_empty(), on_rows, "{psi} at {level:?}");
                    let found = energy.energy(&u).unwrap().total();
                    let error = (found / expected - 1.0).abs();
                    assert!(error < 1e-12, "{psi}, {level:?}, {has_rules}: {error:e}");
                }
            }
        }
    }
}

/// Forces are derivatives of the energy, tangents and products of the forces, and forces balance.
#[test]
fn derivatives_of_bodies_of_several_materials_are_those_of_the_energy() {
    for of_body in &bodies() {
        let (body, _) = of_body;
        let (d, n) = (body.dimension(), body.positions().len());
        let (u, p) = (displacements(body, 0.02, 7), displacements(body, 1.0, 9));
        for interfaces in rules() {
            let materials = materials(body, interfaces);
            for psi in POTENTIALS {
                for level in [Level::Fast, Level::Strict] {
                    let energy = energy(of_body, (psi, level), &materials);
                    let h = 1e-5;
                    let along =
                        |h: f64| -> Vec<f64> { u.iter().zip(&p).map(|(u, p)| u + h * p).collect() };
                    let total = |h: f64| energy.energy(&along(h)).unwrap().total();
                    let forces = |h: f64| {
                        let mut forces = vec![f64::NAN; n];
                        energy.evaluate(&along(h), Wanted::Forces(&mut forces), &mut []).unwrap();
                        forces
                    };
                    let mut tangent = BlockMatrix::zeros(energy.pattern());
                    let (mut own, mut parts) = (vec![f64::NAN; n], vec![0.0; energy.parts().len()]);
                    energy
                        .evaluate(&u, Wanted::Tangent(&mut own, &mut tangent), &mut parts)
                        .unwrap();
                    let mut product = vec![f64::NAN; n];
                    energy.hessian(&u).unwrap().multiply(&p, &mut product);
                    let slope: f64 = own.iter().zip(&p).map(|(f, p)| f * p).sum();
                    let difference = (total(h) - total(-h)) / (2.0 * h);
                    let scale = norm(&own) * norm(&p);
                    assert!(
                        (slope - difference).abs() < 1e-7 * scale,
                        "{psi}: {slope} {difference}"
                    );
                    let (more, less) = (forces(h), forces(-h));
                    let differences: Vec<f64> =
                        more.iter().zip(&less).map(|(x, y)| (x - y) / (2.0 * h)).collect();
                    let errors = [
                        distance(&forces(0.0), &own),
                        distance(&tangent.multiply(&p), &product),
                        1e-6 * distance(&differences, &product),
                    ];
                    assert!(
                        errors.iter().all(|error| *error < 1e-12),
                        "{psi}, {level:?}: {errors:?}"
                    );
                    for axis in 0..d {
                        let sum: f64 = own.iter().skip(axis).step_by(d).sum();
                        assert!(sum.abs() < 1e-13 * norm(&own) * (n as f64).sqrt(), "{sum:e}");
                    }
                }
            }
        }
    }
}

/// Bodies whose points are all of one of the materials are those of that material alone.
#[test]
fn one_material_among_several_is_that_material() {
    for of_body in &bodies() {
        let (body, horizon) = of_body;
        let u = displacements(body, 0.02, 7);
        let forces = |energy: &DiscreteEnergy| {
            let mut forces = vec![0.0; u.len()];
            energy.forces(&u, &mut forces).unwrap();
            forces
        };
        for psi in POTENTIALS {
            let all = Materials::new(vec![1; body.n_points()], vec![]).with_laws(4);
            let of = |level| elements(psi, C[1], level, body.dimension());
            for level in [Level::Fast, Level::Strict] {
                let alone = DiscreteEnergy::with_elements(
                    Arc::clone(body),
                    *horizon,
                    Weights::Volumes,
                    of(level),
                );
                let found = forces(&energy(of_body, (psi, level), &all));
                assert_eq!(found, forces(&alone.unwrap()), "{psi} at {level:?}");
            }
        }
    }
}

/// The numbers of lists of lists, one after the other.
fn flat(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().flat_map(numbers).collect()
}

/// What the models of the reference are in a scene: `[[material]]`, `[correspondence]`, further tables.
struct Written {
    potential: &'static str,
    parameters: Box<dyn Fn(usize) -> String>,
    further: String,
}

fn written(state: &Value) -> Written {
    let pair = |key: &str| numbers(&state[key]);
    let lame =
        move |e: f64, nu: f64| (e * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), e / (2.0 * (1.0 + nu)));
    let model = state["model"].as_str().unwrap();
    if model == "BB" {
        let c = pair("c");
        let further = match state["mixed"].as_str().unwrap() {
            "first" => "rule = \"as\"\nas = \"one\"\n".to_string(),
            "mean" => "rule = \"mean\"\n".to_string(),
            _ => {
                format!("potential = \"bond.piola\"\nparameters = {{ c = {} }}\n", state["c_mixed"])
            }
        };
        return Written {
            potential: "bond.piola",
            parameters: Box::new(move |k| format!("{{ c = {:?} }}", c[k])),
            further: format!("[[interface]]\nbetween = [\"two\", \"one\"]\n{further}"),
        };
    }
    let (e, nu) = (pair("E"), pair("nu"));
    if model == "LPS" {
        let text = move |k: usize| {
            let (k_, g) = (e[k] / (3.0 * (1.0 - 2.0 * nu[k])), e[k] / (2.0 * (1.0 + nu[k])));
            format!("{{ K = {k_:?}, G = {g:?} }}")
        };
        return Written {
            potential: "linear_peridynamic_solid",
            parameters: Box::new(text),
            further: String::new(),
        };
    }
    let text = move |k: usize| {
        let (lambda, mu) = lame(e[k], nu[k]);
        format!("{{ lambda = {lambda:?}, mu = {mu:?} }}")
    };
    let (discretisation, influence) = match model {
        "CC" => ("nodal", "cubic-spline"),
        _ => ("bond-quadrature", "constant"),
    };
    let further = format!(
        "[correspondence]\ndiscretisation = \"{discretisation}\"\ninfluence = \"{influence}\"\n"
    );
    Written { potential: "st_venant_kirchhoff", parameters: Box::new(text), further }
}

/// The scene of a state of the reference.
fn scene(cloud: &Value, state: &Value, folder: &Path, level: &str) -> Case {
    let d = cloud["dim"].as_u64().unwrap() as usize;
    let (x, v) = (flat(&cloud["X"]), numbers(&cloud["V"]));
    let mut table = ["x,y,volume\n", "x,y,z,volume\n"][d - 2].to_string();
    for (x, v) in x.chunks(d).zip(&v) {
        x.iter().for_each(|x| table += &format!("{x:?},"));
        table += &format!("{v:?}\n");
    }
    let is_here = |x: &[f64]| {
        let axes = x.iter().zip(["X", "Y", "Z"]);
        axes.map(|(x, axis)| format!("abs({axis} - ({x:?})) < 1e-9"))
            .collect::<Vec<_>>()
            .join(" and ")
    };
    let second = x.chunks(d).zip(numbers(&cloud["material"])).filter(|(_, m)| *m == 1.0);
    let second: Vec<String> = second.map(|(x, _)| is_here(x)).collect();
    let Written { potential, parameters, further } = written(state);
    let text = format!(
        "[body]\ndimension = {d}\npoints = \"cloud.csv\"\n[horizon]\nradius = {}\nweights = \"volumes\"\n\
         [sets]\nsecond = \"{}\"\n[solver]\nlevel = \"{level}\"\n\
         [[material]]\nset = \"second\"\nname = \"two\"\npotential = \"{potential}\"\nparameters = {}\n\
         [[material]]\nname = \"one\"\npotential = \"{potential}\"\nparameters = {}\n{further}",
        cloud["delta"],
        second.join(" or "),
        parameters(1),
        parameters(0),
    );
    std::fs::write(folder.join("cloud.csv"), table).unwrap();
    std::fs::write(folder.join("scene.toml"), text).unwrap();
    let bond = "potential bond\nparameter c\npsi(l) = 1/2*c*L*(l/L - 1)^2\n";
    std::fs::write(folder.join("bond.piola"), bond).unwrap();
    let find = |name: &str| match name {
        "st_venant_kirchhoff" => {
            Some(include_str!("../../../potentials/st_venant_kirchhoff.piola"))
        }
        "linear_peridynamic_solid" => {
            Some(include_str!("../../../potentials/linear_peridynamic_solid.piola"))
        }
        _ => None,
    };
    let library = Library { find: &find, names: &[] };
    Case::read(&folder.join("scene.toml"), &[], &library).unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn two_materials_are_those_of_the_reference() {
    let file = reference("two_materials.json");
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("two_materials");
    std::fs::create_dir_all(&folder).unwrap();
    let mut count = 0;
    for state in file["states"].as_array().unwrap() {
        let cloud = &file["clouds"][state["cloud"].as_str().unwrap()];
        let d = cloud["dim"].as_u64().unwrap() as usize;
        for level in ["strict", "fast"] {
            let case = scene(cloud, state, &folder, level);
            let energy = case.energy(case.compile().unwrap()).unwrap();
            let u = case.body.from_user_order(&flat(&state["u"]), d);
            let mut forces = vec![0.0; u.len()];
            let total = energy.forces(&u, &mut forces).unwrap().total();
            let stored = state["stored"].as_f64().unwrap();
            let off = |found: &[f64], expected: &[f64]| {
                let size = expected.iter().fold(0.0_f64, |size, x| size.max(x.abs()));
                let pairs = found.iter().zip(expected);
                pairs.fold(0.0_f64, |worst, (x, y)| worst.max((x - y).abs())) / size
            };
            let pull: Vec<f64> = case.body.to_user_order(&forces, d).iter().map(|f| -f).collect();
            let mut errors = vec![(total / stored - 1.0).abs(), off(&pull, &flat(&state["force"]))];
            if !state["direction"].is_null() {
                let p = case.body.from_user_order(&flat(&state["direction"]), d);
                let mut product = vec![0.0; u.len()];
                energy.hessian(&u).unwrap().multiply(&p, &mut product);
                let product = case.body.to_user_order(&product, d);
                errors.push(off(&product, &flat(&state["hessian_times_direction"])));
            }
            println!("{} {} {level}: {errors:?}", state["model"], state["mixed"]);
            assert!(
                errors.iter().all(|error| *error < 1e-11),
                "{} {level}: {errors:?}",
                state["model"]
            );
            count += 1;
        }
    }
    assert_eq!(count, 22);
}
