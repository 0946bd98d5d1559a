// Orders of a page: each is sent to its server, and what that answers is shown in words.

const ANSWER_MS = 15000;

/** Show a sentence, as good news or as bad. */
export function say(sentence, good) {
  const node = document.getElementById("answer");
  node.textContent = sentence;
  node.dataset.good = String(good);
}

export class Orders {
  constructor(link) {
    Object.assign(this, { link, waiting: new Map(), number: 0 });
  }

  /** Send an order, and show the answer; return whether it was carried out. */
  async give(order) {
    const id = this.number++;
    const answered = new Promise((resolve) => {
      this.waiting.set(id, resolve);
      setTimeout(() => resolve({ ok: false, text: `the ${this.link.server} has not answered` }), ANSWER_MS);
    });
    const sent = this.link.send({ id, ...order });
    if (!sent) this.answered({ id, ok: false, text: `there is no connection to the ${this.link.server}` });
    const { ok, text } = await answered;
    this.waiting.delete(id);
    say(text, ok);
    return ok;
  }

  /** Take the server's answer to an order. */
  answered(message) {
    this.waiting.get(message.id)?.(message);
  }
}
