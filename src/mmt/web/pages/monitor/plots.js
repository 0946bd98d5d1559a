// Line plots by uPlot, drawn in the page's colours, and bars.

import uPlot from "./uPlot.js";

const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

/** A line plot that fills its element and follows its size and the colour scheme. */
export class Plot {
  /** `series`: [label, colour variable, dash?]; `axes`: labels of x and y; `ranges`: of x and y. */
  constructor(element, series, axes, ranges = {}) {
    Object.assign(this, { element, series, axes, ranges });
    this.data = [[], ...series.map(() => [])];
    this.#make();
    new ResizeObserver(() => this.#fit()).observe(element);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.#make());
  }

  set(data) {
    this.data = data;
    this.plot.setData(data);
  }

  /** Show x from one value to another, whatever the data. */
  span(from, to) {
    this.ranges = { ...this.ranges, x: { range: [from, to] } };
    this.#make();
  }

  /** Say anew what is drawn upwards, and how its range follows from the data. */
  measure(label, range) {
    this.axes = [this.axes[0], label];
    this.ranges = { ...this.ranges, y: { range } };
    this.#make();
  }

  /** Draw an upright line at a value of x. */
  mark(x) {
    this.marked = x;
    this.plot.redraw(false);
  }

  #drawMark(plot) {
    if (this.marked === undefined || !this.data[0].length) return;
    const at = Math.round(plot.valToPos(this.marked, "x", true));
    const { left, top, width, height } = plot.bbox;
    if (at < left || at > left + width) return;
    plot.ctx.fillStyle = css("ink");
    plot.ctx.fillRect(at - devicePixelRatio, top, 2 * devicePixelRatio, height);
  }

  #size() {
    const legend = this.element.querySelector(".u-legend")?.offsetHeight ?? 24;
    return { width: Math.max(this.element.clientWidth, 50), height: Math.max(this.element.clientHeight - legend, 50) };
  }

  /** Leave the legend its room: how many lines it has shows once the width is set. */
  #fit() {
    this.plot.setSize(this.#size());
    queueMicrotask(() => this.plot.setSize(this.#size()));
  }

  #make() {
    this.plot?.destroy();
    const axis = (label) => ({
      label, stroke: css("ink"), labelSize: 20, size: 44, font: "12px system-ui", labelFont: "12px system-ui",
      grid: { stroke: css("line"), width: 1 }, ticks: { stroke: css("line"), width: 1 },
    });
    const x = axis(this.axes[0]);
    x.size = 30;
    this.plot = new uPlot({
      ...this.#size(),
      cursor: { show: false },
      legend: { live: false },
      hooks: { draw: [(plot) => this.#drawMark(plot)] },
      scales: { x: { time: false, ...this.ranges.x }, y: { ...this.ranges.y } },
      axes: [x, axis(this.axes[1])],
      series: [{}, ...this.series.map(([label, colour, dash]) => ({
        label, stroke: css(colour), width: 1.5, dash, points: { show: false }, spanGaps: false,
      }))],
    }, this.data, this.element);
    this.#fit();
  }
}

/** Draw counts between bounds as bars; each has its numbers as text. */
export function drawBars(element, bounds, counts) {
  const total = counts.reduce((sum, n) => sum + n, 0);
  const most = Math.max(...counts, 1);
  element.replaceChildren(...counts.map((count, i) => {
    const bar = document.createElement("div");
    const fill = document.createElement("i");
    fill.style.height = `${(100 * count) / most}%`;
    const range = i === 0 ? `< ${bounds[0]}` : i === bounds.length ? `> ${bounds.at(-1)}` : `${bounds[i - 1]} to ${bounds[i]}`;
    bar.title = `${range} ms: ${count} (${total ? ((100 * count) / total).toFixed(1) : 0} %)`;
    const label = document.createElement("span");
    label.textContent = i < bounds.length ? bounds[i] : "\u221e";
    bar.append(fill, label);
    return bar;
  }));
  element.setAttribute("aria-label", `${total} counted, most at ${element.children[counts.indexOf(most)]?.title ?? "none"}`);
}
