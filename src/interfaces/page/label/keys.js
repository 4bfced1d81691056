// Keyboard input: a table contains the action of each key; a focused control keeps its own keys.

const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

// `table` contains the action of each key; `step(pictures)` moves in time, `move(du, dv)` moves the selection, `undo` reverts a change.
function actionOf(event, { table, step, move, undo }) {
  const arrow = ARROWS[event.key];
  const times = event.shiftKey ? 10 : 1;
  if (event.ctrlKey && event.key.toLowerCase() === "z") return undo;
  if (arrow && event.ctrlKey) return () => move(arrow[0] * times, arrow[1] * times);
  if (arrow && arrow[0] !== 0) return () => step(arrow[0] * times);
  if (event.ctrlKey || event.altKey || event.metaKey) return null;
  return table[event.key] ?? table[event.key.toLowerCase()] ?? null;
}

export function onKeys(actions) {
  document.addEventListener("keydown", (event) => {
    const { target } = event;
    const writes = target.tagName === "SELECT" || (target.tagName === "INPUT" && target.type === "text");
    if (writes && ["Enter", "Escape"].includes(event.key)) target.blur();
    const works = [" ", "Enter"].includes(event.key) && (["BUTTON", "SUMMARY"].includes(target.tagName) || target.type === "checkbox");
    const act = writes || works ? null : actionOf(event, actions);
    if (!act) return;
    event.preventDefault();
    act();
  });
  document.addEventListener("keyup", (event) => actions.released[event.key.toLowerCase()]?.());
  // After a click, the focus is removed, so that the keys control the clip again.
  document.addEventListener("click", (event) => {
    if (event.detail > 0 && event.target.closest("button, input[type=checkbox], input[type=range]")) document.activeElement?.blur();
  });
}
