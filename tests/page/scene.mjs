// Scan and path of a cycle that is complete, in three dimensions: drawn, rotated by keys, on Run and on the cycle's page, in light and
// dark, on a desktop and a phone; and the same data as text if the browser cannot draw them.
//
// node scene.mjs ADDRESS PICTURES MODULES

import { base, browser, fail, judged, logIn, person, reaches, step, wide, wrong } from "./people.mjs";

const operator = await person();
await logIn(operator, "viewer");
await reaches(operator, "complete");
const drawn = (page) => page.waitForFunction(() => Number(document.querySelector("details.scene > canvas")?.dataset.drawn) > 10_000);
await operator.click("details.scene summary");
await drawn(operator);
const legend = await operator.innerText(".scene .legend");
const executed = /(\d+) \/ (\d+)/.exec(legend);
if (!executed || executed[1] !== executed[2] || Number(executed[1]) < 10) fail(`what was executed is not told: ${legend}`);
await operator.focus("details.scene > canvas");
for (const key of ["ArrowLeft", "+", "Shift+ArrowUp"]) await operator.keyboard.press(key);
await judged(operator, "scene-run");
for (const [scheme, width, height] of [["light", 1920, 1080], ["dark", 390, 844]]) {
  const viewer = await person({ colorScheme: scheme, viewport: { width, height } });
  await logIn(viewer, "viewer");
  await viewer.goto(`${base}/cycle/1`);
  await viewer.click("details.scene summary");
  await drawn(viewer);
  for (const view of ["reset", "top", "side"]) {
    await viewer.click(`[data-view=${view}]`);
    await viewer.locator("details.scene").scrollIntoViewIfNeeded();
    await judged(viewer, `scene-${view}-${scheme}-${width}`);
    await wide(viewer, `scene-${view}-${scheme}-${width}`);
  }
  await viewer.context().close();
}
const without = await person();
await without.addInitScript(() => { HTMLCanvasElement.prototype.getContext = ((own) => function (kind, ...rest) { return kind === "webgl2" ? null : own.call(this, kind, ...rest); })(HTMLCanvasElement.prototype.getContext); });
await logIn(without, "viewer");
await without.goto(`${base}/cycle/1`);
await without.click("details.scene summary");
await without.waitForFunction(() => /WebGL2/.test(document.querySelector(".scene .told").textContent) && /\d+ \/ \d+/.test(document.querySelector(".scene .legend").textContent));
await judged(without, "scene-without");
step("saw scan and path in three dimensions");

await browser.close();
if (wrong.length > 0) fail([...new Set(wrong)].join("\n"));
step("whole");
process.exit(0);
