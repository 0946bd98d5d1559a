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
  const style = getComputedStyle(document.documentElement);
  return { pen, width, height, colour: (name) => style.getPropertyValue(`--${name}`).trim() };
}

/** How much a cell of `cells` lacks: 0 at its share of the stop distance, 1 at twice that of the start's. */
export function lack(distance, { start, stop }, cells) {
  const enough = stop / cells, most = (2 * start) / cells;
  return Math.min(Math.max((distance - enough) / (most - enough), 0), 1);
}

/** The colour of a cell that lacks so much. */
export function shade(need, colour) {
  return `rgba(${need > 0 ? colour("far") : colour("near")}, ${need > 0 ? 0.12 + 0.5 * need : 0.18})`;
}

/** The way there, fading into the past, and where the hand is; `at(point)` gives x and y. */
export function drawTrail(pen, colour, trail, at) {
  pen.strokeStyle = pen.fillStyle = colour("point");
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
  pen.beginPath();
  pen.arc(...at(now), 8, 0, 2 * Math.PI);
  pen.fill();
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
