// Line plots by uPlot, drawn in the page's colours, and bars.

import uPlot from "./uPlot.js";

const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

const readOut = (_, value) => (value === null || value === undefined ? "–" : Number(value.toPrecision(4)).toString());

/** A line plot with a read-out under the cursor, that fills its element and follows its size and the colour scheme. */
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

  /** Make this one of the panels of a time line: they share zoom and cursor, and lead to moments. */
  shareTime(line) {
    this.line = line;
    this.ranges = { ...this.ranges, x: { range: () => line.span } };
    this.#make();
  }

  /** Show the span of its time line. */
  follow() {
    const [min, max] = this.line.span;
    this.plot.setScale("x", { min, max });
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

  /** Draw what was played as a bar along the top, and the moment. */
  #drawMark(plot) {
    const { left, top, width, height } = plot.bbox;
    const within = (x) => Math.min(Math.max(Math.round(plot.valToPos(x, "x", true)), left), left + width);
    for (const [from, to, mode] of this.line?.modes ?? []) {
      plot.ctx.fillStyle = css(mode);
      plot.ctx.fillRect(within(from), top, within(to) - within(from), 4 * devicePixelRatio);
    }
    if (this.marked === undefined) return;
    const at = Math.round(plot.valToPos(this.marked, "x", true));
    if (at < left || at > left + width) return;
    plot.ctx.fillStyle = css("ink");
    plot.ctx.fillRect(at - devicePixelRatio, top, 2 * devicePixelRatio, height);
  }

  #cursor() {
    const { line } = this;
    return {
      y: false,
      drag: { x: Boolean(line), y: false, setScale: false },
      ...(line && {
        sync: { key: "time", scales: ["x", null] },
        bind: { dblclick: () => () => line.zoom(null) },
      }),
    };
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
      cursor: this.#cursor(),
      hooks: {
        draw: [(plot) => this.#drawMark(plot)],
        setSelect: [({ select, posToVal }) => {
          if (select.width > 0) this.line?.zoom(...[0, select.width].map((by) => posToVal(select.left + by, "x")));
        }],
      },
      scales: { x: { time: false, ...this.ranges.x }, y: { ...this.ranges.y } },
      axes: [x, axis(this.axes[1])],
      series: [{ label: this.axes[0].split(", ").at(-1), value: readOut }, ...this.series.map(([label, colour, dash]) => ({
        label, stroke: css(colour), width: 1.5, dash, points: { show: false }, spanGaps: false, value: readOut,
      }))],
    }, this.data, this.element);
    this.plot.over.addEventListener("click", () => this.line?.pick(this.plot.posToVal(this.plot.cursor.left, "x")));
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
