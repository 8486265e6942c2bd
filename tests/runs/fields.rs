//! Parameters that vary in space and time, from outside: a body that warms up, a graded bar, columns of a
//! cloud, and what is refused.

use crate::support::{SceneFolder, piola, table};

/// Bonds with a thermal strain: a body that nothing holds back grows by `alpha*dT` everywhere.
const WARM: &str = "potential warm\nparameter C = 1, C > 0\nparameter alpha = 1e-3\nparameter dT = 0\n\
                    psi(l) = 1/2*C*L*(l/L - 1 - alpha*dT)^2\n";

fn warm(parameters: &str, steps: &str) -> String {
    format!(
        "[body]\nbox = [[0, 0], [1, 0.5]]\nspacing = 0.125\n[horizon]\nspacings = 3\n\
         [material]\npotential = \"warm.piola\"\nparameters = {{ {parameters} }}\n\
         [sets]\ncorner = \"X < 0.1 and Y < 0.1\"\nleft = \"X < 0.1\"\n\
         [[prescribe]]\nset = \"corner\"\nu = [\"free\", 0]\n\
         [[prescribe]]\nset = \"left\"\nu = [0, \"free\"]\n\
         [[probe]]\nname = \"far\"\nat = [0.9375, 0.4375]\n{steps}"
    )
    .replace(
        "[[prescribe]]\nset = \"corner\"\nu = [0, 0]",
        "[[prescribe]]\nset = \"corner\"\nu = [\"free\", 0]",
    )
}

/// The last row of the table of probes.
fn last_probe(folder: &SceneFolder) -> Vec<f64> {
    let table = std::fs::read_to_string(folder.out().join("probes.csv")).unwrap();
    table.lines().last().unwrap().split(',').map(|x| x.parse().unwrap()).collect()
}

/// Every step is the equilibrium at its own temperature: 0.1 % per 1 K, 20 K in the end.
#[test]
fn a_body_that_warms_up_grows_without_stress() {
    for level in ["strict", "fast"] {
        let scene = warm("dT = \"20*t\"", "[steps]\nincrements = 4\n");
        let folder = SceneFolder::new(&format!("{scene}[solver]\nlevel = \"{level}\"\n"));
        folder.file("warm.piola", WARM);
        folder.run(&[]).expect(0);
        let table = std::fs::read_to_string(folder.out().join("probes.csv")).unwrap();
        let rows: Vec<Vec<f64>> = table
            .lines()
            .skip(1)
            .map(|row| row.split(',').map(|x| x.parse().unwrap()).collect())
            .collect();
        assert!(rows.len() >= 4, "{table}");
        for row in rows {
            let growth = 0.02 * row[0];
            let expected = [growth * 0.875, growth * 0.375];
            for (found, expected) in row[1..].iter().zip(expected) {
                assert!((found - expected).abs() <= 1e-10 * 0.02, "{table}");
            }
        }
        // Strains of 2 % at C = 1 have 1e-4 J; none is left.
        let steps = folder.summary()["steps"].as_array().unwrap().clone();
        let energy = steps.last().unwrap()["energy"].as_f64().unwrap();
        assert!(energy.abs() < 1e-18, "{energy}");
    }
}

/// Two bars whose stiffness doubles along them, one as a field and one as columns of a cloud.
#[test]
fn columns_of_a_cloud_are_fields() {
    let bar = |body: &str, value: &str| {
        format!(
            "[body]\n{body}\n[horizon]\nradius = 0.3\n[material]\npotential = \"law.piola\"\n\
             parameters = {{ C = \"{value}\" }}\n[sets]\nleft = \"X < 0.1\"\nright = \"X > 0.9\"\n\
             [[prescribe]]\nset = \"left\"\nu = [0, 0]\n[[prescribe]]\nset = \"right\"\nu = [0.01, 0]\n\
             [[probe]]\nname = \"middle\"\nat = [0.5, 0.25]\n[steps]\nincrements = 1\n"
        )
    };
    let law =
        "potential p\ndimensions 2\nparameter C in J/m^5, C > 0\npsi(l) = 1/2*C*L*(l/L - 1)^2\n";
    let mut cloud = "x,y,volume,stiff,note\n".to_string();
    for i in 0..9 {
        for j in 0..5 {
            let (x, y) = (f64::from(i) / 8.0, f64::from(j) / 8.0);
            cloud += &format!("{x},{y},0.015625,{},7\n", 1.0 + x);
        }
    }
    let probe = |body: &str, value: &str| {
        let folder = SceneFolder::new(&bar(body, value));
        folder.file("law.piola", law);
        folder.file("cloud.csv", &cloud);
        folder.run(&[]).expect(0);
        last_probe(&folder)
    };
    let table = "dimension = 2\npoints = \"cloud.csv\"";
    let by_column = probe(table, "2e6*stiff");
    assert_eq!(by_column, probe(table, "2e6*(1 + X)"));
    assert_eq!(by_column, probe(table, "2*(1 + X) in MJ/m^5"));
    let even = probe(table, "2e6 + 0*X");
    // The soft half stretches more.
    assert!(by_column[1] > 1.1 * even[1] && by_column[1] < 0.01, "{by_column:?} {even:?}");
}

/// Moduli are those of the middle, and say so; the account of a graded body's energy is that of its bonds.
#[test]
fn moduli_of_a_graded_body_are_those_of_its_middle() {
    let found = |parameters: &str| {
        let folder = SceneFolder::new(&warm(parameters, ""));
        folder.file("warm.piola", WARM);
        let output = piola(&["moduli", &folder.scene(), "--format", "json"]).expect(0);
        (output.json()["moduli"].clone(), output.stderr)
    };
    let (graded, said) = found("C = \"1 + 2*X\"");
    let (number, _) = found("C = 2");
    assert_eq!(graded, number);
    assert!(said.contains("parameters that vary"), "{said}");
}

/// What is wrong with a field is told with its place in the scene and in the body.
#[test]
fn wrong_fields_are_refused_with_their_place() {
    let said = |parameters: &str, arguments: &[&str]| {
        let folder = SceneFolder::new(&warm(parameters, "[steps]\nincrements = 2\n"));
        folder.file("warm.piola", WARM);
        let scene = folder.scene();
        let all = [&arguments[..1], &[scene.as_str()], &arguments[1..]].concat();
        piola(&all).expect(1).stderr
    };
    let negative = said("C = \"1 - 2*X\"", &["check"]);
    for part in ["field-out-of-range", "C > 0", "scene.toml:", "1 - 2*X"] {
        assert!(negative.contains(part), "{part}: {negative}");
    }
    let infinite = said("C = \"1/(X - 0.0625)\"", &["check"]);
    assert!(infinite.contains("finite"), "{infinite}");
    let unknown = said("C = \"1 + Q*X\"", &["check"]);
    assert!(unknown.contains("`Q`"), "{unknown}");
    let plane = said("C = \"1 + Z\"", &["check"]);
    assert!(plane.contains("no Z in two dimensions"), "{plane}");
    let unit = said("C = \"1 + X in GPa\"", &["check"]);
    assert!(unit.contains("dimension-mismatch"), "{unit}");
    let text = said("C = \"stiff\"", &["check"]);
    assert!(text.contains("is not a number with a unit"), "{text}");
    // A value that only a later time has ends the run there.
    let folder = SceneFolder::new(&warm("C = \"1 - 1.5*t\"", "[steps]\nincrements = 2\n"));
    folder.file("warm.piola", WARM);
    let late = folder.run(&[]).expect(2).stderr;
    assert!(late.contains("t = 1") && late.contains("C > 0"), "{late}");
    // Of a motion, too; rows up to there are kept.
    let motion = moving("C = \"1 - 1500*t\"", "");
    let late = motion.run(&[]).expect(3).stderr;
    assert!(late.contains("C > 0") && late.contains("the last row"), "{late}");
    let never = moving("C = \"t - 1\"", "").run(&[]).expect(2).stderr;
    assert!(never.contains("field-out-of-range"), "{never}");
}

/// The body in motion for a millisecond.
fn moving(parameters: &str, motion: &str) -> SceneFolder {
    let scene = warm(parameters, &format!("[motion]\nend = 1e-3\n{motion}[output]\nrows = 20\n"));
    let density = "potential = \"warm.piola\"\ndensity = 1e-6";
    let folder = SceneFolder::new(&scene.replace("potential = \"warm.piola\"", density));
    folder.file("warm.piola", WARM);
    folder
}

/// The last row of a motion's account, by name, behind a check that it closes at every row.
fn account(folder: &SceneFolder) -> impl Fn(&str) -> f64 + use<> {
    folder.run(&[]).expect(0);
    let (header, rows) = table(&folder.out().join("motion.csv"));
    let place = |name: &str| header.iter().position(|known| known == name).unwrap();
    let energies = ["kinetic", "stored", "parameters"].map(place);
    let most = rows.iter().flat_map(|row| energies.map(|k| row[k].abs())).fold(0.0, f64::max);
    for row in &rows {
        let of = |name: &str| row[place(name)];
        let gained = of("kinetic_leapfrog") + of("stored") - of("quadrature") - of("parameters");
        assert!((gained - of("external") - of("prescribed")).abs() <= 1e-12 * most, "{row:?}");
        assert!(of("rounding").abs() <= 1e-12 * most, "{row:?}");
    }
    let last = rows.last().unwrap().clone();
    move |name| last[header.iter().position(|known| known == name).unwrap()]
}

/// A body that warms up while it moves: the work of changing its parameters is a column of its account.
#[test]
fn parameters_of_a_motion_change_with_time() {
    // Nothing can move: all that is stored came from the warmth.
    let held = moving("dT = \"2e4*t\"", "step = 1e-4\n");
    let text = std::fs::read_to_string(held.scene()).unwrap();
    held.file(
        "scene.toml",
        text.replace("X < 0.1 and Y < 0.1", "X < 9").replace("X < 0.1\"", "X < 9\""),
    );
    let of = account(&held);
    assert!(of("stored") > 0.0 && of("kinetic") == 0.0);
    assert!((of("parameters") - of("stored")).abs() <= 1e-12 * of("stored"));
    // It may: of second order in the step, by either rule, to the same end.
    let end = |method: &str, step: f64| {
        let motion = format!("method = \"{method}\"\nstep = {step}\n");
        let of = account(&moving("C = \"1 + 500*t\", dT = \"2e4*t\"", &motion));
        ["stored", "kinetic", "parameters", "momentum_x"].map(of)
    };
    let steps = [4e-5, 2e-5, 1e-5];
    let explicit = steps.map(|step| end("verlet", step));
    let implicit = steps.map(|step| end("midpoint", step));
    for k in 0..4 {
        let [coarse, medium, fine] = explicit.map(|values| values[k]);
        let order = libm::log2(((coarse - medium) / (medium - fine)).abs());
        assert!((order - 2.0).abs() < 0.05, "{k}: order {order}");
        let ends = [explicit, implicit].map(|[_, one, other]| other[k] + (other[k] - one[k]) / 3.0);
        assert!((ends[0] - ends[1]).abs() <= 1e-5 * ends[0].abs(), "{k}: {ends:?}");
    }
}
