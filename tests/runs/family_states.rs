//! Bodies whose deformation gradients remember, and whose points do with what they gather, through the program:
//! load steps, motions, plans, histories of bonds, what is written and what is refused.

use crate::support::{SceneFolder, number, piola, repository, table};

/// Softens by the energy that is stored, and ages while it is stretched.
const OF_GRADIENTS: &str = "potential softening\nstate k = 0\nstate life = 1\nw = E : E\n\
    update k = max(k, w)\nupdate life = life - max(0, J - 1)*dt\n\
    parameter c = 1\npsi(F) = 1e9*c*life*exp(-50*k)*w\n";

/// Yields by its dilatation.
const OF_POINTS: &str = "potential yielding\nm = integral(L^2)\ntheta = 2/m*integral(L*(l - L))\n\
    state p = 0\nupdate p = if abs(theta - p) > 0.03 then theta - sign(theta - p)*0.03 else p\n\
    psi(theta) = 1e9*(theta - p)^2\npsi(l, m) = 1e9/m*(l - L)^2\n";

/// A square of 100 points on which all displacements are given: it is stretched and let go again.
fn square(law: &str, keys: &str, stretch: &str) -> SceneFolder {
    let scene = format!(
        "[body]\nbox = [[0, 0], [1, 1]]\nspacing = 0.1\n[horizon]\nspacings = 2.015\n\
         [material]\npotential = \"law.piola\"\n{keys}\n[sets]\nall = \"X > -1\"\n\
         [[prescribe]]\nset = \"all\"\nu = [\"{stretch}*X\", \"{stretch}*Y\"]\n\
         [steps]\nincrements = 8\n[output]\ncolour = \"state {}\"\nfields = [\"states\"]\n",
        if law == OF_POINTS { "p" } else { "k" },
    );
    let made = SceneFolder::new(&scene);
    made.file("law.piola", law);
    made
}

/// Up to half of the way, and back.
const TO_AND_FRO: &str = "0.2*(0.5 - abs(t - 0.5))";

/// Checks columns of energy.csv against `expected`: stored and dissipated at every step, over the volume.
fn has_energies(folder: &SceneFolder, expected: &[[f64; 2]]) {
    let (header, rows) = table(&folder.out().join("energy.csv"));
    let column = |name: &str| header.iter().position(|x| *x == name).unwrap();
    let rows = &rows[rows.len() - expected.len()..];
    let most = expected.iter().flatten().fold(0.0_f64, |most, x| most.max(x.abs()));
    let mut worst = 0.0_f64;
    for (row, [stored, dissipated]) in rows.iter().zip(expected) {
        worst = worst.max((row[column("total")] - stored).abs() / most);
        worst = worst.max((row[column("dissipated")] - dissipated).abs() / most);
        let left = row[column("total")] + row[column("dissipated")] + row[column("relaxed")]
            - row[column("external")]
            - row[column("prescribed")]
            - row[column("quadrature")];
        assert!(left.abs() <= 1e-12 * most, "{left:e}");
    }
    println!("energies {worst:e}");
    assert!(worst <= 1e-12, "{worst:e}");
}

/// A body that is stretched evenly remembers at every place what closed forms say, in steps as long as these.
#[test]
fn load_steps_are_those_of_closed_forms() {
    let kinds = ["bond-quadrature", "stabilised", "nodal"];
    for (discretisation, grows) in kinds.into_iter().flat_map(|kind| [(kind, 0.0), (kind, 1.0)]) {
        let keys = format!(
            "parameters = {{ c = \"1 + {grows}*t\" }}\n\
             [correspondence]\ndiscretisation = \"{discretisation}\""
        );
        let folder = square(OF_GRADIENTS, &keys, TO_AND_FRO);
        folder.run(&[]).expect(0);
        let (mut k, mut life, mut dissipated) = (0.0_f64, 1.0_f64, 0.0);
        let mut expected = Vec::new();
        for step in 1..=8 {
            let t = f64::from(step) / 8.0;
            let f = 1.0 + 0.2 * (0.5 - (t - 0.5).abs());
            let w = 0.5 * (f * f - 1.0) * (f * f - 1.0);
            let c = 1e9 * (1.0 + grows * t);
            let psi = |k: f64, life: f64| c * life * libm::exp(-50.0 * k) * w;
            let before = psi(k, life);
            (k, life) = (k.max(w), life - (f * f - 1.0).max(0.0) / 8.0);
            dissipated += before - psi(k, life);
            expected.push([psi(k, life), dissipated]);
        }
        assert!(dissipated > 1e6);
        has_energies(&folder, &expected);
    }
    let folder = square(OF_POINTS, "", TO_AND_FRO);
    folder.run(&[]).expect(0);
    let (mut p, mut dissipated) = (0.0_f64, 0.0);
    let mut expected = Vec::new();
    for step in 1..=8 {
        let e = 0.2 * (0.5 - (f64::from(step) / 8.0 - 0.5).abs());
        let theta = 2.0 * e;
        let psi = |p: f64| 1e9 * (theta - p) * (theta - p) + 0.5e9 * e * e;
        let before = psi(p);
        let over = theta - p;
        p = if over.abs() > 0.03 { theta - over.signum() * 0.03 } else { p };
        dissipated += before - psi(p);
        expected.push([psi(p), dissipated]);
    }
    assert!(p < 0.04 && dissipated > 1e6, "{p}");
    has_energies(&folder, &expected);
}

/// The example's plate softens before it tears; what is dissipated grows, the account closes, and a bond tells
/// what it remembers.
#[test]
fn plates_soften_before_they_tear() {
    let source = repository("examples/gradients_that_fail");
    let scene = std::fs::read_to_string(source.join("softening.toml")).unwrap();
    for discretisation in ["bond-quadrature", "stabilised"] {
        let keys = format!("discretisation = \"{discretisation}\"\ninfluence = \"constant\"");
        let mut scene = scene.clone();
        for (from, to) in [
            ("spacing = 1e-3", "spacing = 2e-3"),
            ("Y < 1e-3", "Y < 2e-3"),
            ("Y > 0.039", "Y > 0.038"),
            ("influence = \"constant\"", keys.as_str()),
            ("frames = 12\nrows = 300", "frames = 2\nrows = 60"),
        ] {
            assert!(scene.contains(from), "{from}");
            scene = scene.replace(from, to);
        }
        let folder = SceneFolder::new(&scene);
        let law = std::fs::read_to_string(source.join("softening.piola")).unwrap();
        folder.file("softening.piola", law);
        folder.run(&[]).expect(0);
        let (header, rows) = table(&folder.out().join("motion.csv"));
        let column = |name: &str| header.iter().position(|x| *x == name).unwrap();
        let dissipated: Vec<f64> = rows.iter().map(|row| row[column("dissipated")]).collect();
        assert!(dissipated.windows(2).all(|pair| pair[1] >= pair[0] - 1e-15), "{discretisation}");
        let last = rows.last().unwrap();
        assert!(last[column("dissipated")] > 0.01 && last[column("broken_bonds")] > 100.0);
        let largest = rows.iter().flatten().fold(0.0_f64, |most, x| most.max(x.abs()));
        assert!(rows.iter().all(|row| row[column("rounding")].abs() <= 1e-12 * largest));
        let plan = piola(&["plan", &folder.scene()]).expect(0).stdout;
        let what = if discretisation == "stabilised" { "points" } else { "bonds" };
        assert!(plan.contains(&format!("states of {what}")), "{plan}");
        let at = ["--at", "0.051,0.019", "0.051,0.021", "--format", "json"];
        let found = piola(&[&["explain-bond", &folder.scene()], &at[..]].concat()).expect(0).json();
        assert_eq!(found["states"][0], "k");
        let states: Vec<f64> =
            found["rows"].as_array().unwrap().iter().map(|row| number(&row["states"][0])).collect();
        assert!(states[0] == 0.0 && states.windows(2).all(|pair| pair[1] >= pair[0]), "{states:?}");
        assert!(states[states.len() - 1] > 300.0, "{states:?}");
    }
}

#[test]
fn what_is_not_followed_is_refused() {
    let folder = square(OF_GRADIENTS, "[correspondence]\nplane = \"stress\"", TO_AND_FRO);
    folder.run(&[]).expect(2).says(&["states of softening", "plane stress", "plane = \"strain\""]);
    // Of two materials one has no energy left that would gather.
    let both = |parameters: &str| {
        let law = "potential fading\nparameter K = 1e9\nm = integral(L^2)\n\
                   theta = 2/m*integral(L*(l - L))\nstate p = 0\nupdate p = max(p, theta)\n\
                   psi(theta) = K*exp(-p)*theta^2\npsi(l, m) = K/m*(l - L)^2\n";
        let text = std::fs::read_to_string(square(law, "", TO_AND_FRO).scene()).unwrap();
        let text = text.replace("state k", "state p");
        let one = "[material]\npotential = \"law.piola\"\n";
        let two = format!(
            "[[material]]\nset = \"right\"\npotential = \"law.piola\"\n{parameters}\n\
             [[material]]\nset = \"left\"\npotential = \"law.piola\"\n"
        );
        let sets = "[sets]\nleft = \"X < 0.5\"\nright = \"X > 0.5\"\n";
        assert!(text.contains(one) && text.contains("[sets]\n"));
        let made = SceneFolder::new(&text.replace(one, &two).replace("[sets]\n", sets));
        made.file("law.piola", law);
        made
    };
    both("").run(&[]).expect(0);
    let what = ["leave nothing of the energies of gathered values of fading", "give parameters"];
    both("parameters = { K = 0 }").run(&[]).expect(2).says(&what);
    for (law, control) in
        [(OF_GRADIENTS, "arc-length"), (OF_POINTS, "arc-length"), (OF_POINTS, "event")]
    {
        let folder = square(law, "", TO_AND_FRO);
        let control = format!("steps.control=\"{control}\"");
        let run = folder.run(&["--set", &control]).expect(2);
        run.says(&["remembers", "control = \"load\""]);
    }
}

/// Of two materials one is damaged, by points as well as by bonds; a bond between both has a part in it. However
/// derivatives come about, and with a checkpoint between, the run is the same.
#[test]
fn materials_remember_by_themselves() {
    for discretisation in ["bond-quadrature", "stabilised", "nodal"] {
        let scene = |more: &str| {
            format!(
                "[body]\nbox = [[0, 0], [1, 0.5]]\nspacing = 0.1\n[horizon]\nspacings = 2.015\n{more}\n\
                 [correspondence]\ndiscretisation = \"{discretisation}\"\n\
                 [sets]\nsoft = \"X < 0.5\"\nhard = \"X > 0.5\"\n\
                 [[material]]\nset = \"soft\"\npotential = \"law.piola\"\ndensity = 1e3\n\
                 [[material]]\nset = \"hard\"\npotential = \"st_venant_kirchhoff\"\ndensity = 1e3\n\
                 parameters = {{ lambda = 1e9, mu = 1e9 }}\n\
                 [[initial]]\nset = \"hard\"\nv = [\"100*X\", 0]\n\
                 [motion]\nend = \"1 ms\"\n[output]\nframes = 2\nrows = 40\nfields = [\"states\"]\n"
            )
        };
        let run = |more: &str, arguments: &[&str]| {
            let folder = SceneFolder::new(&scene(more));
            folder.file("law.piola", OF_GRADIENTS);
            folder.run(arguments).expect(0);
            table(&folder.out().join("motion.csv"))
        };
        let (header, rows) = run("", &[]);
        let column = |name: &str| header.iter().position(|x| *x == name).unwrap();
        let last = rows.last().unwrap();
        let largest = rows.iter().flatten().fold(0.0_f64, |most, x| most.max(x.abs()));
        assert!(last[column("dissipated")] > 1e-3 * largest, "{discretisation}: {last:?}");
        assert!(rows.iter().all(|row| row[column("rounding")].abs() <= 1e-12 * largest));
        for more in
            ["derivatives = \"hyperdual\"", "derivatives = \"interpreter\"", "level = \"strict\""]
        {
            let (_, others) = run(&format!("[solver]\n{more}"), &[]);
            let off = others.iter().flatten().zip(rows.iter().flatten());
            let off = off.fold(0.0_f64, |most, (x, y)| most.max((x - y).abs()));
            println!("{discretisation}, {more}: {off:e} of {largest:e}");
            assert!(off <= 1e-9 * largest, "{discretisation}, {more}: {off:e}");
        }
    }
}
