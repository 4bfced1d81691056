// Loads the page's content again and again, so that it stays where it is and keeps the reader's place. It says that no person asks: it
// keeps no session alive.
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
