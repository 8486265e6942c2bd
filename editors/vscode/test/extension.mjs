// Loads the bundle beside something that stands for VS Code: it must load, start `piola lsp`, and stop.

import { createRequire } from "node:module";
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { fileURLToPath } from "node:url";
import Module from "node:module";

const require = createRequire(import.meta.url);
const folder = mkdtempSync(join(tmpdir(), "piola-"));
const log = join(folder, "log");

// A server that answers `initialize` and `shutdown`, and notes what it is asked.
const server = join(folder, "piola");
writeFileSync(server, `#!${process.execPath}
const { appendFileSync } = require("node:fs");
appendFileSync(${JSON.stringify(log)}, "args " + process.argv.slice(2).join(" ") + "\\n");
let buffer = Buffer.alloc(0);
process.stdin.on("data", (data) => {
  buffer = Buffer.concat([buffer, data]);
  for (;;) {
    const end = buffer.indexOf("\\r\\n\\r\\n");
    if (end < 0) return;
    const length = Number(/Content-Length: (\\d+)/i.exec(buffer.subarray(0, end))[1]);
    if (buffer.length < end + 4 + length) return;
    const message = JSON.parse(buffer.subarray(end + 4, end + 4 + length));
    buffer = buffer.subarray(end + 4 + length);
    appendFileSync(${JSON.stringify(log)}, message.method + "\\n");
    if (message.method === "exit") process.exit(0);
    if (message.id === undefined) continue;
    const result = message.method === "initialize" ? { capabilities: { textDocumentSync: 1 } } : null;
    const answer = JSON.stringify({ jsonrpc: "2.0", id: message.id, result });
    process.stdout.write("Content-Length: " + Buffer.byteLength(answer) + "\\r\\n\\r\\n" + answer);
  }
});
`, { mode: 0o755 });

// Everything that is not named here is a class, a function and an object at once.
function anything() {
  const target = function () {};
  return new Proxy(target, {
    get: (_, key) => (key === Symbol.toPrimitive ? () => 0 : key === "prototype" ? target.prototype : key === "then" ? undefined : key === Symbol.iterator ? [][Symbol.iterator] : anything()),
    apply: () => anything(),
    construct: () => ({}),
  });
}

class Disposable {
  dispose() {}
}
class EventEmitter {
  event = () => new Disposable();
  fire() {}
  dispose() {}
}
const settings = { path: server, scenes: "**/*.toml" };
const errors = [];
const selectors = [];
const event = () => new Disposable();
const some = (named) => new Proxy(named, { get: (target, key) => (key in target ? target[key] : anything()) });
const configuration = { get: (key, fallback) => settings[key] ?? fallback, has: () => false, inspect: () => undefined };
const vscode = some({
  version: "1.99.0",
  Disposable,
  EventEmitter,
  env: some({ appName: "test", language: "en" }),
  workspace: some({
    isTrusted: true,
    workspaceFolders: undefined,
    textDocuments: [],
    notebookDocuments: [],
    getConfiguration: () => configuration,
    onDidChangeConfiguration: event,
    onDidGrantWorkspaceTrust: event,
    onDidOpenTextDocument: event,
    onDidChangeTextDocument: event,
    onDidCloseTextDocument: event,
  }),
  languages: some({ createDiagnosticCollection: () => some({ dispose() {}, clear() {} }), match: (selector) => (selectors.push(selector), 0) }),
  window: some({
    visibleTextEditors: [],
    activeTextEditor: undefined,
    tabGroups: some({ all: [] }),
    createOutputChannel: () => ({ append() {}, appendLine() {}, show() {}, clear() {}, dispose() {} }),
    showErrorMessage: async (message) => void errors.push(message),
  }),
  commands: some({ registerCommand: () => new Disposable() }),
});

const load = Module._load;
Module._load = (name, ...rest) => (name === "vscode" ? vscode : load(name, ...rest));

try {
  const extension = require(fileURLToPath(new URL("../dist/extension.js", import.meta.url)));
  await extension.activate({ subscriptions: [] });
  await extension.deactivate();
  if (errors.length > 0) throw new Error(errors.join("\n"));
  const asked = readFileSync(log, "utf8").split("\n");
  for (const line of ["args lsp", "initialize", "initialized", "shutdown"]) {
    if (!asked.some((l) => l.startsWith(line))) throw new Error(`the server was not asked \`${line}\`: ${asked.join(", ")}`);
  }
  settings.path = join(folder, "none");
  await extension.activate({ subscriptions: [] });
  if (!errors.some((message) => message.includes("did not start"))) throw new Error("no message where there is no server");
  console.log("extension: starts `piola lsp`, stops it, and says so where there is none");
} catch (error) {
  console.error(`extension: ${error.stack}`);
  process.exitCode = 1;
} finally {
  rmSync(folder, { recursive: true, force: true });
}
// A client that could not start keeps timers.
process.exit();
