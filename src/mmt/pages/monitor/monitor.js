// The live monitor's page: takes the leader's messages and shows them.

import { Controls } from "./controls.js";
import { Link } from "./link.js";
import { Plane } from "./plane.js";
import { Plot, drawBars } from "./plots.js";
import { Ring, frequencies, spectrum } from "./signals.js";

const SHOWN = 512;
const HISTORY = 250;
const SPECTRA_EVERY_MS = 200;

const $ = (id) => document.getElementById(id);
const text = (id, value) => { const node = $(id); if (node.textContent !== value) node.textContent = value; };
const number = (value, digits, unit = "") => (value === null || value === undefined ? "–" : `${value.toFixed(digits)}${unit}`);

let hello = { rate_hz: 1000, start_distance: 7.5, stop_distance: 4.243 };
const rings = { measured: new Ring(SHOWN), played: new Ring(SHOWN), modelled: new Ring(SHOWN) };
const history = { time: [], force: [[], [], []], position: [[], [], []] };
let dirty = false;
let spectraAt = 0;

const plane = new Plane($("plane"), $("plane-text"));
const plots = {
  completion: new Plot($("completion"), [["sum", "ink"], ["start", "played", [6, 4]], ["stop", "third", [2, 3]]],
    ["session time, s", "sum of distances"], { y: { range: (_, low, high) => [0, Math.max(high || 0, 12)] } }),
  vibration: new Plot($("vibration"), [["measured", "measured"], ["played: streamed", "third"], ["played: synthesized", "played"]], ["ms", "m/s²"]),
  spectra: new Plot($("spectra"), [["measured", "measured"], ["played", "played"]], ["Hz", "dB re 1 (m/s²)²/Hz"]),
  force: new Plot($("force"), [["x", "measured"], ["y", "third"], ["z", "played"]], ["session time, s", "N"]),
  position: new Plot($("position"), [["x", "measured"], ["y", "third"], ["z", "played"]], ["session time, s", "mm"]),
};

const take = {
  hello(message) {
    hello = message;
    text("session", message.session);
    document.title = `mmt monitor: ${message.session}`;
    plane.setLimits(message);
    for (const ring of Object.values(rings)) ring.clear();
    history.time.length = 0;
    for (const axis of [...history.force, ...history.position]) axis.length = 0;
  },

  live(message) {
    rings.measured.add(message.arrays.measured, message.measured_count);
    rings.played.add(message.arrays.played, message.played_count);
    const modelled = message.mode === "synthesized" || message.mode === "fading";
    rings.modelled.add(message.arrays.played.map(() => modelled), message.played_count);
    plane.move(message.point);
    showMode(message);
    if (history.time.length === 0 || message.time_s > history.time.at(-1)) {
      history.time.push(message.time_s);
      for (let axis = 0; axis < 3; axis++) {
        history.force[axis].push(message.force_n?.[axis] ?? null);
        history.position[axis].push(message.position_mm?.[axis] ?? null);
      }
      for (const list of [history.time, ...history.force, ...history.position]) {
        if (list.length > HISTORY) list.shift();
      }
    }
    dirty = true;
  },

  model(message) {
    plane.setModel(message);
    dirty = true;
  },

  completion(message) {
    const { time_s, distance } = message.arrays;
    const level = (value) => Array.from(time_s, () => value);
    plots.completion.set([Array.from(time_s), Array.from(distance), level(hello.start_distance), level(hello.stop_distance)]);
    const sum = distance.at(-1);
    const met = [];
    if (message.start_s !== null) met.push(`start met at ${message.start_s.toFixed(1)} s`);
    if (message.stop_s !== null) met.push(`stop met at ${message.stop_s.toFixed(1)} s`);
    text("completion-text", sum === undefined ? "Nothing is modelled yet." : `${sum.toFixed(2)} now; ${met.join(", ") || `start at ${hello.start_distance}`}.`);
  },

  link(message) {
    drawBars($("latency"), message.bounds_ms, message.counts);
    figures("link-figures", {
      "frames": String(message.frames),
      "lost": String(message.lost),
      "out of order, repeated": `${message.out_of_order}, ${message.repeated}`,
      "rejected": String(message.rejected),
      "latency p50, p99": `${number(message.latency_p50_ms, 2)}, ${number(message.latency_p99_ms, 2)} ms`,
      "clock offset": number(message.clock.offset_ms, 3, " ms"),
    });
  },

  ticks(message) {
    drawBars($("periods"), message.bounds_ms, message.counts);
    figures("tick-figures", {
      "ticks, missed": `${message.ticks}, ${message.missed}`,
      "period p50, p99": `${number(message.period_p50_ms, 3)}, ${number(message.period_p99_ms, 3)} ms`,
      "over 1 ms late": message.late_share_1ms === null ? "–" : `${(100 * message.late_share_1ms).toFixed(2)} %`,
      "playout delay": number(message.playout_delay_ms, 1, " ms"),
    });
  },

  events(message) {
    $("events").replaceChildren(...message.events.toReversed().map(([time_s, sentence]) => {
      const item = document.createElement("li");
      const time = document.createElement("time");
      time.textContent = `${time_s.toFixed(1)} s`;
      item.append(time, sentence);
      return item;
    }));
  },

  controls(message) {
    controls.show(message);
  },

  answer(message) {
    controls.answered(message);
  },

  end(message) {
    text("why", `the session is over: ${message.outcome}`);
  },
};

function showMode(message) {
  text("mode", message.mode);
  $("mode").dataset.mode = message.mode;
  text("why", message.why);
  text("time", `${message.time_s.toFixed(1)} s`);
}

function figures(id, rows) {
  $(id).replaceChildren(...Object.entries(rows).flatMap(([name, value]) => {
    const dt = document.createElement("dt"), dd = document.createElement("dd");
    dt.textContent = name;
    dd.textContent = value;
    return [dt, dd];
  }));
}

const ages = Array.from({ length: SHOWN }, (_, i) => i - SHOWN + 1);

function draw(now) {
  requestAnimationFrame(draw);
  if (!dirty) return;
  dirty = false;
  plane.draw();
  const played = (modelled) => rings.played.values.map((value, i) => (rings.modelled.values[i] === modelled ? value : null));
  plots.vibration.set([ages, rings.measured.values, played(0), played(1)]);
  plots.force.set([history.time, ...history.force]);
  plots.position.set([history.time, ...history.position]);
  if (now - spectraAt > SPECTRA_EVERY_MS) {
    spectraAt = now;
    plots.spectra.set([frequencies(hello.rate_hz), spectrum(rings.measured.values, hello.rate_hz), spectrum(rings.played.values, hello.rate_hz)]);
  }
}

function showState(state, sentence) {
  text("connection", sentence);
  $("connection").dataset.state = state;
  document.body.classList.toggle("lost", state !== "live");
  $("token-form").hidden = state !== "refused";
}

const link = new Link((message) => take[message.kind]?.(message), showState, (given) => {
  text("token-problem", given ? "That is not the leader's token." : "");
  $("token").focus();
});

const controls = new Controls(link);

$("token-form").addEventListener("submit", (event) => {
  event.preventDefault();
  link.useToken($("token").value);
  $("token").value = "";
});

addEventListener("resize", () => { dirty = true; });
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { dirty = true; });
requestAnimationFrame(draw);
