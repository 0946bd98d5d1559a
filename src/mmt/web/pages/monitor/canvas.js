// What every picture on a canvas needs: its size in pixels, the page's colours, one notion of lack.

/** Clear a canvas for drawing at the screen's resolution; return pen, size and colours. */
export function prepare(canvas) {
  const ratio = devicePixelRatio || 1;
  const { clientWidth: width, clientHeight: height } = canvas;
  if (canvas.width !== Math.round(width * ratio)) canvas.width = Math.round(width * ratio);
  if (canvas.height !== Math.round(height * ratio)) canvas.height = Math.round(height * ratio);
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  pen.font = "12px system-ui, sans-serif";
  const style = getComputedStyle(document.documentElement);
  return { pen, width, height, colour: (name) => style.getPropertyValue(`--${name}`).trim() };
}

/** Begin a path with a circle. */
export function circle(pen, x, y, radius) {
  pen.beginPath();
  pen.arc(x, y, radius, 0, 2 * Math.PI);
}

/** How much a cell of `cells` lacks: 0 where it has its part of what stops, 1 at twice what is left at the start. */
export function lack(value, { start, stop, rises }, cells) {
  const enough = rises ? stop : stop / cells, most = rises ? 2 * start - 1 : (2 * start) / cells;
  return Math.min(Math.max((value - enough) / (most - enough), 0), 1);
}

/** The cell that lacks most. */
export function worstOf(cells, { rises }) {
  return cells.indexOf(rises ? Math.min(...cells) : Math.max(...cells));
}

/** Which stroke gains most, in words. */
export function advise(advice) {
  const force = `${advice.at(-1).toFixed(1)} N`, speed = Math.hypot(...advice.slice(0, -1));
  if (advice.length === 2) return ` A stroke at about ${speed.toFixed(0)} mm/s and ${force} gains most.`;
  const towards = speed < 1 ? "" : ` towards ${headingOf(advice)}°`;
  return ` A stroke at about ${speed.toFixed(0)} mm/s${towards} with ${force} gains most.`;
}

/** The heading of a velocity, 0 to 359 degrees. */
export function headingOf([x, y]) {
  return (Math.round((Math.atan2(y, x) * 180) / Math.PI) + 360) % 360;
}

/** Mark a place where a stroke is wanted: two rings around it. */
export function drawAdvice(pen, colour, [x, y], size = 1) {
  pen.strokeStyle = colour("ink");
  pen.lineWidth = 2;
  for (const radius of [6 * size, 12 * size]) {
    circle(pen, x, y, radius);
    pen.stroke();
  }
}

/** The colour of a cell that lacks so much: the bluer, the readier. */
export function shade(need, colour) {
  return `color-mix(in srgb, ${colour("unready")} ${100 * need}%, ${colour("ready")})`;
}

/** The way there, fading into the past, and where the hand is; `at(point)` gives x and y. */
export function drawTrail(pen, colour, trail, at) {
  pen.strokeStyle = pen.fillStyle = colour("synthesized");
  pen.lineWidth = 2;
  trail.forEach((point, i) => {
    const before = trail[i - 1];
    if (!point || !before) return;
    pen.globalAlpha = (i + 1) / trail.length;
    pen.beginPath();
    pen.moveTo(...at(before));
    pen.lineTo(...at(point));
    pen.stroke();
  });
  pen.globalAlpha = 1;
  const now = trail.at(-1);
  if (!now) return;
  circle(pen, ...at(now), 8);
  pen.fill();
}

/** The space of a model on a canvas, and `describe()` of it in words. */
export class ModelPlane {
  /** `limits`: the largest speed and force, start, stop and rises of the criterion. */
  constructor(canvas, text, limits) {
    Object.assign(this, { canvas, text, limits, model: null, cells: null, advice: null });
  }

  setModel(model) {
    this.model = model;
    this.show();
  }

  /** Take what the criterion says of each cell, and where it wants a stroke; null for neither. */
  setCompletion(cells, advice) {
    Object.assign(this, { cells, advice });
    this.show();
  }

  show() {
    this.text.textContent = this.model?.samples ? this.describe() : "No model yet.";
  }
}

/** The newest points of the hand, each {speed, force, velocity} or null. */
export class Trail {
  static LONGEST = 120;

  constructor() {
    this.points = [];
  }

  add(point) {
    this.points.push(point);
    if (this.points.length > Trail.LONGEST) this.points.shift();
  }

  get newest() {
    return this.points.at(-1) ?? null;
  }
}
