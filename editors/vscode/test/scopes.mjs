// node scopes.mjs REPOSITORY FILE..: tokenises files as VS Code does and looks for the scope of every
// word, number, text and comment. A second way to find these, the few lines of `lex`, says what they are.

import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { basename, dirname, join } from "node:path";
import { fileURLToPath } from "node:url";
import { compare, readWords } from "./words.mjs";

const require = createRequire(import.meta.url);
const { loadWASM, OnigScanner, OnigString } = require("vscode-oniguruma");
const { INITIAL, Registry, parseRawGrammar } = require("vscode-textmate");

const [repository, ...files] = process.argv.slice(2);
const vscode = dirname(dirname(fileURLToPath(import.meta.url)));
const words = readWords(dirname(vscode));
const complaints = compare(words, repository);
if (complaints.length === 0) console.log("words: editors/words.json has those of the language");

const wasm = readFileSync(require.resolve("vscode-oniguruma").replace(/main\.js$/, "onig.wasm"));
await loadWASM(wasm.buffer.slice(wasm.byteOffset, wasm.byteOffset + wasm.byteLength));
const registry = new Registry({
  onigLib: Promise.resolve({
    createOnigScanner: (patterns) => new OnigScanner(patterns),
    createOnigString: (text) => new OnigString(text),
  }),
  loadGrammar: async (scope) => {
    if (scope !== "source.piola") return null;
    const path = join(vscode, "syntaxes", "piola.tmLanguage.json");
    return parseRawGrammar(readFileSync(path, "utf8"), path);
  },
});
const grammar = await registry.loadGrammar("source.piola");

function tokenise(text) {
  let state = INITIAL;
  return text.split(/\r\n|\r|\n/).map((line) => {
    const { tokens, ruleStack } = grammar.tokenizeLine(line, state);
    state = ruleStack;
    return { line, tokens };
  });
}

const scopesAt = ({ tokens }, column) => tokens.find((t) => t.startIndex <= column && column < t.endIndex).scopes;

const NAME = "[a-zA-Z_Α-ΡΣ-Ωα-ωϑϕϖϰϱϵµ][a-zA-Z0-9_Α-ΡΣ-Ωα-ωϑϕϖϰϱϵµ]*";
const TOKEN = new RegExp(`(#.*)|("[^"]*")|((?:\\d+(?:\\.\\d*)?|\\.\\d+)(?:[eE][-+]?\\d+)?)|(${NAME})|\\S`, "g");
const KINDS = [, "comment", "text", "number", "name"];

function lex(line) {
  return [...line.matchAll(TOKEN)].map((m) => {
    const kind = KINDS[[1, 2, 3, 4].find((i) => m[i] !== undefined)] ?? "mark";
    return { kind, text: m[0], at: m.index, next: line.slice(m.index + m[0].length).trimStart()[0] };
  });
}

const spelled = Object.fromEntries(Object.entries(words.greek).map(([word, letter]) => [letter, word]));
const PARTS = new Set(words.parts);
// Where a file defines one of these, the grammar takes all tensors for ordinary names.
const OWNED = new Set(words.tensors.filter((word) => word.length === 1));
const UNIT = new RegExp(`^(${[...words.prefixes, "μ"].join("|")})?(${words.units.join("|")})$`);

/** What the language gives a scope of its own; users' names have none of these. */
const OF_THE_LANGUAGE = /^(keyword|storage|support|constant|variable\.language)\b/;

/** Follows a file: which names it has made its own, whether a unit is open. */
function expectations() {
  let ownsParts = false;
  let ownsTensors = false;
  const owned = new Set();
  let formals = [];
  let unit = false;
  let depth = 0;
  return (tokens) => {
    const expected = [];
    if (depth === 0) {
      unit = false;
      formals = [];
    }
    const [first, second] = tokens;
    const declares = first?.text === "parameter" || first?.text === "state";
    const marks = tokens.filter((t) => t.kind === "mark").map((t) => t.text).join("");
    const isHead = depth === 0 && first?.kind === "name" && /^(\(,*\))?=(?!=)/.test(marks) && (first.next === "=" || first.next === "(");
    const isEnergy = isHead && words.heads.includes(spelled[first.text] ?? first.text);
    const own = declares ? second?.text : isHead && !isEnergy && !words.allKeywords.includes(first.text) ? first.text : undefined;
    ownsParts ||= PARTS.has(own);
    ownsTensors ||= OWNED.has(own);
    if (own !== undefined) owned.add(own);
    const equals = tokens.findIndex((t) => t.text === "=");
    if (isHead && !isEnergy && first.next === "(") formals = tokens.slice(1, equals).filter((t) => t.kind === "name").map((t) => t.text);
    tokens.forEach((token, i) => {
      const { kind, text, next } = token;
      const word = spelled[text] ?? text;
      const want = (scope) => expected.push({ token, scope });
      if (kind === "comment") want(/^comment\.line/);
      else if (kind === "text") want(/^string\.quoted/);
      else if (kind === "number") want(/^constant\.numeric/);
      else if (kind === "mark") {
        if ("([".includes(text)) depth++;
        if (")]".includes(text)) depth = Math.max(0, depth - 1);
        if (text === "," && depth === 0) unit = false;
        if (text !== "'" ? "<>=!+-*/:^".includes(text) : true) want(/^keyword\.operator/);
      } else if (words.allKeywords.includes(text)) {
        if (text === "in") unit = next !== "(" && next !== "[";
        want(/^(keyword|storage\.type)\./);
      } else if (isHead && i === 0) want(isEnergy ? /^storage\.type/ : first.next === "(" ? /^entity\.name\.function/ : /^entity\.name\.constant/);
      else if (isHead && i < equals && formals.includes(text)) want(/^variable\.parameter/);
      else if (formals.includes(text)) return; // a grammar of lines cannot know
      else if (i === 1 && declares) want(/^variable\.(parameter|other\.state)/);
      else if (i === 1 && first.text === "potential") want(/^entity\.name\.type/);
      else if (i === 1 && first.text === "update") want(/^variable\.other\.state/);
      else if (i === 1 && first.text === "weights") want(/^support\.constant/);
      else if (unit && depth === 0 && tokens[i - 1]?.text !== "^") want(UNIT.test(text) ? /^keyword\.other\.unit/ : /^variable\.other/);
      else if (owned.has(text) && !PARTS.has(text) && !OWNED.has(text)) return; // nor this: `I1 = tr(C)`, `sum(x, y) = x + y`
      else if (isEnergy && i < equals && PARTS.has(text)) want(/^variable\.language/);
      else if (words.allFunctions.includes(word) && next === "(" && !unit) want(/^support\.function/);
      else if (words.constants.includes(word)) want(/^constant\.language/);
      else if (words.measures.includes(word)) want(/^variable\.language/);
      else if (PARTS.has(word)) want(ownsParts ? null : /^variable\.language/);
      else if (words.tensors.includes(word)) want(ownsTensors ? null : /^variable\.language/);
      else want(null);
    });
    return expected;
  };
}

let looked = 0;
function look(name, text, mayBeInvalid) {
  const expect = expectations();
  tokenise(text).forEach((tokenised, number) => {
    const place = (column) => `${name}:${number + 1}:${column + 1}`;
    for (const { startIndex, endIndex, scopes } of tokenised.tokens) {
      if (!mayBeInvalid && scopes.some((scope) => scope.startsWith("invalid"))) {
        complaints.push(`${place(startIndex)}: \`${tokenised.line.slice(startIndex, endIndex)}\` is ${scopes.at(-1)}`);
      }
    }
    if (mayBeInvalid) return;
    for (const { token, scope } of expect(lex(tokenised.line))) {
      const scopes = scopesAt(tokenised, token.at);
      const fits = scope === null ? !scopes.some((s) => OF_THE_LANGUAGE.test(s)) : scopes.some((s) => scope.test(s));
      if (!fits) complaints.push(`${place(token.at)}: \`${token.text}\` is ${scopes.at(-1)}, expected ${scope ?? "a user's name"}`);
      looked += 1;
    }
  });
}

// What does not read as piola may be marked as such.
const unreadable = new Set((process.env.PIOLA_UNREADABLE ?? "").split(" "));
for (const file of files) look(file, readFileSync(join(repository, file), "utf8").replace(/^\uFEFF/, ""), unreadable.has(file));

// Every word once, whether a file has it or not.
const spellings = (list) => list.flatMap((word) => (word in words.greek ? [word, words.greek[word]] : [word]));
const every = [
  `potential p "title" # comment`, `source "text"`, `import "a.piola"`, `allow "code" "reason"`, "dimensions 2, 3", "weights volumes",
  ...words.units.flatMap((unit) => ["", ...words.prefixes].map((prefix) => `parameter x in ${prefix}${unit}^2, x > 0 "text"`)),
  "state k = 0 in 1/s", "update k = k", "update k(j) = 1.", "domain l/L in [.5, 2.5e-3)", "break when l > 2 \"text\"",
  "psi(l) = 1", "ψ(angle, l1) = 1", "dissipation(l) = 1",
  "y = if x > 1 and x < 2 or not x == 3 then 1 else 2",
  ...words.allFunctions.map((word) => `y = ${word === "table" ? 'table("a.csv", x)' : `${word}(x)`}`),
  ...spellings([...words.constants, ...words.measures, ...words.parts, ...words.tensors]).map((word) => `y = x*${word}`),
  ...words.scenes.map((word) => `y = x*${word}`),
];
look("words.json", every.join("\n"), false);
// What makes a name a user's: all of it is one name.
look("names", ["y = exp + sumx(2) + pi_ + lambda1 + inn + iff + table", "y = µ + λ1*Δμ_0", "y = 1e5 + 1.e5", "parameter C", "y = C*E*tr(x)*a1", "l1 = 3", "y = l1*C"].join("\n"), false);
// And what is marked as a mistake.
for (const [text, scope] of [['source "text', "invalid.illegal.unclosed-string.piola"], ["y = x; z", "invalid.illegal.character.piola"], ["y = parameter", "invalid.illegal.keyword.piola"]]) {
  const found = tokenise(text)[0].tokens.some((token) => token.scopes.includes(scope));
  if (!found) complaints.push(`\`${text}\` has no ${scope}`);
}

if (complaints.length > 0) {
  for (const complaint of complaints.slice(0, 40)) console.error(complaint);
  console.error(`scopes: ${complaints.length} complaints`);
  process.exit(1);
}
console.log(`scopes: ${looked} words and marks of ${files.length} files have theirs`);
