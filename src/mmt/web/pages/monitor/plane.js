// The speed-force plane: samples, triangles, nine cells, the hand and its trail.

import { ModelPlane, advise, circle, drawAdvice, drawTrail, lack, prepare, shade, worstOf } from "./canvas.js";

const MARGIN = { left: 48, right: 18, top: 10, bottom: 36 };
const CELLS = ["slow", "medium", "fast"];
const FORCES = ["light", "medium", "strong"];

export class Plane extends ModelPlane {
  draw(trail) {
    const { pen, width, height, colour } = prepare(this.canvas);
    this.colour = colour;
    this.area = {
      x: MARGIN.left, y: MARGIN.top,
      width: width - MARGIN.left - MARGIN.right, height: height - MARGIN.top - MARGIN.bottom,
    };
    this.#cells(pen);
    this.#axes(pen);
    if (this.model) this.#samples(pen);
    const { speed, force } = this.limits;
    if (this.advice) drawAdvice(pen, colour, this.#at(this.advice[0] / speed, this.advice[1] / force));
    drawTrail(pen, colour, trail.points, (point) => this.#at(point.speed / speed, point.force / force));
  }

  #at(u, v) {
    const { x, y, width, height } = this.area;
    return [x + Math.min(Math.max(u, 0), 1) * width, y + (1 - Math.min(Math.max(v, 0), 1)) * height];
  }

  #cells(pen) {
    const { cells } = this;
    if (!cells) return;
    cells.forEach((value, index) => {
      const column = index % 3, row = Math.floor(index / 3);
      const need = lack(value, this.limits, cells.length);
      const [x, y] = this.#at(column / 3, (row + 1) / 3);
      pen.fillStyle = shade(need, this.colour);
      pen.fillRect(x, y, this.area.width / 3, this.area.height / 3);
      pen.fillStyle = this.colour("ink");
      pen.textAlign = "left";
      pen.fillText(value.toFixed(2), x + 6, y + 16);
    });
  }

  #axes(pen) {
    const { x, y, width, height } = this.area;
    pen.strokeStyle = this.colour("line");
    pen.lineWidth = 1;
    pen.fillStyle = this.colour("ink");
    for (let i = 0; i <= 3; i++) {
      const [px] = this.#at(i / 3, 0), [, py] = this.#at(0, i / 3);
      pen.beginPath();
      pen.moveTo(px, y); pen.lineTo(px, y + height);
      pen.moveTo(x, py); pen.lineTo(x + width, py);
      pen.stroke();
      pen.textAlign = "center";
      pen.fillText(String(Math.round((i / 3) * this.limits.speed)), px, y + height + 15);
      pen.textAlign = "right";
      pen.fillText(((i / 3) * this.limits.force).toFixed(1), x - 6, py + 4);
    }
    pen.textAlign = "center";
    pen.fillText("speed, mm/s", x + width / 2, y + height + 31);
    pen.save();
    pen.translate(12, y + height / 2);
    pen.rotate(-Math.PI / 2);
    pen.fillText("force, N", 0, 0);
    pen.restore();
  }

  #samples(pen) {
    const { points, vertices, triangles } = this.model.arrays;
    if (triangles) {
      pen.strokeStyle = this.colour("faint");
      pen.globalAlpha = 0.45;
      pen.beginPath();
      for (let t = 0; t < triangles.length; t += 3) {
        const corners = [0, 1, 2].map((k) => triangles[t + k]);
        corners.forEach((c, k) => {
          const at = this.#at(vertices[2 * c], vertices[2 * c + 1]);
          k === 0 ? pen.moveTo(...at) : pen.lineTo(...at);
        });
        pen.closePath();
      }
      pen.stroke();
      pen.globalAlpha = 1;
    }
    pen.fillStyle = this.colour("measured");
    for (let i = 0; points && i < points.length; i += 2) {
      circle(pen, ...this.#at(points[i], points[i + 1]), 4);
      pen.fill();
    }
  }

  /** Say in words which stroke gains most; without advice, where the model lacks most. */
  describe() {
    const { model, cells, advice, limits } = this;
    const count = `${model.samples} samples, order ${model.order}.`;
    if (advice) return count + advise(advice);
    if (!cells) return count;
    const worst = worstOf(cells, limits);
    return `${count} Lacks most: ${CELLS[worst % 3]} strokes with ${FORCES[Math.floor(worst / 3)]} force.`;
  }
}
