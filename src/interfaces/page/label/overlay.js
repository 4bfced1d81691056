// Draws the overlay on the picture, and the time line with phases and breaks below the picture.

import { cornersAt, stateAt } from "./breaks.js";

const SVG = "http://www.w3.org/2000/svg";

export function element(name, attributes, parent) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  parent.append(made);
  return made;
}

const points = (corners) => corners.map(([u, v]) => `${u},${v}`).join(" ");

function word(text, [u, v], kind, scale, parent) {
  const made = element("text", { class: kind, x: u, y: v, "font-size": 15 * scale }, parent);
  made.textContent = text;
}

// Pixel centres are whole numbers, so the picture begins at minus a half.
export function drawOverlay(overlay, view) {
  const { size, time, grids, breaks, chosen, corner, drawn, showsBreaks, showsGrids } = view;
  overlay.replaceChildren();
  overlay.setAttribute("viewBox", `-0.5 -0.5 ${size[0]} ${size[1]}`);
  const scale = size[0] / Math.max(1, overlay.getBoundingClientRect().width);
  if (showsGrids) {
    for (const { id, edge_px } of grids) {
      element("polygon", { class: "grid", points: points(edge_px) }, overlay);
      if (edge_px.length > 0) word(id, [edge_px[0][0] + 5 * scale, edge_px[0][1] + 15 * scale], "name of-grid", 0.75 * scale, overlay);
    }
  }
  if (showsBreaks) {
    breaks.forEach((one, index) => drawBreak(overlay, { one, index, time, isChosen: index === chosen, corner, scale }));
  }
  if (drawn) {
    element("polyline", { class: "halo", points: points(drawn.corners_px) }, overlay);
    element("polyline", { class: "drawn", points: points(drawn.corners_px) }, overlay);
    drawn.corners_px.forEach(([u, v], index) => {
      const kind = index === 0 ? "corner begin" : "corner";
      element("circle", { class: kind, cx: u, cy: v, r: (index === 0 ? 7 : 4) * scale, "data-end": index === 0 ? "1" : "" }, overlay);
    });
  }
}

function drawBreak(overlay, { one, index, time, isChosen, corner, scale }) {
  const corners = cornersAt(one, time);
  if (corners.length === 0) return;
  const state = stateAt(one, time);
  element("polygon", { class: "halo", points: points(corners) }, overlay);
  element("polygon", {
    class: `area ${state}${isChosen ? " chosen" : ""}`, points: points(corners), "data-break": index,
  }, overlay);
  const top = corners.reduce((best, place) => (place[1] < best[1] ? place : best));
  word(`${index + 1}`, [top[0] + 6 * scale, top[1] - 6 * scale], "name", scale, overlay);
  if (!isChosen || state !== "open") return;
  corners.forEach(([u, v], number) => {
    element("circle", {
      class: `corner${number === corner ? " chosen" : ""}`, cx: u, cy: v, r: 6 * scale, "data-break": index, "data-corner": number,
    }, overlay);
  });
}

// Returns the position of a time on the time line, from 0 to 1.
function along(shots, time) {
  const after = shots.findIndex((shot) => shot.time_s >= time);
  if (after <= 0) return after === 0 ? 0 : 1;
  const [a, b] = [shots[after - 1].time_s, shots[after].time_s];
  return (after - 1 + (time - a) / (b - a)) / (shots.length - 1);
}

export function drawStrip(strip, { shots, index, breaks, chosen }) {
  strip.replaceChildren();
  const { width, height } = strip.getBoundingClientRect();
  const last = Math.max(1, shots.length - 1);
  for (let from = 0; from < shots.length;) {
    const { phase } = shots[from];
    const next = shots.findIndex((shot, place) => place > from && shot.phase !== phase);
    const until = next < 0 ? shots.length - 1 : next;
    const [x, wide] = [from / last * width, (until - from) / last * width];
    element("rect", { class: `phase ${phase}`, x, y: 0, width: wide, height: 15 }, strip);
    if (wide > 30) word(phase, [x + 4, 11.5], "word", 0.74, strip);
    from = next < 0 ? shots.length : next;
  }
  const each = Math.min(10, (height - 20) / Math.max(1, breaks.length));
  breaks.forEach((one, place) => {
    if (one.shapes.length === 0) return;
    const x = along(shots, one.shapes[0].from_s) * width;
    const end = one.closes_s === null ? width : along(shots, one.closes_s) * width;
    const y = 19 + place * each;
    const kind = place === chosen ? "bar chosen" : "bar";
    element("rect", { class: kind, x, y, width: Math.max(2, end - x), height: Math.max(1, each - 2) }, strip);
    for (const shape of one.shapes.slice(1)) {
      const at = along(shots, shape.from_s) * width;
      element("line", { class: "tick", x1: at, x2: at, y1: y, y2: y + Math.max(1, each - 2) }, strip);
    }
  });
  const at = index / last * width;
  element("line", { class: "cursor", x1: at, x2: at, y1: 0, y2: height }, strip);
}
