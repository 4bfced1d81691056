// The operator's page as people use it: logs in, runs a part, holds, accepts a review, signs, opens every page in both languages,
// light and dark and at three widths, and checks each page with axe-core. Pictures of every page are kept in a folder.
//
// node browser.mjs ADDRESS PICTURES MODULES: writes a line for each step; at "restart" and "hang" it waits for a line on its input.

import { createInterface } from "node:readline";
import { asked, base, browser, fail, judged, logIn, password, person, pictures, reaches, starts, state, step, wide, wrong } from "./people.mjs";

const lines = createInterface({ input: process.stdin })[Symbol.asyncIterator]();

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
// The Enter of a barcode scanner moves to the next field; the first press shows the question; a double click is one press.
await operator.focus("input[name=serial]");
for (const key of ["Enter", "Enter"]) await operator.keyboard.press(key);
if (!(await operator.evaluate(() => document.activeElement.matches("input[name=order]")))) fail("Enter does not lead to the next field");
await operator.dblclick("#start-first");
await operator.waitForTimeout(300);
if ((await state(operator)) !== "idle" || !(await operator.locator("#start-second").isVisible())) fail("a start does not ask first");
if (!(await operator.isDisabled("#start-second button[type=submit]"))) fail("a double click is two presses");
await judged(operator, "run-start-asked");
await operator.click("#start-cancel");
await starts(operator);
step("started with a serial number");

await reaches(operator, "held");
const review = operator.locator("#review");
await review.waitFor();
await operator.waitForFunction(() => [...document.querySelectorAll("#review img")].every((image) => image.complete && image.naturalWidth > 0));
if (!/grid r/.test(await review.innerText())) fail(`the review does not say what it is about: ${await review.innerText()}`);
if (!(await operator.locator("#panel").innerText()).includes("SN-0017")) fail("the part is not shown");
await judged(operator, "run-review");
const german = await person({ locale: "de-DE" });
await logIn(german, "inspector");
await german.locator("#review").waitFor();
const said = await german.locator("#review").innerText();
if ((said.match(/Abhilfe:/g) ?? []).length !== 1 || !/Prüfen|prüfen/.test(said) || !/grid r/.test(said)) fail(`the review is not told in German: ${said}`);
await judged(german, "run-review-german");
step("read the review in German");
if ((await review.locator("button").count()) !== 0 || !/Call an inspector/.test(await operator.innerText("#state"))) fail("an operator is offered to accept a deviation");
await german.locator("#review button:enabled").click();
step("accepted a review by its numbers");

await operator.waitForFunction(() => /\d/.test(document.querySelector("#film").textContent));
await operator.waitForFunction(() => !document.querySelector("#frame").hidden);
await operator.fill("#why-held", "water on the lens");
await asked(operator, "hold");
await judged(operator, "run-film");
await reaches(operator, "held");
await operator.waitForFunction(() => /operator: water on the lens/.test(document.querySelector("#state").innerText));
if ((await operator.inputValue("#why-held")) !== "") fail("the reason of this hold would be sent with the next one");
await judged(operator, "run-held");
step("watched and held with a reason");
await asked(operator, "unhold");
await operator.waitForFunction(() => document.querySelector("#state").dataset.state === "held" && document.querySelector("#review:not([hidden])") || document.querySelector("#state").dataset.state === "complete");
while ((await state(operator)) !== "complete") {
  await german.locator("#review button:enabled").click();
  await operator.waitForFunction(() => ["held", "complete"].includes(document.querySelector("#state").dataset.state) && document.querySelector("#state").dataset.state !== "execute");
  await operator.waitForTimeout(300);
}
await judged(operator, "run-complete");
if (/now|jetzt/i.test(await operator.innerText("#frame-name"))) fail("a film that is over is called the film now");
await german.context().close();
step("continued and completed");

// After the session has ended, the page shows no data of the part, and reports the end. A wall display keeps its session.
const [watcher, display] = [await person(), await person()];
await logIn(display, "display");
await logIn(watcher, "viewer");
await watcher.waitForFunction(() => document.querySelector("#panel").innerText.includes("SN-0017") && document.querySelector("#grids table"));
for (let others = 0; others < 3; others += 1) {
  const other = await person();
  await logIn(other, "viewer");
  await other.context().close();
}
await watcher.waitForSelector(".banner:has-text('Your session has ended')", { timeout: 10_000 });
await watcher.waitForSelector("#state[data-state=complete]");
const left = await watcher.innerText("main");
if (left.includes("SN-0017") || (await watcher.$("#grids table")) || (await watcher.$("#frame"))) fail(`a page without a session shows ${left}`);
if (!(await display.innerText("#panel")).includes("SN-0017")) fail("the wall display does not show the part");
await judged(watcher, "run-session-ended");
await judged(display, "run-display");
await watcher.context().close();
await display.context().close();
step("a session ended, and the page said so");

// Without an answer, Stop and Abort report this within about a second, on every page.
const reader = await person();
await logIn(reader, "operator");
await reader.goto(`${base}/history`);
const halts = async (page, name, expected) => {
  const since = Date.now();
  await page.click(`#${name}`);
  await page.waitForFunction((expected) => new RegExp(expected).test(document.querySelector("#stop-told").innerText), expected, { timeout: 1_500 });
  return Date.now() - since;
};
// A response that is not from the cell is not reported as received.
for (const status of [200, 403, 409, 502]) {
  await reader.route("**/request/stop", (route) => route.fulfill({ status, contentType: "text/html", body: "a proxy" }));
  await halts(reader, "stop", "no answer.*emergency stop");
  await reader.unroute("**/request/stop");
}
step("hang");
await lines.next();
for (const page of [operator, reader]) await halts(page, "stop", "emergency stop");
await operator.waitForFunction(() => /emergency stop/.test(document.querySelector("#stale").innerText));
await judged(operator, "run-hung");
await judged(reader, "history-hung");
step("wake");
await lines.next();
await operator.waitForFunction(() => document.querySelector("#stale").hidden);
step("a service that hangs does not answer a stop, and the page says so");

step("restart");
await operator.waitForFunction(() => !document.querySelector("#stale").hidden);
for (const page of [operator, reader]) await halts(page, "abort", "emergency stop");
await judged(operator, "run-stale");
await reader.screenshot({ path: `${pictures}/history-dead.png` });
await reader.context().close();
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
await inspector.waitForSelector("#sign form .told.bad");
await inspector.fill("#sign input[name=password]", password);
await judged(inspector, "cycle-to-sign");
// The cycle was rejected: one person alone cannot release the part.
await inspector.click("#sign button[type=submit]");
await inspector.waitForFunction(() => /deviation accepted/.test(document.querySelector("#sign form .told.bad")?.textContent ?? ""));
if (await inspector.$("main li:has-text('inspected and released')")) fail("a rejected part was released by one person");
await inspector.selectOption("select[name=meaning]", "inspected_and_not_released");
await inspector.fill("#sign input[name=password]", password);
await inspector.click("#sign button[type=submit]");
await inspector.waitForSelector("main li:has-text('inspected and not released')");
const record = inspector.frameLocator("iframe.record");
await record.locator("text=SN-0017").first().waitFor();
await judged(inspector, "cycle-signed");
step("signed");

const history = async (part) => { await inspector.goto(`${base}/history?part=${part}`); return inspector.locator("main").innerText(); };
if (!(await history("SN-0017")).includes("SN-0017")) fail("the part is not in the history");
if (/SN-0017|\/cycle\//.test(await history("SN-9999"))) fail("the history lists what was not searched");
if (!(await inspector.locator("main").innerText()).includes("No cycle was found.")) fail("the history does not say that nothing was found");
step("found in the history");

await asked(operator, "reset");
await reaches(operator, "idle");
const ready = await operator.evaluate(() => ["#panel", "#cycle", "#pass"].map((name) => document.querySelector(name).innerText).join("|"));
if (ready !== "|–|–" || (await operator.$("#grids table td")) || !(await operator.locator("#frame").isHidden())) fail(`a cell that was reset shows ${ready}`);
await judged(operator, "run-ready-again");
await operator.fill("input[name=serial]", "SN-0018");
await starts(operator);
await operator.waitForFunction(() => document.querySelector("#state").dataset.state === "execute");
const stranger = await person();
await stranger.goto(`${base}/`);
await stranger.waitForSelector("#state[data-state]:not([data-state=''])");
await halts(stranger, "abort", "received by the cell");
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
await engineer.fill("textarea", `${recipe}\n# changed again\n`);
await engineer.evaluate(() => { document.querySelector("form .told").textContent = ""; });
await engineer.click("button.primary");
await engineer.waitForFunction(() => document.querySelector("form .told").textContent === "Saved.");
await engineer.evaluate(() => { document.querySelector("input[name=before]").value = "0".repeat(64); });
await engineer.click("button.primary");
await engineer.waitForFunction(() => /This recipe was changed after this page was opened/.test(document.querySelector("form .told").textContent));
step("changed a recipe, and not over another person's change");

await engineer.goto(`${base}/setup/recipe/recipe.toml/draw`);
await engineer.waitForSelector("#propose:enabled");
await engineer.fill("#rows", "2");
await engineer.focus("[data-kind=region][data-corner='0']");
for (const key of ["Shift+ArrowRight", "ArrowDown"]) await engineer.keyboard.press(key);
await engineer.click("#add");
await engineer.click("#propose");
await engineer.waitForSelector("#proposal:not([hidden]) ins");
const proposed = await engineer.innerText("#difference");
if (!/\+ rows = 2/.test(proposed) || !/masked_px/.test(proposed) || !/\+ .*corners_px/.test(proposed)) fail(`the proposal is another one: ${proposed}`);
await judged(engineer, "draw-proposal");
// A region with exchanged corners is not valid, and is not proposed.
const drag = async (corner, at) => {
  const box = await engineer.locator(`[data-kind=region][data-corner='${corner}']`).boundingBox();
  await engineer.mouse.move(box.x + box.width / 2, box.y + box.height / 2);
  await engineer.mouse.down();
  await engineer.mouse.move(at.x + at.width / 2, at.y + at.height / 2);
  await engineer.mouse.up();
};
await engineer.evaluate(() => window.scrollTo(0, 0));
const [first, second] = [await engineer.locator("[data-kind=region][data-corner='0']").boundingBox(), await engineer.locator("[data-kind=region][data-corner='1']").boundingBox()];
await drag(0, { ...second, x: second.x + 30 });
await drag(1, first);
await engineer.click("#propose");
await engineer.waitForSelector("#told.bad");
if (!(await engineer.locator("#proposal").isHidden())) fail("what is no region is proposed");
await engineer.reload();
await engineer.waitForSelector("#propose:enabled");
await engineer.fill("#columns", "4");
await engineer.click("#propose");
await engineer.fill("#proposal input[name=why]", "wider grids");
await engineer.click("#proposal button.primary");
await engineer.waitForSelector("details summary:has-text('wider grids')");
step("drew a recipe's region and approved it");

await engineer.goto(`${base}/setup/cameras`);
for (const name of ["scanner", "flange"]) {
  await engineer.click(`form[data-post="/setup/cameras/${name}"] button`);
  await engineer.waitForFunction((name) => document.querySelector(`img[src^="/setup/cameras/${name}"]`)?.naturalWidth > 0, name);
}
await judged(engineer, "cameras-taken");
await engineer.goto(`${base}/setup/doctor`);
if (!/OpenCV/.test(await engineer.innerText("main"))) fail("the doctor found no program");
step("looked at the cameras and the doctor");

const pages = { "/": "run", "/history": "history", "/trends": "trends", "/alarms": "alarms", "/setup": "setup", "/setup/cameras": "cameras", "/setup/doctor": "doctor", "/setup/recipe/recipe.toml/draw": "draw", "/audit": "audit", "/cycle/1": "cycle", "/login": "login" };
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
await administrator.goto(`${base}/audit`);
const trail = await administrator.innerText("main");
for (const words of ["reset", "water on the lens", "accept", "abort", "log in"]) if (!trail.includes(words)) fail(`the audit trail has no ${words}: ${trail}`);
await judged(administrator, "audit");
step("looked at every page in both languages, light and dark, at three widths");

await browser.close();
if (wrong.length > 0) fail(wrong.join("\n"));
step("whole");
process.exit(0);
