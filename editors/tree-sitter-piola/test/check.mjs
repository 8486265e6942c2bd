// node check.mjs REPOSITORY TREE_SITTER WORK FILE..: parses files, what grammar/tests/mistakes.txt has,
// and every word of the language. The current folder is that of the grammar, WORK one for files of this.

import { execFileSync } from "node:child_process";
import { mkdirSync, readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";

const [repository, treeSitter, work, ...files] = process.argv.slice(2);
mkdirSync(work, { recursive: true });
const complaints = [];

function run(...args) {
  try {
    return execFileSync(treeSitter, args, { encoding: "utf8", maxBuffer: 1 << 26, stdio: ["ignore", "pipe", "pipe"] });
  } catch (error) {
    // It ends with 1 where a file has an error in it.
    if (error.status === 1 && error.stdout !== "") return error.stdout;
    throw new Error(`tree-sitter ${args.join(" ")}: ${error.stderr ?? error.message}`);
  }
}

/** Which of these paths have an ERROR or a MISSING in their tree. */
function refused(paths) {
  const list = join(work, "paths");
  writeFileSync(list, paths.join("\n") + "\n");
  const out = run("parse", "--quiet", "--stat", "--paths", list);
  const total = out.match(/Total parses: (\d+); successful parses: (\d+)/);
  if (total === null || Number(total[1]) !== paths.length) throw new Error(`tree-sitter parsed not all of ${paths.length} files:\n${out}`);
  const lines = out.split("\n").filter((line) => /\((ERROR|MISSING)/.test(line));
  const found = new Set(paths.filter((path) => lines.some((line) => line.startsWith(`${path} `) || line.startsWith(`${path}\t`))));
  if (found.size !== Number(total[1]) - Number(total[2])) throw new Error(`which files were refused does not show:\n${out}`);
  return found;
}

// Files of the repository.
const unreadable = new Set((process.env.PIOLA_UNREADABLE ?? "").split(" "));
const bad = refused(files.map((file) => join(repository, file)));
for (const file of files) {
  const isBad = bad.has(join(repository, file));
  if (isBad && !unreadable.has(file)) complaints.push(`${file}: an error, and editors/unreadable does not name it`);
  if (!isBad && unreadable.has(file)) complaints.push(`${file}: no error, though editors/unreadable names it`);
}

// What the reader of the language refuses, and what of it only sense can: these the grammar may take.
const OF_SENSE = new Set([
  "psi(l, L) = l", "psi(a, l) = l", "parameter psi = 2", "dissipation(l, a) = rate(l)^2", "k = 1e999", "k = 1e-999",
  "", "# nothing", "parameter C = 1\npsi(l) = l", "# late\nk = 1\npotential p", "potential p\npotential q",
]);
const cases = [];
for (const line of readFileSync(join(repository, "grammar/tests/mistakes.txt"), "utf8").split("\n")) {
  const [, kind, text] = line.match(/^([sfeu+])> ?(.*)$/) ?? [];
  if (kind === "+") cases.at(-1).text += `\n${line.slice(3)}`;
  else if (kind !== undefined) cases.push({ kind, text });
}
const around = { s: (t) => `potential p\n${t}`, f: (t) => t, e: (t) => `potential p\nx = (${t})`, u: (t) => `potential p\nparameter C in ${t}` };
const mistakes = cases.map(({ kind, text }, i) => {
  const path = join(work, `mistake-${i}.piola`);
  writeFileSync(path, `${around[kind](text)}\n`);
  return { path, text };
});
const errors = refused(mistakes.map(({ path }) => path));
const taken = mistakes.filter(({ path, text }) => !errors.has(path) && !OF_SENSE.has(text));
for (const { text } of taken) complaints.push(`no error in \`${text}\`, which grammar/tests/mistakes.txt has`);

// Every word has its capture: the last pattern that fits wins.
const words = JSON.parse(readFileSync(join("..", "words.json"), "utf8"));
const spellings = (list) => list.flatMap((word) => (word in words.greek ? [word, words.greek[word]] : [word]));
const lines = [];
const add = (text, word, capture) => lines.push({ text, word, capture });
const head = { potential: "potential p", source: 'source "a"', import: 'import "a"', allow: 'allow "a"', parameter: "parameter p", dimensions: "dimensions 2", weights: "weights volumes", domain: "domain l in (0, 1)", break: "break when x", state: "state s = 1", update: "update s = 1" };
for (const word of words.keywords.statements) add(head[word] ?? word, word, /^keyword/);
add("break when x", "when", /^keyword/);
add("domain l in (0, 1)", "in", /^keyword/);
for (const word of [...words.keywords.choice, ...words.keywords.logic]) add("x = if not a and b or c then 1 else 2", word, /^keyword/);
for (const word of spellings(words.heads)) add(`${word}(l) = 1`, word, /^keyword/);
for (const word of words.weights) add(`weights ${word}`, word, /^constant\.builtin/);
for (const word of Object.values(words.functions).flat()) add(word === "table" ? 'x = table("a", 1)' : `x = ${word}(1)`, word, /^function\.builtin/);
for (const word of spellings(words.constants)) add(`x = ${word}`, word, /^constant\.builtin/);
for (const word of spellings([...words.measures, ...words.parts])) add(`x = ${word}`, word, /^variable\.builtin/);
for (const word of words.tensors) add(`x = tr(${word})`, word, /^variable\.builtin/);
for (const unit of words.units) add(`x = 1 in ${unit}`, unit, /^type\.builtin/);
add("x = 1 # text", "# text", /^comment/);
add('source "text"', '"text"', /^string/);
add("x = 2.5e-3", "2.5e-3", /^number/);
for (const word of ["C", "mu", "S(x)", "exp", "lambda1", "sum"]) add(`y = ${word}`, word.replace(/\(.*/, ""), word.includes("(") ? /^function\.call$/ : /^variable$/);
const path = join(work, "words.piola");
writeFileSync(path, lines.map(({ text }) => `${text}\n`).join(""));
const captured = new Map();
for (const line of run("query", "--captures", "queries/highlights.scm", path).split("\n")) {
  const m = line.match(/pattern: *(\d+), capture: *\d+ - ([\w.]+), start: \((\d+), \d+\), end: \(.*?\), text: `(.*)`$/);
  if (m === null || m[2].startsWith("_")) continue;
  const key = `${m[3]} ${m[4]}`;
  if (!captured.has(key) || captured.get(key).pattern <= Number(m[1])) captured.set(key, { pattern: Number(m[1]), name: m[2] });
}
lines.forEach(({ text, word, capture }, row) => {
  const name = captured.get(`${row} ${word}`)?.name;
  if (name === undefined || !capture.test(name)) complaints.push(`highlights.scm: \`${word}\` of \`${text}\` is ${name ?? "nothing"}, expected ${capture}`);
});

if (complaints.length > 0) {
  for (const complaint of complaints.slice(0, 40)) console.error(complaint);
  console.error(`tree-sitter: ${complaints.length} complaints`);
  process.exit(1);
}
console.log(`tree-sitter: ${files.length} files as expected, ${errors.size} of ${mistakes.length} mistakes are errors, ${lines.length} words have their captures`);
