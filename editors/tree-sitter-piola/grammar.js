/**
 * The language of piola for editors: a statement a line, newlines inside parentheses are blanks.
 *
 * It follows grammar/src/piola.pest and, in what binds how tightly, grammar/src/operator.rs.
 * Stricter readings that the compiler has behind its grammar stand here, too, where syntax can say
 * them: comparisons do not chain, and `not` behind a tighter operator needs parentheses.
 *
 * @license MIT OR Apache-2.0
 */

/// <reference types="tree-sitter-cli/dsl" />
// @ts-check

// From the loosest to the tightest, as `Binding` of operator.rs.
const BINDING = {
  conditional: -1,
  or: 1,
  and: 2,
  not: 3,
  comparison: 4,
  sum: 5,
  product: 6,
  sign: 7,
  power: 8,
  transpose: 9,
};

// Words that cannot be names.
const KEYWORDS = [
  "potential", "source", "import", "allow", "parameter", "dimensions", "weights", "domain",
  "break", "when", "state", "update",
  "in", "if", "then", "else", "and", "or", "not",
];

const commaSeparated = (rule) => seq(rule, repeat(seq(",", rule)));

module.exports = grammar({
  name: "piola",

  // src/scanner.c counts parentheses: inside them a newline is a blank, outside it ends a statement.
  externals: ($) => [$._newline, $._blank_newline, "(", ")", "[", "]"],

  extras: ($) => [/[ \t]/, $._blank_newline, $.comment],

  word: ($) => $.name,

  reserved: { global: (_) => KEYWORDS },

  supertypes: ($) => [$.statement],

  rules: {
    source_file: ($) =>
      seq(
        repeat($._newline),
        optional(seq($.statement, repeat(seq(repeat1($._newline), $.statement)), repeat($._newline))),
      ),

    statement: ($) =>
      choice(
        $.potential,
        $.source,
        $.import,
        $.allow,
        $.dimensions,
        $.weights,
        $.parameter,
        $.state,
        $.update,
        $.domain,
        $.break,
        $.energy,
        $.dissipation,
        $.function_definition,
        $.definition,
      ),

    // Statements

    potential: ($) =>
      seq("potential", field("name", $.name), optional(field("title", $.string))),

    source: ($) => seq("source", field("text", $.string)),

    import: ($) => seq("import", field("file", $.string)),

    allow: ($) => seq("allow", field("code", $.string), optional(field("reason", $.string))),

    dimensions: ($) => seq("dimensions", commaSeparated(alias(choice("2", "3"), $.number))),

    weights: (_) => seq("weights", field("kind", "volumes")),

    parameter: ($) =>
      seq(
        "parameter",
        field("name", $.name),
        optional($.size),
        optional(seq("=", field("default", choice($.entries, $._expression)))),
        optional($._in_unit),
        repeat(seq(",", field("condition", $._expression))),
        optional(field("description", $.string)),
      ),

    state: ($) =>
      seq(
        "state",
        field("name", $.name),
        optional($.size),
        "=",
        field("start", choice($.entries, $._expression)),
        optional($._in_unit),
        optional(field("description", $.string)),
      ),

    update: ($) =>
      seq(
        "update",
        field("state", $.name),
        optional(seq("(", field("index", $.name), ")")),
        "=",
        field("next", $._expression),
      ),

    domain: ($) => seq("domain", field("quantity", $._expression), "in", $.interval),

    interval: ($) =>
      seq(
        choice("(", "["),
        field("lower", $._expression),
        ",",
        field("upper", $._expression),
        choice(")", "]"),
      ),

    break: ($) =>
      seq(
        "break",
        "when",
        field("condition", $._expression),
        optional(field("reason", $.string)),
      ),

    energy: ($) =>
      seq(choice("psi", "ψ"), $.measures, "=", field("body", $._expression)),

    dissipation: ($) => seq("dissipation", $.measures, "=", field("body", $._expression)),

    // A dissipation of several measures is refused behind the grammar.
    measures: ($) => seq("(", commaSeparated($.name), ")"),

    function_definition: ($) =>
      seq(field("name", $.name), $.formals, "=", field("body", $._expression)),

    formals: ($) => seq("(", commaSeparated($.name), ")"),

    definition: ($) =>
      seq(field("name", $.name), "=", field("value", $._expression), optional($._in_unit)),

    size: ($) => seq("(", alias($._whole, $.number), ")"),

    entries: ($) => seq("(", $._expression, repeat1(seq(",", $._expression)), ")"),

    // Units: a product of powers of named units; `1` is the empty product.

    _in_unit: ($) => seq("in", field("unit", $.unit)),

    unit: ($) =>
      seq(
        choice(alias("1", $.number), $._unit_factor),
        repeat(seq(choice("*", "/"), $._unit_factor)),
      ),

    _unit_factor: ($) => choice($.unit_name, $.unit_power),

    unit_power: ($) => seq($.unit_name, "^", field("exponent", $.exponent)),

    unit_name: ($) => $.name,

    exponent: ($) => seq(optional("-"), choice($.number, $.name, $.group)),

    // Expressions: `_arithmetic` is what may stand beside an operator tighter than `not`.

    _expression: ($) =>
      choice($._arithmetic, $.comparison, $.negation, $.conjunction, $.disjunction),

    disjunction: ($) =>
      prec.left(
        BINDING.or,
        seq(field("left", $._expression), "or", field("right", $._expression)),
      ),

    conjunction: ($) =>
      prec.left(
        BINDING.and,
        seq(field("left", $._expression), "and", field("right", $._expression)),
      ),

    negation: ($) => prec(BINDING.not, seq("not", field("operand", $._expression))),

    comparison: ($) =>
      prec(
        BINDING.comparison,
        seq(
          field("left", $._arithmetic),
          field("operator", choice("==", "!=", "<", "<=", ">", ">=")),
          field("right", $._arithmetic),
        ),
      ),

    _arithmetic: ($) =>
      choice(
        $.sum,
        $.product,
        $.sign,
        $.power,
        $.transpose,
        $.conditional,
        $.group,
        $.table,
        $.call,
        $.number,
        $.name,
        // `table` is a name where no text stands behind its parenthesis.
        alias("table", $.name),
      ),

    sum: ($) =>
      prec.left(
        BINDING.sum,
        seq(
          field("left", $._arithmetic),
          field("operator", choice("+", "-")),
          field("right", $._arithmetic),
        ),
      ),

    product: ($) =>
      prec.left(
        BINDING.product,
        seq(
          field("left", $._arithmetic),
          field("operator", choice("*", "/", ":")),
          field("right", $._arithmetic),
        ),
      ),

    sign: ($) => prec(BINDING.sign, seq("-", field("operand", $._arithmetic))),

    power: ($) =>
      prec.right(
        BINDING.power,
        seq(field("base", $._arithmetic), "^", field("exponent", $._arithmetic)),
      ),

    transpose: ($) => prec(BINDING.transpose, seq(field("operand", $._arithmetic), "'")),

    // Its last branch goes on as far as it can.
    conditional: ($) =>
      prec(
        BINDING.conditional,
        seq(
          "if",
          field("condition", $._expression),
          "then",
          field("then", $._expression),
          "else",
          field("else", $._expression),
        ),
      ),

    group: ($) => seq("(", $._expression, ")"),

    table: ($) =>
      seq("table", "(", field("file", $.string), ",", field("at", $._expression), ")"),

    call: ($) =>
      seq(
        field("function", choice($.name, alias("table", $.name))),
        "(",
        commaSeparated($._expression),
        ")",
      ),

    // Words and marks

    name: (_) =>
      /[a-zA-Z_\u0391-\u03A1\u03A3-\u03A9\u03B1-\u03C9\u03D1\u03D5\u03D6\u03F0\u03F1\u03F5\u00B5][a-zA-Z0-9_\u0391-\u03A1\u03A3-\u03A9\u03B1-\u03C9\u03D1\u03D5\u03D6\u03F0\u03F1\u03F5\u00B5]*/,

    number: (_) => token(/([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]+)?/),

    _whole: (_) => /[0-9]+/,

    string: (_) => /"[^"\r\n]*"/,

    comment: (_) => /#[^\r\n]*/,  },
});
