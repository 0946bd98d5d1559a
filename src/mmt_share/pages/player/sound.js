// The sound: asks the server for samples as they are played, and measures how late they come.

import { Playout } from "./playout.js";

/** Number of the order that opens the sound; those of the scenarios count from 0. */
export const OPENING = -1;

const FADE_S = 0.008;
const SCRIPT_FRAMES = 256;
const MARGIN_S = 0.004;
const SETTLE_S = 1;
const MEMORY = 512;
const MOST_UNANSWERED = 4; // more would queue up where machine or network are busy

/** How many samples are to wait: as few as the last second needed. */
export class Lead {
  constructor(rate) {
    this.rate = rate;
    this.least = Math.round(0.006 * rate);
    this.most = Math.round(0.3 * rate);
    this.samples = Math.round(0.02 * rate);
    this.calm = 0;
    this.spare = Infinity;
  }

  /** Take a report: as many more as samples lacked, less where some were spare for a second. */
  take({ lacked, least, counted }) {
    if (lacked) {
      this.samples = Math.min(this.most, this.samples + lacked);
      this.calm = 0;
      this.spare = Infinity;
      return;
    }
    this.spare = Math.min(this.spare, least);
    this.calm += counted;
    if (this.calm < SETTLE_S * this.rate) return;
    const excess = this.spare - MARGIN_S * this.rate;
    if (excess > 0) this.samples = Math.max(this.least, Math.floor(this.samples - excess / 2));
    this.calm = 0;
    this.spare = Infinity;
  }
}

/** Plays what the server renders. `touch()` gives tile and points; `onReport(figures)`. */
export class Sound {
  constructor(link, touch, onReport) {
    Object.assign(this, { link, touch, onReport });
    this.running = false;
    this.opened = false;
    this.scale = 1 / 30;
    this.volume = 0;
    this.number = 0;
    this.asked = new Map();
    this.latencies = [];
    this.trips = [];
  }

  /** Begin; to be called while a person presses something. */
  async start() {
    this.wanted = true;
    if (this.context === undefined) await this.#make();
    await this.context.resume();
    this.running = true;
    this.open();
    this.#fade(this.volume);
  }

  /** Fall silent without a click, then rest. */
  async stop() {
    this.running = this.wanted = false;
    if (this.context === undefined) return;
    this.#fade(0);
    await new Promise((resolve) => setTimeout(resolve, 10 * FADE_S * 1000));
    if (!this.wanted) await this.context.suspend();
  }

  /** Begin a stream at the server. */
  open() {
    if (!this.running) return;
    this.opened = false;
    this.link.send({ do: "open", id: OPENING, rate_hz: this.context.sampleRate });
  }

  setVolume(volume) {
    this.volume = volume;
    if (this.running) this.#fade(volume);
  }

  take = {
    opened: (message) => {
      this.opened = true;
      this.delayMs = message.delay_ms;
      this.asked.clear();
      this.unanswered = 0;
      this.lead = new Lead(message.rate_hz);
      this.port.postMessage({ reset: true });
      this.played = 0;
      this.#ask();
    },
    sound: (message) => {
      const asked = this.asked.get(message.number);
      if (asked) remember(this.trips, performance.now() - asked.sent);
      if (!this.opened) return;
      this.unanswered--;
      this.port.postMessage({ samples: message.arrays.sound, number: message.number, scale: this.scale });
    },
  };

  async #make() {
    const context = new AudioContext({ latencyHint: 0 });
    this.gain = new GainNode(context, { gain: 0 });
    this.gain.connect(context.destination);
    if (context.audioWorklet !== undefined) {
      await context.audioWorklet.addModule("worklet.js");
      const node = new AudioWorkletNode(context, "mmt-playout", { numberOfInputs: 0, outputChannelCount: [1] });
      this.port = node.port;
      node.port.onmessage = ({ data }) => this.#report(data);
      node.connect(this.gain);
      this.by = "worklet";
    } else {
      this.#makeScript(context);
    }
    this.context = context;
  }

  /** Browsers have worklets for pages of https and of this machine alone. */
  #makeScript(context) {
    const playout = new Playout();
    const node = context.createScriptProcessor(SCRIPT_FRAMES, 1, 1);
    node.onaudioprocess = (event) => {
      playout.fill(event.outputBuffer.getChannelData(0), Math.round(event.playbackTime * context.sampleRate));
      this.#report(playout.report());
    };
    this.port = {
      postMessage: (data) => (data.reset ? playout.reset() : playout.add(data.samples, data.number, data.scale)),
    };
    this.script = node; // without a reference it would be collected
    node.connect(this.gain);
    this.by = "script";
  }

  #fade(level) {
    this.gain.gain.cancelScheduledValues(this.context.currentTime);
    this.gain.gain.setTargetAtTime(level, this.context.currentTime, FADE_S);
  }

  #report(report) {
    if (!this.opened) return;
    this.played = report.played;
    this.lead.take(report);
    for (const [number, frame] of report.heard) this.#heard(number, frame);
    this.#ask();
    this.onReport({ ...report, lead: this.lead.samples });
  }

  #ask() {
    if (this.unanswered >= MOST_UNANSWERED) return;
    const number = this.number++;
    const { tile, points, moved } = this.touch();
    const now = performance.now();
    const asked = this.link.send({ do: "play", number, now_ms: now, played: this.played, lead: this.lead.samples, tile, points });
    if (!asked) return;
    this.unanswered++;
    this.asked.set(number, { sent: now, moved });
    if (this.asked.size > MEMORY) this.asked.delete(this.asked.keys().next().value);
  }

  /** A sample that answers a request leaves for the sound card: what the pointer did, is heard. */
  #heard(number, frame) {
    const asked = this.asked.get(number);
    if (asked?.moved === undefined) return;
    remember(this.latencies, this.#outputMs(frame) + this.delayMs - asked.moved);
  }

  /** When a frame leaves the sound card, by the page's clock. */
  #outputMs(frame) {
    const { contextTime, performanceTime } = this.context.getOutputTimestamp();
    const time = frame / this.context.sampleRate;
    if (performanceTime > 0 && contextTime > 0) return performanceTime + 1e3 * (time - contextTime);
    return performance.now() + 1e3 * (time - this.context.currentTime + this.#outputS());
  }

  #outputS() {
    return (this.context.baseLatency || 0) + (this.context.outputLatency || 0);
  }

  /** Medians of what was measured, in ms; null where nothing was. */
  figures() {
    return {
      total: median(this.latencies),
      trip: median(this.trips),
      ahead: this.lead ? (1e3 * this.lead.samples) / this.context.sampleRate : null,
      conversion: this.delayMs ?? null,
      output: this.context ? 1e3 * this.#outputS() : null,
      by: this.by,
    };
  }
}

function remember(list, value) {
  list.push(value);
  if (list.length > 200) list.shift();
}

function median(list) {
  if (!list.length) return null;
  return [...list].sort((a, b) => a - b)[list.length >> 1];
}
