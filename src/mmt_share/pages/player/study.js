// The scenarios: what is asked of the participant, and the answers.

import { letter } from "./grid.js";
import { Orders, say } from "./orders.js";

const $ = (id) => document.getElementById(id);

export class Study {
  constructor(link, grid) {
    Object.assign(this, { grid, orders: new Orders(link) });
    this.state = { scenario: null };
    this.sample = null;
    $("begin-form").onsubmit = (event) => {
      event.preventDefault();
      this.orders.give({ do: "begin", scenario: $("scenario").value, participant: $("participant").value });
    };
    $("leave").onclick = () => {
      if (this.state.done || confirm("Leave the scenario before its end?")) this.orders.give({ do: "leave" });
    };
    $("finish").onclick = () => this.orders.give({ do: "finish" });
    $("answer-tile").onclick = () => this.match();
  }

  /** Make the scale of ratings. */
  make(names, best) {
    this.names = names;
    $("rating-buttons").replaceChildren(...Array.from({ length: best }, (_, i) => {
      const button = document.createElement("button");
      button.textContent = String(i + 1);
      button.onclick = () => this.orders.give({ do: "rate", rating: i + 1 });
      return button;
    }));
  }

  /** Show the state of the scenario. */
  show(state) {
    this.state = state;
    const runs = state.scenario !== null, matches = state.scenario === "matching";
    $("begin-form").hidden = runs;
    $("leave").hidden = !runs;
    if (runs) $("study").open = true;
    $("leave").textContent = state.done ? "Done" : "Leave";
    $("ratings").hidden = !runs || state.done || (matches && state.matches === null);
    for (const button of $("rating-buttons").children) button.disabled = !state.rates;
    const asks = matches && state.matches === null;
    $("samples").hidden = $("answer-tile").hidden = !asks;
    const all = asks && Object.keys(state.tiles).length === this.names.length;
    $("finish").hidden = !all;
    this.grid.show(this.names.map((_, tile) => (state.hidden ? null : matches ? state.textures[tile] : tile)));
    this.grid.mark((tile) => this.#marks(tile));
    if (asks) this.#samples();
    else this.sample = null;
    $("prompt").textContent = this.#prompt();
  }

  /** Answer that the chosen tile feels like the current sample. */
  async match() {
    const { scenario, matches } = this.state, tile = this.grid.chosen;
    if (scenario !== "matching" || matches !== null) return;
    if (tile === null) return say("stroke a tile first", false);
    this.grid.choose(null); // a double click would name it for the next sample, too
    if (!await this.orders.give({ do: "answer", sample: this.sample, tile })) return;
    this.sample = null; // on to one without a tile
    this.show(this.state);
  }

  /** Rate by a digit key; return whether there was something to rate. */
  rate(rating) {
    if (!this.state.rates) return false;
    $("rating-buttons").children[rating - 1]?.click();
    return true;
  }

  #samples() {
    const { samples, tiles } = this.state;
    if (this.sample === null) this.sample = samples.find((sample) => !(sample in tiles)) ?? samples[0];
    $("samples").replaceChildren(...samples.map((sample) => {
      const button = document.createElement("button"), tile = document.createElement("span");
      tile.textContent = sample in tiles ? letter(tiles[sample]) : "–";
      button.append(this.names[sample], tile);
      button.setAttribute("role", "radio");
      button.setAttribute("aria-checked", String(sample === this.sample));
      button.onclick = () => {
        this.sample = sample;
        this.show(this.state);
      };
      return button;
    }));
  }

  #marks(tile) {
    const { scenario, matches, textures, tiles, done } = this.state;
    if (scenario === "exploration" && !done) return [tile === this.state.tile ? "asked" : "off"];
    if (scenario !== "matching" || matches === null) return [];
    return [tiles[textures[tile]] === tile ? "right" : "wrong"];
  }

  #prompt() {
    const { scenario, done, trial, trials, tile, matches } = this.state;
    if (scenario === "exploration") {
      if (done) return `All ${trials} textures are rated. Thank you.`;
      return `${trial} of ${trials}: compare the real ${this.names[tile]} with tile ${letter(tile)}, then rate how real it feels.`;
    }
    if (scenario !== "matching") return "";
    if (matches === null) return `Which tile feels like ${this.names[this.sample]}?`;
    const counted = `${matches} of ${this.names.length} match.`;
    return done ? `${counted} Thank you.` : `${counted} How real did the textures feel?`;
  }
}
