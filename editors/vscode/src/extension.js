// Starts `piola lsp` and speaks with it over stdin and stdout.

const path = require("node:path");
const vscode = require("vscode");
const { LanguageClient, TransportKind } = require("vscode-languageclient/node");

let client;
// Starts and stops follow each other, however fast settings change.
let turn = Promise.resolve();

/** The program that the setting names; a path that is not absolute counts from the open folder. */
function program(setting) {
  const folder = vscode.workspace.workspaceFolders?.[0]?.uri.fsPath;
  const isRelative = /[\\/]/.test(setting) && !path.isAbsolute(setting);
  return isRelative && folder !== undefined ? path.join(folder, setting) : setting;
}

/** Potentials, and the files that may be scenes. */
function selector(scenes) {
  const potentials = [{ scheme: "file", language: "piola" }, { scheme: "untitled", language: "piola" }];
  return scenes === "" ? potentials : [...potentials, { scheme: "file", pattern: scenes }];
}

async function start() {
  const settings = vscode.workspace.getConfiguration("piola");
  const command = program(settings.get("path", "piola"));
  const server = { command, args: ["lsp"], transport: TransportKind.stdio };
  const starting = new LanguageClient("piola", "piola", server, {
    documentSelector: selector(settings.get("scenes", "**/*.toml")),
  });
  client = starting;
  try {
    await starting.start();
  } catch (error) {
    client = undefined;
    const open = "Open settings";
    const message = `piola: \`${command} lsp\` did not start: ${error.message ?? error}`;
    // Not awaited: the message stays until somebody reads it.
    vscode.window.showErrorMessage(message, open).then((choice) => {
      if (choice === open) vscode.commands.executeCommand("workbench.action.openSettings", "piola.path");
    });
  }
}

async function stop() {
  const stopping = client;
  client = undefined;
  if (stopping?.needsStop()) await stopping.stop().catch(() => {});
}

function inTurn(...steps) {
  for (const step of steps) turn = turn.then(step);
  return turn;
}

function activate(context) {
  const restart = () => inTurn(stop, start);
  context.subscriptions.push(
    vscode.commands.registerCommand("piola.restart", restart),
    vscode.workspace.onDidChangeConfiguration((change) => {
      if (!vscode.workspace.isTrusted) return;
      if (change.affectsConfiguration("piola.path") || change.affectsConfiguration("piola.scenes")) restart();
    }),
    vscode.workspace.onDidGrantWorkspaceTrust(restart),
  );
  // A folder that is not trusted gets colours alone.
  return vscode.workspace.isTrusted ? inTurn(start) : undefined;
}

function deactivate() {
  return inTurn(stop);
}

module.exports = { activate, deactivate };
