// The region, its grids and the masks, drawn over the taught scan's picture. Places are pixels of the picture.

const SVG = "http://www.w3.org/2000/svg";
const at = (id) => document.getElementById(id);
const overlay = at("overlay");

let size = [1, 1];
let drawn = null;
// Which corner is selected: -1 is the region, 0 … the masks.
let chosen = null;
let dragged = null;

const shape = (index) => (index < 0 ? drawn.corners_px : drawn.masked_px[index]);

function element(name, attributes, parent) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  parent.append(made);
  return made;
}

const points = (corners) => corners.map(([u, v]) => `${u},${v}`).join(" ");

// A place inside four corners, by its shares along the first and the last side.
function inside([a, b, c, d], across, down) {
  const mix = (p, q, share) => [p[0] + (q[0] - p[0]) * share, p[1] + (q[1] - p[1]) * share];
  return mix(mix(a, b, across), mix(d, c, across), down);
}

// The size of one pixel of the screen, in pixels of the picture.
const perScreenPixel = () => size[0] / Math.max(1, overlay.getBoundingClientRect().width);

function draw() {
  overlay.replaceChildren();
  overlay.setAttribute("viewBox", `0 0 ${size[0]} ${size[1]}`);
  const scale = perScreenPixel();
  const all = [[-1, drawn.corners_px], ...drawn.masked_px.map((mask, index) => [index, mask])];
  for (const [index, corners] of all) {
    const kind = index < 0 ? "region" : "mask";
    element("polygon", { class: `area ${kind}`, points: points(corners) }, overlay);
    if (index < 0) grids(corners);
  }
  for (const [index, corners] of all) {
    const kind = index < 0 ? "region" : "mask";
    corners.forEach(([u, v], corner) => {
      const isChosen = chosen && chosen[0] === index && chosen[1] === corner;
      const name = index < 0 ? `corner ${corner + 1} of the region` : `corner ${corner + 1} of mask ${index + 1}`;
      const dot = element("circle", {
        class: `corner ${kind}${isChosen ? " chosen" : ""}`, cx: u, cy: v, r: 9 * scale, tabindex: 0,
        "aria-label": name, "data-shape": index, "data-corner": corner,
      }, overlay);
      dot.addEventListener("focus", () => choose(index, corner));
      const label = index < 0 ? `${corner + 1}` : `m${index + 1}`;
      const text = element("text", { class: "name", x: u + 12 * scale, y: v - 8 * scale, "font-size": 16 * scale }, overlay);
      text.textContent = label;
    });
  }
  describe();
}

function grids(corners) {
  const line = (p, q) => element("line", { class: "grid", x1: p[0], y1: p[1], x2: q[0], y2: q[1] }, overlay);
  for (let row = 1; row < drawn.rows; row += 1) {
    line(inside(corners, 0, row / drawn.rows), inside(corners, 1, row / drawn.rows));
  }
  for (let column = 1; column < drawn.columns; column += 1) {
    line(inside(corners, column / drawn.columns, 0), inside(corners, column / drawn.columns, 1));
  }
}

function describe() {
  at("remove").disabled = !chosen || chosen[0] < 0;
  if (!chosen) return;
  const [u, v] = shape(chosen[0])[chosen[1]];
  const of = chosen[0] < 0 ? "the region" : `mask ${chosen[0] + 1}`;
  at("selected").textContent = `Corner ${chosen[1] + 1} of ${of}: (${u.toFixed(1)}, ${v.toFixed(1)}) px`;
}

function choose(index, corner) {
  if (chosen && chosen[0] === index && chosen[1] === corner) return;
  chosen = [index, corner];
  for (const dot of overlay.querySelectorAll(".corner")) {
    dot.classList.toggle("chosen", Number(dot.dataset.shape) === index && Number(dot.dataset.corner) === corner);
  }
  describe();
}

function move([index, corner], u, v) {
  const within = (value, most) => Math.min(Math.max(value, 0), most - 1);
  shape(index)[corner] = [within(u, size[0]), within(v, size[1])];
  draw();
  tell("Not saved yet.", false);
}

function place(event) {
  const box = overlay.getBoundingClientRect();
  return [(event.clientX - box.left) / box.width * size[0], (event.clientY - box.top) / box.height * size[1]];
}

overlay.addEventListener("pointerdown", (event) => {
  if (!event.target.dataset?.corner) return;
  dragged = [Number(event.target.dataset.shape), Number(event.target.dataset.corner)];
  choose(...dragged);
  overlay.setPointerCapture(event.pointerId);
  event.preventDefault();
});
overlay.addEventListener("pointermove", (event) => {
  if (dragged) move(dragged, ...place(event));
});
overlay.addEventListener("pointerup", () => { dragged = null; });
overlay.addEventListener("pointercancel", () => { dragged = null; });

document.addEventListener("keydown", (event) => {
  const steps = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  const step = steps[event.key];
  if (!step || !chosen || event.target.tagName === "INPUT") return;
  event.preventDefault();
  const times = event.shiftKey ? 10 : 1;
  const [u, v] = shape(chosen[0])[chosen[1]];
  const kept = chosen;
  move(kept, u + step[0] * times, v + step[1] * times);
  overlay.querySelector(`[data-shape="${kept[0]}"][data-corner="${kept[1]}"]`)?.focus();
});

for (const key of ["rows", "columns"]) {
  at(key).addEventListener("input", () => {
    const number = Number.parseInt(at(key).value, 10);
    if (Number.isInteger(number) && number >= 1 && number <= 50) {
      drawn[key] = number;
      draw();
      tell("Not saved yet.", false);
    }
  });
}

at("add").addEventListener("click", () => {
  const middle = inside(drawn.corners_px, 0.5, 0.5);
  const half = [size[0] / 20, size[1] / 20];
  const corner = (x, y) => [middle[0] + x * half[0], middle[1] + y * half[1]];
  drawn.masked_px.push([corner(-1, -1), corner(1, -1), corner(1, 1), corner(-1, 1)]);
  chosen = [drawn.masked_px.length - 1, 0];
  draw();
  tell("Not saved yet.", false);
});

at("remove").addEventListener("click", () => {
  if (!chosen || chosen[0] < 0) return;
  drawn.masked_px.splice(chosen[0], 1);
  chosen = null;
  at("selected").textContent = "None.";
  draw();
  tell("Not saved yet.", false);
});

at("whole").addEventListener("change", () => {
  at("paper").classList.toggle("whole", at("whole").checked);
  draw();
});
window.addEventListener("resize", () => { if (drawn) draw(); });

function tell(words, isWrong) {
  at("told").textContent = words;
  at("told").classList.toggle("wrong", isWrong);
}

async function ask(path, options) {
  const answer = await fetch(path, options);
  const found = await answer.json();
  if (!answer.ok) throw new Error((found.problems ?? ["the program refuses"]).join("\n"));
  return found;
}

at("save").addEventListener("click", async () => {
  try {
    const body = JSON.stringify(drawn);
    const found = await ask("save", { method: "POST", headers: { "content-type": "application/json" }, body });
    tell(`Saved in ${found.saved}.`, false);
  } catch (error) {
    tell(`Not saved. ${error.message}`, true);
  }
});

at("done").addEventListener("click", async () => {
  try {
    await ask("done", { method: "POST" });
    tell("Closed; the program goes on at the terminal.", false);
    for (const button of document.querySelectorAll("button")) button.disabled = true;
  } catch (error) {
    tell(error.message, true);
  }
});

try {
  const found = await ask("drawing.json");
  size = found.size_px;
  drawn = found.drawn;
  at("panel").textContent = found.panel;
  at("file").textContent = found.recipe;
  at("rows").value = drawn.rows;
  at("columns").value = drawn.columns;
  await at("picture").decode();
  draw();
} catch (error) {
  tell(error.message, true);
}
