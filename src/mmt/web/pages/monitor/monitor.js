// The live monitor: takes the leader's messages and shows them.

import { Controls } from "./controls.js";
import { offerHelp } from "./help.js";
import { Link } from "./link.js";
import { showListeners } from "./listeners.js";
import { Panels, figures, number, showLatencies, text } from "./panels.js";
import { drawBars } from "./plots.js";

const $ = (id) => document.getElementById(id);
const panels = new Panels();

const take = {
  hello(message) {
    text("answer", ""); // one of before a lost connection holds no more
    controls.begin();
    showListeners(null);
    panels.begin(message);
  },

  live(message) {
    const { rings } = panels;
    rings.measured.add(message.arrays.measured, message.measured_count);
    rings.played.add(message.arrays.played, message.played_count);
    const modelled = message.mode === "synthesized" || message.mode === "fading";
    rings.modelled.add(message.arrays.played.map(() => modelled), message.played_count);
    const { point } = message;
    panels.trail.add(point && { speed: point[0], force: point[1], velocity: message.velocity_mm_s });
    panels.verdict(message.verdict);
    panels.surface(message.surfaces);
    panels.remember(message);
    panels.dirty = true;
  },

  model: (message) => panels.model(message),

  completion(message) {
    panels.curve(message.arrays);
    panels.completion(message);
  },

  link(message) {
    showLatencies(message.bounds_ms, message.counts, {
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

  listeners: (message) => showListeners(message.figures),

  events(message) {
    $("events").replaceChildren(...message.events.toReversed().map(([time_s, sentence]) => {
      const item = document.createElement("li");
      const time = document.createElement("time");
      time.textContent = `${time_s.toFixed(1)} s`;
      item.append(time, sentence);
      return item;
    }));
  },

  controls: (message) => controls.show(message),
  control: (message) => controls.showControl(message),
  answer: (message) => controls.orders.answered(message),

  end({ outcome, verdict }) {
    const over = verdict.state === "failed" ? verdict.now : `${verdict.now}; over: ${outcome}`;
    panels.verdict({ ...verdict, now: over });
  },
};

function showState(state) {
  $("connection").hidden = state === "live"; // then the verdict says how the run is
  document.body.classList.toggle("lost", state !== "live");
  if (state !== "live") controls.turnOff();
}

const controls = new Controls(new Link("leader", (message) => take[message.kind]?.(message), showState));
offerHelp("live");
