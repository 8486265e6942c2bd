//! Names and formats that scripts rely on.

use crate::scenes::{STRIP, strip, strip_with};
use crate::support::{SceneFolder, number, numbers, piola, piola_with_input, table};

#[test]
fn eval_answers_row_by_row_in_shortest_decimals() {
    let rows = b"l,L\n1.5,1\n2e0,1.0\n.5,+1\n1,1\n";
    let eval = |mode: &str| {
        let arguments = [
            "eval",
            "firooz2023",
            "--measure",
            "l",
            "--dim",
            "3",
            "--set",
            "C1=2",
            "--points",
            "-",
            "--mode",
            mode,
        ];
        piola_with_input(&arguments, rows).expect(0).stdout
    };
    let expected = "l,L,psi,dpsi,d2psi\n1.5,1,0.25,1,2\n2,1,1,2,2\n0.5,1,0.25,-1,2\n1,1,0,0,2\n";
    for mode in ["jit", "interpreter", "hyperdual"] {
        assert_eq!(eval(mode), expected, "{mode}");
    }
}

#[test]
fn eval_keeps_rows_that_are_not_finite_and_says_so() {
    let arguments = ["eval", "logarithmic", "--measure", "l", "--dim", "2", "--points", "-"];
    let outcome = piola_with_input(&arguments, b"l,L\n1,1\n0,1\n-1,1\n").expect(1);
    let lines: Vec<&str> = outcome.stdout.lines().collect();
    assert_eq!(lines[1..], ["1,1,0,0,1", "0,1,inf,-inf,inf", "-1,1,nan,nan,nan"]);
    outcome.says(&["2 of 3 rows", "row 2"]);
    piola_with_input(&arguments, b"x,L\n1,1\n").expect(2).says(&["`l`"]);
    piola_with_input(&arguments, b"l,L\n1,0\n").expect(2).says(&["[out-of-range]", "-:2:3", "> 0"]);
    piola_with_input(&arguments, b"l,L\n1,one\n").expect(2).says(&[
        "[not-a-number]",
        "-:2:3",
        "`one`",
    ]);
    let all = piola_with_input(&arguments, b"l,L\n1,one\n1,1\nx,y\n1,0\n1,1,1\n").expect(2);
    all.says(&[
        "-:2:3", "`one`", "-:4:1", "`x`", "-:4:3", "`y`", "-:5:3", "> 0", "-:6:1", "3 fields",
    ]);
    let infinite = piola_with_input(&arguments, b"L,l\n1,inf\n1,nan\n").expect(1).stdout;
    assert!(infinite.contains("\ninf,1,inf,") && infinite.contains("\nnan,1,nan,"), "{infinite}");
    let table = ["l,L\n", &"x,1\n".repeat(50)].concat();
    let many = piola_with_input(&arguments, table.as_bytes()).expect(2);
    assert_eq!(many.stderr.matches("is not a number").count(), 20);
}

#[test]
fn energy_is_json_in_the_users_order() {
    // Three points listed from right to left, so that the body sorts them anew.
    let folder = SceneFolder::new(
        "[body]\ndimension = 2\npoints = \"p.csv\"\n[horizon]\nradius = 1.5\nweights = \"unit\"\n\
         [material]\npotential = \"javili2020\"\nparameters = { C1 = 2.0 }\n",
    );
    folder.file("p.csv", "x,y,volume\n2,0,1\n1,0,1\n0,0,1\n");
    let energy = folder.energy("name,u,v\na,0.5,0\nb,0,0\nc,0,0\n", &[]).json();
    assert_eq!(energy["points"], 3);
    assert_eq!(energy["dimension"], 2);
    assert_eq!(energy["interactions"]["bonds"], 2);
    assert_eq!(energy["interactions"]["triangles"], 0);
    // One bond from 1 to 1.5: psi = 2*1*0.5^2/2, and the force on the first listed point.
    assert_eq!(number(&energy["energy"]), 0.25);
    assert_eq!(number(&energy["energy_parts"]["psi(l)"]), 0.25);
    assert!(energy["energy_parts"]["psi(a)"].is_null(), "it has none");
    let gradient: Vec<Vec<f64>> =
        energy["gradient"].as_array().unwrap().iter().map(numbers).collect();
    assert_eq!(gradient, [[1.0, 0.0], [-1.0, 0.0], [0.0, 0.0]]);
    let tangent = &energy["tangent"];
    let entry = |row: f64, column: f64| {
        let (rows, columns) = (numbers(&tangent["rows"]), numbers(&tangent["cols"]));
        let found = rows.iter().zip(&columns).position(|(r, c)| *r == row && *c == column);
        found.map_or(0.0, |k| numbers(&tangent["values"])[k])
    };
    assert_eq!((entry(0.0, 0.0), entry(0.0, 2.0), entry(2.0, 0.0)), (2.0, -2.0, -2.0));
    assert_eq!((entry(0.0, 4.0), entry(2.0, 2.0)), (0.0, 4.0));
}

#[test]
fn a_run_leaves_everything_the_contract_names() {
    let folder = strip();
    folder.run(&[]).expect(0);
    let out = folder.out();
    for name in [
        "run.pvd",
        "displacement.csv",
        "reactions.csv",
        "energy.csv",
        "probes.csv",
        "scene.resolved.toml",
        "picture.png",
        "picture.svg",
        "summary.json",
    ] {
        assert!(out.join(name).exists(), "{name}");
    }
    assert_eq!(table(&out.join("displacement.csv")).0, ["X", "Y", "u", "v"]);
    assert_eq!(table(&out.join("displacement.csv")).1.len(), 55);
    assert_eq!(
        table(&out.join("reactions.csv")).0,
        ["t", "left_x", "left_y", "right_x", "right_y"]
    );
    assert_eq!(table(&out.join("energy.csv")).0, ["t", "total", "psi(l)", "psi(a)"]);
    assert_eq!(table(&out.join("probes.csv")).0, ["t", "middle_u", "middle_v"]);
    let summary = folder.summary();
    assert_eq!(summary["exit_reason"], "completed");
    assert!(summary["scene_hash"].as_str().unwrap().starts_with("fnv1a64:"));
    let steps = summary["steps"].as_array().unwrap();
    assert_eq!(steps.len(), 4);
    let last = &steps[3];
    assert_eq!(number(&last["t"]), 1.0);
    assert_eq!(last["positive_definite"], true);
    let residual = numbers(&last["residual"]);
    assert_eq!(residual.len(), 1 + number(&last["iterations"]) as usize);
    assert!(*numbers(&last["residual_over_reaction"]).last().unwrap() <= 1e-10);
    let parts = &last["energy_parts"];
    let sum: f64 = parts.as_object().unwrap().values().map(number).sum();
    assert!((sum - number(&last["energy"])).abs() <= 1e-14 * sum);
    let reaction = |set: &str| numbers(&last["reactions"][set]);
    assert!((reaction("left")[0] + reaction("right")[0]).abs() <= 1e-9 * reaction("right")[0]);
    // What was resolved runs again to the same result.
    let again =
        SceneFolder::new(&std::fs::read_to_string(out.join("scene.resolved.toml")).unwrap());
    again.run(&[]).expect(0);
    assert_eq!(
        std::fs::read(out.join("displacement.csv")).unwrap(),
        std::fs::read(again.out().join("displacement.csv")).unwrap()
    );
}

#[test]
fn an_output_folder_is_not_overwritten_unasked() {
    let folder = strip();
    folder.run(&[]).expect(0);
    std::fs::write(folder.out().join("mine.txt"), "mine").unwrap();
    folder.run(&[]).expect(2).says(&["--force"]);
    folder.run(&["--force"]).expect(0);
    assert_eq!(std::fs::read_to_string(folder.out().join("mine.txt")).unwrap(), "mine");
}

#[test]
fn loads_are_balanced_by_reactions() {
    // The strip is pulled by a force in place of the prescribed displacement.
    let pulled = STRIP.replace(
        "[[prescribe]]\nset = \"right\"\nu = [\"0.2*t\", 0]",
        "[[load]]\nset = \"right\"\nforce = [\"1e-3*t\", 0]",
    );
    let folder = SceneFolder::new(&pulled);
    folder.run(&[]).expect(0);
    let summary = folder.summary();
    for step in summary["steps"].as_array().unwrap() {
        let (t, left) = (number(&step["t"]), numbers(&step["reactions"]["left"]));
        assert!((left[0] + 1e-3 * t).abs() <= 1e-9 * 1e-3, "{left:?} at {t}");
        assert!(left[1].abs() <= 1e-9 * 1e-3);
    }
}

#[test]
fn an_unstable_equilibrium_is_reported() {
    let text =
        std::fs::read_to_string(crate::support::repository("examples/cube_C1_C2/scene.toml"));
    let text = text.unwrap().replace("C2 = 100.0", "C2 = 1000.0");
    let outcome = SceneFolder::new(&text).run(&["--set", "output.frames=1"]).expect(1);
    outcome.says(&["not stable", "unstable = \"accept\""]);
}

#[test]
fn a_solver_that_does_not_converge_returns_3_and_keeps_what_did() {
    let folder = strip_with("[\"0.2*t\", 0]", "[\"if t < 0.6 then 0.2*t else -5*t\", 0]");
    folder.run(&["--set", "solver.max_iterations=4"]).expect(3);
    let summary = folder.summary();
    assert_ne!(summary["exit_reason"], "completed");
    assert_eq!(
        summary["steps"].as_array().unwrap().iter().filter(|s| number(&s["t"]) <= 0.5).count(),
        2
    );
}

#[test]
fn every_stage_can_be_printed() {
    for stage in ["text", "latex", "c", "ast", "model", "graph", "clif", "asm"] {
        let outcome = piola(&["derive", "firooz2023", "--emit", stage]).expect(0);
        assert!(outcome.stdout.len() > 100, "{stage}");
        let outcome = piola(&["derive", "neo_hooke", "--emit", stage]).expect(0);
        assert!(outcome.stdout.len() > 100, "{stage}");
        if stage == "c" {
            assert!(outcome.stdout.contains("void neo_hooke_F_product(size_t n,"));
        }
        let outcome = piola(&["derive", "hencky", "--emit", stage]).expect(0);
        match stage {
            "text" => assert!(outcome.stdout.starts_with("# F_ab = sum_i s_i n_ia N_ib: ")),
            "latex" => assert!(outcome.stdout.contains(r"\ln\left(\boldsymbol{U}\right)")),
            "c" => assert!(outcome.stdout.contains("piola_axes(3, 1, change + i, n, axes);")),
            _ => assert!(outcome.stdout.len() > 100, "{stage}"),
        }
    }
    piola(&["completions", "bash"]).expect(0);
    piola(&["info"]).expect(0);
    piola(&["verify", "javili2020", "--points", "50"]).expect(0);
}

#[test]
fn the_library_is_listed_by_kind() {
    let all = piola(&["info"]).expect(0).stdout;
    let kinds = ["bond", "clique", "state", "solid", "rubber", "foam", "tissue"];
    let mut listed = 0;
    for kind in kinds {
        let one = piola(&["info", "--kind", kind]).expect(0).stdout;
        let heading = format!("\n{kind}: ");
        assert!(all.contains(&heading) && one.contains(&heading), "{one}");
        let names: Vec<&str> = one.lines().filter(|line| line.starts_with("  ")).collect();
        assert!(!names.is_empty() && names.iter().all(|name| all.contains(name)), "{one}");
        listed += names.len();
    }
    assert_eq!(listed, all.lines().filter(|line| line.starts_with("  ")).count());
    piola(&["info", "--kind", "wood"]).expect(2).says(&kinds);
    piola(&["info", "--kind", "foam", "gent"]).expect(2).says(&["cannot be used with"]);
}
