// The operator's page as people use it: logs in, runs a part, holds, accepts a review, signs, looks at every page in both languages,
// light and dark and at three widths, and holds each against the rules of axe-core. Pictures of every page stay in a folder.
//
// node browser.mjs ADDRESS PICTURES MODULES: writes a line for each step; at "restart" it waits for a line on its input.

import { createRequire } from "node:module";
import { readFileSync, mkdirSync } from "node:fs";
import { createInterface } from "node:readline";

const [base, pictures, modules] = process.argv.slice(2);
const require = createRequire(`${modules}/`);
const { chromium } = require("playwright-core");
const axe = readFileSync(require.resolve("axe-core/axe.min.js"), "utf8");
const password = "correct horse";
mkdirSync(pictures, { recursive: true });

const lines = createInterface({ input: process.stdin })[Symbol.asyncIterator]();
const step = (words) => console.log(words);
const fail = (words) => { throw new Error(words); };
const browser = await chromium.launch({ executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium", args: ["--no-sandbox", "--disable-dev-shm-usage"] });
const wrong = [];

async function person(options = {}) {
  const context = await browser.newContext({ viewport: { width: 1920, height: 1080 }, locale: "en-GB", ...options });
  const page = await context.newPage();
  page.setDefaultTimeout(90_000);
  page.on("pageerror", (error) => wrong.push(`script: ${error.message}`));
  page.on("console", (line) => { if (line.type() === "error" && /Content Security|Refused/.test(line.text())) wrong.push(line.text()); });
  return page;
}

async function logIn(page, name) {
  await page.goto(`${base}/login?next=/`);
  await page.fill("input[name=name]", name);
  await page.fill("input[name=password]", password);
  await page.keyboard.press("Enter");
  await page.waitForSelector("#logout");
}

const state = (page) => page.getAttribute("#state", "data-state");
const reaches = (page, wanted) => page.waitForFunction((wanted) => document.querySelector("#state").dataset.state === wanted, wanted);
const asked = (page, name) => page.click(`.actions button[data-request="${name}"]:enabled`);

async function judged(page, name) {
  await page.evaluate(axe);
  const { violations } = await page.evaluate(() => window.axe.run(document, { iframes: false, resultTypes: ["violations"] }));
  for (const { id, nodes } of violations) wrong.push(`${name}: ${id} at ${nodes.slice(0, 3).map((node) => node.target.join(" ")).join("; ")}`);
  await page.screenshot({ path: `${pictures}/${name}.png` });
}

async function wide(page, name) {
  const over = await page.evaluate(() => document.documentElement.scrollWidth - document.documentElement.clientWidth);
  if (over > 1) wrong.push(`${name}: the page is ${over} px wider than the screen`);
  const small = await page.evaluate(() => [...document.querySelectorAll("button, nav a, input:not([type=hidden]), select")]
    .filter((element) => element.checkVisibility()).map((element) => [element.outerHTML.slice(0, 80), element.getBoundingClientRect()])
    .filter(([, box]) => box.height < 43.5).map(([words]) => words).filter((words) => !words.includes("checkbox") && !words.includes("radio")));
  for (const words of small) wrong.push(`${name}: too small for a glove: ${words}`);
}

const operator = await person();
await operator.goto(`${base}/`);
await operator.waitForSelector("#state[data-state=stopped]");
await judged(operator, "run-logged-out");
await logIn(operator, "operator");
step("logged in");

await reaches(operator, "stopped");
await asked(operator, "reset");
await reaches(operator, "idle");
await operator.fill("input[name=serial]", "SN-0017");
await operator.fill("input[name=order]", "W-4");
await judged(operator, "run-idle");
await operator.click("form#start button[type=submit]");
step("started with a serial number");

await reaches(operator, "held");
const review = operator.locator("#review");
await review.waitFor();
await operator.waitForFunction(() => [...document.querySelectorAll("#review img")].every((image) => image.complete && image.naturalWidth > 0));
if (!/grid r/.test(await review.innerText())) fail(`the review does not say what it is about: ${await review.innerText()}`);
if (!(await operator.locator("#panel").innerText()).includes("SN-0017")) fail("the part is not shown");
await judged(operator, "run-review");
await review.locator("button").click();
step("accepted a review by its numbers");

await operator.waitForFunction(() => /\d/.test(document.querySelector("#film").textContent));
await operator.waitForFunction(() => !document.querySelector("#frame").hidden);
await operator.fill("#why-held", "water on the lens");
await asked(operator, "hold");
await judged(operator, "run-film");
await reaches(operator, "held");
await judged(operator, "run-held");
step("watched and held with a reason");
await asked(operator, "unhold");
await operator.waitForFunction(() => document.querySelector("#state").dataset.state === "held" && document.querySelector("#review:not([hidden])") || document.querySelector("#state").dataset.state === "complete");
while ((await state(operator)) !== "complete") {
  await operator.locator("#review button:enabled").click();
  await operator.waitForFunction(() => ["held", "complete"].includes(document.querySelector("#state").dataset.state) && document.querySelector("#state").dataset.state !== "execute");
  await operator.waitForTimeout(300);
}
await judged(operator, "run-complete");
step("went on and completed");

step("restart");
await operator.waitForFunction(() => !document.querySelector("#stale").hidden);
await operator.screenshot({ path: `${pictures}/run-stale.png` });
await lines.next();
await operator.waitForFunction(() => document.querySelector("#stale").hidden && document.querySelector("#state").dataset.state === "stopped");
step("came back after a restart");
await logIn(operator, "operator");

const inspector = await person();
await logIn(inspector, "inspector");
await inspector.goto(`${base}/cycle/1`);
await inspector.click("#sign summary");
await inspector.selectOption("select[name=meaning]", "inspected_and_released");
await inspector.fill("#sign input[name=password]", "wrong horse");
await inspector.click("#sign button[type=submit]");
await inspector.waitForSelector("#sign .told.bad");
await inspector.fill("#sign input[name=password]", password);
await judged(inspector, "cycle-to-sign");
await inspector.click("#sign button[type=submit]");
await inspector.waitForSelector("main li:has-text('inspected and released')");
const record = inspector.frameLocator("iframe.record");
await record.locator("text=SN-0017").first().waitFor();
await judged(inspector, "cycle-signed");
step("signed");

await inspector.goto(`${base}/history?serial=SN-0017`);
if (!(await inspector.locator("main").innerText()).includes("SN-0017")) fail("the part is not in the history");
step("found in the history");

await asked(operator, "reset");
await reaches(operator, "idle");
await operator.fill("input[name=serial]", "SN-0018");
await operator.click("form#start button[type=submit]");
await operator.waitForFunction(() => document.querySelector("#state").dataset.state === "execute");
const stranger = await person();
await stranger.goto(`${base}/`);
await stranger.waitForSelector("#state[data-state]:not([data-state=''])");
await stranger.click("#abort");
await reaches(stranger, "aborted");
await judged(stranger, "run-aborted");
step("aborted without logging in");

const engineer = await person();
await logIn(engineer, "engineer");
await engineer.goto(`${base}/setup/recipe/recipe.toml`);
const recipe = await engineer.inputValue("textarea");
await engineer.fill("textarea", recipe.replace("observation_s", "observaton_s"));
await engineer.fill("input[name=why]", "a test");
await engineer.click("button[data-post='/setup/check']");
await engineer.waitForSelector(".told.bad");
await judged(engineer, "recipe-wrong");
await engineer.fill("textarea", `${recipe}\n# changed on the page\n`);
await engineer.click("button.primary");
await engineer.waitForFunction(() => document.querySelector("form .told").textContent === "Saved.");
step("changed a recipe");

const pages = { "/": "run", "/history": "history", "/trends": "trends", "/alarms": "alarms", "/setup": "setup", "/audit": "audit", "/cycle/1": "cycle", "/login": "login" };
for (const [language, scheme, width, height] of [["en", "light", 1920, 1080], ["de", "dark", 1024, 768], ["de", "light", 390, 844], ["en", "dark", 390, 844]]) {
  const page = await person({ colorScheme: scheme, viewport: { width, height }, locale: language === "de" ? "de-DE" : "en-GB" });
  await logIn(page, "engineer");
  for (const [path, name] of Object.entries(pages)) {
    await page.goto(base + path);
    if (path === "/") await page.waitForSelector("#state[data-state]:not([data-state=''])");
    if ((await page.getAttribute("html", "lang")) !== language) wrong.push(`${name}: not in ${language}`);
    const shown = `${name}-${language}-${scheme}-${width}`;
    await judged(page, shown);
    await wide(page, shown);
  }
  await page.context().close();
}
const administrator = await person();
await logIn(administrator, "administrator");
await administrator.goto(`${base}/people`);
await judged(administrator, "people");
step("looked at every page in both languages, light and dark, at three widths");

await browser.close();
if (wrong.length > 0) fail(wrong.join("\n"));
step("whole");
process.exit(0);
