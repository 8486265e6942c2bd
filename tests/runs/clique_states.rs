//! Triangles and tetrahedra that remember, through the program: load steps, what plans and frames tell, and
//! what is refused.

use std::fs;

use crate::support::frames::{read_pvd, read_vtu};
use crate::support::{SceneFolder, piola, table};

/// Triangles that soften from a growth of 1 % on.
const SOFTENING: &str = "potential softening\nparameter g0 = 0.01\nstate k = 0\ng = a/A - 1\n\
    update k = max(k, g)\nleft = if k <= g0 then 1 else g0/k*exp(-(k - g0)/(4*g0))\n\
    psi(l) = 1/2*1e13*L*(l/L - 1)^2\npsi(a) = 1/2*1e14*A*left*g^2\n";

/// Volumes that yield.
const YIELDING: &str = "potential yielding\nstate q = 0\nh = v/V - 1\n\
    update q = if abs(h - q) > 0.004 then h - sign(h - q)*0.004 else q\n\
    psi(l) = 1/2*1e13*L*(l/L - 1)^2\npsi(v) = 1/2*1e15*V*(h - q)^2\n";

/// A body between two grips that are pulled apart.
fn pulled(third: &str, steps: &str, output: &str, potential: &str) -> SceneFolder {
    let (low, high) = if third.is_empty() { ("[0, 0]", "[1, 0.6]") } else { ("[0, 0, 0]", third) };
    let scene = format!(
        "[body]\nbox = [{low}, {high}]\nspacing = 0.1\n[horizon]\nspacings = 1.75\n\
         [material]\npotential = \"law.piola\"\n[sets]\nleft = \"X < 0.1\"\nright = \"X > 0.9\"\n\
         [[prescribe]]\nset = \"left\"\nu = [0, {free}]\n[[prescribe]]\nset = \"right\"\nu = [\"0.04*t\", {free}]\n\
         {steps}\n[output]\nframes = 2\n{output}\n",
        free = if third.is_empty() { "0" } else { "0, 0" },
    );
    let folder = SceneFolder::new(&scene);
    folder.file("law.piola", potential);
    folder
}

/// What the last row of a run says in some columns.
fn last(folder: &SceneFolder, names: [&str; 3]) -> [f64; 3] {
    let (header, rows) = table(&folder.out().join("energy.csv"));
    let column = |name: &str| header.iter().position(|own| own == name).unwrap();
    names.map(|name| rows[rows.len() - 1][column(name)])
}

/// Newton's method follows what triangles and tetrahedra come to remember; what they dissipate, and what is left
/// of the account, go with the square of the step.
#[test]
fn load_steps_dissipate_of_second_order() {
    for (third, potential) in [("", SOFTENING), ("[1, 0.4, 0.3]", YIELDING)] {
        let run = |increments: usize| {
            let folder =
                pulled(third, &format!("[steps]\nincrements = {increments}"), "", potential);
            folder.run(&[]).expect(0);
            let [total, dissipated, quadrature] =
                last(&folder, ["total", "dissipated", "quadrature"]);
            let work = last(&folder, ["prescribed", "external", "total"]);
            let account = work[0] + work[1] + quadrature - total - dissipated;
            assert!(account.abs() < 1e-9 * total || quadrature.abs() > 0.0, "{account:e}");
            (dissipated, quadrature.abs() / total)
        };
        let [(coarse, first), (middle, second), (fine, third)] = [10, 20, 40].map(run);
        assert!(coarse > 0.0 && fine > 0.0);
        assert!((middle - fine).abs() < 0.02 * fine, "{middle} {fine}");
        assert!(third < first && second < 0.02 && third < 0.01, "{first} {second} {third}");
    }
}

/// What triangles begin with is the mean of their points; frames have means over what is left, pictures show
/// them, and the plan counts their memory.
#[test]
fn frames_plans_and_pictures_know_what_triangles_remember() {
    let folder = pulled(
        "",
        "[steps]\nincrements = 4",
        "colour = \"state k\"\nfields = [\"states\"]",
        SOFTENING,
    );
    let text = fs::read_to_string(folder.scene()).unwrap();
    let scene = text.replace("[sets]", "parameters = { k = \"0.001*X\" }\n[sets]");
    let graded = SceneFolder::new(&scene);
    graded.file("law.piola", SOFTENING);
    let plan = piola(&["plan", &graded.scene()]).expect(0).stdout;
    assert!(plan.contains("states of triangles") && !plan.contains("states of bonds"), "{plan}");
    graded.run(&[]).expect(0);
    let frames = read_pvd(&fs::read_to_string(graded.out().join("run.pvd")).unwrap()).unwrap();
    let states = |k: usize| {
        let frame = read_vtu(&graded.out().join(&frames[k].1)).unwrap();
        frame.array("state k").unwrap().values.clone()
    };
    let (first, end) = (states(0), states(frames.len() - 1));
    // Inside triangles lie evenly about a point.
    for (point, k) in first.iter().enumerate().filter(|(point, _)| (3..7).contains(&(point / 6))) {
        let x = 0.1 * ((point / 6) as f64 + 0.5);
        assert!((k - 0.001 * x).abs() < 1e-15, "{x}: {k}");
    }
    assert!(first.iter().zip(&end).all(|(before, now)| now >= before));
    assert!(end.iter().any(|k| *k > 0.02));
    let picture = fs::read_to_string(graded.out().join("picture.svg")).unwrap();
    assert!(picture.contains("state k"));
}

#[test]
fn what_triangles_that_remember_cannot_do_is_said() {
    let breaking = format!("{SOFTENING}break when g > 0.2\nbreak when l/L - 1 > 1\n");
    let events = pulled("", "[steps]\ncontrol = \"event\"", "", &breaking);
    events.run(&[]).expect(2).says(&["by events", "softening remembers", "control = \"load\""]);
    let numbers = pulled("", "[solver]\nderivatives = \"hyperdual\"", "", SOFTENING);
    numbers.run(&[]).expect(2).says(&["symbolic derivatives in load steps"]);
    let moduli = piola(&["moduli", &pulled("", "", "", &breaking).scene()]).expect(0);
    assert!(moduli.stdout.contains("triangles remember"), "{}", moduli.stdout);
}
