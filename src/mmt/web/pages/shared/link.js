// A page's socket to its server: decodes messages, asks for the token, comes back by itself.

const RETRY_MS = [300, 600, 1000, 2000, 3000];
const SILENT_MS = 5000;
const REFUSED = 4401;
const TAKEN_OVER = 4409;

const $ = (id) => document.getElementById(id);

/** Decode a message: header length, JSON header, then little-endian float32 arrays. */
export function decode(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  let offset = 4 + length;
  const arrays = {};
  for (const [name, shape] of header.arrays) {
    const count = shape.reduce((product, n) => product * n, 1);
    arrays[name] = new Float32Array(buffer, offset, count);
    offset += 4 * count;
  }
  header.arrays = arrays;
  return header;
}

/** Keep a connection to a `server`, show how it is, and ask for the token; `onMessage(header)`, `onState(state)`. */
export class Link {
  constructor(server, onMessage, onState = () => {}) {
    Object.assign(this, { server, onMessage, onState });
    $("token-form").onsubmit = (event) => {
      event.preventDefault();
      this.token = $("token").value;
      sessionStorage.setItem("mmt-token", this.token);
      $("token").value = "";
      this.open();
    };
    this.token = sessionStorage.getItem("mmt-token");
    this.tries = 0;
    this.ended = null;
    setInterval(() => this.#watch(), 1000);
    this.open();
  }

  /** Send an order; false where there is no connection. */
  send(order) {
    if (this.socket.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(order));
    return true;
  }

  open() {
    clearTimeout(this.timer);
    const address = new URL("socket", location.href); // beside the page
    address.protocol = location.protocol === "https:" ? "wss:" : "ws:";
    const socket = new WebSocket(address);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    this.heard = performance.now();
    socket.onopen = () => socket.send(JSON.stringify({ token: this.token }));
    socket.onmessage = (event) => {
      this.heard = performance.now();
      const message = decode(event.data);
      if (message.kind === "hello") {
        this.tries = 0;
        this.ended = null;
        this.#show("live", "live");
      }
      if (message.kind === "end") this.ended = message.outcome;
      this.onMessage(message);
    };
    socket.onclose = (event) => {
      if (socket === this.socket) this.#closed(event.code, event.reason);
    };
  }

  #closed(code, reason) {
    if (code === REFUSED) {
      const given = this.token !== null;
      this.token = null;
      sessionStorage.removeItem("mmt-token");
      this.#show("refused", "token needed");
      $("token-problem").textContent = given ? `That is not the ${this.server}'s token.` : "";
      $("token").focus();
      return;
    }
    if (code === TAKEN_OVER) { // coming back by itself would take it from the other page again
      this.#show("taken", "used by another page: load this one again to come back");
      return;
    }
    if (this.ended === null) this.#show("lost", `${reason || "connection lost"}, trying again`);
    else this.#show("over", `session over: ${this.ended}`);
    const wait = RETRY_MS[Math.min(this.tries++, RETRY_MS.length - 1)];
    this.timer = setTimeout(() => this.open(), wait);
  }

  #show(state, sentence) {
    $("connection").textContent = sentence;
    $("connection").dataset.state = state;
    $("token-form").hidden = state !== "refused";
    this.onState(state);
  }

  /** A network that vanished closes nothing: give up a socket that is silent, or does not open. */
  #watch() {
    const waits = this.socket.readyState <= WebSocket.OPEN;
    if (waits && performance.now() - this.heard > SILENT_MS) {
      const socket = this.socket;
      this.socket = { readyState: WebSocket.CLOSED };
      socket.close();
      this.#closed(0, "");
    }
  }
}
