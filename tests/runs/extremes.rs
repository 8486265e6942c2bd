//! Collapse, inversion, overflow and input that is no number, as the user meets them.

use crate::scenes::{LATTICE, STRIP, strip_with};
use crate::support::{Outcome, SceneFolder, number, numbers, piola};

/// A tetrahedron with edges of 1 m along the axes, listed so that the body sorts its points anew.
const POINTS: &str = "x,y,z,volume\n1,0,0,1\n0,0,0,1\n0,1,0,1\n0,0,1,1\n";

/// `piola energy` of a tetrahedron; `rows` are displacements of its points.
#[track_caller]
fn energy(potential: &str, parameters: &str, rows: &str, code: i32) -> Outcome {
    let folder = SceneFolder::new(&format!(
        "[body]\ndimension = 3\npoints = \"p.csv\"\n[horizon]\nradius = 2\nweights = \"unit\"\n\
         [material]\npotential = \"{potential}\"\nparameters = {{ {parameters} }}\n"
    ));
    folder.file("p.csv", POINTS);
    folder.file(
        "own.piola",
        "potential own\nparameter k = 1\nallow \"no-bond-energy\" \"one tetrahedron\"\n\
         psi(v) = k*V*(V/v - 1)^2\n",
    );
    folder.file(
        "bound.piola",
        "potential bound\nallow \"no-bond-energy\" \"one tetrahedron\"\n\
         domain v/V in [0.5, 2]\npsi(v) = V*(v/V - 1)^2\n",
    );
    let (scene, table) = (folder.scene(), folder.file("u.csv", format!("u,v,w\n{rows}")));
    piola(&["energy", &scene, "--displacement", &table, "--tangent"]).expect(code)
}

/// Point 0 moves onto point 1.
const MEET: &str = "-1,0,0\n0,0,0\n0,0,0\n0,0,0\n";

/// Point 3 moves onto the edge of points 0 and 1: their triangle has no area.
const COLLINEAR: &str = "0,0,0\n0,0,0\n0,0,0\n0.5,0,-1\n";

/// Point 3 moves through the plane of the others.
const MIRRORED: &str = "0,0,0\n0,0,0\n0,0,0\n0,0,-2\n";

#[test]
fn e07_points_that_meet_are_named_unless_the_energy_is_smooth() {
    for n in [2, 4] {
        let smooth = energy("firooz2023", &format!("C1 = 1.0, n = {n}"), MEET, 0).json();
        let all = [numbers(&smooth["gradient"]), numbers(&smooth["tangent"]["values"])].concat();
        assert!(all.iter().all(|x| x.is_finite()), "n = {n}");
        // The bond of the two points does not pull, and the others of point 1 are as at rest.
        assert_eq!(numbers(&smooth["gradient"])[3..6], [0.0; 3]);
    }
    let said = [
        "bond of the points 1, 0",
        "l = 0e0, L = 1e0",
        "point 0 at (1, 0, 0) m, displaced by (-1, 0, 0) m",
    ];
    let kink = energy("firooz2023", "C1 = 3.0", MEET, 2).says(&said);
    kink.says(&["psi(l) = 1/2*C1*L*S(l/L)^2", "C1 = 3e0, n = 1e0", "psi'(l) = -3e0 at l = 0"]);
    energy("firooz2023", "C1 = 1.0, n = 0", MEET, 2)
        .says(&said)
        .says(&["ln(l/L) is -inf with l/L = 0e0"]);
    energy("firooz2023", "C1 = 1.0, n = -1", MEET, 2)
        .says(&said)
        .says(&["(l/L)^n is inf with l/L = 0e0"]);
}

#[test]
fn e08_a_triangle_without_area_is_named_unless_the_energy_is_smooth() {
    for n in [2, 4] {
        let parameters = format!("C1 = 1.0, C2 = 1.0, n = {n}");
        let smooth = energy("firooz2023", &parameters, COLLINEAR, 0).json();
        let all = [numbers(&smooth["gradient"]), numbers(&smooth["tangent"]["values"])].concat();
        assert!(all.iter().all(|x| x.is_finite()), "n = {n}");
    }
    let said = ["triangle of the points 1, 3, 0", "a = 0e0, A = 1e0", "psi(a)"];
    energy("firooz2023", "C1 = 1.0, C2 = 1.0", COLLINEAR, 2)
        .says(&said)
        .says(&["psi'(a) = -1e0 at a = 0"]);
    energy("firooz2023", "C1 = 1.0, C2 = 1.0, n = 0", COLLINEAR, 2)
        .says(&said)
        .says(&["ln(a/A) is -inf"]);
}

#[test]
fn e10_a_tetrahedron_turned_inside_out_is_named_where_the_energy_forbids_it() {
    for n in [1, 2, 4] {
        let parameters = format!("C1 = 1.0, C3 = 1.0, n = {n}");
        let mirrored = energy("firooz2023", &parameters, MIRRORED, 0).json();
        // n = 2 and n = 4 have a second minimum at v/V = -1.
        assert_eq!(number(&mirrored["energy_parts"]["psi(v)"]) == 0.0, n != 1, "{n}");
    }
    let said = ["psi(v) forbids that the tetrahedron", "turns inside out: v = -1e0, V = 1e0"];
    let points = ["of the points 1, 2, 3, 0", "point 3 at (0, 0, 1) m, displaced by (0, 0, -2) m"];
    for (n, why) in [
        ("0", "ln(v/V) is NaN with v/V = -1e0"),
        ("0.5", "is NaN"),
        ("-1", "(v/V)^n is inf with v/V = 0e0"),
    ] {
        let parameters = format!("C1 = 1.0, C3 = 1.0, n = {n}");
        energy("firooz2023", &parameters, MIRRORED, 2).says(&said).says(&points).says(&[why]);
    }
    energy("own.piola", "k = 2", MIRRORED, 2)
        .says(&said)
        .says(&["V/v is inf with V = 1e0, v = 0e0"]);
    energy("bound.piola", "", MIRRORED, 2).says(&said).says(&["the declared domain of v/V"]);
}

/// St Venant-Kirchhoff is finite for a body in its mirror; a declared domain of J refuses it.
#[test]
fn e19_a_place_outside_the_declared_domain_of_j_is_named() {
    let body = |domain: &str, energy: &str| {
        let folder = SceneFolder::new(
            "[body]\ndimension = 2\npoints = \"p.csv\"\n[horizon]\nradius = 1.6\n\
             [material]\npotential = \"own.piola\"\nparameters = { mu = 1.0 }\n",
        );
        let own = format!("potential own\nparameter mu in Pa\npsi(F) = {energy}\n{domain}");
        folder.file("own.piola", own);
        let places = || (0..4).flat_map(|i| (0..4).map(move |j| (i, j)));
        let points: String = places().map(|(i, j)| format!("{i},{j},1\n")).collect();
        folder.file("p.csv", format!("x,y,volume\n{points}"));
        let mirror: String = places().map(|(i, _)| format!("{},0\n", -2 * i)).collect();
        let table = folder.file("u.csv", format!("u,v\n{mirror}"));
        piola(&["energy", &folder.scene(), "--displacement", &table])
    };
    let energy = "mu*(E : E)";
    body("", energy).expect(0);
    body("domain J in [-2, 2)\n", energy).expect(0);
    let refused = body("domain J in (0, inf)\n", energy).expect(2);
    refused.says(&[
        "psi(F) is declared for J in (0, inf) alone, and J = -",
        "for the bond of the points ",
        "displaced by",
    ]);
    body("domain J in (0, inf)\n", "mu/2*(tr(C) - d - 2*ln(J))")
        .expect(2)
        .says(&["declared for J"]);
    body("", "mu/2*(tr(C) - d - 2*ln(J))").expect(2).says(&["is not finite for the bond"]);
    // A mirror has `tr(C) = d`: what else is declared is named where it may have been left.
    body("domain tr(C) in (1, 3)\n", energy).expect(0);
    let refused = body("domain tr(C) in (3, inf)\n", energy).expect(2);
    refused.says(&["is not finite for the bond", "psi(F) is declared for tr(C) in (3, inf) alone"]);
}

#[test]
fn e13_an_overflow_is_named_and_finite_numbers_are_kept() {
    let far = "1e60,0,0\n0,0,0\n0,0,0\n0,0,0\n";
    energy("firooz2023", "C1 = 1.0, n = 4", far, 2).says(&[
        "bond of the points",
        "l = 1e60",
        "is inf",
    ]);
    let kept = energy("firooz2023", "C1 = 1.0", "1e150,0,0\n0,0,0\n0,0,0\n0,0,0\n", 0).json();
    assert!(numbers(&kept["gradient"]).iter().all(|x| x.is_finite()));
}

/// The apex of the tetrahedron is moved through its base.
fn crossing(n: &str) -> SceneFolder {
    let folder = SceneFolder::new(&format!(
        "[body]\ndimension = 3\npoints = \"p.csv\"\n[horizon]\nradius = 2\nweights = \"unit\"\n\
         [material]\npotential = \"firooz2023\"\nparameters = {{ C1 = 1.0, C3 = 1.0, n = {n} }}\n\
         [sets]\nbase = \"Z < 0.5\"\napex = \"Z > 0.5\"\n\
         [[prescribe]]\nset = \"base\"\nu = [0, 0, 0]\n\
         [[prescribe]]\nset = \"apex\"\nu = [0, 0, \"-2*t\"]\n[steps]\nincrements = 4\n"
    ));
    folder.file("p.csv", POINTS);
    folder
}

#[test]
fn e10_a_run_ends_before_the_turn_or_counts_it() {
    let through = crossing("2");
    through.run(&[]).expect(0).says(&["0 triangles and 1 tetrahedra are turned inside out"]);
    let steps = through.summary()["steps"].as_array().unwrap().clone();
    let turned: Vec<f64> = steps.iter().map(|s| number(&s["inverted"]["tetrahedra"])).collect();
    assert_eq!(turned, [0.0, 0.0, 1.0, 1.0]);
    for n in ["0", "-1"] {
        let stopped = crossing(n);
        stopped.run(&[]).expect(3).says(&[
            "forbids that the tetrahedron",
            "turns inside out",
            "is ",
        ]);
        let summary = stopped.summary();
        assert_eq!(summary["exit_reason"], "non_finite");
        let steps = summary["steps"].as_array().unwrap();
        let last = number(&steps.last().unwrap()["t"]);
        // Every step went at most 0.9 of the way to the turn at t = 1/2.
        assert!((0.49..0.5).contains(&last), "n = {n}: {last}");
        let times: Vec<f64> = steps.iter().map(|step| number(&step["t"])).collect();
        let before = std::iter::once(&0.0).chain(&times);
        assert!(times.iter().zip(before).all(|(t, from)| t - from <= 0.901 * (0.5 - from)));
    }
}

#[test]
fn the_condition_of_the_tangent_is_in_the_summary() {
    let folder = strip_with("frames = 4", "frames = 1");
    folder.run(&[]).expect(0);
    let summary = folder.summary();
    let last = summary["steps"].as_array().unwrap().last().unwrap().clone();
    let condition = number(&last["condition"]);
    assert!((1.0..1e6).contains(&condition), "{condition}");
    assert_eq!(number(&last["displacement_error"]), condition * f64::EPSILON / 2.0);
    assert_eq!(numbers(&serde_json::json!([last["inverted"]["triangles"]])), [0.0]);
    folder.run(&["--force", "--set", "solver.linear=\"cg\""]).expect(0);
    let last = folder.summary()["steps"].as_array().unwrap().last().unwrap().clone();
    let ratio = number(&last["condition"]) / condition;
    assert!((0.3..1.1).contains(&ratio), "{ratio}");
}

#[test]
fn a_tolerance_below_rounding_is_a_warning() {
    let folder = strip_with("increments = 4", "increments = 1");
    let outcome = folder.run(&["--set", "solver.tolerance=1e-15"]);
    let warned = outcome.code == 0 && outcome.stderr.contains("below the rounding of the forces");
    let failed = outcome.code == 3 && outcome.stderr.contains("smaller than double precision");
    assert!(warned || failed, "{}", outcome.stderr);
    if warned {
        assert!(folder.summary()["warnings"].to_string().contains("below the rounding"));
    }
}

#[test]
fn e20_what_is_no_number_or_not_positive_is_refused_with_its_place() {
    for (old, new, said) in [
        ("spacing = 0.1", "spacing = nan", "spacing"),
        ("spacing = 0.1", "spacing = -0.1", "spacing"),
        ("[1.0, 0.4]", "[inf, 0.4]", "box"),
        ("spacings = 2", "spacings = nan", "spacings"),
        ("spacings = 2", "radius = 0.0", "radius"),
        ("\"javili2020\"\nparameters = { C1 = 1.0, ", "\"firooz2023\"\nparameters = { ", "C1"),
        ("C2 = 5.0", "C2 = nan", "C2"),
        ("C1 = 1.0, ", "C1 = inf, ", "C1"),
        ("0.2*t", "0/0*t", "is NaN at point"),
        ("increments = 4", "end = inf", "end"),
    ] {
        let folder = strip_with(old, new);
        let outcome = folder.run(&[]).expect(2).says(&[said]);
        assert!(outcome.stderr.contains("error"), "{new}");
        assert!(!folder.out().join("summary.json").exists(), "{new}");
    }
    for (row, said) in
        [("0,0,0", "volume"), ("0,0,-1", "volume"), ("nan,0,1", "p.csv:2"), ("0,inf,1", "p.csv:2")]
    {
        let scene = STRIP.replace(LATTICE, "points = \"p.csv\"");
        let scene = scene.replace("spacings = 2", "radius = 2\nweights = \"unit\"");
        let folder = SceneFolder::new(&scene.replace("X > 0.85", "X > 0.45"));
        folder.file("p.csv", format!("x,y,volume\n{row}\n0.5,0,1\n1,0,1\n1,1,1\n"));
        folder.run(&[]).expect(2).says(&[said]);
    }
}

/// Lengths whose powers vanish or overflow: no energy is dropped in silence, no triangle counts as
/// collinear because squares of areas are 0.
#[test]
fn bodies_that_numbers_cannot_hold_are_refused() {
    let own = |measure: &str| {
        let (now, rest, k) =
            (measure, measure.to_uppercase(), 2 + "lav".find(measure).unwrap_or_default());
        format!(
            "potential own\nparameter C = 1 in J/m^({k}*d)\n\
             allow \"no-bond-energy\" \"one kind at a time\"\npsi({now}) = C*({now}/{rest} - 1)^2\n"
        )
    };
    let energy = |d: usize, size: f64, potential: &str, weights: &str| {
        let corner = vec![4.0 * size; d];
        let folder = SceneFolder::new(&format!(
            "[body]\nbox = [{:?}, {corner:?}]\nspacing = {size:?}\n[horizon]\nspacings = 2\n\
             weights = \"{weights}\"\n[material]\npotential = \"{potential}\"\n",
            vec![0.0; d]
        ));
        for measure in ["l", "a", "v"] {
            folder.file(&format!("{measure}.piola"), own(measure));
        }
        ["energy", "moduli"].map(|command| piola(&[command, &folder.scene()]))
    };
    for size in [1e-100, 1e100] {
        let named =
            format!("the horizon is {:e} m: it must lie between 1e-28 and 1e28 m", 2.0 * size);
        for (d, potential) in
            [(2, "l.piola"), (2, "a.piola"), (3, "l.piola"), (3, "a.piola"), (3, "v.piola")]
        {
            for weights in ["unit", "volumes", "uniform", "truncated"] {
                for outcome in energy(d, size, potential, weights) {
                    outcome.expect(2).says(&[&named, "another unit of length"]);
                }
            }
        }
        for (potential, parameters) in [
            ("neo_hooke", "lambda = 1.0, mu = 1.0"),
            ("linear_peridynamic_solid", "K = 1.0, G = 1.0"),
        ] {
            let material = format!("{potential}\"\nparameters = {{ {parameters} }} # \"");
            let [energy, _] = energy(3, size, &material, "uniform");
            energy.expect(2).says(&[&named]);
        }
    }
    // Energies of families weight each bond with two volumes.
    for material in [
        "neo_hooke\"\nparameters = { lambda = 1.0, mu = 1.0 }",
        "linear_peridynamic_solid\"\nparameters = { K = 1.0, G = 1.0 }",
    ] {
        let folder = SceneFolder::new(&format!(
            "[body]\ndimension = 2\npoints = \"p.csv\"\n[horizon]\nradius = 2\n\
             [material]\npotential = \"{material}\n"
        ));
        folder.file("p.csv", "x,y,volume\n0,0,1e-170\n1,0,1e-170\n0,1,1e-170\n1,1,1e-170\n");
        let outcome = piola(&["energy", &folder.scene()]).expect(2);
        outcome.says(&["the weight of a bond is a product of 2 volumes and comes out as 0e0"]);
    }
    // Eighth powers of lengths hold, the product of four volumes does not.
    let [energy, _] = energy(3, 1e-27, "v.piola", "volumes");
    let said = ["the weight of a tetrahedron is a product of 4 volumes and comes out as 0e0"];
    energy.expect(2).says(&said);
}
