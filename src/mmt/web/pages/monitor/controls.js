// The controls: each order is sent to the leader, and what it answers is shown in words.

import { isTaken } from "./help.js";
import { Orders, say } from "./orders.js";

const FOCUSED = { m: "mark", v: "force" };
const PRESSED = { s: "save" }; // what undoes, ends or forgets something has no key
const CONTROL = {
  own: () => "The leader's hand moves the robot.",
  giving: (operator) => `The robot holds for ${operator}.`,
  given: (operator) => `${operator} moves the robot.`,
  returning: () => "The robot holds for the leader's hand.",
};
const $ = (id) => document.getElementById(id);

export class Controls {
  /** `link` sends orders and knows the token. */
  constructor(link) {
    this.link = link;
    this.orders = new Orders(link);
    this.state = {};
    $("record").onclick = () => this.orders.give({ do: "record", on: !this.state.recording });
    $("save").onclick = () => this.orders.give({ do: "save" });
    $("freeze").onclick = () => this.orders.give({ do: "freeze", on: !this.state.frozen });
    $("reset").onclick = () => {
      if (confirm("Forget the model and begin anew?")) this.orders.give({ do: "reset" });
    };
    $("surface-said").onchange = async () => {
      const { value } = $("surface-said");
      await this.orders.give({ do: "surface", surface: value === "" ? null : Number(value) });
      this.#showSurfaces(); // as the leader has it, until it has followed
    };
    $("take-back").onclick = () => this.orders.give({ do: "control", decision: "take back" });
    $("force").onchange = async () => {
      await this.orders.give({ do: "mode", mode: $("force").value });
      $("force").value = this.state.forced; // as it is, should the leader have refused
    };
    $("network").onchange = () => this.#changeNetwork($("network").value);
    $("mark-form").onsubmit = async (event) => {
      event.preventDefault();
      const { value } = $("mark");
      $("mark").value = "";
      if (!await this.orders.give({ do: "mark", text: value })) $("mark").value ||= value;
    };
    addEventListener("keydown", (event) => this.#shortcut(event));
  }

  /** Begin with a leader, of which nothing is known yet. */
  begin() {
    this.state = {};
    $("control").hidden = true;
  }

  /** Show what the controls stand at; those that the scene lacks cannot be used. */
  show(state) {
    const first = this.state.network === undefined;
    this.state = state;
    label("record", state.recording === null ? "Record" : "Stop recording"); // quietly: it ends something
    label("freeze", state.frozen ? "Let the model grow" : "Freeze model");
    $("freeze").setAttribute("aria-pressed", String(state.frozen));
    $("record").disabled = !state.records;
    $("freeze").disabled = !state.models;
    $("reset").disabled = !state.models || !state.saves;
    for (const each of [...$("mark-form").elements, $("surface-said")]) each.disabled = false;
    $("save").disabled = !state.saves;
    $("force").disabled = !state.renders;
    $("force").value = state.forced;
    $("network").disabled = !state.network;
    $("network").title = state.network ? "" : "the scene has no [network]";
    this.#showSurfaces();
    $("controls").hidden = false;
    if (first && state.network) this.#readNetwork();
  }

  /** Turn everything off: nobody would carry it out. */
  turnOff() {
    for (const each of $("controls").querySelectorAll("button, input, select")) each.disabled = true;
  }

  /** Show the surface that the tool is taken to be on, and those that a person may name. */
  #showSurfaces() {
    const { surfaces } = this.state;
    $("surfaces").hidden = !surfaces;
    if (!surfaces) return;
    const [now, known] = surfaces;
    const named = known.map((n) => new Option(n === now ? `surface ${n}` : `surface ${n} again`, n));
    $("surface-said").replaceChildren(...named, new Option("another surface", ""));
    $("surface-said").value = now;
  }

  /** Show who moves the robot, and each who asks to with what may be answered. */
  showControl({ state, operator, asking }) {
    $("control").hidden = false;
    $("control-text").textContent = CONTROL[state](operator);
    $("take-back").disabled = operator === "";
    $("asking").replaceChildren(
      ...asking.map(([who, name]) => {
        const item = document.createElement("li");
        item.append(
          `${name} asks for control `,
          ...["Give", "Refuse"].map((label) => this.#decision(label, who, name)),
        );
        return item;
      }),
    );
  }

  #decision(label, who, name) {
    const button = document.createElement("button");
    button.textContent = label;
    button.setAttribute("aria-label", `${label}: ${name}`);
    button.onclick = () => this.orders.give({ do: "control", decision: label.toLowerCase(), who });
    return button;
  }

  async #changeNetwork(profile) {
    try {
      const settings = await this.#network({
        method: "PUT",
        body: JSON.stringify(profile === "none" ? {} : { profile }),
      });
      say(`emulated network: ${settings.profile ?? "none"}`, true);
    } catch (error) {
      say(error.message, false);
      this.#readNetwork();
    }
  }

  async #readNetwork() {
    try {
      const settings = await this.#network({});
      const plain = !settings.delay_ms && !settings.loss && !settings.bandwidth_kbit_s;
      $("network").value = settings.profile ?? (plain ? "none" : "own");
    } catch (error) {
      say(error.message, false);
    }
  }

  async #network(request) {
    const headers = { "Content-Type": "application/json" };
    if (this.link.token !== null) headers.Authorization = `Bearer ${this.link.token}`;
    const answer = await fetch("/network", { ...request, headers });
    const content = await answer.json();
    if (!answer.ok) throw new Error(content.error ?? `the leader answered ${answer.status}`);
    return content;
  }

  #shortcut(event) {
    if (isTaken(event) || $("controls").hidden) return;
    const { key } = event;
    if (key in FOCUSED) $(FOCUSED[key]).focus();
    else if (key in PRESSED) $(PRESSED[key]).click();
    else return;
    event.preventDefault();
  }
}

function label(id, words) {
  if ($(id).firstChild.data !== words) $(id).firstChild.data = words;
}
