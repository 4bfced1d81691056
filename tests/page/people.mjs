// People who use the operator's page with a browser, and the checks of every page that they open.
//
// The script that uses it is called with ADDRESS PICTURES MODULES and writes a line for each step.

import { createRequire } from "node:module";
import { readFileSync, mkdirSync } from "node:fs";

export const [base, pictures, modules] = process.argv.slice(2);
const require = createRequire(`${modules}/`);
const { chromium } = require("playwright-core");
const axe = readFileSync(require.resolve("axe-core/axe.min.js"), "utf8");
export const password = "correct horse";
mkdirSync(pictures, { recursive: true });

export const step = (words) => console.log(words);
export const fail = (words) => { throw new Error(words); };
export const browser = await chromium.launch({ executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium", args: ["--no-sandbox", "--disable-dev-shm-usage"] });
export const wrong = [];

export async function person(options = {}) {
  const context = await browser.newContext({ viewport: { width: 1920, height: 1080 }, locale: "en-GB", ...options });
  const page = await context.newPage();
  page.setDefaultTimeout(90_000);
  page.on("pageerror", (error) => wrong.push(`script: ${error.message}`));
  page.on("console", (line) => { if (line.type() === "error" && /Content Security|Refused/.test(line.text())) wrong.push(line.text()); });
  return page;
}

export async function logIn(page, name) {
  await page.goto(`${base}/login?next=/`);
  await page.fill("input[name=name]", name);
  await page.fill("input[name=password]", password);
  await page.keyboard.press("Enter");
  await page.waitForSelector("#logout");
}

export const state = (page) => page.getAttribute("#state", "data-state");
export const reaches = (page, wanted) => page.waitForFunction((wanted) => document.querySelector("#state").dataset.state === wanted, wanted);
export const asked = (page, name) => page.click(`.actions button[data-request="${name}"]:enabled`);

/** Presses Start, and then confirms that the guard is closed and no person is inside. */
export async function starts(page) {
  await page.click("#start-first:enabled");
  await page.click("#start-second button[type=submit]:enabled");
}

export async function judged(page, name) {
  await page.evaluate(axe);
  const { violations } = await page.evaluate(() => window.axe.run(document, { iframes: false, resultTypes: ["violations"] }));
  for (const { id, nodes } of violations) wrong.push(`${name}: ${id} at ${nodes.slice(0, 3).map((node) => node.target.join(" ")).join("; ")}`);
  await page.screenshot({ path: `${pictures}/${name}.png` });
}

export async function wide(page, name) {
  const over = await page.evaluate(() => document.documentElement.scrollWidth - document.documentElement.clientWidth);
  if (over > 1) wrong.push(`${name}: the page is ${over} px wider than the screen`);
  const small = await page.evaluate(() => [...document.querySelectorAll("button, nav a, input:not([type=hidden]), select")]
    .filter((element) => element.checkVisibility()).map((element) => [element.outerHTML.slice(0, 80), element.getBoundingClientRect()])
    .filter(([, box]) => box.height < 43.5).map(([words]) => words).filter((words) => !words.includes("checkbox") && !words.includes("radio")));
  for (const words of small) wrong.push(`${name}: too small for a glove: ${words}`);
}
