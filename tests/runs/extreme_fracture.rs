//! Fracture energies from next to nothing to more than any body holds, in bodies of every kind that breaks.

use std::path::Path;

use crate::support::{SceneFolder, table};

/// A bar that is pulled at both ends, with a material to be filled in.
fn pulled(potential: &str, parameters: &str, density: f64, more: &str) -> SceneFolder {
    SceneFolder::new(&format!(
        "[body]\nbox = [[0, 0, 0], [0.08, 0.03, 0.03]]\nspacing = 0.01\n[horizon]\nspacings = 2.015\n\
         [material]\npotential = \"{potential}\"\ndensity = {density:e}\nparameters = {{ {parameters} }}\n\
         [sets]\nall = \"X > 0\"\nleft = \"X < 0.01\"\nright = \"X > 0.07\"\n[fracture]\nunbreakable = [\"left\", \"right\"]\n\
         {more}"
    ))
}

/// The table of the motion, column by column of a name, and the displacements at the end as they are written.
fn run(folder: &SceneFolder) -> (impl Fn(&str) -> Vec<f64> + use<>, String) {
    folder.run(&[]).expect(0);
    let out = folder.path("out");
    let (header, rows) = table(&Path::new(&out).join("motion.csv"));
    let of = move |name: &str| {
        let column = header.iter().position(|own| own == name).unwrap();
        rows.iter().map(|row| row[column]).collect()
    };
    (of, std::fs::read_to_string(Path::new(&out).join("displacement.csv")).unwrap())
}

/// Stiffness, density and fracture energy by powers of two, the last from 6e-27 to 9e33 J/m^2: the same bonds break at
/// the same steps, to the last bit of displacements, and what they release is so many times as much.
#[test]
fn the_same_breaks_whatever_joules_are() {
    let kinds = [
        ("prototype_microelastic_brittle", "", false),
        ("miranda_modified_stretch_brittle", "", false),
        ("bilinear_softening", ", s0 = 9e-3", false),
        ("linear_peridynamic_solid_brittle", "G", false),
        ("st_venant_kirchhoff_brittle", "G", true),
    ];
    for (potential, rest, has_gradients) in kinds {
        let runs = [-100, 0, 100].map(|power| {
            let factor = libm::exp2(f64::from(power));
            let shear = format!(", G = {:e}", 1.2e9 * factor);
            let rest = if rest == "G" { shear.as_str() } else { rest };
            // A critical stretch of 1 %.
            let parameters = format!("K = {:e}, Gc = {:e}{rest}", 2e9 * factor, 7254.0 * factor);
            let correspondence = if has_gradients { "[correspondence]\n" } else { "" };
            let more = format!(
                "{correspondence}[[prescribe]]\nset = \"left\"\nv = [-20, 0, 0]\n[[prescribe]]\nset = \"right\"\n\
                 v = [20, 0, 0]\n[motion]\nend = 8e-5\n[output]\nrows = 40\n"
            );
            let (of, end) = run(&pulled(potential, &parameters, 2000.0 * factor, &more));
            let released: Vec<f64> = of("released").iter().map(|x| x / factor).collect();
            ([of("t"), of("broken_bonds"), released], end)
        });
        let [_, broken, released] = &runs[1].0;
        println!("{potential}: {broken:?}");
        assert!(broken[0] == 0.0 && broken[broken.len() - 1] > 0.0, "{potential}");
        assert!(released[released.len() - 1] > 0.0);
        assert!(runs.iter().all(|run| *run == runs[1]), "{potential}");
    }
}

/// With 1e-40 J/m^2 and 1 Pa bonds break at a stretch of 5e-20, far below what the last digit of a place stretches them
/// by, and not where the body stands aside; with 1e30 they hold.
#[test]
fn nothing_breaks_by_itself_and_nothing_breaks_what_holds() {
    for potential in ["prototype_microelastic_brittle", "miranda_modified_stretch_brittle"] {
        let broken = |energy: &str, aside: f64, opening: f64| {
            let more = format!(
                "[[prescribe]]\nset = \"left\"\nu = [{:e}, 0, 0]\n[[prescribe]]\nset = \"right\"\nu = [{:e}, 0, 0]\n\
                 [[initial]]\nset = \"all\"\nu = [{aside:e}, 0, 0]\n\
                 [motion]\nend = 1\nstep = 1e-3\n[output]\nrows = 10\n",
                aside - opening,
                aside + opening
            );
            let folder = pulled(potential, &format!("K = 1, Gc = {energy}"), 1.0, &more);
            let (of, _) = run(&folder);
            let broken = of("broken_bonds");
            broken[broken.len() - 1]
        };
        assert_eq!(broken("1e-40", 0.0, 0.0), 0.0, "{potential}");
        assert_eq!(broken("1e-40", 0.7, 0.0), 0.0, "{potential}");
        assert!(broken("1e-40", 0.0, 1e-20) > 50.0, "{potential}");
        assert_eq!(broken("1e30", 0.0, 5e-3), 0.0, "{potential}");
    }
}
