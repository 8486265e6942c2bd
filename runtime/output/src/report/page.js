// The page from its data.

const data = JSON.parse(document.getElementById("data").textContent);
const { summary } = data;
const of = (id) => document.getElementById(id);

of("title").textContent = data.title;
const isGood = summary.exit_reason === "completed";
of("state").textContent = isGood ? "reached its end" : `${summary.exit_reason}: ${summary.exit_message}`;
of("state").classList.toggle("bad", !isGood);

for (const warning of summary.warnings ?? []) {
  const item = document.createElement("li");
  item.textContent = warning;
  of("warnings").querySelector("ul").append(item);
  of("warnings").hidden = false;
}

function row(name, value) {
  const line = of("numbers").querySelector("table").insertRow();
  line.insertCell().textContent = name;
  const cell = line.insertCell();
  cell.textContent = value;
  cell.className = "number";
}

const grouped = (x) => String(x).replace(/\B(?=(\d{3})+$)/g, "\u202f");
row("dimensions", summary.dimension);
row("points", grouped(summary.points));
for (const [name, count] of Object.entries(summary.interactions ?? {})) if (count) row(name, grouped(count));
for (const [name, count] of Object.entries(summary.dropped ?? {})) if (count) row(`${name} left out`, grouped(count));
if (summary.steps?.length) {
  row("load steps", summary.steps.length);
  row("Newton iterations", summary.steps.reduce((sum, step) => sum + step.iterations, 0));
  const last = summary.steps.at(-1);
  row("energy at the end, J", shortest(last.energy));
  row("equilibrium at the end", last.positive_definite === true ? "stable" : last.positive_definite === false ? "not stable" : "not looked at");
}
if (summary.solver) row("linear systems", summary.solver.linear);
if (summary.motion) {
  row("method", summary.motion.method);
  row("steps", grouped(summary.motion.steps_made));
  row("step, s", shortest(summary.motion.step_seconds));
  for (const [name, value] of Object.entries(summary.motion.energies)) row(name.replaceAll("_", " ") + (name === "broken_bonds" ? "" : " energy, J"), shortest(value));
}
row("wall time, s", shortest(summary.wall_seconds));
for (const phase of summary.phases ?? []) row(`of that ${phase.name}, s`, shortest(phase.wall_seconds));
row("threads", summary.threads);
if (summary.peak_memory_bytes) row("memory, MB", shortest(summary.peak_memory_bytes / 1e6));
row("piola", Object.values(summary.versions).join(", "));
row("scene", summary.scene_hash);

for (const table of data.tables) {
  if (table.text.trim().split("\n").length < 3) continue;
  of("charts").querySelector("div").append(chart(table));
  of("charts").hidden = false;
}
if (data.picture) {
  of("picture").querySelector("img").src = data.picture;
  of("picture").hidden = false;
}
if (data.scene) {
  of("settings").querySelector("pre").textContent = data.scene;
  of("settings").hidden = false;
}
if (data.body) showBody(data.body);
