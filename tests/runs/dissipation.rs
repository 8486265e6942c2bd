//! Bonds that dissipate by their rates, from outside: what a run leaves and what it refuses.

use crate::motion::THROWN;
use crate::support::{SceneFolder, table};

/// Bonds whose viscosity varies from point to point, grows with what they remember, and is gone with them.
const LAW: &str = "potential p
parameter C = 1e9
parameter eta = 1e3
state k = 0
s = l/L - 1
update k = max(k, s)
psi(l) = 1/2*C*L*s^2
dissipation(l) = 1/2*eta*(1 + k)*l*(rate(l)/L)^2
break when s > 0.5
";

fn thrown(parameters: &str) -> SceneFolder {
    let scene = THROWN
        .replace("\"javili2020\"", "\"law.piola\"")
        .replace("{ C1 = 1e9, C2 = 0 }", parameters)
        .replace("damping = 0.1\n", "");
    let folder = SceneFolder::new(&scene);
    folder.file("law.piola", LAW);
    folder
}

#[test]
fn what_bonds_dissipate_stands_in_the_account() {
    for parameters in ["{ eta = 1e4 }", "{ eta = \"1e4*(1 + X)\", k = \"0.01*Y\" }"] {
        let folder = thrown(parameters);
        folder.run(&[]).expect(0);
        let (header, rows) = table(&folder.out().join("motion.csv"));
        let column = |name: &str| -> Vec<f64> {
            let place = header.iter().position(|known| known == name).unwrap();
            rows.iter().map(|row| row[place]).collect()
        };
        let (damping, rounding) = (column("damping"), column("rounding"));
        assert!(damping.windows(2).all(|pair| pair[1] >= pair[0]), "{damping:?}");
        let last = damping[damping.len() - 1];
        assert!(last > 0.0 && rounding.iter().all(|x| x.abs() < 1e-12 * last), "{rounding:?}");
    }
}

#[test]
fn statics_have_no_rates() {
    let folder = thrown("{ eta = 1e4 }");
    let refused = |scene: &str, parts: &[&str]| {
        folder.file("scene.toml", scene);
        folder.run(&[]).expect(2).says(parts);
    };
    let scene = std::fs::read_to_string(folder.path("scene.toml")).unwrap();
    let midpoint = scene.replace("end = 0.5", "end = 0.5\nmethod = \"midpoint\"");
    refused(&midpoint, &["midpoint", "p has a dissipation(l)", "\"verlet\""]);
    let corrected = scene.replace("spacings = 2", "spacings = 2\nsurface = \"energy\"");
    refused(&corrected, &["surface", "p has a dissipation(l)"]);
    let from = scene.find("[[initial]]").unwrap();
    let statics = format!(
        "{}[[prescribe]]\nset = \"left\"\nu = [0, 0]\n[steps]\nincrements = 1\n",
        &scene[..from]
    );
    refused(&statics, &["statics", "no rates", "[motion]"]);
}
