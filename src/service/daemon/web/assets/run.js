// The page of the running cell, which is updated by the events of the service.

import { action, localTime, meta, send, tell, word } from "./PAGE_JS";

const id = (name) => document.getElementById(name);
const STALE_MS = 3000; // the service sends an event at least once a second
const set = (element, text) => { if (element && element.textContent !== text) element.textContent = text; };

let now = null;
let heard = Date.now();
let frame = 0;
let read = null; // the last read record of a cycle
let recordOf = "";
let reviewOf = "";
let reviewStep = null;
let path = null;

/** Returns the record of the shown cycle; the record of another cycle is never shown. */
const record = () => (now.cycle !== null && read?.cycle === now.cycle ? read : { part: null, panel: null, passes: null, grids: {}, no_part: false });

/** The style of a state: only abnormal states have a colour, together with a symbol. */
function looks(now) {
  if (!now.answers || now.state === "aborted" || now.state === "aborting") return "bad";
  if (now.state === "complete" && record().no_part) return "doubt";
  if (now.state === "complete") return { pass: "good", accept: "good", fail: "bad", reject: "bad" }[now.verdict] ?? "doubt";
  if (now.state === "held" || now.state === "holding" || (now.state === "stopped" && now.verdict === "aborted") || (now.reasons.length > 0 && now.state !== "execute")) return "doubt";
  return "";
}

/** The commands that a message names, and the buttons with the same function. */
const COMMANDS = [["unhold --dried", "unhold_dried"], ["unhold", "unhold"], ["accept", "accept"], ["clear", "clear"], ["reset", "reset"]];

/** Decisions that depend on the shown state; they contain the number of the step. */
const DECISIONS = new Set(["unhold", "accept", "clear"]);

/** Converts a text of the program for this page: buttons replace commands, and backticks are removed. */
const readable = (text) => COMMANDS.reduce((all, [command, name]) => all.replaceAll(`\`panelprep ctl ${command}\``, `“${action(name)}”`), text).replaceAll("`", "");

/** The meanings of the requested codes, by code: { short, cause, remedy }, or null if there is no answer yet. */
const meanings = new Map();

/** The meaning of a code and its remedy, in the page's language; fetched once, and the state is shown again when it arrives. */
function meaning(code) {
  if (!meanings.has(code)) {
    meanings.set(code, null);
    fetch(`/message/${encodeURIComponent(code)}`).then((response) => (response.ok ? response.json() : null)).then((found) => {
      meanings.set(code, found);
      if (found) showState();
    }).catch(() => meanings.delete(code));
  }
  return meanings.get(code);
}

/** Returns the decision for which a review waits: a new disc, a decision on the result of sanding (phase Assess), which drying the panel does not change, or another decision. */
function reviewKind() {
  // A person without the permission to accept the result calls a person with this permission.
  const call = document.querySelector('button[data-request="accept"]') ? "" : "_call";
  if (now.reasons.some(({ code }) => code === "disc_worn")) return `_disc${call}`;
  return now.phase === "assess" ? `_contact${call}` : call;
}

/** The texts of a reason on this page, { text, sentence, remedy }: in the page's language, with the program's English sentence and its values beside it. */
function said(reason) {
  if (reason.code === "held_by") return { text: `${word("held_by")} ${reason.message}`, sentence: "", remedy: "" };
  const key = `why.${now.state}.${reason.code}${reason.code === "review" ? reviewKind() : ""}`;
  if (word(key) !== key) return { text: word(key), sentence: "", remedy: "" };
  const sentence = `${readable(reason.message)} (${reason.code})`;
  const known = meaning(reason.code);
  const remedy = known ? readable(known.remedy) : "";
  // The short line can be read from a distance; the sentence with its values is beside it.
  if (known?.short) return { text: known.short, sentence, remedy };
  const isEnglish = document.documentElement.lang === "en";
  return known && !isEnglish ? { text: readable(known.cause), sentence, remedy } : { text: sentence, sentence: "", remedy };
}

/** Returns the next action of the operator, if the state of the cell has no reason. */
function next() {
  const keys = [`next.${now.state}.${now.verdict}`, `next.${now.state}`];
  return keys.map((key) => [key, word(key)]).find(([key, text]) => text !== key)?.[1] ?? "";
}

function showState() {
  const ended = ["complete", "stopped", "aborted"].includes(now.state) && now.verdict;
  // A cycle that found no part gives no result about the part with the entered serial number.
  const isNoPart = now.state === "complete" && Boolean(record().no_part);
  const verdict = now.verdict && now.state !== "aborted" ? `: ${word(`verdict.${isNoPart ? "no_part" : now.verdict}`)}` : "";
  const state = id("state");
  state.dataset.state = now.state ?? "";
  state.className = `state ${looks(now)}`;
  set(id("state-word"), now.state ? word(`state.${now.state}`) + (ended ? verdict : "") : "…");
  const { part: named, panel } = record();
  const part = named ?? {};
  set(id("panel"), [now.panel ?? panel, part.serial, part.order, part.operator].filter(Boolean).join(" · "));
  // The reasons of a review are shown beside its pictures and buttons.
  const given = (now.is_review ? now.reasons.slice(0, 1) : now.reasons).map(said);
  const list = isNoPart ? [{ text: word("next.no_part"), sentence: "", remedy: "" }, ...given] : given;
  const first = list[0] ?? { text: next(), sentence: "", remedy: "" };
  set(id("why"), first.text);
  id("why").classList.toggle("is-long", first.text.length > 140);
  set(id("sentence"), first.sentence);
  const remedy = now.is_review || now.state === "execute" ? "" : first.remedy;
  set(id("remedy"), remedy);
  id("remedy").parentElement.hidden = remedy === "";
  const more = id("reasons");
  if (more.dataset.list !== JSON.stringify(list)) {
    more.dataset.list = JSON.stringify(list);
    more.replaceChildren(...list.slice(1).map(({ text, sentence }) => {
      const item = Object.assign(document.createElement("li"), { textContent: text });
      if (sentence) item.append(" ", Object.assign(document.createElement("small"), { lang: "en", textContent: sentence }));
      return item;
    }));
  }
}

/** Returns the remaining seconds of the film, or of the path at its present speed. */
function left() {
  if (now.film_s !== null && now.film_total_s) return Math.max(0, now.film_total_s - now.film_s);
  if (now.waypoint === null || !now.of) { path = null; return null; }
  if (!path || path.of !== now.of || now.waypoint < path.from) path = { of: now.of, from: now.waypoint, at: Date.now() };
  const done = now.waypoint - path.from;
  return done < 5 ? null : ((now.of - now.waypoint) * (Date.now() - path.at)) / 1000 / done;
}

function showProgress() {
  for (const item of id("phases").children) {
    const isNow = item.dataset.phase === now.phase;
    item.classList.toggle("is-now", isNow);
    if (isNow) item.setAttribute("aria-current", "step"); else item.removeAttribute("aria-current");
  }
  const total = now.film_total_s ? ` / ${now.film_total_s.toFixed(0)}` : "";
  set(id("film"), now.film_s === null ? "–" : `${now.film_s.toFixed(1)}${total} s`);
  set(id("waypoint"), now.of === null ? "–" : `${now.waypoint} / ${now.of}`);
  const seconds = left();
  set(id("left"), seconds === null ? "–" : `${seconds.toFixed(0)} s`);
  const { passes } = record();
  set(id("pass"), passes === null ? "–" : String(passes));
  const cycle = id("cycle");
  if (now.cycle === null) { delete cycle.dataset.cycle; set(cycle, "–"); } else if (cycle.dataset.cycle !== String(now.cycle)) {
    cycle.dataset.cycle = String(now.cycle);
    const link = Object.assign(document.createElement("a"), { href: `/cycle/${now.cycle}`, textContent: String(now.cycle) });
    link.setAttribute("aria-label", `${word("record")} ${now.cycle}`);
    cycle.replaceChildren(link);
  }
  const share = now.film_s !== null && now.film_total_s ? now.film_s / now.film_total_s : now.of ? now.waypoint / now.of : 0;
  id("bar").value = Math.min(1, share);
}

function showButtons() {
  const possible = new Set(now.answers ? now.possible : []);
  for (const button of document.querySelectorAll("button[data-request]")) button.disabled = !possible.has(button.dataset.request);
  // A result can be accepted only while it is shown.
  const isShown = reviewStep !== null && reviewStep === now.step;
  for (const button of document.querySelectorAll('button[data-request="accept"]')) button.disabled ||= !isShown;
  for (const button of document.querySelectorAll("button[data-needs]")) button.disabled = !possible.has(button.dataset.needs);
  const second = document.querySelector("#start-second button[type=submit]");
  if (second) second.disabled ||= !isStartOpen();
}

function showGrids() {
  const place = id("grids");
  if (!place) return;
  const { grids } = record();
  // After a restart the service knows the panel only from the record.
  const cells = (now.grids.length > 0 ? now.grids : Object.keys(grids)).map((name) => /^r(\d+)c(\d+)$/.exec(name)).filter(Boolean).map(([name, row, column]) => ({ name, row: +row, column: +column }));
  const state = (name) => grids[name] ?? "untested";
  const shown = JSON.stringify(cells.map(({ name }) => [name, state(name)]));
  if (place.dataset.shown === shown) return;
  place.dataset.shown = shown;
  const table = Object.assign(document.createElement("table"), { className: "map" });
  const rows = Math.max(-1, ...cells.map(({ row }) => row));
  const columns = Math.max(-1, ...cells.map(({ column }) => column));
  for (let row = 0; row <= rows; row += 1) {
    const line = table.insertRow();
    for (let column = 0; column <= columns; column += 1) {
      const cell = line.insertCell();
      const found = cells.find((one) => one.row === row && one.column === column);
      if (!found) continue;
      const box = Object.assign(document.createElement("span"), { className: `grid ${state(found.name)}`, title: found.name });
      box.setAttribute("role", "img");
      box.setAttribute("aria-label", `${found.name}: ${word(state(found.name))}`);
      cell.append(box);
    }
  }
  place.replaceChildren(table);
}

/** Returns the title of the picture: only a film in progress has the title "The film now". */
function frameName() {
  const isFilm = now.frame_name === "film" && now.state === "execute" && now.phase === "inspect";
  return isFilm ? word("picture.film") : word("picture.last");
}

function showFrame() {
  const image = id("frame");
  if (!image) return;
  if (now.frame === 0) {
    frame = 0;
    image.hidden = true;
    image.removeAttribute("src");
    set(id("frame-name"), word("picture.none"));
    return;
  }
  if (!image.hidden) { image.alt = frameName(); set(id("frame-name"), frameName()); }
  if (now.frame === frame) return;
  const number = frame = now.frame;
  const loading = new Image();
  loading.onload = () => {
    if (frame !== number) return;
    image.src = loading.src;
    image.hidden = false;
    image.alt = frameName();
    set(id("frame-name"), frameName());
  };
  loading.src = `/frame.jpg?${number}`;
}

/** Reads part, grids and sanding passes from the record, which changes with the phase. */
async function readRecord() {
  const of = `${now.cycle} ${now.state} ${now.phase} ${now.pass}`;
  if (of === recordOf || !id("grids")) return;
  recordOf = of;
  try {
    const response = await fetch("/now.json", { cache: "no-store" });
    read = response.ok ? await response.json() : null;
    if (!response.ok) recordOf = "";
    showState(); showProgress(); showGrids();
  } catch { recordOf = ""; }
}

async function readReview() {
  const place = id("review");
  const step = now.step;
  const of = now.is_review && meta("person") ? `${now.cycle} ${step}` : "";
  if (of === reviewOf) return;
  reviewOf = of;
  reviewStep = null;
  place.hidden = true;
  if (!of) { place.replaceChildren(); return; }
  try {
    const response = await fetch("/review", { cache: "no-store" });
    if (!response.ok) { reviewOf = ""; return; }
    const parsed = new DOMParser().parseFromString(await response.text(), "text/html");
    const accept = document.querySelector('button[data-request="accept"]');
    place.replaceChildren(...parsed.body.childNodes);
    if (accept) {
      const beside = accept.cloneNode(true);
      beside.disabled = false;
      beside.classList.add("primary");
      beside.addEventListener("click", () => ask(beside));
      place.append(beside);
    }
    place.hidden = false;
    if (reviewOf === of) reviewStep = step;
    showButtons();
  } catch { reviewOf = ""; }
}

async function ask(button) {
  button.disabled = true;
  const body = button.dataset.body ? JSON.parse(button.dataset.body) : {};
  // The step to which the decision refers: that of the shown state, or of the review beside the button.
  if (DECISIONS.has(button.dataset.request)) body.step = button.dataset.request === "accept" ? reviewStep : now?.step ?? null;
  if (button.dataset.request === "hold") body.why = id("why-held")?.value ?? "";
  const result = await send(`/request/${button.dataset.request}`, body);
  // The reason belongs to this hold only.
  if (result.ok && button.dataset.request === "hold") id("why-held").value = "";
  tell(id("told"), result);
  if (now) showButtons();
}

// A start needs two presses: the second one confirms that the guard is closed and no person is inside.
const START_PAUSE_MS = 1000; // minimum time between the presses: a double click is treated as one press
const START_ASKED_MS = 20_000; // after this time the cell may have changed, and the question is asked again
let startAsked = null;

/** Returns whether the second press is accepted now. */
function isStartOpen() {
  const since = startAsked === null ? -1 : Date.now() - startAsked;
  return since >= START_PAUSE_MS && since < START_ASKED_MS;
}

/** Shows the question before a start, or instead of it the first button. */
function askStart(isAsked) {
  if (!id("start-second")) return;
  startAsked = isAsked ? Date.now() : null;
  id("start-second").hidden = !isAsked;
  id("start-first").hidden = isAsked;
  // The button that does not start the cycle has the focus.
  if (isAsked) id("start-cancel").focus();
  if (now) showButtons();
}

id("start-first")?.addEventListener("click", () => { if (id("start").reportValidity()) askStart(true); });
// The second click of a double click may hit this button.
id("start-cancel")?.addEventListener("click", () => { if (Date.now() - startAsked >= START_PAUSE_MS) askStart(false); });
id("start")?.addEventListener("input", () => askStart(false));
id("start")?.addEventListener("submit", () => askStart(false));
// A barcode scanner ends each code with Enter: Enter moves to the next field and never starts a cycle.
id("start")?.addEventListener("keydown", (event) => {
  if (event.key !== "Enter") return;
  event.preventDefault();
  const fields = [...id("start").querySelectorAll("input[name=serial], input[name=order]")];
  if (fields.includes(event.target)) fields[fields.indexOf(event.target) + 1]?.focus();
});

// A space in a scanned code must not press the second button. The other characters of the code cancel the question, and a
// space counts only if no other character follows within the time that a scanner needs for its next one.
const SCANNER_PAUSE_MS = 150;
document.addEventListener("keydown", (event) => { if (startAsked !== null && event.key.length === 1 && event.key !== " ") askStart(false); });
const secondStart = document.querySelector("#start-second button[type=submit]");
let lastSpaceMs = -Infinity;
secondStart?.addEventListener("keydown", (event) => { if (event.key === " ") event.preventDefault(); });
secondStart?.addEventListener("keyup", (event) => {
  if (event.key !== " ") return;
  event.preventDefault();
  const asked = startAsked;
  const isScanned = Date.now() - lastSpaceMs < SCANNER_PAUSE_MS;
  lastSpaceMs = Date.now();
  if (isScanned) { askStart(false); return; }
  setTimeout(() => {
    if (asked !== null && startAsked === asked && isStartOpen()) id("start").requestSubmit(secondStart);
  }, SCANNER_PAUSE_MS);
});

// The next part is a different one, so the form is cleared after a start.
id("start")?.addEventListener("sent", () => { for (const field of id("start").querySelectorAll("input:not([type=hidden])")) { field.value = ""; field.checked = false; } });

for (const button of document.querySelectorAll("button[data-request]")) button.addEventListener("click", () => ask(button));

function show(event) {
  now = JSON.parse(event.data);
  heard = Date.now();
  if ((now.by ?? "") !== meta("person")) { leave(); return; }
  showState(); showProgress(); showButtons(); showGrids();
  showFrame(); readRecord(); readReview();
  showStale();
}

/** The page's session has ended, or is another person's now: all its data are removed from the screen, and the page is loaded again. */
function leave() {
  source.close();
  document.querySelector("main").hidden = true;
  set(id("stale"), word("log_in"));
  id("stale").hidden = false;
  location.reload();
}

/** Marks the shown state as stale if the service sends no event, or if the loop of the cell does not answer the service. */
function showStale() {
  const silent = Date.now() - heard > STALE_MS;
  const isStale = silent || (now && !now.answers);
  const place = id("stale");
  document.body.classList.toggle("is-stale", Boolean(isStale));
  place.hidden = !isStale;
  if (isStale) {
    const since = silent ? heard : now.answered_ms || heard;
    set(place, `${word(silent ? "stale" : "silent")} ${localTime(since)}. ${word("stop.dead")}`);
  }
  if (silent) for (const button of document.querySelectorAll("button[data-request], button[data-needs]")) button.disabled = true;
}

let source = null;
function listen() {
  source?.close();
  source = new EventSource("/events");
  source.onmessage = show;
  source.onerror = () => { if (source.readyState === EventSource.CLOSED) setTimeout(listen, 1000); };
}
listen();
setInterval(() => {
  showStale();
  if (startAsked === null) return;
  if (Date.now() - startAsked >= START_ASKED_MS) askStart(false);
  else if (now && Date.now() - heard <= STALE_MS) showButtons();
}, 500);
