// The web page of the office server as people use it: a wrong password, every page, in light and dark and at three widths, each page
// checked with axe-core. Pictures of every page are kept in a folder.
//
// node fleet.mjs ADDRESS PICTURES MODULES: writes a line for each step.

import { base, browser, fail, judged, person, pictures, step, wide, wrong } from "./people.mjs";

const page = await person();
const told = () => page.locator("main").innerText();

await page.goto(`${base}/cycles`);
if (!page.url().endsWith("/login")) fail("a page without a session");
for (const password of ["a wrong password", "a long password"]) {
  await page.fill("input[name=name]", "office");
  await page.fill("input[name=password]", password);
  await page.keyboard.press("Enter");
  if (password.includes("wrong")) {
    await page.waitForSelector("[role=alert]");
    await judged(page, "fleet-login");
  }
}
await page.waitForSelector("nav a[aria-current]");
step("logged in after a wrong password");

for (let tries = 0; !/stopped|complete|idle/.test(await told()); tries += 1) {
  if (tries > 30) fail(`the cell's state is not shown: ${await told()}`);
  await page.waitForTimeout(1000);
  await page.goto(`${base}/`);
}
if (!/cell-1/.test(await told()) || !/cell-2/.test(await told())) fail(`not all cells: ${await told()}`);
await judged(page, "fleet-cells");
step("saw all cells");

await page.click("nav a[href='/cycles']");
await page.selectOption("select[name=cell]", "cell-1");
await page.fill("input[name=serial]", "sn-0017");
await page.click("main button[type=submit]");
if (!/SN-0017/.test(await told()) || /cell-2\t/.test(await told())) fail(`the search: ${await told()}`);
await judged(page, "fleet-cycles");
await page.click("tbody a");
await page.waitForFunction(() => [...document.images].length > 0);
await page.evaluate(() => document.querySelectorAll("img").forEach((image) => { image.loading = "eager"; }));
await page.waitForFunction(() => [...document.images].every((image) => image.complete && image.naturalWidth > 0));
if (!/signed by the cell/.test(await told())) fail("who signed is not shown");
await judged(page, "fleet-cycle");
step("opened a cycle with its pictures");

await page.click("nav a[href='/numbers']");
await page.selectOption("select[name=quantity]", "localization-residual");
await page.click("main button[type=submit]");
await page.waitForSelector("svg.chart");
await judged(page, "fleet-numbers");
await page.click("nav a[href='/verifications']");
await page.waitForSelector("svg.chart");
await judged(page, "fleet-verifications");
step("compared numbers and verifications over cells");

await page.click("nav a[href='/recipes']");
await page.selectOption("select[name=panel]", "simulated-panel");
await page.click("main button[type=submit]");
if (!/approved by Anna/.test(await told())) fail("what is offered is not shown");
await judged(page, "fleet-recipes");
await page.click("tbody a");
await page.waitForSelector("pre");
if (!/panel = /.test(await told())) fail("the recipe's text is not shown");
step("read a recipe");

for (const [what, options] of [["phone", { viewport: { width: 390, height: 844 } }], ["tablet", { viewport: { width: 820, height: 1180 } }], ["dark", { colorScheme: "dark" }]]) {
  const other = await person({ ...options, storageState: await page.context().storageState() });
  for (const path of ["", "cycles", "numbers", "verifications", "recipes"]) {
    await other.goto(`${base}/${path}`);
    await judged(other, `fleet-${path || "cells"}-${what}`);
    await wide(other, `fleet-${path || "cells"}-${what}`);
  }
}
step("looked on a phone, on a tablet and in the dark");

await page.click("button.plain");
await page.goto(`${base}/cells.json`);
if (!page.url().endsWith("/login")) fail("a session continues after logging out");
await browser.close();
if (wrong.length) fail(`${wrong.join("\n")}\n(pictures: ${pictures})`);
step("whole");
