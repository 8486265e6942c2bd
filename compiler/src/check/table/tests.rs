use super::*;
use crate::check::check_text_with;
use crate::expression::interpret::Interpreter;
use crate::expression::precise::Precise;
use crate::verify::verify;
use crate::{Form, Model, test_support::values};

const DATA: &str =
    "strain [1], stress [MPa]  # measured\n-0.2, -3\n\n0, 0\n0.1, 2\n0.3, 3\n0.4, 3\n0.7, 2.5\n";

fn checked(text: &str, data: &str) -> Result<Model, Vec<Diagnostic>> {
    let files = |name: &str| match name {
        "data.csv" => Ok(data.to_string()),
        _ => Err("there is no such file".to_string()),
    };
    check_text_with(text, &files).map(|(_, model)| model)
}

/// What is said of a file, of a table of pure numbers.
fn refused(data: &str) -> String {
    let found = checked("potential p\npsi(l) = table(\"data.csv\", l/L)", data).unwrap_err();
    assert_eq!((found.len(), found[0].code), (1, "wrong-table"), "{found:?}");
    found[0].message.clone()
}

/// psi, psi' and psi'' of `table("data.csv", l)` at `l`, worked out to 256 bits.
fn curve(table: &Table, at: f64) -> [f64; 3] {
    let mut graph = ExprGraph::new();
    let measure = crate::expression::Input::Current(crate::Measure::Length);
    let x = graph.intern(Node::Input(measure)).unwrap();
    let root = table.curve(&mut graph, x).unwrap();
    let mut interpreter = Interpreter::<Precise<256>>::new();
    interpreter.run(&graph, |_| Precise::variable(at));
    interpreter.number(root).rounded()
}

#[test]
fn the_curve_goes_through_the_points_with_one_slope_and_overshoots_nowhere() {
    let table = Table::read("data.csv", DATA).unwrap();
    assert_eq!(table.y, [-3e6, 0.0, 2e6, 3e6, 3e6, 2.5e6]);
    let scale = 3e6;
    for k in 0..table.x.len() {
        let step = 1e-12;
        let [left, right] = [-step, step].map(|by| curve(&table, table.x[k] + by));
        assert!((curve(&table, table.x[k])[0] - table.y[k]).abs() <= 1e-9, "point {k}");
        assert!((left[0] - right[0]).abs() <= 1e-10 * scale, "value at point {k}");
        assert!((left[1] - right[1]).abs() <= 1e-8 * scale, "slope at point {k}");
        if k + 1 < table.x.len() {
            let (low, high) = (table.y[k].min(table.y[k + 1]), table.y[k].max(table.y[k + 1]));
            for part in 0..=100 {
                let at = table.x[k] + f64::from(part) / 100.0 * (table.x[k + 1] - table.x[k]);
                let value = curve(&table, at)[0];
                assert!((low - 1e-9..=high + 1e-9).contains(&value), "{at}: {value}");
            }
        }
    }
    // Beyond the points it is straight, with the slope of the last.
    let [value, slope, bend] = curve(&table, 2.0);
    assert_eq!(bend, 0.0);
    assert!((value - (2.5e6 + slope * 1.3)).abs() < 1e-6);
    assert_eq!(curve(&table, -5.0)[1], curve(&table, -0.2 - 1e-9)[1]);
}

/// By hand: harmonic means inside (Fritsch and Butland), three points at the ends.
#[test]
fn slopes_are_those_of_the_papers() {
    let found = slopes(&[0.0, 1.0, 3.0, 4.0], &[0.0, 2.0, 3.0, 3.0]);
    // w = 2*2 + 1 = 5, 2 + 2*1 = 4: 9/(5/2 + 4/0.5); beyond a flat piece 0.
    let expected = [2.0 + 1.0 / 3.0 * 1.5, 9.0 / (2.5 + 8.0), 0.0, 0.0];
    for (found, expected) in found.iter().zip(expected) {
        assert!((found - expected).abs() < 1e-15, "{found} {expected}");
    }
    // A parabola is met at both ends: y = x^2.
    let found = slopes(&[1.0, 2.0, 3.0], &[1.0, 4.0, 9.0]);
    assert!((found[0] - 2.0).abs() < 1e-15 && (found[2] - 6.0).abs() < 1e-15, "{found:?}");
    assert_eq!(slopes(&[0.0, 2.0], &[1.0, 4.0]), [1.5, 1.5]);
}

#[test]
fn what_is_wrong_with_a_file_names_its_line_and_column() {
    for (data, said) in [
        ("0, 1\n1, x\n", "data.csv:2:3: `x` is not a finite number"),
        ("0, 1\n1, inf\n", "data.csv:2:3: `inf` is not a finite number"),
        ("0, 1\n\n# no\n0, 2\n", "data.csv:4:1: x is 0 here and 0 before: it must ascend"),
        ("0, 1\n1; 2\n", "data.csv:2:1: `1; 2` is not `x, y`"),
        ("0, 1, 2\n", "data.csv:1:1: `0, 1, 2` is not `x, y`"),
        ("x [1], y [furlong]\n0, 1\n", "data.csv:1:7: `furlong` is not a unit"),
        ("x, y\n0, 1\n", "data.csv: a table has at least 2 points, not 1"),
        ("0, 0\n1e-300, 1e300\n", "data.csv: the curve has slopes that are not finite"),
    ] {
        assert_eq!(refused(data), said);
    }
    let rows = |n: usize| (0..n).map(|k| format!("{k}, {}\n", k * k)).collect::<String>();
    assert!(refused(&rows(MAX_ROWS + 1)).contains(":201:1: a table has at most 200 points"));
    let missing = "potential p\npsi(l) = table(\"other.csv\", l/L)";
    let found = checked(missing, "").unwrap_err();
    assert_eq!(found[0].message, "cannot read other.csv: there is no such file");
    assert_eq!(&missing[found[0].span.range()], "\"other.csv\"");
    let alone = crate::check_text(missing).unwrap_err();
    assert!(alone[0].message.contains("lies in no folder"), "{alone:?}");
}

#[test]
fn columns_have_units() {
    let law = |body: &str| {
        checked(
            &format!("potential p\ndimensions 3\nparameter C in m, C > 0\npsi(l) = {body}"),
            DATA,
        )
    };
    let code = |body: &str| law(body).unwrap_err()[0].code;
    law("C/L*table(\"data.csv\", l/L - 1)/L^3").unwrap();
    assert_eq!(code("table(\"data.csv\", l)/L^3"), "dimension-mismatch");
    assert_eq!(code("table(\"data.csv\", l/L - 1)"), "dimension-mismatch");
    assert_eq!(code("table(\"data.csv\", l > L)/L^3"), "type-mismatch");
}

/// The largest table that is read, in every way that derivatives are taken.
#[test]
fn all_ways_agree_and_the_largest_table_fits_a_kernel() {
    let rows: String = (0..MAX_ROWS)
        .map(|k| format!("{}, {}\n", k as f64 / 100.0 - 0.5, libm::sin(k as f64)))
        .collect();
    for body in ["L*table(\"data.csv\", l/L - 1)*(l/L)", "L*table(\"data.csv\", (l/L)^2 - 1)"] {
        let model = checked(&format!("potential p\npsi(l) = {body}"), &rows).unwrap();
        let (found, _) = verify(&model, &values(&model, 3, &[]), 200).unwrap();
        assert!(found[0].passed(), "{body}: {:?}", found[0].misses.first());
        for form in [Form::Accurate, Form::Textbook] {
            assert!(model.specialise_as(&values(&model, 3, &[]), form).is_ok());
        }
    }
    let rows: String = (-20..20).map(|k| format!("{}, {}\n", f64::from(k) / 20.0, k * k)).collect();
    let found = |energy: &str| {
        let model = checked(&format!("potential p\n{energy}"), &rows).unwrap();
        verify(&model, &values(&model, 3, &[]), 20).unwrap().0.remove(0)
    };
    // At rest it is 0, on a point.
    assert!(found("psi(l) = L*table(\"data.csv\", l/L - 1)").passed());
    // The choice has the digits of J alone.
    let of_gradient = found("psi(F) = table(\"data.csv\", J - 1) + E : E");
    assert!(of_gradient.misses.iter().all(|miss| !miss.is_wrong), "{of_gradient:?}");
}

/// A byte order mark is no name, and what cannot be read is no head.
#[test]
fn first_lines_are_names_or_points() {
    let points = |text: &str| Table::read("data.csv", text).map(|table| table.x);
    assert_eq!(points("\u{feff}0, 0\n1, 2\n").unwrap(), [0.0, 1.0]);
    assert_eq!(points("\"strain\", \"stress\"\n0, 0\n1, 2\n").unwrap(), [0.0, 1.0]);
    for text in ["O, 0\n1, 2\n2, 3\n", "0.0.1, 5\n1, 6\n2, 7\n", "x, 5\n1, 6\n2, 7\n"] {
        assert!(points(text).unwrap_err().contains("not a finite number"), "{text}");
    }
}
