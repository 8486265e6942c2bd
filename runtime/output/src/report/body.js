// The body at all times: the faces of its cells, or points as squares; turned by dragging, nearer by scrolling.

// Viridis at even steps.
const COLOURS = [
  [68, 1, 84], [71, 45, 123], [59, 82, 139], [44, 114, 142], [33, 144, 141],
  [39, 173, 129], [92, 200, 99], [170, 220, 50], [253, 231, 37],
];

function colourOf(part) {
  if (!(part >= 0)) return "#bbb";
  const at = Math.min(part, 1) * (COLOURS.length - 1);
  const k = Math.min(Math.floor(at), COLOURS.length - 2);
  const mix = COLOURS[k].map((c, i) => Math.round(c + (at - k) * (COLOURS[k + 1][i] - c)));
  return `rgb(${mix})`;
}

const PALETTE = Array.from({ length: 256 }, (_, k) => colourOf(k / 255));

function bytesOf(text) {
  return Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
}

/** Numbers that were written in steps; the last step is no number. */
function numbersOf(values, frame) {
  const steps = new Uint16Array(bytesOf(values.frames[frame]));
  const scale = (values.high - values.low) / 65534;
  return Float64Array.from(steps, (step) => (step === 65535 ? NaN : values.low + step * scale));
}

/** 1, 2 or 5 times a power of ten, so that the largest displacement is seen. */
function magnification(displacement, size) {
  const wanted = (0.08 * size) / (displacement || size);
  if (wanted < 2) return 1;
  const power = 10 ** Math.floor(Math.log10(wanted));
  return power * [5, 2, 1].find((s) => s * power <= wanted);
}

function showBody(body) {
  const of = (id) => document.getElementById(id);
  const rest = new Float32Array(bytesOf(body.positions));
  const n = body.shown;
  const flat = body.dimension === 2;
  const faces = new Uint32Array(bytesOf(body.faces));
  const rangeOf = (place) => [0, 1, 2].map((axis) => {
    let [low, high] = [Infinity, -Infinity];
    for (let p = 0; p < n; p++) {
      low = Math.min(low, place(3 * p + axis));
      high = Math.max(high, place(3 * p + axis));
    }
    return [low, high];
  });
  const sizeOf = (range) => Math.hypot(...range.map(([low, high]) => high - low)) || 1;
  const atRest = rangeOf((k) => rest[k]);
  const auto = magnification(body.fields[0].values.high, sizeOf(atRest));
  // What is shown at first fits.
  const end = numbersOf(body.moved, body.times.length - 1);
  const range = rangeOf((k) => rest[k] + auto * end[k]);
  const size = sizeOf(range);
  const centre = range.map(([low, high]) => (low + high) / 2);
  // Points of an even body of this volume are so far apart.
  const extents = atRest.map(([low, high]) => high - low).filter((extent) => extent > 1e-9 * size);
  const apart = extents.reduce((product, extent) => product * extent, 1) ** (1 / (extents.length || 1)) / n ** (1 / (extents.length || 1));
  const state = { yaw: flat ? 0 : -0.6, pitch: flat ? 0 : 0.5, zoom: 1, frame: body.times.length - 1, field: 0, shift: [0, 0] };
  const canvas = of("canvas");
  let moved = null;
  let field = null;

  for (const factor of [...new Set([1, auto, 10 * auto])].sort((a, b) => a - b)) {
    of("magnified").append(new Option(`${shortest(factor)} times`, factor, factor === auto, factor === auto));
  }
  body.fields.forEach((one, k) => of("field").append(new Option(one.name, k)));
  const first = body.fields.findIndex((one) => one.name === "damage" || one.name === "von_mises");
  state.field = Math.max(first, 0);
  of("field").value = state.field;
  of("time").max = body.times.length - 1;
  of("time").value = state.frame;
  const strip = of("colours").getContext("2d");
  for (let k = 0; k < 256; k++) {
    strip.fillStyle = PALETTE[255 - k];
    strip.fillRect(0, k, 16, 1);
  }
  const told = [];
  if (body.shown < body.points) told.push(`${body.shown} of ${body.points} points`);
  if (body.times.length < body.frames) told.push(`${body.times.length} of ${body.frames} frames`);
  of("thinned").textContent = (told.length ? `Shown are ${told.join(" and ")}. ` : "") +
    "Drag to turn, scroll to come nearer, drag with shift to move; of vectors and tensors colours show the size.";

  function read() {
    moved = numbersOf(body.moved, state.frame);
    field = numbersOf(body.fields[state.field].values, state.frame);
    const { low, high } = body.fields[state.field].values;
    of("low").textContent = shortest(low);
    of("high").textContent = shortest(high);
    of("now").textContent = `t = ${shortest(body.times[state.frame])}`;
    draw();
  }

  /** How wide and high the box around the body is where it is seen from. */
  function fitOf(seen) {
    const corners = [0, 1, 2, 3, 4, 5, 6, 7].map((k) => seen(...[0, 1, 2].map((axis) => range[axis][(k >> axis) & 1])));
    return [0, 1].map((axis) => {
      const places = corners.map((corner) => corner[axis]);
      return Math.max(...places) - Math.min(...places) || size;
    });
  }

  function draw() {
    const ratio = window.devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    canvas.width = width * ratio;
    canvas.height = height * ratio;
    const context = canvas.getContext("2d");
    context.scale(ratio, ratio);
    const factor = Number(of("magnified").value);
    const { low, high } = body.fields[state.field].values;
    const [cy, sy, cp, sp] = [Math.cos(state.yaw), Math.sin(state.yaw), Math.cos(state.pitch), Math.sin(state.pitch)];
    // Around the vertical, z in space and y in the plane, then towards whoever looks.
    const seen = (x, y, z) => {
      const [a, b, c] = flat ? [x, y, z] : [x, z, -y];
      const [right, deep] = [cy * a + sy * c, -sy * a + cy * c];
      return [right, cp * b - sp * deep, sp * b + cp * deep];
    };
    state.fit ??= fitOf(seen);
    const fit = Math.min((0.85 * width) / state.fit[0], (0.85 * height) / state.fit[1]);
    const scale = state.zoom * fit;
    const places = new Float64Array(3 * n);
    for (let p = 0; p < n; p++) {
      const [x, y, z] = [0, 1, 2].map((axis) => rest[3 * p + axis] + factor * moved[3 * p + axis] - centre[axis]);
      const [right, above, near] = seen(x, y, z);
      places[3 * p] = width / 2 + state.shift[0] + scale * right;
      places[3 * p + 1] = height / 2 + state.shift[1] - scale * above;
      places[3 * p + 2] = near;
    }
    const colour = (value) => {
      const part = high > low ? (value - low) / (high - low) : 0;
      return part >= 0 ? PALETTE[Math.min(255, Math.round(255 * part))] : "#bbb";
    };
    if (faces.length > 0) drawFaces(context, places, colour);
    else drawPoints(context, places, colour, Math.max(scale * apart * 1.02, 1.5));
  }

  function drawPoints(context, places, colour, side) {
    const order = Array.from({ length: n }, (_, p) => p);
    if (!flat) order.sort((p, q) => places[3 * p + 2] - places[3 * q + 2]);
    for (const p of order) {
      context.fillStyle = colour(field[p]);
      context.fillRect(places[3 * p] - side / 2, places[3 * p + 1] - side / 2, side, side);
    }
  }

  function drawFaces(context, places, colour) {
    const order = Array.from({ length: faces.length / 4 }, (_, f) => f);
    const depth = order.map((f) => [0, 1, 2, 3].reduce((sum, k) => sum + places[3 * faces[4 * f + k] + 2], 0));
    if (!flat) order.sort((f, g) => depth[f] - depth[g]);
    context.lineJoin = "round";
    context.lineWidth = 0.6;
    for (const f of order) {
      const corners = faces.subarray(4 * f, 4 * f + 4);
      context.beginPath();
      for (const p of corners) context.lineTo(places[3 * p], places[3 * p + 1]);
      context.closePath();
      context.fillStyle = colour(corners.reduce((sum, p) => sum + field[p] / 4, 0));
      context.fill();
      // Without a seam between neighbours in the plane, with one between faces in space.
      context.strokeStyle = flat ? context.fillStyle : "rgba(0, 0, 0, .35)";
      context.stroke();
    }
  }

  let held = null;
  canvas.onpointerdown = (event) => {
    held = [event.clientX, event.clientY];
    canvas.setPointerCapture(event.pointerId);
  };
  canvas.onpointermove = (event) => {
    if (held === null) return;
    const [dx, dy] = [event.clientX - held[0], event.clientY - held[1]];
    held = [event.clientX, event.clientY];
    if (event.shiftKey || flat) {
      state.shift = [state.shift[0] + dx, state.shift[1] + dy];
    } else {
      state.yaw += dx / 150;
      state.pitch = Math.max(-1.57, Math.min(1.57, state.pitch + dy / 150));
    }
    draw();
  };
  canvas.onpointerup = () => { held = null; };
  canvas.onwheel = (event) => {
    event.preventDefault();
    state.zoom *= Math.exp(-event.deltaY / 600);
    draw();
  };
  of("field").onchange = () => { state.field = Number(of("field").value); read(); };
  of("magnified").onchange = draw;
  of("time").oninput = () => { state.frame = Number(of("time").value); read(); };
  let playing = null;
  of("play").onclick = () => {
    if (playing !== null) {
      clearInterval(playing);
      playing = null;
    } else {
      playing = setInterval(() => {
        state.frame = (state.frame + 1) % body.times.length;
        of("time").value = state.frame;
        read();
      }, 120);
    }
    of("play").textContent = playing === null ? "play" : "pause";
  };
  window.addEventListener("resize", draw);
  of("body").hidden = false;
  read();
}
