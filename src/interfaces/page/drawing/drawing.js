// The page of `panelprep teach`: draws the shapes of the recipe, and saves the changed shapes in the recipe.

import { begin, now } from "./sheet.js";

const at = (id) => document.getElementById(id);

function tell(words, isWrong) {
  at("told").textContent = words;
  at("told").classList.toggle("wrong", isWrong);
}

async function ask(path, options) {
  const answer = await fetch(path, options);
  const found = await answer.json();
  if (!answer.ok) throw new Error((found.problems ?? ["the program refused the request"]).join("\n"));
  return found;
}

at("save").addEventListener("click", async () => {
  try {
    const body = JSON.stringify(now());
    const found = await ask("save", { method: "POST", headers: { "content-type": "application/json" }, body });
    tell(`Saved in ${found.saved}.`, false);
  } catch (error) {
    tell(`Not saved. ${error.message}`, true);
  }
});

at("done").addEventListener("click", async () => {
  try {
    await ask("done", { method: "POST" });
    tell("Closed. The program continues in the terminal.", false);
    for (const button of document.querySelectorAll("button")) button.disabled = true;
  } catch (error) {
    tell(error.message, true);
  }
});

try {
  const found = await ask("drawing.json");
  at("panel").textContent = found.panel;
  at("file").textContent = found.recipe;
  await begin(found.drawn, () => tell("Not saved yet.", false));
} catch (error) {
  tell(error.message, true);
}
