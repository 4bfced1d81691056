// The operator's page with the keyboard alone: an operator logs in, starts, holds with a reason and continues, an inspector accepts and signs.
// Every element that the Tab key reaches must show that it has the focus.
//
// node keyboard.mjs ADDRESS PICTURES MODULES

import { base, browser, fail, judged, person, reaches, state, step, wrong } from "./people.mjs";

const MAX_TAB_STOPS = 150; // more than the number of elements on a page that the Tab key reaches

/** Returns the element with the focus, and whether the focus is visible: an outline, or the fill of a drawn corner. */
const focused = (page) => page.evaluate(() => {
  const element = document.activeElement;
  if (!element || element === document.body || element.tagName === "IFRAME") return null;
  const { outlineStyle, outlineWidth } = getComputedStyle(element);
  return { words: element.outerHTML.slice(0, 90), isSeen: outlineStyle !== "none" && Number.parseFloat(outlineWidth) >= 2 };
});

/** Presses a key until this element has the focus. */
async function to(page, selector, key = "Tab") {
  for (let count = 0; count < MAX_TAB_STOPS; count += 1) {
    await page.keyboard.press(key);
    const now = await focused(page);
    if (now && !now.isSeen) wrong.push(`the focus is not seen at ${now.words}`);
    if (await page.evaluate((selector) => document.activeElement.matches(selector), selector)) return;
  }
  fail(`the keyboard does not come to ${selector}`);
}

async function logsIn(page, name) {
  await page.goto(`${base}/login?next=/`);
  await to(page, "input[name=name]");
  await page.keyboard.type(name);
  await to(page, "input[name=password]");
  await page.keyboard.type("correct horse");
  await page.keyboard.press("Enter");
  await page.waitForSelector("#logout");
}

async function presses(page, selector, key = "Enter") {
  await page.waitForSelector(selector);
  await to(page, selector);
  await page.keyboard.press(key);
}

const operator = await person();
await logsIn(operator, "operator");
await reaches(operator, "stopped");
await presses(operator, "button[data-request=reset]:enabled");
await reaches(operator, "idle");
await to(operator, "#why-held");
await operator.keyboard.type("a hair on the lens");
await to(operator, "input[name=serial]");
await operator.keyboard.type("SN-0020");
await presses(operator, "#start-first:enabled", "Space");
await operator.waitForSelector("#start-second button[type=submit]:enabled");
// A scanned code with a space presses no button now.
await to(operator, "#start-second button[type=submit]:enabled");
for (const code of ["SN 17", " SN17", "  17", "17 "]) {
  await operator.keyboard.type(code);
  await operator.waitForSelector("#start-second", { state: "hidden" });
  await operator.waitForTimeout(400);
  if ((await state(operator)) !== "idle") fail(`the scanned code "${code}" starts a cycle`);
  await presses(operator, "#start-first:enabled", "Space");
  await operator.waitForSelector("#start-second button[type=submit]:enabled");
  await to(operator, "#start-second button[type=submit]:enabled");
}
await operator.keyboard.type("17");
await operator.waitForSelector("#start-second", { state: "hidden" });
await presses(operator, "#start-first:enabled", "Space");
await operator.waitForSelector("#start-second button[type=submit]:enabled");
await presses(operator, "#start-second button[type=submit]:enabled", "Space");
step("started");

await reaches(operator, "held");
const inspector = await person();
await logsIn(inspector, "inspector");
await presses(inspector, "#review button:enabled");
step("accepted");

await operator.waitForFunction(() => /\d/.test(document.querySelector("#film").textContent));
await presses(operator, ".actions button[data-request=hold]:enabled", "Space");
await reaches(operator, "held");
await judged(operator, "keyboard-held");
await presses(operator, ".actions button[data-request=unhold]:enabled");
step("held and continued");

for (;;) {
  await operator.waitForFunction(() => document.querySelector("#state").dataset.state === "complete" || document.querySelector("#review:not([hidden])"));
  if ((await state(operator)) === "complete") break;
  await presses(inspector, "#review button:enabled");
  await operator.waitForFunction(() => document.querySelector("#state").dataset.state !== "held");
}
step("completed");

await inspector.goto(`${base}/cycle/1`);
await presses(inspector, "#sign summary");
await to(inspector, "select[name=meaning]");
// The cycle was rejected, so the inspector does not release the part: the second meaning.
for (const key of ["ArrowDown", "ArrowDown"]) await inspector.keyboard.press(key);
if ((await inspector.inputValue("select[name=meaning]")) !== "inspected_and_not_released") fail("the keyboard chooses another meaning");
await to(inspector, "#sign input[name=password]");
await inspector.keyboard.type("correct horse");
await presses(inspector, "#sign button[type=submit]");
await inspector.waitForFunction(() => /inspector/.test(document.querySelector("main ul")?.textContent ?? ""));
await judged(inspector, "keyboard-signed");
step("signed");

await browser.close();
if (wrong.length > 0) fail([...new Set(wrong)].join("\n"));
step("whole");
process.exit(0);
