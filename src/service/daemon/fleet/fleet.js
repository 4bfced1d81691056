// Reloads the page's content at an interval, without a new page, so the reader's scroll position stays. The request states that no
// person made it, so it does not keep a session alive.
const every_ms = 1000 * Number(document.querySelector("meta[name=again]").content);

async function again() {
  try {
    const answer = await fetch(location.href, { headers: { "x-by-itself": "1" } });
    if (answer.ok && !answer.redirected) {
      const page = new DOMParser().parseFromString(await answer.text(), "text/html");
      document.querySelector("#main").replaceChildren(...page.querySelector("#main").childNodes);
    } else {
      location.reload();
    }
    document.body.classList.remove("is-stale");
  } catch {
    document.body.classList.add("is-stale");
  }
  setTimeout(again, every_ms);
}

setTimeout(again, every_ms);
