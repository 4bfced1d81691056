// Labels the breaks in a clip. `said` contains the labels; the program stores every change as a draft, so that a reload of the
// page loses nothing. Positions are pixels of the clip's pictures, with whole numbers at pixel centres; times are those of the clip.

import { beginAt, closeAt, cornersAt, isOpen, rounded, seconds, shapeFrom } from "./breaks.js";
import { Film } from "./film.js";
import { onKeys } from "./keys.js";
import { drawOverlay, drawStrip } from "./overlay.js";
import { drawList, drawSelected } from "./panel.js";
import { Drafts, ask, posted } from "./program.js";

const at = (id) => document.getElementById(id);
const overlay = at("overlay");
const MAX_UNDO = 200;

let [clip, film, said] = [null, null, null];
let [index, zoom, wetFrom] = [0, 1, 0];
// The selected break and its selected corner; the break that is being drawn; the object that a pointer drags.
let [chosen, corner, drawn, dragged] = [-1, -1, null, null];
let [playing, holdsDry] = [null, false];
const undone = [];

const now = () => clip.shots[index].time_s;
const selected = () => said.breaks[chosen];
const within = (value, most) => Math.min(Math.max(value, -0.5), most - 0.5);

function tell(words, isWrong = false) {
  at("told").textContent = words;
  at("told").classList.toggle("wrong", isWrong);
}

const drafts = new Drafts((problem) => tell(`The drawing was not stored: ${problem}`, true));

// --- labels

function remember() {
  undone.push(JSON.stringify(said));
  if (undone.length > MAX_UNDO) undone.shift();
}

// Changes the person's labels.
function change(how) {
  remember();
  how();
  changed();
}

function changed() {
  chosen = Math.min(chosen, said.breaks.length - 1);
  if (said.breaks.length > 0) said.clean = false;
  tell("Not saved yet. The draft is stored: a reload of the page loses nothing.");
  render();
  if (!dragged) drafts.keep(said);
}

// --- rendering

function render() {
  const view = {
    size: clip.size_px, time: now(), grids: clip.grids, breaks: said.breaks, chosen, corner, drawn,
    showsBreaks: at("names").checked, showsGrids: at("grids").checked,
  };
  drawOverlay(overlay, view);
  drawStrip(at("strip"), { shots: clip.shots, index, breaks: said.breaks, chosen });
  const shot = clip.shots[index];
  const since = shot.time_s - wetFrom;
  const wet = since >= 0 ? `, ${seconds(since)} after the first wet picture` : "";
  at("now").textContent = `picture ${index + 1} of ${clip.shots.length}: ${seconds(shot.time_s)}, ${shot.phase}${wet}`;
  at("time").value = index;
  at("time").setAttribute("aria-valuetext", at("now").textContent);
  at("undo").disabled = undone.length === 0;
  at("clean").checked = said.clean;
  at("clean").disabled = said.breaks.length > 0;
  at("draw").textContent = drawn ? "End the break (Enter)" : "Draw a break";
  overlay.classList.toggle("draws", drawn !== null);
  drawList({ breaks: said.breaks, chosen, onChoose: chooseInList });
  drawSelected({
    one: selected(), number: chosen, corner, time: now(), wetFrom, onGo: goToTime,
    onRemove: (shape) => change(() => selected().shapes.splice(shape, 1)),
  });
}

function chooseInList(number) {
  choose(number);
  if (!isOpen(selected(), now())) goToTime(selected().shapes[0].from_s);
}

function choose(number, ofCorner = -1) {
  [chosen, corner] = [number, ofCorner];
  render();
}

// --- time

function show() {
  film.show(index, holdsDry ? "dry" : at("show").value).catch((error) => tell(error.message, true));
}

function goTo(place) {
  index = Math.min(Math.max(place, 0), clip.shots.length - 1);
  history.replaceState(null, "", `#${index + 1}`);
  corner = selected() && corner < cornersAt(selected(), now()).length ? corner : -1;
  show();
  render();
}

function goToTime(time) {
  const place = clip.shots.findIndex((shot) => shot.time_s >= time);
  goTo(place < 0 ? clip.shots.length - 1 : place);
}

function step(pictures) {
  pause();
  goTo(index + pictures);
}

// Start with the picture whose number is in the URL, which a reload keeps; otherwise with the first wet picture.
function goToAsked() {
  const asked = Number.parseInt(location.hash.slice(1), 10);
  if (asked >= 1) goTo(asked - 1);
  else goToTime(wetFrom);
}

function pause() {
  if (playing) cancelAnimationFrame(playing.request);
  playing = null;
  at("play").textContent = "Play";
}

// Plays the clip with its own times; pictures that are loaded too late are skipped.
function play() {
  if (index === clip.shots.length - 1) goTo(0);
  playing = { since: performance.now(), from: now(), request: 0 };
  at("play").textContent = "Pause";
  const advance = (moment) => {
    if (!playing) return;
    const time = playing.from + (moment - playing.since) / 1000 * Number(at("speed").value);
    const place = clip.shots.findLastIndex((shot) => shot.time_s <= time);
    if (place > index) goTo(place);
    if (index === clip.shots.length - 1) pause();
    else playing.request = requestAnimationFrame(advance);
  };
  playing.request = requestAnimationFrame(advance);
}

// --- size

function setZoom(wanted, [x, y] = [0.5, 0.5]) {
  const stage = at("stage");
  const fit = Math.min(stage.clientWidth / clip.size_px[0], stage.clientHeight / clip.size_px[1]);
  const before = zoom;
  zoom = Math.min(Math.max(wanted ?? fit, Math.min(fit, 0.1)), 16);
  const [middleX, middleY] = [x * stage.clientWidth, y * stage.clientHeight];
  const kept = [(stage.scrollLeft + middleX) / before, (stage.scrollTop + middleY) / before];
  at("paper").style.width = `${clip.size_px[0] * zoom}px`;
  at("paper").style.height = `${clip.size_px[1] * zoom}px`;
  at("paper").classList.toggle("close", zoom > 1.5);
  stage.scrollLeft = kept[0] * zoom - middleX;
  stage.scrollTop = kept[1] * zoom - middleY;
  at("zoom").textContent = `${Math.round(100 * zoom)} %`;
  render();
}

// Zooms to the grids, or displays the whole picture if there are no grids.
function lookAtGrids() {
  setZoom();
  const edges = clip.grids.flatMap(({ edge_px }) => edge_px);
  if (edges.length === 0) return;
  const [low, high] = [Math.min, Math.max].map((of) => [0, 1].map((axis) => of(...edges.map((place) => place[axis]))));
  const stage = at("stage");
  setZoom(0.85 * Math.min(stage.clientWidth / (high[0] - low[0]), stage.clientHeight / (high[1] - low[1])));
  stage.scrollLeft = (low[0] + high[0]) / 2 * zoom - stage.clientWidth / 2;
  stage.scrollTop = (low[1] + high[1]) / 2 * zoom - stage.clientHeight / 2;
}

// --- drawing

function beginDrawing() {
  pause();
  if (now() < wetFrom) {
    tell(`A break must begin in a wet picture: the first wet picture is at ${seconds(wetFrom)}.`, true);
    return;
  }
  drawn = { from_s: now(), corners_px: [] };
  [chosen, corner] = [-1, -1];
  tell(`New break from ${seconds(now())} on: click its corners; Enter, or a click on the first corner, ends it.`);
  render();
}

function endDrawing() {
  const { from_s, corners_px } = drawn;
  if (corners_px.length < 3) {
    tell(`A break needs at least three corners; this break has ${corners_px.length}.`, true);
    return;
  }
  drawn = null;
  change(() => said.breaks.push({ closes_s: null, shapes: [{ from_s, corners_px }] }));
  choose(said.breaks.length - 1);
}

function giveUp() {
  if (drawn) tell("The drawing of the break was cancelled.");
  drawn = null;
  render();
}

function removeBreak() {
  change(() => said.breaks.splice(chosen, 1));
  choose(-1);
}

function removeCorner() {
  change(() => shapeFrom(selected(), now()).corners_px.splice(corner, 1));
  choose(chosen);
}

function insertCorner() {
  change(() => {
    const corners = shapeFrom(selected(), now()).corners_px;
    const [a, b] = [corners[corner], corners[(corner + 1) % corners.length]];
    corners.splice(corner + 1, 0, rounded([(a[0] + b[0]) / 2, (a[1] + b[1]) / 2]));
  });
  choose(chosen, corner + 1);
}

// Moves the selected corner of the shape at this time; without a selected corner, moves the whole shape.
function moveBy(du, dv) {
  const shape = shapeFrom(selected(), now());
  const moved = ([u, v]) => rounded([within(u + du, clip.size_px[0]), within(v + dv, clip.size_px[1])]);
  shape.corners_px = shape.corners_px.map((place, number) => (corner < 0 || corner === number ? moved(place) : place));
}

function undo() {
  const before = undone.pop();
  if (!before) return;
  said = { ...JSON.parse(before), author: said.author };
  corner = -1;
  changed();
}

// --- the pointer

function place(event) {
  const box = overlay.getBoundingClientRect();
  const of = (value, low, length, most) => within((value - low) / length * most - 0.5, most);
  return rounded([
    of(event.clientX, box.left, box.width, clip.size_px[0]), of(event.clientY, box.top, box.height, clip.size_px[1]),
  ]);
}

// Adds a corner. A click on the first corner, or a second click on the last corner, completes the break.
function drawTo(event) {
  const [u, v] = place(event);
  const last = drawn.corners_px.at(-1);
  const isDouble = last && Math.hypot(u - last[0], v - last[1]) * zoom < 4;
  if (event.target.dataset.end || isDouble) return endDrawing();
  drawn.corners_px.push([u, v]);
  render();
}

overlay.addEventListener("pointerdown", (event) => {
  if (event.button !== 0) return;
  event.preventDefault();
  document.activeElement?.blur();
  if (drawn) {
    drawTo(event);
    return;
  }
  pause();
  const stage = at("stage");
  const { dataset } = event.target;
  const number = dataset.break === undefined ? -1 : Number(dataset.break);
  const wasChosen = number >= 0 && number === chosen;
  if (number >= 0) choose(number, dataset.corner === undefined ? -1 : Number(dataset.corner));
  const canMove = wasChosen && isOpen(selected(), now());
  dragged = canMove
    ? { from: place(event), before: JSON.stringify(said), moved: false }
    : { scroll: [stage.scrollLeft + event.clientX, stage.scrollTop + event.clientY], onNothing: number < 0, moved: false };
  overlay.setPointerCapture(event.pointerId);
});

overlay.addEventListener("pointermove", (event) => {
  if (!dragged) return;
  if (dragged.scroll) {
    const stage = at("stage");
    const [left, top] = [dragged.scroll[0] - event.clientX, dragged.scroll[1] - event.clientY];
    dragged.moved ||= Math.hypot(left - stage.scrollLeft, top - stage.scrollTop) > 3;
    [stage.scrollLeft, stage.scrollTop] = [left, top];
    return;
  }
  const [u, v] = place(event);
  const [du, dv] = [u - dragged.from[0], v - dragged.from[1]];
  if (!dragged.moved && Math.hypot(du, dv) * zoom < 3) return;
  if (!dragged.moved) undone.push(dragged.before);
  dragged.moved = true;
  said = JSON.parse(dragged.before);
  moveBy(du, dv);
  changed();
});

function endDrag() {
  const ended = dragged;
  dragged = null;
  if (ended?.onNothing && !ended.moved) choose(-1);
  if (ended?.before && ended.moved) changed();
}
overlay.addEventListener("pointerup", endDrag);
overlay.addEventListener("pointercancel", endDrag);

at("stage").addEventListener("wheel", (event) => {
  if (!event.ctrlKey) return;
  event.preventDefault();
  const box = at("stage").getBoundingClientRect();
  setZoom(zoom * 1.2 ** -Math.sign(event.deltaY), [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height]);
}, { passive: false });

// --- buttons and keys

const table = {
  " ": () => at("play").click(),
  Home: () => goToTime(wetFrom),
  End: () => goTo(clip.shots.length - 1),
  Enter: () => { if (drawn) endDrawing(); },
  Escape: () => (drawn ? giveUp() : choose(-1)),
  Backspace: () => { if (drawn?.corners_px.pop()) render(); },
  Delete: () => { if (selected()) (corner >= 0 && !at("cut").disabled ? removeCorner : removeBreak)(); },
  n: () => at("draw").click(), b: () => at("begins").click(), c: () => at("closes").click(), k: () => at("shape").click(),
  "+": () => setZoom(zoom * 1.25), "-": () => setZoom(zoom / 1.25), 0: () => setZoom(),
  d: () => { if (!holdsDry) { holdsDry = true; show(); } },
};

// Moves the selected corner or break, if the break is open at this time.
function nudge(du, dv) {
  if (selected() && isOpen(selected(), now())) change(() => moveBy(du, dv));
}

function releaseDry() {
  if (!holdsDry) return;
  holdsDry = false;
  show();
}

const ON_CLICK = {
  back: () => step(-1),
  next: () => step(1),
  play: () => (playing ? pause() : play()),
  fit: () => setZoom(),
  larger: () => setZoom(zoom * 1.25),
  smaller: () => setZoom(zoom / 1.25),
  draw: () => (drawn ? endDrawing() : beginDrawing()),
  undo,
  begins: () => change(() => beginAt(selected(), now())),
  closes: () => change(() => closeAt(selected(), now())),
  stays: () => change(() => { selected().closes_s = null; }),
  shape: () => change(() => shapeFrom(selected(), now())),
  insert: insertCorner,
  cut: removeCorner,
  remove: removeBreak,
};
for (const [id, act] of Object.entries(ON_CLICK)) at(id).addEventListener("click", act);
at("time").addEventListener("input", () => { pause(); goTo(Number(at("time").value)); });
at("show").addEventListener("change", () => { show(); at("show").blur(); });
at("speed").addEventListener("change", () => { if (playing) { pause(); play(); } at("speed").blur(); });
for (const id of ["names", "grids"]) at(id).addEventListener("change", render);
at("clean").addEventListener("change", () => change(() => { said.clean = at("clean").checked; }));
at("author").addEventListener("input", () => { said.author = at("author").value; changed(); });
window.addEventListener("resize", () => { if (clip) setZoom(zoom); });

at("save").addEventListener("click", async () => {
  try {
    if (drawn) throw new Error("A break is still being drawn: end it with Enter, or cancel it with Escape.");
    await drafts.areKept();
    const { labels, former, saved_at } = await ask("save", posted(said));
    const kept = former ? ` The previous labels are kept as ${former}.` : "";
    tell(`Saved in ${labels}, with mask.png and times.png.${kept}`);
    at("kept").textContent = `labelled, saved ${saved_at}`;
  } catch (error) {
    tell(`Not saved. ${error.message}`, true);
  }
});

at("done").addEventListener("click", async () => {
  try {
    await drafts.areKept();
    await ask("done", { method: "POST" });
    pause();
    tell("Closed. The program continues in the terminal.");
    for (const one of document.querySelectorAll("button, input, select")) one.disabled = true;
  } catch (error) {
    tell(error.message, true);
  }
});

// --- start

function tellWhatIsKept({ saved_at, is_draft, note }) {
  at("kept").textContent = saved_at ? `labelled, saved ${saved_at}` : "not labelled yet";
  if (note) tell(`Note: ${note}.`, true);
  else if (is_draft) tell("The drawing is a draft and is not saved yet.");
}

try {
  clip = await ask("clip.json");
  said = clip.now.said;
  wetFrom = clip.shots.find((shot) => shot.phase === "wet").time_s;
  film = new Film(at("picture"), clip.shots, clip.size_px);
  at("clip").textContent = clip.clip;
  at("author").value = said.author;
  at("time").max = clip.shots.length - 1;
  at("grids").parentElement.hidden = clip.grids.length === 0;
  lookAtGrids();
  tellWhatIsKept(clip.now);
  goToAsked();
  window.addEventListener("hashchange", goToAsked);
  onKeys({ table, step, move: nudge, undo, released: { d: releaseDry } });
} catch (error) {
  tell(error.message, true);
}
