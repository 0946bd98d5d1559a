// The panels of the page, whoever fills them: a run that goes on, or a recording.

import { Trail } from "./canvas.js";
import { Plane } from "./plane.js";
import { Plot, drawBars } from "./plots.js";
import { Ring, frequencies, spectrum } from "./signals.js";
import { VelocityPlane } from "./velocity.js";

const SHOWN = 512;
const HISTORY = 250;
const SPECTRA_EVERY_MS = 200;

const $ = (id) => document.getElementById(id);
const agesMs = (rateHz) => Array.from({ length: SHOWN }, (_, i) => (1000 * (i - SHOWN + 1)) / rateHz);
const axes = [["x", "streamed"], ["y", "synthesized"], ["z", "third"]];

/** Put a text where it is not there yet. */
export function text(id, value) {
  const node = $(id);
  if (node.textContent !== value) node.textContent = value;
}

/** A number in words, a dash where it is not known. */
export function number(value, digits, unit = "") {
  return value === null || value === undefined ? "–" : `${value.toFixed(digits)}${unit}`;
}

/** Fill a list of figures by their names. */
export function figures(id, rows) {
  $(id).replaceChildren(...Object.entries(rows).flatMap(([name, value]) => {
    const dt = document.createElement("dt"), dd = document.createElement("dd");
    dt.textContent = name;
    dd.textContent = value;
    return [dt, dd];
  }));
}

export class Panels {
  constructor() {
    this.rings = { measured: new Ring(SHOWN), played: new Ring(SHOWN), modelled: new Ring(SHOWN) };
    this.history = { time: [], force: [[], [], []], position: [[], [], []] };
    this.trail = new Trail();
    this.plane = null;
    this.dirty = false;
    this.spectraAt = 0;
    this.plots = {
      completion: new Plot($("completion"), [["now", "ink"], ["start", "faint", [6, 4]], ["stop", "faint", [2, 3]]], ["session time, s", ""]),
      vibration: new Plot($("vibration"), [["measured", "measured"], ["played: streamed", "streamed"], ["played: synthesized", "synthesized"]], ["ms", "m/s²"]),
      spectra: new Plot($("spectra"), [["measured", "measured"], ["played: streamed", "streamed"], ["played: synthesized", "synthesized"]], ["Hz", "dB re 1 (m/s²)²/Hz"]),
      force: new Plot($("force-plot"), axes, ["session time, s", "N"]),
      position: new Plot($("position"), axes, ["session time, s", "mm"]),
    };
    const redraw = () => { this.dirty = true; };
    addEventListener("resize", redraw);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
    requestAnimationFrame((now) => this.#draw(now));
  }

  /** Begin with a session: its name, limits and thresholds. */
  begin(hello) {
    this.hello = hello;
    text("session", hello.session);
    const limits = {
      speed: hello.maximum_speed_mm_s, force: hello.maximum_force_n,
      ...hello.criterion,
    };
    const { title, rises } = hello.criterion;
    text("h-completion", title[0].toUpperCase() + title.slice(1));
    text("plane-numbers", rises ? "the share of a cell's strokes whose level is expected right" : "a cell's distance to its nearest samples");
    this.plots.completion.measure(rises ? "share expected right" : "sum of distances",
      rises ? () => [0, 1] : (_, low, high) => [0, Math.max(high || 0, 12)]);
    const View = hello.inputs === "anisotropic" ? VelocityPlane : Plane;
    this.plane = new View($("plane"), $("plane-text"), limits);
    this.trail = new Trail();
    for (const ring of Object.values(this.rings)) ring.clear();
    this.history.time.length = 0;
    for (const axis of [...this.history.force, ...this.history.position]) axis.length = 0;
  }

  model(message) {
    this.plane.setModel(message);
    if (!message.cells) this.plane.setCompletion(null, null);
    else if (!this.hello.criterion.rises) this.plane.setCompletion(message.cells, this.plane.advice);
    this.dirty = true;
  }

  /** Show what the criterion says against time, with both thresholds. */
  curve({ time_s, value }) {
    const { start, stop } = this.hello.criterion;
    const level = (threshold) => Array.from(time_s, () => threshold);
    this.plots.completion.set([Array.from(time_s), Array.from(value), level(start), level(stop)]);
  }

  /** Say what the criterion says and when it was met, and mark where a stroke is wanted. */
  completion(said) {
    const { value = null, cells = null, advice = null, start_s = null, stop_s = null, faults = "" } = said ?? {};
    const { start, stop } = this.hello.criterion;
    const begun = start_s === null ? `start at ${number(start, 2)}` : `start met at ${start_s.toFixed(1)} s`;
    const ended = stop_s === null ? `stop at ${number(stop, 2)}` : `stop met at ${stop_s.toFixed(1)} s`;
    const now = value === null ? "Nothing is modelled yet." : `${value.toFixed(2)} now; ${begun}, ${ended}.`;
    text("completion-text", faults ? `${now} Not measured: ${faults}.` : now);
    if (cells || !said) this.plane.setCompletion(cells, advice); // else those of a saved model stay
    this.dirty = true;
  }

  /** Show the verdict on the run as it is served, in the header and in the page's title. */
  verdict({ state, now, readiness, error, noticeable, faults, sentence, time }, note = "") {
    $("verdict").dataset.state = state;
    text("now", now);
    const unsaid = faults.filter((fault) => !now.includes(fault));
    text("why", [...unsaid, error && `error ${error}, ${noticeable}`, readiness, note].filter(Boolean).join("; "));
    text("time", time);
    const title = `${sentence} – ${this.hello.session}`;
    if (document.title !== title) document.title = title;
  }

  /** Say which of several surfaces the tool is on; nothing where they are not told apart. */
  surface(surfaces) {
    $("surface").hidden = !surfaces;
    if (surfaces) text("surface", `surface ${surfaces.now} (${surfaces.known} known)`);
  }

  /** Add force and position of a moment to what is shown of the past. */
  remember(message) {
    const { time, force, position } = this.history;
    if (time.length > 0 && message.time_s <= time.at(-1)) return;
    time.push(message.time_s);
    for (let axis = 0; axis < 3; axis++) {
      force[axis].push(message.force_n?.[axis] ?? null);
      position[axis].push(message.position_mm?.[axis] ?? null);
    }
    for (const list of [time, ...force, ...position]) {
      if (list.length > HISTORY) list.shift();
    }
  }

  #draw(now) {
    requestAnimationFrame((next) => this.#draw(next));
    if (!this.dirty || !this.plane) return;
    this.dirty = false;
    this.plane.draw(this.trail);
    const { plots, rings, history } = this;
    const played = (modelled) => rings.played.values.map((value, i) => (rings.modelled.values[i] === modelled ? value : null));
    plots.vibration.set([agesMs(this.hello.rate_hz), rings.measured.values, played(0), played(1)]);
    plots.force.set([history.time, ...history.force]);
    plots.position.set([history.time, ...history.position]);
    if (now - this.spectraAt > SPECTRA_EVERY_MS) this.#spectra(now);
    else this.dirty = true; // the spectra of the newest samples come with the next picture
  }

  #spectra(now) {
    this.spectraAt = now;
    const { rate_hz } = this.hello;
    const { measured, played, modelled } = this.rings;
    const inner = (values) => spectrum(values, rate_hz);
    const [streamed, synthesized] = modelled.values.at(-1) ? [[], played.values] : [played.values, []];
    this.plots.spectra.set([frequencies(rate_hz), ...[measured.values, streamed, synthesized].map(inner)]);
  }
}

/** Draw a histogram of latencies and list figures beside it. */
export function showLatencies(bounds_ms, counts, rows) {
  drawBars($("latency"), bounds_ms, counts);
  figures("link-figures", rows);
}
