// The region, its grids, the masks, the panel's outline and its holders, drawn on the taught picture. Positions are pixels of the picture.
// This module only draws: the page that contains it supplies the recipe's shapes and receives the changed shapes.

const SVG = "http://www.w3.org/2000/svg";
const at = (id) => document.getElementById(id);
const overlay = at("overlay");
const words = JSON.parse(at("sheet").dataset.words);
/** Returns the page's text for a key; `{1}` is replaced by the first value. */
const word = (key, ...put) => put.reduce((text, one, index) => text.replace(`{${index + 1}}`, one), words[`draw.${key}`] ?? key);

let size = [1, 1];
let drawn = null;
// The selected corner: the kind of its shape, the index of the shape within this kind, and the index of the corner.
let chosen = null;
let dragged = null;
let hearsChanges = () => {};

const KINDS = {
  region: { name: () => word("the_region"), label: (index, corner) => `${corner + 1}` },
  mask: { name: (index) => word("mask_number", index + 1), label: (index) => `m${index + 1}` },
  outline: { name: () => word("the_outline"), label: () => "" },
  held: { name: (index) => word("held_number", index + 1), label: (index) => `h${index + 1}` },
};

// Returns all shapes; the region is the last one, so that its corners are on top.
const shapes = () => [
  ...(drawn.outline_px.length > 0 ? [{ kind: "outline", index: 0, corners: drawn.outline_px }] : []),
  ...drawn.held_px.map((corners, index) => ({ kind: "held", index, corners })),
  ...drawn.masked_px.map((corners, index) => ({ kind: "mask", index, corners })),
  { kind: "region", index: 0, corners: drawn.corners_px },
];
const shapeOf = (place) => shapes().find((one) => one.kind === place.kind && one.index === place.index);
const isSame = (a, b) => a && b && a.kind === b.kind && a.index === b.index && a.corner === b.corner;

function element(name, attributes, parent) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  parent.append(made);
  return made;
}

const points = (corners) => corners.map(([u, v]) => `${u},${v}`).join(" ");

// Returns the point inside a quadrilateral with these fractions along its first and its last side.
function inside([a, b, c, d], across, down) {
  const mix = (p, q, share) => [p[0] + (q[0] - p[0]) * share, p[1] + (q[1] - p[1]) * share];
  return mix(mix(a, b, across), mix(d, c, across), down);
}

// Returns the size of a screen pixel, in pixels of the picture.
const perScreenPixel = () => size[0] / Math.max(1, overlay.getBoundingClientRect().width);

function draw() {
  overlay.replaceChildren();
  overlay.setAttribute("viewBox", `0 0 ${size[0]} ${size[1]}`);
  const scale = perScreenPixel();
  for (const { kind, corners } of shapes()) {
    element("polygon", { class: `area ${kind}`, points: points(corners) }, overlay);
    if (kind === "region") grids(corners);
  }
  for (const { kind, index, corners } of shapes()) {
    corners.forEach(([u, v], corner) => {
      const place = { kind, index, corner };
      const dot = element("circle", {
        class: `corner ${kind}${isSame(chosen, place) ? " chosen" : ""}`, cx: u, cy: v, r: 9 * scale, tabindex: 0, role: "button",
        "aria-label": word("corner", corner + 1, KINDS[kind].name(index)),
        "data-kind": kind, "data-index": index, "data-corner": corner,
      }, overlay);
      dot.addEventListener("focus", () => choose(place));
      const text = element("text", { class: "name", x: u + 12 * scale, y: v - 8 * scale, "font-size": 16 * scale }, overlay);
      text.textContent = KINDS[kind].label(index, corner);
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
  const kind = chosen?.kind;
  at("remove").disabled = !chosen || kind === "region";
  at("insert").disabled = kind !== "outline";
  at("cut").disabled = kind !== "outline" || drawn.outline_px.length <= 3;
  at("outline").disabled = drawn.outline_px.length > 0;
  if (!chosen) {
    at("selected").textContent = word("none_selected");
    return;
  }
  const [u, v] = shapeOf(chosen).corners[chosen.corner];
  const corner = word("corner", chosen.corner + 1, KINDS[kind].name(chosen.index));
  at("selected").textContent = `${corner}: (${u.toFixed(1)}, ${v.toFixed(1)}) px`;
}

function choose(place) {
  if (isSame(chosen, place)) return;
  chosen = place;
  for (const dot of overlay.querySelectorAll(".corner")) dot.classList.toggle("chosen", isSame(placeOf(dot), place));
  describe();
}

const placeOf = (dot) =>
  ({ kind: dot.dataset.kind, index: Number(dot.dataset.index), corner: Number(dot.dataset.corner) });

function changed() {
  draw();
  hearsChanges();
}

const within = (value, most) => Math.min(Math.max(value, 0), most - 1);

function move(place, u, v) {
  shapeOf(place).corners[place.corner] = [within(u, size[0]), within(v, size[1])];
  changed();
}

function place(event) {
  const box = overlay.getBoundingClientRect();
  return [(event.clientX - box.left) / box.width * size[0], (event.clientY - box.top) / box.height * size[1]];
}

overlay.addEventListener("pointerdown", (event) => {
  if (!event.target.dataset?.corner) return;
  dragged = placeOf(event.target);
  choose(dragged);
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
  const [u, v] = shapeOf(chosen).corners[chosen.corner];
  move(chosen, u + step[0] * times, v + step[1] * times);
  focusOn(chosen);
});

function focusOn({ kind, index, corner }) {
  overlay.querySelector(`[data-kind="${kind}"][data-index="${index}"][data-corner="${corner}"]`)?.focus();
}

for (const key of ["rows", "columns"]) {
  at(key).addEventListener("input", () => {
    const number = Number.parseInt(at(key).value, 10);
    if (Number.isInteger(number) && number >= 1 && number <= 50) {
      drawn[key] = number;
      changed();
    }
  });
}

// Returns a small rectangle around a point.
function rectangle([u, v]) {
  const half = [size[0] / 20, size[1] / 20];
  const corner = (x, y) => [within(u + x * half[0], size[0]), within(v + y * half[1], size[1])];
  return [corner(-1, -1), corner(1, -1), corner(1, 1), corner(-1, 1)];
}

at("add").addEventListener("click", () => {
  drawn.masked_px.push(rectangle(inside(drawn.corners_px, 0.5, 0.5)));
  chosen = { kind: "mask", index: drawn.masked_px.length - 1, corner: 0 };
  changed();
});

at("hold").addEventListener("click", () => {
  drawn.held_px.push(rectangle(inside(drawn.corners_px, 0.5, -0.25)));
  chosen = { kind: "held", index: drawn.held_px.length - 1, corner: 0 };
  changed();
});

// The first outline is the enlarged region.
at("outline").addEventListener("click", () => {
  const larger = [[-0.2, -0.2], [1.2, -0.2], [1.2, 1.2], [-0.2, 1.2]];
  drawn.outline_px = larger
    .map(([across, down]) => inside(drawn.corners_px, across, down))
    .map(([u, v]) => [within(u, size[0]), within(v, size[1])]);
  chosen = { kind: "outline", index: 0, corner: 0 };
  changed();
});

at("insert").addEventListener("click", () => {
  const next = (chosen.corner + 1) % drawn.outline_px.length;
  const [a, b] = [drawn.outline_px[chosen.corner], drawn.outline_px[next]];
  drawn.outline_px.splice(chosen.corner + 1, 0, [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2]);
  chosen = { ...chosen, corner: chosen.corner + 1 };
  changed();
  focusOn(chosen);
});

at("cut").addEventListener("click", () => {
  drawn.outline_px.splice(chosen.corner, 1);
  chosen = { ...chosen, corner: chosen.corner % drawn.outline_px.length };
  changed();
  focusOn(chosen);
});

at("remove").addEventListener("click", () => {
  const { kind, index } = chosen;
  if (kind === "mask") drawn.masked_px.splice(index, 1);
  if (kind === "held") drawn.held_px.splice(index, 1);
  if (kind === "outline") drawn.outline_px = [];
  chosen = null;
  changed();
});

at("whole").addEventListener("change", () => {
  at("paper").classList.toggle("whole", at("whole").checked);
  draw();
});
window.addEventListener("resize", () => { if (drawn) draw(); });

/** Draws the recipe's shapes on the picture after it is loaded; `changes` is called after each change. */
export async function begin(recipe, changes) {
  await at("picture").decode();
  drawn = recipe;
  size = [at("picture").naturalWidth, at("picture").naturalHeight];
  at("rows").value = drawn.rows;
  at("columns").value = drawn.columns;
  hearsChanges = changes;
  draw();
}

/** Returns the present shapes. */
export const now = () => drawn;
