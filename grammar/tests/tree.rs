//! What the tree of a text is: shape, names and places.

use piola_grammar::ast::{Arena, ExprId, ExprKind, Statement, UnaryOperator};
use piola_grammar::{Ast, parse, parse_expression, parse_unit, print, print_expression};

const SETH_HILL: &str = r#"potential seth_hill  "Seth-Hill family of one-, two- and three-neighbour energies"
source "Firooz, Javili, Steinmann 2023, eqs. (40)-(42)"

parameter C1      in J/m^(2*d+1), C1 > 0     "resistance to change of length"
parameter C2 = 0  in J/m^(3*d+2), C2 >= 0    "resistance to change of area"
parameter C3 = 0  in J/m^(4*d+3), C3 >= 0    "resistance to change of volume"
parameter n = 1                              "Seth-Hill exponent, 0 is the logarithm"

S(x) = if n == 0 then ln(x) else (x^n - 1)/n

psi(l) = 1/2*C1*L*S(l/L)^2
psi(a) = 1/2*C2*A*S(a/A)^2
psi(v) = 1/2*C3*V*S(v/V)^2
"#;

/// The expression with every operation in parentheses, written without the printer under test.
fn explicit(arena: &Arena, id: ExprId) -> String {
    let of = |id| explicit(arena, id);
    match &arena[id].kind {
        ExprKind::Number(value) => value.to_string(),
        ExprKind::Name(name) => name.clone(),
        ExprKind::Call { function, arguments } => {
            let arguments: Vec<String> = arguments.iter().map(|&id| of(id)).collect();
            format!("{}({})", function.name, arguments.join(" "))
        }
        ExprKind::Table { file, argument } => format!("table({} {})", file.text, of(*argument)),
        ExprKind::Unary { operator: UnaryOperator::Transpose, operand } => {
            format!("({}')", of(*operand))
        }
        ExprKind::Unary { operator, operand } => {
            let sign = if *operator == UnaryOperator::Negate { "-" } else { "not " };
            format!("({sign}{})", of(*operand))
        }
        ExprKind::Binary { operator, left, right } => {
            format!("({} {} {})", of(*left), operator.symbol(), of(*right))
        }
        ExprKind::If { condition, then, otherwise } => {
            format!("(if {} {} {})", of(*condition), of(*then), of(*otherwise))
        }
    }
}

#[test]
fn operators_group_as_the_table_says() {
    for (text, tree) in [
        ("1+2*3", "(1 + (2 * 3))"),
        ("table(\"a.csv\", x + 1)^2", "(table(a.csv (x + 1)) ^ 2)"),
        ("table + 1", "(table + 1)"),
        ("1-2-3", "((1 - 2) - 3)"),
        ("8/4/2", "((8 / 4) / 2)"),
        ("a/b*c", "((a / b) * c)"),
        ("2^3^2", "(2 ^ (3 ^ 2))"),
        ("-x^2", "(-(x ^ 2))"),
        ("2^-x", "(2 ^ (-x))"),
        ("2^-x^2*y", "((2 ^ (-(x ^ 2))) * y)"),
        ("a*-b", "(a * (-b))"),
        ("-a*b", "((-a) * b)"),
        ("--x", "(-(-x))"),
        ("-F'*F", "((-(F')) * F)"),
        ("x^F''", "(x ^ ((F')'))"),
        ("(A*B)'", "((A * B)')"),
        ("1/2*E:C*B", "((((1 / 2) * E) : C) * B)"),
        ("a - -b", "(a - (-b))"),
        ("1/2*C*S(l/L)^2", "(((1 / 2) * C) * (S((l / L)) ^ 2))"),
        ("a < b and c or not d == e", "(((a < b) and c) or (not (d == e)))"),
        ("not not a and b", "((not (not a)) and b)"),
        ("a + 1 <= b*2", "((a + 1) <= (b * 2))"),
        ("(a < b) == (c < d)", "((a < b) == (c < d))"),
        ("if a then b else c + d", "(if a b (c + d))"),
        ("1 + if a then b else c + d", "(1 + (if a b (c + d)))"),
        ("if a then if b then 1 else 2 else 3", "(if a (if b 1 2) 3)"),
        ("if a then 1 else if b then 2 else 3", "(if a 1 (if b 2 3))"),
        ("min(a,\n  b) # of both", "min(a b)"),
        ("if(a)then(b)else(c)", "(if a b c)"),
        (".5+1.+2.5E-3", "((0.5 + 1) + 0.0025)"),
        ("ψ*λ1/δ", "((psi * lambda1) / delta)"),
    ] {
        let ast = parse_expression(text).unwrap_or_else(|found| panic!("{text}: {found:?}"));
        assert_eq!(explicit(&ast.arena, ast.root), tree, "{text}");
    }
}

#[test]
fn spans_cover_what_was_written_and_children_stand_before_parents() {
    let text = "((a + λ)) * f( x , -(y) ) ^ if c then 1 else (2)   # end";
    let ast = parse_expression(text).unwrap();
    let places: Vec<&str> = ast.arena.iter().map(|(_, e)| &text[e.span.range()]).collect();
    let expected = [
        "a",
        "λ",
        "a + λ",
        "x",
        "y",
        "-(y)",
        "f( x , -(y) )",
        "c",
        "1",
        "2",
        "if c then 1 else (2)",
        "f( x , -(y) ) ^ if c then 1 else (2)",
        "((a + λ)) * f( x , -(y) ) ^ if c then 1 else (2)",
    ];
    assert_eq!(places, expected);
    assert_eq!(ast.root, ExprId(12));
}

#[test]
fn the_file_of_the_papers_reads_as_it_stands() {
    let ast = parse(SETH_HILL).unwrap();
    assert_eq!(ast.name.name, "seth_hill");
    assert_eq!(ast.statements.len(), 9);
    let Statement::Parameter(c1) = &ast.statements[1] else { panic!() };
    assert_eq!((c1.name.name.as_str(), c1.defaults.len()), ("C1", 0));
    let unit = c1.unit.as_ref().unwrap();
    assert_eq!(&SETH_HILL[unit.span.range()], "J/m^(2*d+1)");
    assert!(!unit.factors[0].divided && unit.factors[1].divided);
    assert_eq!(print_expression(&ast.arena, unit.factors[1].exponent.unwrap()), "2*d + 1");
    assert_eq!(print_expression(&ast.arena, c1.constraints[0]), "C1 > 0");
    let Statement::Energy(energy) = &ast.statements[7] else { panic!() };
    assert_eq!(energy.measure.name, "a");
    assert_eq!(&SETH_HILL[energy.head.range()], "psi(a)");
    assert_eq!(&SETH_HILL[ast.arena[energy.body].span.range()], "1/2*C2*A*S(a/A)^2");
}

#[test]
fn the_canonical_text_of_that_file() {
    let expected = r#"potential seth_hill "Seth-Hill family of one-, two- and three-neighbour energies"
source "Firooz, Javili, Steinmann 2023, eqs. (40)-(42)"
parameter C1 in J/m^(2*d + 1), C1 > 0 "resistance to change of length"
parameter C2 = 0 in J/m^(3*d + 2), C2 >= 0 "resistance to change of area"
parameter C3 = 0 in J/m^(4*d + 3), C3 >= 0 "resistance to change of volume"
parameter n = 1 "Seth-Hill exponent, 0 is the logarithm"
S(x) = if n == 0 then ln(x) else (x^n - 1)/n
psi(l) = 1/2*C1*L*S(l/L)^2
psi(a) = 1/2*C2*A*S(a/A)^2
psi(v) = 1/2*C3*V*S(v/V)^2
"#;
    assert_eq!(print(&parse(SETH_HILL).unwrap()), expected);
}

fn one_statement(text: &str) -> (Ast, Statement) {
    let ast = parse(&format!("potential p\n{text}")).unwrap_or_else(|e| panic!("{text}: {e:?}"));
    assert_eq!(ast.statements.len(), 1);
    let statement = ast.statements[0].clone();
    (ast, statement)
}

#[test]
fn every_form_of_a_statement() {
    for (text, canonical) in [
        ("parameter k = 2, k >= 1", "parameter k = 2, k >= 1"),
        ("parameter k,k>=1,k<2\"two\"", "parameter k, k >= 1, k < 2 \"two\""),
        ("parameter λ in 1", "parameter lambda in 1"),
        ("parameter k in 1/s # rate", "parameter k in 1/s"),
        ("parameter k in kg*m^-2*s^d/K^(-2)", "parameter k in kg*m^-2*s^d/K^-2"),
        ("parameter k in m^(d+1)/µm", "parameter k in m^(d + 1)/um"),
        ("dimensions 2,3", "dimensions 2, 3"),
        ("domain l / L in (0, 10]", "domain l/L in (0, 10]"),
        ("domain v in [-inf,inf)", "domain v in [-inf, inf)"),
        ("domain a in ((1+2)*3, 2)", "domain a in ((1 + 2)*3, 2)"),
        ("psi(F) = 1", "psi(F) = 1"),
        ("ψ ( whatever ) = 1", "psi(whatever) = 1"),
        ("S(x, y) = x", "S(x, y) = x"),
        ("iffy = 1", "iffy = 1"),
        ("allow \"no-bond-energy\"", "allow \"no-bond-energy\""),
        ("allow\"x\"\"why\" # (", "allow \"x\" \"why\""),
        ("source \"#(\" # (", "source \"#(\""),
    ] {
        let (ast, _) = one_statement(text);
        assert_eq!(print(&ast), format!("potential p\n{canonical}\n"));
    }
}

#[test]
fn domains_state_their_ends_and_their_place() {
    let (ast, statement) = one_statement("  domain l/L in (0, 10] # used");
    let Statement::Domain(domain) = statement else { panic!() };
    assert!(!domain.lower.inclusive && domain.upper.inclusive);
    assert_eq!(ast.arena[domain.upper.value].kind, ExprKind::Number(10.0));
    let start = "potential p\n  ".len();
    let end = start + "domain l/L in (0, 10]".len();
    assert_eq!(domain.span.range(), start..end);
}

#[test]
fn line_ends_marks_and_blanks_do_not_matter() {
    let unix = "potential p\n\n# comment\npsi(l) = (1\n + l)\n\n";
    let tree = print(&parse(unix).unwrap());
    let windows = unix.replace('\n', "\r\n");
    let mac = unix.replace('\n', "\r");
    let marked = format!("\u{FEFF}{unix}");
    let indented = unix.replace('\n', "\n\t ");
    for text in [windows, mac, marked, indented, unix.trim_end().to_string()] {
        assert_eq!(print(&parse(&text).unwrap()), tree, "{text:?}");
    }
    let marked = "\u{FEFF}potential p\npsi(l) = 2";
    let ast = parse(marked).unwrap();
    assert_eq!(&marked[ast.name.span.range()], "p");
}

#[test]
fn a_unit_alone() {
    for (text, canonical) in [("GPa", "GPa"), (" N / m ^ 2 ", "N/m^2"), ("1", "1"), ("1*m", "m")] {
        let (unit, arena) = parse_unit(text).unwrap();
        assert_eq!(piola_grammar::print_unit(&arena, &unit), canonical);
    }
    let (unit, _) = parse_unit(" N / m ^ 2 ").unwrap();
    assert_eq!(unit.span.range(), 1..10);
}
