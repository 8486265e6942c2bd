; Later patterns win where several fit.

(name) @variable
(number) @number
(string) @string
(comment) @comment

["(" ")" "[" "]"] @punctuation.bracket
"," @punctuation.delimiter

["=" "==" "!=" "<" "<=" ">" ">=" "+" "-" "*" "/" ":" "^" "'"] @operator

; Words

["potential" "parameter" "state"] @keyword.type
["source" "allow" "dimensions" "weights" "domain" "update" "in"] @keyword
"import" @keyword.import
["break" "when"] @keyword.control
["if" "then" "else"] @keyword.conditional
["and" "or" "not"] @keyword.operator
["psi" "ψ" "dissipation"] @keyword.function
"volumes" @constant.builtin

; What a file defines, and calls

(potential name: (name) @type.definition)
(call function: (name) @function.call)
(parameter name: (name) @variable.parameter)
(state name: (name) @variable.member)
(update state: (name) @variable.member)
(definition name: (name) @constant)
(function_definition name: (name) @function)

; What the language knows

((name) @constant.builtin
  (#any-of? @constant.builtin "pi" "π" "inf" "delta" "δ" "d" "dt"))

((name) @variable.builtin
  (#any-of? @variable.builtin
    "l" "L" "a" "A" "v" "V" "F" "xi" "ξ" "Xi" "Ξ"
    "J" "I1" "I2" "I3"
    "l1" "l2" "l3" "l4" "l5" "l6" "L1" "L2" "L3" "L4" "L5" "L6"
    "a1" "a2" "a3" "a4" "A1" "A2" "A3" "A4" "angle" "Angle"))

; `C`, `E`, `I` and `U` are tensors beside F and everywhere else anybody's names, and a query does not
; see a whole file: only where no number can stand.
(transpose operand: (name) @variable.builtin
  (#any-of? @variable.builtin "C" "E" "I" "U"))
(call
  function: (name) @_function
  (name) @variable.builtin
  (#any-of? @_function "tr" "det" "inv" "dev" "sym" "norm")
  (#any-of? @variable.builtin "C" "E" "I" "U"))
(product
  operator: ":"
  (name) @variable.builtin
  (#any-of? @variable.builtin "C" "E" "I" "U"))

(call
  function: (name) @function.builtin
  (#any-of? @function.builtin
    "sqrt" "exp" "ln" "log1p" "expm1" "log1pmx" "sin" "cos" "tan" "asin" "acos" "atan"
    "sinh" "cosh" "tanh" "erf" "abs" "sign" "min" "max" "atan2"
    "tr" "det" "inv" "dev" "sym" "dyad" "vector" "norm" "I4" "I5"
    "sum" "rate" "integral" "neighbour"))
(table "table" @function.builtin)

(formals (name) @variable.parameter)
(parameter name: (name) @variable.parameter)
(definition name: (name) @constant)
(function_definition name: (name) @function)

(unit (number) @type.builtin)
(unit_name (name) @type.builtin)
