// Reloads the content at an interval without reloading the whole page, so that the scroll position is kept. The request is marked
// as automatic, so that it does not extend the session.
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
