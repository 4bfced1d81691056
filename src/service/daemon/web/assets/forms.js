// Sends forms as JSON with the token of the session; the result is shown beside the button.

import { send, tell } from "./PAGE_JS";

for (const form of document.querySelectorAll("form[data-post]")) {
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    const path = event.submitter?.dataset.post ?? form.dataset.post;
    const body = {};
    for (const field of form.elements) {
      if (!field.name) continue;
      body[field.name] = field.type === "checkbox" ? field.checked : field.value === "true" && field.type === "hidden" ? true : field.value;
      // A recipe is sent with the hash of the text that the page shows.
      const sha256 = field.selectedOptions?.[0]?.dataset.sha256;
      if (sha256) body.sha256 = sha256;
    }
    const result = await send(path, body);
    tell(form.querySelector(".told"), result);
    for (const [name, value] of Object.entries(result.told?.fields ?? {})) {
      form.elements[name].value = value;
      // As if a person had changed the field: a question about the former value is withdrawn.
      form.elements[name].dispatchEvent(new Event("input", { bubbles: true }));
    }
    if (!result.ok || path !== form.dataset.post) return;
    form.dispatchEvent(new Event("sent"));
    if (form.dataset.then) location.assign(form.dataset.then);
  });
}
