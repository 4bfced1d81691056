// The newest cycle in three dimensions: the scan's points and the paths, by pass. Dragging rotates, two fingers or Shift move, the
// wheel and + and - zoom; arrow keys rotate, with Shift they move. The same content is also shown as text.

import { word } from "./PAGE_JS";
import { identity, multiplied, perspective, rotated, shifted } from "./MATRIX_JS";

const POLL_INTERVAL_MS = 2000; // interval at which the progress of a running cycle is requested
// Without colour, the passes differ by their dashes in the legend and by the text beside them.
const COLOURS = [[0.34, 0.71, 0.91], [0.90, 0.62, 0], [0, 0.62, 0.45], [0.80, 0.47, 0.65], [0.94, 0.89, 0.26]];
const AIR = [0.55, 0.55, 0.55];
const LIFT_MM = 2; // height of the lines above the surface, whose points would otherwise hide them

const SHADER = `#version 300 es
in vec3 at; in vec4 colour; uniform mat4 view; uniform float size; out vec4 shade;
void main() { gl_Position = view * vec4(at, 1.0); gl_PointSize = size; shade = colour; }`;
const PAINT = `#version 300 es
precision mediump float; in vec4 shade; out vec4 seen;
void main() { seen = shade; }`;

function program(gl) {
  const made = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, SHADER], [gl.FRAGMENT_SHADER, PAINT]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(made, shader);
  }
  gl.bindAttribLocation(made, 0, "at");
  gl.bindAttribLocation(made, 1, "colour");
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
  return made;
}

/** Points of 16 bytes each, three floats and a colour, in the format of the graphics processor. */
function upload(gl, bytes) {
  const array = gl.createVertexArray();
  gl.bindVertexArray(array);
  const buffer = gl.createBuffer();
  gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
  gl.bufferData(gl.ARRAY_BUFFER, bytes, gl.STATIC_DRAW);
  gl.enableVertexAttribArray(0);
  gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 16, 0);
  gl.enableVertexAttribArray(1);
  gl.vertexAttribPointer(1, 4, gl.UNSIGNED_BYTE, true, 16, 12);
  return { array, buffer, count: bytes.byteLength / 16 };
}

function forget(gl, parts) {
  for (const part of parts.filter(Boolean)) { gl.deleteVertexArray(part.array); gl.deleteBuffer(part.buffer); }
}

/** The lines of a path; moves that are not executed yet are paler. */
function lines(path, facing) {
  const count = path.contact.length;
  const bytes = new ArrayBuffer(Math.max(0, count - 1) * 32);
  const view = new DataView(bytes);
  const colour = COLOURS[Math.max(0, path.pass - 1) % COLOURS.length];
  for (let move = 1; move < count; move += 1) {
    const [r, g, b] = path.contact[move - 1] && path.contact[move] ? colour : AIR;
    const share = move <= path.executed ? 255 : 120;
    [move - 1, move].forEach((waypoint, end) => {
      const place = (2 * (move - 1) + end) * 16;
      for (let axis = 0; axis < 3; axis += 1) view.setFloat32(place + 4 * axis, path.at_mm[3 * waypoint + axis] + LIFT_MM * facing[axis], true);
      [r, g, b].forEach((part, index) => view.setUint8(place + 12 + index, Math.round(share * part)));
    });
  }
  return bytes;
}

/** The middle and the size of the shown objects, mm: of the paths if there are any, otherwise of the points. */
function extent(points, paths) {
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  const add = (x, axis) => { low[axis] = Math.min(low[axis], x); high[axis] = Math.max(high[axis], x); };
  for (const path of paths) path.at_mm.forEach((x, index) => add(x, index % 3));
  if (paths.length === 0 && points) {
    const view = new DataView(points);
    for (let at = 0; at < points.byteLength; at += 16) for (let axis = 0; axis < 3; axis += 1) add(view.getFloat32(at + 4 * axis, true), axis);
  }
  if (!Number.isFinite(low[0])) return { middle: [0, 0, 0], size: 1000 };
  return { middle: low.map((x, axis) => (x + high[axis]) / 2), size: Math.max(100, ...low.map((x, axis) => high[axis] - x)) };
}

class Scene {
  constructor(place) {
    this.place = place;
    this.canvas = place.querySelector("canvas");
    this.told = place.querySelector(".told");
    this.cycle = null;
    this.paths = [];
    this.extent = { middle: [0, 0, 0], size: 1000 };
    this.facing = [0, 0, 1];
    this.gl = this.canvas.getContext("webgl2", { antialias: true, alpha: false });
    this.canvas.hidden = !this.gl;
    if (this.gl) this.program = program(this.gl);
    for (const button of place.querySelectorAll("[data-view]")) {
      button.disabled = !this.gl;
      button.addEventListener("click", () => this.look(button.dataset.view));
    }
    this.look("reset");
    this.hear();
    new ResizeObserver(() => this.draw()).observe(this.canvas);
  }

  look(view) {
    const tilt = { reset: -0.9, top: 0, side: -Math.PI / 2 }[view];
    this.eye = { turn: view === "reset" ? 0.5 : 0, tilt, away: 1.6, shift: [0, 0] };
    this.draw();
  }

  hear() {
    const { canvas } = this;
    const touching = new Map();
    canvas.addEventListener("pointerdown", (event) => { canvas.setPointerCapture(event.pointerId); touching.set(event.pointerId, [event.clientX, event.clientY]); canvas.focus(); });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (event) => touching.delete(event.pointerId));
    canvas.addEventListener("pointermove", (event) => {
      const was = touching.get(event.pointerId);
      if (!was) return;
      const apart = () => { const [a, b] = [...touching.values()]; return Math.hypot(a[0] - b[0], a[1] - b[1]); };
      const before = touching.size === 2 ? apart() : 0;
      touching.set(event.pointerId, [event.clientX, event.clientY]);
      const [dx, dy] = [event.clientX - was[0], event.clientY - was[1]];
      if (touching.size === 2) { this.nearer(before / Math.max(1, apart())); this.move(dx / 2, dy / 2); }
      else if (event.shiftKey) this.move(dx, dy);
      else this.turn(dx / 150, dy / 150);
    });
    canvas.addEventListener("wheel", (event) => { event.preventDefault(); this.nearer(Math.exp(event.deltaY / 800)); }, { passive: false });
    canvas.addEventListener("keydown", (event) => {
      const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
      if (step && event.shiftKey) this.move(20 * step[0], 20 * step[1]);
      else if (step) this.turn(step[0] / 10, step[1] / 10);
      else if (event.key === "+" || event.key === "-") this.nearer(event.key === "+" ? 0.85 : 1.18);
      else return;
      event.preventDefault();
    });
  }

  turn(about, up) { this.eye.turn += about; this.eye.tilt = Math.min(0, Math.max(-Math.PI, this.eye.tilt + up)); this.draw(); }
  move(right, down) { this.eye.shift[0] += right / 400; this.eye.shift[1] -= down / 400; this.draw(); }
  nearer(share) { this.eye.away = Math.min(8, Math.max(0.15, this.eye.away * share)); this.draw(); }

  view() {
    const { middle, size } = this.extent;
    // The front of the panel is rotated to +z, whatever its direction in the cell: first about z, then about y.
    const [x, y, z] = this.facing;
    const upright = multiplied(rotated(2, Math.PI / 2), multiplied(rotated(1, -Math.acos(Math.max(-1, Math.min(1, z)))), rotated(2, -Math.atan2(y, x))));
    const { turn, tilt, away, shift } = this.eye;
    const scale = 1 / size;
    const eye = shifted(shift[0], shift[1], -away);
    const scaled = identity().map((x, index) => (index % 5 === 0 && index < 15 ? x * scale : x));
    const model = multiplied(rotated(0, tilt), multiplied(rotated(2, turn), multiplied(upright, multiplied(scaled, shifted(...middle.map((x) => -x))))));
    return multiplied(perspective(0.9, this.canvas.width / Math.max(1, this.canvas.height), 0.02, 50), multiplied(eye, model));
  }

  draw() {
    const { gl, canvas } = this;
    if (!gl || !this.place.open) return;
    const scale = Math.min(2, window.devicePixelRatio || 1);
    canvas.width = Math.round(canvas.clientWidth * scale);
    canvas.height = Math.round(canvas.clientHeight * scale);
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(0.07, 0.08, 0.09, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.useProgram(this.program);
    gl.uniformMatrix4fv(gl.getUniformLocation(this.program, "view"), false, this.view());
    gl.uniform1f(gl.getUniformLocation(this.program, "size"), Math.min(6, Math.max(1.5, (2.4 * scale) / this.eye.away)));
    for (const [mode, part] of [[gl.POINTS, this.points], ...(this.lines ?? []).map((one) => [gl.LINES, one])]) {
      if (!part) continue;
      gl.bindVertexArray(part.array);
      gl.drawArrays(mode, 0, part.count);
    }
    canvas.dataset.drawn = String((this.points?.count ?? 0) + (this.lines ?? []).reduce((sum, one) => sum + one.count, 0));
  }

  /** Reads the new data of this cycle: the points once when they exist, the paths each time. */
  async read(cycle) {
    if (cycle !== this.cycle) {
      if (this.gl) forget(this.gl, [this.points, ...(this.lines ?? [])]);
      [this.cycle, this.points, this.paths, this.lines] = [cycle, null, [], []];
    }
    const response = await fetch(`/cycle/${cycle}/scene.json`, { cache: "no-store" }).catch(() => null);
    if (!response?.ok) { this.told.textContent = word("scene.none"); this.draw(); return; }
    const { paths, has_points: hasPoints, facing } = await response.json();
    this.facing = facing;
    const isNew = paths.length !== this.paths.length;
    let bytes = null;
    if (this.gl && hasPoints && !this.points) {
      const points = await fetch(`/cycle/${cycle}/scene.bin`, { cache: "no-store" }).catch(() => null);
      if (points?.ok) bytes = await points.arrayBuffer();
      if (bytes) this.points = upload(this.gl, bytes);
    }
    if (isNew || bytes) this.extent = extent(bytes, paths);
    this.paths = paths;
    if (this.gl) forget(this.gl, this.lines);
    if (this.gl) this.lines = paths.map((path) => upload(this.gl, lines(path, facing)));
    this.told.textContent = [this.gl ? "" : word("scene.no_webgl"), paths.length === 0 ? word("scene.no_path") : ""].filter(Boolean).join(" ");
    this.explain();
    this.draw();
  }

  explain() {
    const items = this.paths.map(({ pass, contact, executed }) => {
      const item = document.createElement("li");
      const sample = document.createElement("canvas");
      Object.assign(sample, { width: 30, height: 14, className: "sample" });
      sample.setAttribute("aria-hidden", "true");
      const pen = sample.getContext("2d");
      pen.strokeStyle = `rgb(${COLOURS[Math.max(0, pass - 1) % COLOURS.length].map((part) => 255 * part).join(",")})`;
      pen.lineWidth = 4;
      pen.setLineDash([[], [8, 4], [3, 3], [12, 3, 3, 3], [2, 6]][Math.max(0, pass - 1) % 5]);
      pen.beginPath(); pen.moveTo(0, 7); pen.lineTo(30, 7); pen.stroke();
      item.append(sample, `${word("scene.pass")} ${pass}: ${executed} / ${Math.max(0, contact.length - 1)} ${word("scene.executed")}`);
      return item;
    });
    this.place.querySelector(".legend").replaceChildren(...items);
  }
}

/** Shows the scene in this part of a page once it is opened; `newest` returns the cycle to show. */
function begin(place, newest) {
  let scene = null;
  const again = async () => {
    const cycle = newest();
    if (!place.open || !cycle) return;
    scene ??= new Scene(place);
    await scene.read(cycle);
  };
  place.addEventListener("toggle", again);
  if (!place.dataset.cycle) setInterval(again, POLL_INTERVAL_MS);
}

for (const place of document.querySelectorAll("details.scene")) {
  begin(place, () => place.dataset.cycle ?? document.getElementById("cycle")?.dataset.cycle);
}
