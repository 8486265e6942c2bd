// Charts of the tables: `t` along, the others up; a click on a name hides its line.

const LINES = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#262626"];

function shortest(x) {
  if (typeof x !== "number" || !Number.isFinite(x)) return String(x ?? "unknown");
  if (x === 0) return "0";
  const size = Math.abs(x);
  return size >= 1e4 || size < 1e-3 ? x.toExponential(2).replace(/\.?0+e/, "e") : String(Number(x.toPrecision(4)));
}

/** Places of about `n` round numbers from `low` to `high`. */
function ticks(low, high, n) {
  const raw = (high - low) / n || 1;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = power * ([1, 2, 5, 10].find((s) => s * power >= raw) ?? 10);
  const found = [];
  for (let k = Math.ceil(low / step); k * step <= high + 1e-9 * step; k++) found.push(k * step);
  return found;
}

function columns(text) {
  const rows = text.trim().split("\n").map((line) => line.split(","));
  const heads = rows.shift().map((head) => head.replace(/^"|"$/g, ""));
  return heads.map((name, k) => ({ name, values: rows.map((row) => (row[k] === "" ? NaN : Number(row[k]))) }));
}

function element(name, attributes = {}, text) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text !== undefined) made.textContent = text;
  return made;
}

function chart(table) {
  const read = columns(table.text);
  const along = read.find((column) => column.name === "t") ?? read[0];
  const all = read.filter((column) => column !== along && column.name !== "step");
  const size = (column) => column.values.reduce((most, x) => (Number.isFinite(x) ? Math.max(most, Math.abs(x)) : most), 0);
  const largest = Math.max(...all.map(size), 0);
  // What is small beside the others is there to be asked for, and not drawn at first.
  const seen = all.filter((column) => size(column) > 1e-3 * largest).slice(0, LINES.length);
  const lines = all.map((column, k) => ({ ...column, colour: LINES[k % LINES.length], shown: seen.includes(column) }));
  const figure = document.createElement("figure");
  const caption = document.createElement("figcaption");
  caption.textContent = table.name;
  const legend = document.createElement("div");
  legend.className = "legend";
  const [width, height, left, bottom, top] = [500, 280, 70, 40, 12];
  const svg = element("svg", { width, height, role: "img", "aria-label": table.name });

  function draw() {
    svg.replaceChildren();
    const shown = lines.filter((line) => line.shown);
    const ups = shown.flatMap((line) => line.values.filter(Number.isFinite));
    const [x0, x1] = [Math.min(...along.values), Math.max(...along.values)];
    let [y0, y1] = [Math.min(0, ...ups), Math.max(0, ...ups)];
    if (y0 === y1) y1 = y0 + 1;
    const px = (x) => left + ((x - x0) / (x1 - x0 || 1)) * (width - left - 12);
    const py = (y) => height - bottom - ((y - y0) / (y1 - y0)) * (height - bottom - top);
    for (const x of ticks(x0, x1, 5)) {
      svg.append(element("line", { x1: px(x), x2: px(x), y1: top, y2: height - bottom, stroke: "#eee" }));
      svg.append(element("text", { x: px(x), y: height - bottom + 16, "text-anchor": "middle" }, shortest(x)));
    }
    for (const y of ticks(y0, y1, 5)) {
      svg.append(element("line", { x1: left, x2: width - 12, y1: py(y), y2: py(y), stroke: y === 0 ? "#999" : "#eee" }));
      svg.append(element("text", { x: left - 6, y: py(y) + 4, "text-anchor": "end" }, shortest(y)));
    }
    svg.append(element("text", { x: (left + width) / 2, y: height - 6, "text-anchor": "middle" }, along.name));
    for (const line of shown) {
      let path = "";
      let isUp = true;
      line.values.forEach((y, k) => {
        if (Number.isFinite(y)) path += `${isUp ? "M" : "L"}${px(along.values[k]).toFixed(1)} ${py(y).toFixed(1)}`;
        isUp = !Number.isFinite(y);
      });
      svg.append(element("path", { d: path, fill: "none", stroke: line.colour, "stroke-width": 1.8 }));
    }
  }

  for (const line of lines) {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = `\u2014 ${line.name}`;
    button.style.color = line.colour;
    button.classList.toggle("off", !line.shown);
    button.onclick = () => {
      line.shown = !line.shown;
      button.classList.toggle("off", !line.shown);
      draw();
    };
    legend.append(button);
  }
  draw();
  figure.append(caption, svg, legend);
  return figure;
}
