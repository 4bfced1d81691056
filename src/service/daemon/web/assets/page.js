// The functions of every page: stop and abort, logging out, times in local time with offset, sending a change.

export const meta = (name) => document.querySelector(`meta[name="${name}"]`)?.content ?? "";
const words = JSON.parse(meta("words") || "{}");

/** Returns the page's text for a key. */
export const word = (key) => words[`js.${key}`] ?? key;

/** Returns the text of a button. */
export const action = (key) => words[`action.${key}`] ?? key;

/** Sends a change and returns its result as { ok, status, message }. It never throws. */
export async function send(path, body = {}) {
  try {
    const headers = { "content-type": "application/json", "x-csrf-token": meta("csrf") };
    const response = await fetch(path, { method: "POST", headers, body: JSON.stringify(body), cache: "no-store" });
    const text = await response.text();
    let told = {};
    try { told = JSON.parse(text); } catch { told = { message: text }; }
    const message = response.status === 401 && path !== "/login" ? word("log_in") : told.message;
    return { ok: response.ok, status: response.status, told, message: message || (response.ok ? word("done") : `${response.status}`) };
  } catch {
    return { ok: false, status: 0, message: word("failed") };
  }
}

/** Returns a time as local date and time, with the offset of this computer from UTC. */
export function localTime(ms) {
  const at = new Date(ms);
  const pad = (n) => String(Math.abs(n)).padStart(2, "0");
  const off = -at.getTimezoneOffset();
  const offset = `${off < 0 ? "-" : "+"}${pad(Math.trunc(off / 60))}:${pad(off % 60)}`;
  const day = `${at.getFullYear()}-${pad(at.getMonth() + 1)}-${pad(at.getDate())}`;
  return `${day} ${pad(at.getHours())}:${pad(at.getMinutes())}:${pad(at.getSeconds())} ${offset}`;
}

/** Shows the result of a change. */
export function tell(place, { ok, message }) {
  if (!place) return;
  place.textContent = message;
  place.classList.toggle("bad", !ok);
}

const ANSWER_MS = 1000; // time after which a stop without an answer is reported

/** Requests a stop or an abort. The result is shown beside the buttons with its time, also if there is no answer. */
async function halt(name) {
  const place = document.getElementById("stop-told");
  const asked = `${action(name)} ${localTime(Date.now()).slice(11, 19)}:`;
  const say = (ok, message) => tell(place, { ok, message: `${asked} ${message}` });
  say(true, "…");
  // The request is not cancelled: a busy service may still execute it.
  const late = setTimeout(() => say(false, word("stop.no_answer")), ANSWER_MS);
  const { ok, status, told, message } = await send(`/request/${name}`);
  clearTimeout(late);
  // Only an answer with the state of the cell proves that the request was received.
  const isOfCell = typeof told?.state === "string";
  if (ok && isOfCell) say(true, word("stop.taken"));
  else if (status === 409 && isOfCell) say(false, message);
  else say(false, `${word("stop.no_answer")} (${message})`);
}

for (const name of ["stop", "abort"]) document.getElementById(name)?.addEventListener("click", () => halt(name));
document.getElementById("logout")?.addEventListener("click", async () => {
  if ((await send("/logout")).ok) location.assign("/");
});
for (const time of document.querySelectorAll("time[data-ms]")) time.textContent = localTime(Number(time.dataset.ms));
