// Requests to the program, which stores the drafts.

export async function ask(path, options) {
  const answer = await fetch(path, options);
  const found = await answer.json().catch(() => null);
  if (!answer.ok || !found) throw new Error((found?.problems ?? ["the program could not process the request"]).join("\n"));
  return found;
}

export const posted = (body) => ({ method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(body) });

// Stores the drawing as a draft. While a draft is being sent, only the newest one is kept for the next request.
export class Drafts {
  constructor(tellProblem) {
    Object.assign(this, { tellProblem, sending: null, waiting: null });
  }

  keep(said) {
    this.waiting = JSON.stringify(said);
    this.sending ??= this.send();
  }

  async send() {
    while (this.waiting !== null) {
      const body = this.waiting;
      this.waiting = null;
      await ask("draft", { ...posted(null), body }).catch((error) => this.tellProblem(error.message));
    }
    this.sending = null;
  }

  async areKept() {
    await this.sending;
  }
}
