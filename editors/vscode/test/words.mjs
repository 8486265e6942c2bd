// editors/words.json against the language itself: fails where one has a word that the other has not,
// and where a table of the compiler is no longer where this looks.

import { readFileSync } from "node:fs";
import { join } from "node:path";

const quoted = (text) => [...text.matchAll(/"((?:\\.|[^"\\])*)"/g)].map((m) => unescape(m[1]));

function unescape(text) {
  return text.replace(/\\u\{([0-9A-Fa-f]+)\}/g, (_, hex) => String.fromCodePoint(parseInt(hex, 16)));
}

/** What `pattern` captures in a file of the repository. */
function part(repository, file, pattern) {
  const found = readFileSync(join(repository, file), "utf8").match(pattern);
  if (found === null) throw new Error(`${file}: nothing fits ${pattern}; say in words.mjs where it is now`);
  return found[1];
}

export function readWords(editors) {
  const words = JSON.parse(readFileSync(join(editors, "words.json"), "utf8"));
  const all = (groups) => Object.values(groups).flat();
  return { ...words, allKeywords: all(words.keywords), allFunctions: all(words.functions) };
}

/** A list of complaints; empty if both have the same words. */
export function compare(words, repository) {
  const complaints = [];
  const same = (what, ours, theirs) => {
    for (const word of theirs) if (!ours.includes(word)) complaints.push(`${what}: the language has \`${word}\`, editors/words.json has not`);
    for (const word of ours) if (!theirs.includes(word)) complaints.push(`${what}: editors/words.json has \`${word}\`, the language has not`);
  };
  const within = (what, ours, theirs) => same(what, ours, [...new Set([...ours, ...theirs])]);

  const pest = "grammar/src/piola.pest";
  const names = "grammar/src/names.rs";
  const keywords = quoted(part(repository, pest, /\nkeyword = _\{([^}]*)\}/));
  same("keywords", words.allKeywords, keywords);
  same("keywords", words.allKeywords, quoted(part(repository, names, /const KEYWORDS: [^=]*= \[([^\]]*)\]/)));
  same("keywords of statements", words.keywords.statements, quoted(part(repository, names, /const STATEMENT_KEYWORDS: [^=]*= \[([^\]]*)\]/)));
  // Words that are no keywords and yet have a rule: `psi`, `dissipation`, `table`.
  const rules = readFileSync(join(repository, pest), "utf8").matchAll(/^\w+_word\s*= @\{(.*)\}$/gm);
  const ruled = [...rules].flatMap((m) => quoted(m[1])).filter((word) => !keywords.includes(word));
  same("words of piola.pest", [...words.heads, "ψ", "table"], ruled);
  // Every other text in quotes of the grammar is a mark, or a keyword again.
  const letters = quoted(readFileSync(join(repository, pest), "utf8").replace(/\/\/.*$/gm, "")).filter((t) => /^[a-z]{2,}$/.test(t));
  within("words of piola.pest", [...words.allKeywords, ...words.heads, "table"], letters);

  const functions = ["UNARY_FUNCTIONS", "BINARY_FUNCTIONS"].flatMap((table) =>
    quoted(part(repository, names, new RegExp(`const ${table}: [^=]*= \\[([^\\]]*)\\]`))));
  same("functions", words.functions.numbers, functions);
  const symbols = "compiler/src/check/symbols.rs";
  const tensors = quoted(part(repository, symbols, /impl TensorFunction \{[^=]*NAMES: [^=]*=\s*\[([^\]]*)\]/));
  same("functions of tensors", words.functions.tensors, [...tensors, "I4", "I5"]);
  const kinematics = quoted(part(repository, symbols, /impl Kinematic \{[^=]*NAMED: [^=]*= \[([^\]]*)\]/));
  within("tensors", [...words.tensors, ...words.measures], kinematics);
  const clique = readFileSync(join(repository, "compiler/src/clique.rs"), "utf8");
  const parts = [...clique.matchAll(/Part::(?:Edge|Face)\(k\) => \[([^\]]*)\]/g)].flatMap((m) => quoted(m[1]));
  same("parts of triangles and tetrahedra", words.parts, [...parts, "angle", "Angle"]);
  const reserved = part(repository, "compiler/src/check/names.rs", /const RESERVED: [^=]*= &\[([\s\S]*?)\n\];/);
  within("reserved names", [...words.measures, ...words.constants, ...words.heads, ...words.scenes], [...reserved.matchAll(/\("(\w+)",/g)].map((m) => m[1]));
  const unit = "compiler/src/check/unit.rs";
  const firsts = (text) => [...text.matchAll(/\("([^"]+)",/g)].map((m) => m[1]);
  same("units", words.units, firsts(part(repository, unit, /const NAMED: [^=]*= &\[([\s\S]*?)\n\];/)));
  same("prefixes", words.prefixes, firsts(part(repository, unit, /const PREFIXES: [^=]*= &\[([\s\S]*?)\n\];/)));

  // What LANGUAGE.md tells of functions, and of names.
  const manual = "grammar/LANGUAGE.md";
  const cells = (text) => [...text.matchAll(/^\| (`.*?) \|/gm)].flatMap((m) => [...m[1].matchAll(/`([^`]*)`/g)].map((n) => n[1]));
  const told = cells(part(repository, manual, /\n### Functions\n([\s\S]*?)\n### /)).map((call) => call.replace(/\(.*/, ""));
  within("functions of LANGUAGE.md", words.allFunctions, told);
  const known = cells(part(repository, manual, /\n### Names the language knows\n([\s\S]*?)\n### /)).flatMap((cell) => cell.split(" "));
  within("names of LANGUAGE.md", [...words.measures, ...words.constants, ...words.tensors, ...words.scenes], known);
  const text = readFileSync(join(repository, manual), "utf8");
  for (const word of words.functions.special) if (!text.includes(`${word}(`)) complaints.push(`LANGUAGE.md knows no \`${word}(..)\``);
  return complaints;
}
