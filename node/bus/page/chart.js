/** The last minute of one sensor: estimated level with its uncertainty, and what was injected. */

import { FONT, fitted } from "./dom.js";
import { colour } from "./theme.js";

export const SPAN_MS = 60000;
const GAP_MS = 1500; // a line does not bridge a longer silence
const LEFT = 34;
const RIGHT = 10;
const TOP = 10;
const BOTTOM = 22;
const LINES = [0, 20, 50, 100]; // the ends, and where "fair" and "poor" begin

export class Chart {
  constructor(canvas, injectable) {
    this.canvas = canvas;
    this.injectable = injectable;
    this.points = []; // [t in ms, level, std, injected or null]
  }

  reset() {
    this.points = [];
  }

  add(points) {
    let last = this.points.at(-1)?.[0] ?? -1;
    for (const point of points) {
      if (point[0] > last) {
        this.points.push(point);
        last = point[0];
      }
    }
  }

  draw(now) {
    const { context, width, height } = fitted(this.canvas);
    if (width < 40 || height < 40) return;
    while (this.points.length > 1 && this.points[1][0] < now - SPAN_MS) this.points.shift();
    const x = (t) => LEFT + (1 - (now - t) / SPAN_MS) * (width - LEFT - RIGHT);
    const y = (level) => TOP + (1 - level / 100) * (height - TOP - BOTTOM);
    this.drawGrid(context, x, y, now, width);
    context.save();
    context.beginPath();
    context.rect(LEFT, 0, width - LEFT - RIGHT, height);
    context.clip();
    this.drawSilence(context, x, y, now);
    for (const run of this.runs()) {
      drawBand(context, x, y, run);
      drawEstimated(context, x, y, run);
      if (this.injectable) drawInjected(context, x, y, run);
    }
    context.restore();
    this.drawNewest(context, x, y, now);
  }

  drawGrid(context, x, y, now, width) {
    context.font = `13px ${FONT}`;
    context.fillStyle = colour("muted");
    context.lineWidth = 1;
    context.textBaseline = "middle";
    context.textAlign = "right";
    for (const level of LINES) {
      const row = Math.round(y(level)) + 0.5;
      context.strokeStyle = colour(level === 0 ? "axis" : "grid");
      context.beginPath();
      context.moveTo(LEFT, row);
      context.lineTo(width - RIGHT, row);
      context.stroke();
      context.fillText(String(level), LEFT - 6, row);
    }
    context.textBaseline = "top";
    const under = y(0) + 6;
    for (const [seconds, text, align] of [[60, "60 s ago", "left"], [30, "30 s", "center"], [0, "now", "right"]]) {
      context.textAlign = align;
      context.fillText(text, x(now - seconds * 1000), under);
    }
  }

  /** Hatch the time since the last news, where that is long. */
  drawSilence(context, x, y, now) {
    const last = this.points.at(-1)?.[0];
    if (last === undefined || now - last < GAP_MS) return;
    const from = Math.max(LEFT, x(last));
    const [top, bottom] = [y(100), y(0)];
    context.save();
    context.beginPath();
    context.rect(from, top, x(now) - from, bottom - top);
    context.clip();
    context.strokeStyle = colour("axis");
    context.beginPath();
    for (let at = from - (bottom - top); at < x(now); at += 9) {
      context.moveTo(at, bottom);
      context.lineTo(at + bottom - top, top);
    }
    context.stroke();
    context.restore();
  }

  /** Stretches of points without a silence between them. */
  *runs() {
    let from = 0;
    for (let i = 1; i <= this.points.length; i++) {
      if (i === this.points.length || this.points[i][0] - this.points[i - 1][0] > GAP_MS) {
        yield this.points.slice(from, i);
        from = i;
      }
    }
  }

  drawNewest(context, x, y, now) {
    const point = this.points.at(-1);
    if (!point || now - point[0] > GAP_MS) return;
    context.fillStyle = colour("estimated");
    context.beginPath();
    context.arc(x(point[0]), y(point[1]), 4, 0, 2 * Math.PI);
    context.fill();
  }
}

function drawBand(context, x, y, points) {
  context.fillStyle = colour("band");
  context.beginPath();
  for (const [t, level, std] of points) context.lineTo(x(t), y(Math.min(100, level + std)));
  for (const [t, level, std] of points.toReversed()) {
    context.lineTo(x(t), y(Math.max(0, level - std)));
  }
  context.fill();
}

/** What was injected holds until the next message; null is nothing. */
function drawInjected(context, x, y, points) {
  context.strokeStyle = colour("injected");
  context.lineWidth = 2;
  context.setLineDash([6, 6]);
  context.beginPath();
  let before = points[0][3] ?? 0;
  for (const [t, , , injected] of points) {
    const level = injected ?? 0;
    if (level !== before) context.lineTo(x(t), y(before));
    context.lineTo(x(t), y(level));
    before = level;
  }
  context.stroke();
  context.setLineDash([]);
}

function drawEstimated(context, x, y, points) {
  context.strokeStyle = colour("estimated");
  context.lineWidth = 3;
  context.lineJoin = "round";
  context.beginPath();
  for (const [t, level] of points) context.lineTo(x(t), y(level));
  context.stroke();
}
