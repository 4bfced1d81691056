// Draws the list of breaks and the selected break, beside the picture.

import { areaPx, cornersAt, inWords, isOpen, seconds, shapeIndex } from "./breaks.js";

const at = (id) => document.getElementById(id);

function button(words, act) {
  const made = document.createElement("button");
  made.type = "button";
  made.textContent = words;
  made.addEventListener("click", act);
  return made;
}

export function drawList({ breaks, chosen, onChoose }) {
  at("list").replaceChildren(...breaks.map((one, number) => {
    const item = document.createElement("li");
    const made = button(`${number + 1}: ${inWords(one)}`, () => onChoose(number));
    made.setAttribute("aria-pressed", number === chosen);
    item.append(made);
    return item;
  }));
}

function shapeLine(shape, { isShown, isOnly, onGo, onRemove }) {
  const [item, words, buttons] = ["li", "span", "span"].map((name) => document.createElement(name));
  item.classList.toggle("shown", isShown);
  words.textContent = `${seconds(shape.from_s)}: ${shape.corners_px.length} corners, ${areaPx(shape.corners_px).toFixed(0)} px²`;
  const gone = button("✕", onRemove);
  gone.title = "Remove this shape";
  gone.setAttribute("aria-label", `Remove the shape from ${seconds(shape.from_s)}`);
  gone.disabled = isOnly;
  buttons.append(button("Go to", onGo), " ", gone);
  item.append(words, buttons);
  return item;
}

// Draws the selected break, if there is one, with the actions that are possible at this time.
export function drawSelected({ one, number, corner, time, wetFrom, onGo, onRemove }) {
  at("selected").hidden = !one;
  at("unselected").hidden = Boolean(one);
  at("which").textContent = one ? `Break ${number + 1}: ${inWords(one)}` : "The selected break";
  for (const id of ["begins", "closes", "stays", "shape", "insert", "cut"]) at(id).disabled = !one;
  if (!one) return;
  const shown = shapeIndex(one, time);
  at("shapes").replaceChildren(...one.shapes.map((shape, index) => shapeLine(shape, {
    isShown: index === shown, isOnly: one.shapes.length === 1, onGo: () => onGo(shape.from_s), onRemove: () => onRemove(index),
  })));
  const canShape = isOpen(one, time);
  at("begins").disabled = time < wetFrom || (one.closes_s !== null && time >= one.closes_s);
  at("closes").disabled = time <= one.shapes[0].from_s;
  at("stays").disabled = one.closes_s === null;
  at("shape").disabled = !canShape || one.shapes[shown]?.from_s === time;
  at("insert").disabled = !canShape || corner < 0;
  at("cut").disabled = !canShape || corner < 0 || cornersAt(one, time).length <= 3;
}
