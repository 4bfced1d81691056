// Drawing on the taught picture: the drawing becomes a proposed recipe text, shown with its differences for approval.

import { send, tell, word } from "./PAGE_JS";
import { begin, now } from "./SHEET_JS";

const id = (name) => document.getElementById(name);
const recipe = document.querySelector("[data-recipe]").dataset.recipe;

id("propose").addEventListener("click", async () => {
  id("proposal").hidden = true;
  const result = await send(`${recipe}/proposal`, now());
  tell(id("told"), result.ok ? { ok: true, message: result.told.is_changed ? "" : word("draw.same") } : result);
  if (!result.ok || !result.told.is_changed) return;
  const parsed = new DOMParser().parseFromString(result.told.difference, "text/html");
  id("difference").replaceChildren(...parsed.body.childNodes);
  id("proposal").querySelector("textarea").value = result.told.text;
  id("proposal").querySelector("input[name=before]").value = result.told.before;
  id("proposal").hidden = false;
  id("proposal").querySelector("input[name=why]").focus();
});

try {
  const response = await fetch(`${recipe}/drawing.json`, { cache: "no-store" });
  const found = await response.json();
  if (!response.ok) throw new Error(found.message);
  // If there is no picture, the response contains the reason.
  const picture = await fetch(`${recipe}/picture.png`, { method: "GET", cache: "no-store" });
  if (!picture.ok) throw new Error((await picture.json()).message);
  await begin(found, () => {
    // The drawing now differs from the proposed text.
    id("proposal").hidden = true;
    tell(id("told"), { ok: true, message: word("draw.changed") });
  });
  id("propose").disabled = false;
} catch (error) {
  tell(id("told"), { ok: false, message: error.message });
}
