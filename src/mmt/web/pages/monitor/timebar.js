// Where in a recording one is: a slider, play and pause, the speed, and the keys for them.

import { isTaken } from "./help.js";

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 5, 10, 50];
const STEP_S = 1;
const FAR_S = 10;
const FINE_S = 0.04;

const $ = (id) => document.getElementById(id);

export class TimeBar {
  /** `onTime(time_s)` is called with each new time, by whatever way it came. */
  constructor(duration_s, onTime) {
    Object.assign(this, { duration_s, onTime, time_s: 0, playing: false });
    $("slider").max = duration_s;
    $("speed").replaceChildren(...SPEEDS.map((speed) => new Option(`${speed} ×`, speed, speed === 1, speed === 1)));
    $("slider").oninput = () => this.go($("slider").valueAsNumber);
    $("play").onclick = () => this.play(!this.playing);
    addEventListener("keydown", (event) => this.#key(event));
    $("timebar").hidden = false;
    this.#show();
  }

  /** Go to a time; beyond the ends is at the ends. */
  go(time_s) {
    this.time_s = Math.min(Math.max(time_s, 0), this.duration_s);
    this.#show();
    this.onTime(this.time_s);
  }

  play(wanted) {
    if (wanted && this.time_s >= this.duration_s) this.go(0);
    if (wanted && !this.playing) {
      this.last = performance.now();
      requestAnimationFrame((now) => this.#tick(now));
    }
    this.playing = wanted;
    this.#show();
  }

  /** Draw what happened below the slider; `happenings`: [time_s, kind, sentence]. */
  mark(happenings) {
    $("slider-marks").replaceChildren(...happenings.filter(([, kind]) => kind !== "other").map(([time_s, kind, sentence]) => {
      const mark = document.createElement("i");
      mark.className = kind;
      mark.style.left = `${(100 * time_s) / this.duration_s}%`;
      mark.title = `${time_s.toFixed(1)} s: ${sentence}`;
      return mark;
    }));
  }

  #tick(now) {
    if (!this.playing) return;
    const passed_s = Math.max(0, now - this.last) / 1000;
    this.last = now;
    this.go(this.time_s + passed_s * Number($("speed").value));
    if (this.time_s >= this.duration_s) this.play(false);
    else requestAnimationFrame((next) => this.#tick(next));
  }

  #show() {
    $("slider").value = this.time_s;
    const spoken = `${this.time_s.toFixed(2)} of ${this.duration_s.toFixed(2)} s`;
    $("slider").setAttribute("aria-valuetext", spoken);
    $("at").textContent = spoken;
    $("play").textContent = this.playing ? "Pause" : "Play";
    $("play").setAttribute("aria-pressed", String(this.playing));
  }

  #key(event) {
    if (isTaken(event)) return;
    const step = event.shiftKey ? FAR_S : STEP_S;
    const way = {
      ArrowLeft: () => this.go(this.time_s - step),
      ArrowRight: () => this.go(this.time_s + step),
      ",": () => this.go(this.time_s - FINE_S),
      ".": () => this.go(this.time_s + FINE_S),
      Home: () => this.go(0),
      End: () => this.go(this.duration_s),
      "-": () => this.#faster(-1),
      "+": () => this.#faster(1),
      " ": () => this.play(!this.playing),
    }[event.key];
    // a button that has the focus is what the space bar presses
    if (way === undefined || (event.key === " " && event.target.closest("button"))) return;
    event.preventDefault();
    way();
  }

  #faster(by) {
    const place = SPEEDS.indexOf(Number($("speed").value)) + by;
    $("speed").value = SPEEDS[Math.min(Math.max(place, 0), SPEEDS.length - 1)];
  }
}
