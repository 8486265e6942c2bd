//! How many energies of textbooks and papers keep their digits: the collection in `laws/`, near rest
//! and in the regimes of the audit, at both levels, against numbers of 256 binary digits and more.

#[path = "support/processors.rs"]
mod processors;
#[path = "support/laws/mod.rs"]
mod support;

use std::collections::BTreeMap;

use processors::on_all_processors;
use support::{BAR, Found, Kind, Law, collection, look_at};

/// Which share of the laws keeps psi, psi' and psi'' (of F: psi, P, dP) within [`BAR`].
const SHARE_KEPT: f64 = 0.61;

/// Which share keeps them at strains up to a quarter, whatever is lost farther away.
const SHARE_KEPT_NEAR_REST: f64 = 0.64;

/// A function less its value and its tangent at rest, or a sum that is one: `J - ln(J) - 1`,
/// `1 - (1 + s)*exp(-s)`, `x^n/n - x^m/m`. The terms are rounded before they cancel.
const TANGENT: &str = "a function less its tangent";

/// A function less its value at rest where no rule sees that value: a quotient of exponentials, a product
/// of a power and an exponential, a power of V/v, `ln(cosh(s))`, a number beside a square.
const VALUE: &str = "a function less its value at rest";

/// Constants with ten digits leave a force at rest of some 1e-11, which cancels, too.
const CONSTANTS: &str = "a force at rest that rounded constants leave";

/// `abs(x)` in a logarithm, and `max(x, 0)` in an energy of F, where `if x > 0 then` keeps its digits.
const KINK: &str = "a kink";

/// The square root of an invariant that is 0 at rest and of second order: rounding makes it negative.
const ROOT: &str = "the root of what is 0 at rest";

/// No rule is applied to energies of points.
const POINTS: &str = "energies of points are compiled as written";

/// Terms of psi' or psi'' cancel at large strains.
const FAR: &str = "lost far from rest alone";

/// The laws that are lost, by kind, and why as far as is known.
const LOST: [(Kind, &str, &str); 46] = [
    (Kind::Bonds, "born_lande", TANGENT),
    (Kind::Bonds, "born_mayer", TANGENT),
    (Kind::Bonds, "buckingham", TANGENT),
    (Kind::Bonds, "deng_fan", VALUE),
    (Kind::Bonds, "double_well", VALUE),
    (Kind::Bonds, "exponential_softening", TANGENT),
    (Kind::Bonds, "fair", KINK),
    (Kind::Bonds, "fene_spring", TANGENT),
    (Kind::Bonds, "geman_mcclure", FAR),
    (Kind::Bonds, "langevin_pade", TANGENT),
    (Kind::Bonds, "langevin_series", TANGENT),
    (Kind::Bonds, "log_cosh", VALUE),
    (Kind::Bonds, "marko_siggia", TANGENT),
    (Kind::Bonds, "mie", TANGENT),
    (Kind::Bonds, "murrell_sorbie", TANGENT),
    (Kind::Bonds, "neo_hooke_bond", TANGENT),
    (Kind::Bonds, "pseudo_huber", FAR),
    (Kind::Bonds, "rose_universal", TANGENT),
    (Kind::Bonds, "rydberg", TANGENT),
    (Kind::Bonds, "stillinger_weber", CONSTANTS),
    (Kind::Bonds, "toda", TANGENT),
    (Kind::Bonds, "uniaxial_gent", TANGENT),
    (Kind::Bonds, "uniaxial_mooney", TANGENT),
    (Kind::Bonds, "uniaxial_neo_hooke", TANGENT),
    (Kind::Bonds, "varshni", VALUE),
    (Kind::Areas, "gent_area", TANGENT),
    (Kind::Areas, "skalak", TANGENT),
    (Kind::Areas, "symmetric_dirichlet", FAR),
    (Kind::Volumes, "birch_murnaghan", VALUE),
    (Kind::Volumes, "doll_schweizerhof", TANGENT),
    (Kind::Volumes, "liu_hofstetter_mang", TANGENT),
    (Kind::Volumes, "miehe", TANGENT),
    (Kind::Volumes, "murnaghan", TANGENT),
    (Kind::Volumes, "ogden_volumetric", TANGENT),
    (Kind::Volumes, "simo_miehe", TANGENT),
    (Kind::Volumes, "tait", TANGENT),
    (Kind::Volumes, "vinet", TANGENT),
    (Kind::Gradients, "balzani", KINK),
    (Kind::Gradients, "gasser_ogden_holzapfel", KINK),
    (Kind::Gradients, "holzapfel_ogden", KINK),
    (Kind::Gradients, "van_der_waals", ROOT),
    (Kind::Gathered, "dilatation_stiffening", POINTS),
    (Kind::Gathered, "embedded_atom", POINTS),
    (Kind::Gathered, "finnis_sinclair", POINTS),
    (Kind::Gathered, "green_states", POINTS),
    (Kind::Gathered, "volumetric_simo_miehe", POINTS),
];

#[test]
fn the_collection_keeps_its_digits() {
    let laws = collection();
    let found = on_all_processors(&laws, look_at);
    for (law, found) in laws.iter().zip(&found) {
        println!("{}", row(law, found));
    }
    let mut wrong = Vec::new();
    for (law, found) in laws.iter().zip(&found) {
        assert!(found.n_places >= 15, "{}: {} places", law.name, found.n_places);
        let is_listed = LOST.iter().any(|(kind, name, _)| (*kind, *name) == (law.kind, &law.name));
        if found.is_kept() == is_listed {
            let verb = if is_listed { "is kept, and listed as lost" } else { "is lost" };
            wrong.push(format!("{} ({}) {verb}: {}", law.name, law.kind.name(), found.missed()));
        }
    }
    let is_there = |kind: Kind, name: &str| laws.iter().any(|l| (l.kind, &*l.name) == (kind, name));
    assert!(LOST.iter().all(|(kind, name, _)| is_there(*kind, name)), "a listed law is gone");
    let kept = share("kept", &laws, &found, Found::is_kept);
    let near = share("kept near rest", &laws, &found, Found::is_kept_near_rest);
    let mut reasons: BTreeMap<&str, usize> = BTreeMap::new();
    LOST.iter().for_each(|(_, _, reason)| *reasons.entry(reason).or_default() += 1);
    println!("kept {kept:.3}, near rest {near:.3}; lost by reason: {reasons:?}");
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(kept >= SHARE_KEPT && near >= SHARE_KEPT_NEAR_REST, "{kept} {near}");
    assert!(laws.len() >= 60, "{}", laws.len());
}

/// Energies of F in all regimes of `piola audit`, with its excuses, of which the test above takes those that
/// are quick: near rest nothing else is found. `cargo test --release --workspace --test laws -- --ignored --nocapture`
#[test]
#[ignore = "minutes"]
fn the_audit_finds_the_same_near_rest_for_energies_of_the_deformation_gradient() {
    let mut laws = collection();
    laws.retain(|law| law.kind == Kind::Gradients);
    let missed = on_all_processors(&laws, support::regimes_missed);
    for (law, missed) in laws.iter().zip(missed) {
        println!("{}: {}", law.name, missed.join(", "));
        let is_lost = LOST.iter().any(|(kind, name, _)| (*kind, *name) == (law.kind, &law.name));
        let near = missed.iter().any(|name| name.contains("strain") || name.contains("guards"));
        assert_eq!(near, is_lost, "{}", law.name);
    }
}

/// A line of the table: the largest errors in u, and where the largest of all is.
fn row(law: &Law, found: &Found) -> String {
    let all = found.near.iter().chain(&found.far);
    let worst = all.max_by(|x, y| x.error.total_cmp(&y.error)).unwrap();
    let number = |x: f64| if x < 1e4 { format!("{x:.1}") } else { format!("{x:.0e}") };
    let numbers = |of: &[support::Worst; 3]| {
        of.iter().map(|worst| format!("{:>7}", number(worst.error))).collect::<String>()
    };
    let mark = if found.is_kept() { " " } else { "*" };
    let (near, far) = (numbers(&found.near), numbers(&found.far));
    let (kind, name) = (law.kind.name(), &law.name);
    format!("{mark} {kind:9} {name:24} near{near}  far{far}  {}", worst.at)
}

/// Prints the share of each kind, and gives that of all.
fn share(label: &str, laws: &[Law], found: &[Found], is_kept: fn(&Found) -> bool) -> f64 {
    let count = |kind: Option<Kind>| {
        let of_kind = laws.iter().zip(found).filter(|(law, _)| kind.is_none_or(|k| k == law.kind));
        let all: Vec<bool> = of_kind.map(|(_, found)| is_kept(found)).collect();
        (all.iter().filter(|kept| **kept).count(), all.len())
    };
    for kind in Kind::ALL {
        let (kept, all) = count(Some(kind));
        println!("{}: {kept} of {all} {label}, within {BAR} u", kind.name());
    }
    let (kept, all) = count(None);
    kept as f64 / all as f64
}
