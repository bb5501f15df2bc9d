/** A radar scan from above: ahead is up, left is left; on dark ground in either theme. */

import { FONT, choice, element, fitted, remember, remembered } from "./dom.js";

// ARS 408-21: near scan 70 m within ±45° and 20 m at ±60°, far scan 250 m within ±9°.
const NEAR = { range: 70, angle: 45, edgeRange: 20, edgeAngle: 60 };
const FAR = { range: 250, angle: 9 };
const NAMES_ANGLE = 48;
const RINGS = { 50: 10, 100: 25, 250: 50 };
const GROUND = "#0a0e13";
const LINE = "#33414f";
const VIEW = "#14212d";
const TEXT = "#b4c0cc";

// Lightness rises with RCS; approaching and receding are orange and blue: both are told apart
// without red and green.
const COLOURS = {
  rcs: { stops: ["#5560c8", "#2d8fbd", "#2fc0a0", "#8fdc5a", "#fdee4f"], from: -15, to: 25, unit: "dBm²" },
  doppler: { stops: ["#ff8c1a", "#ffc58a", "#d8dee5", "#8fc4ff", "#2f8dff"], from: -20, to: 20, unit: "m/s" },
};
const SHADES = 32;

export class BirdsEye {
  constructor(sensor, figure) {
    this.scan = null;
    this.range = Number(remembered(`range-${sensor}`, "100"));
    if (!(this.range in RINGS)) this.range = 100;
    this.mode = remembered(`colour-${sensor}`, "rcs") === "doppler" ? "doppler" : "rcs";
    this.canvas = element("canvas", { role: "img", "aria-label": "Radar points from above" });
    this.dirty = true;
    const ranges = Object.keys(RINGS).map((range) => [range, range]);
    ranges.at(-1)[1] += " m";
    figure.append(
      this.canvas,
      element(
        "div",
        { class: "tools" },
        choice("Points coloured by", [["rcs", "RCS"], ["doppler", "Doppler"]], this.mode, (mode) => {
          this.mode = mode;
          this.dirty = true;
          remember(`colour-${sensor}`, mode);
        }),
        choice("Range shown", ranges, this.range, (range) => {
          this.range = Number(range);
          this.dirty = true;
          remember(`range-${sensor}`, range);
        }),
      ),
    );
    new ResizeObserver(() => (this.dirty = true)).observe(this.canvas);
  }

  show(scan) {
    this.scan = scan;
    this.dirty = true;
    this.canvas.setAttribute("aria-label", `Radar from above: ${scan.x.length} points`);
  }

  draw() {
    if (!this.dirty || !this.canvas.clientWidth) return;
    this.dirty = false;
    const { context, width, height } = fitted(this.canvas);
    context.fillStyle = GROUND;
    context.fillRect(0, 0, width, height);
    const origin = { x: width / 2, y: height - 26 };
    const scale = (origin.y - 24) / this.range; // pixels a metre; room for the outer ring's label
    drawView(context, origin, scale);
    this.drawRings(context, origin, scale, width);
    this.drawPoints(context, origin, scale);
    this.nameRings(context, origin, scale, width);
    drawVehicle(context, origin);
    this.drawKey(context, width, height);
  }

  drawRings(context, origin, scale, width) {
    context.strokeStyle = LINE;
    context.lineWidth = 1;
    const furthest = Math.hypot(width / 2, origin.y) / scale;
    const step = RINGS[this.range];
    for (let metres = step; metres < furthest; metres += step) {
      context.beginPath();
      context.arc(origin.x, origin.y, metres * scale, Math.PI, 2 * Math.PI);
      context.stroke();
    }
  }

  /** Name every other ring where it leaves the field of view, clear of most points. */
  nameRings(context, origin, scale, width) {
    context.fillStyle = TEXT;
    context.font = `13px ${FONT}`;
    context.textAlign = "left";
    context.textBaseline = "middle";
    for (let metres = 2 * RINGS[this.range]; metres <= this.range; metres += 2 * RINGS[this.range]) {
      const angle = ((NAMES_ANGLE - 90) * Math.PI) / 180;
      const column = origin.x + metres * scale * Math.cos(angle);
      context.fillText(`${metres} m`, Math.min(column + 4, width - 46), origin.y + metres * scale * Math.sin(angle));
    }
  }

  /** Points of one shade together: a path a shade instead of a fill a point. */
  drawPoints(context, origin, scale) {
    if (!this.scan) return;
    const { x, y } = this.scan;
    const size = this.range > 100 ? 2.2 : 3.2;
    const { from, to } = COLOURS[this.mode];
    const values = this.mode === "rcs" ? this.scan.rcs : radialSpeeds(this.scan);
    const paths = Array.from({ length: SHADES }, () => new Path2D());
    for (let i = 0; i < x.length; i++) {
      const shade = Math.floor(((values[i] - from) / (to - from)) * SHADES);
      const path = paths[Math.max(0, Math.min(SHADES - 1, shade))];
      const column = origin.x - (y[i] / 10) * scale;
      const row = origin.y - (x[i] / 10) * scale;
      path.moveTo(column + size, row);
      path.arc(column, row, size, 0, 2 * Math.PI);
    }
    paths.forEach((path, shade) => {
      context.fillStyle = shadeOf(this.mode, (shade + 0.5) / SHADES);
      context.fill(path);
    });
  }

  drawKey(context, width, height) {
    const { stops, from, to, unit } = COLOURS[this.mode];
    const wide = Math.min(110, width * 0.25);
    const [left, top] = [10, height - 12];
    const gradient = context.createLinearGradient(left, 0, left + wide, 0);
    stops.forEach((stop, i) => gradient.addColorStop(i / (stops.length - 1), stop));
    context.fillStyle = gradient;
    context.fillRect(left, top, wide, 5);
    context.fillStyle = TEXT;
    context.textBaseline = "bottom";
    context.textAlign = "left";
    context.fillText(`−${-from} to ${to} ${unit}`, left, top - 3);
    context.textAlign = "right";
    context.fillText(`${this.scan?.x.length ?? 0} points`, width - 10, height - 6);
  }
}

/** Radial speed in m/s from the relative velocity; below zero comes closer. */
function radialSpeeds({ x, y, vx, vy }) {
  return x.map((ahead, i) => (ahead * vx[i] + y[i] * vy[i]) / (10 * Math.max(1, Math.hypot(ahead, y[i]))));
}

function drawView(context, origin, scale) {
  const at = (range, degrees) => {
    const angle = (degrees * Math.PI) / 180;
    return [origin.x + range * scale * Math.sin(angle), origin.y - range * scale * Math.cos(angle)];
  };
  context.fillStyle = VIEW;
  for (const outline of [nearOutline(), farOutline()]) {
    context.beginPath();
    context.moveTo(origin.x, origin.y);
    for (const [range, degrees] of outline) context.lineTo(...at(range, degrees));
    context.fill();
  }
}

function nearOutline() {
  const { range, angle, edgeRange, edgeAngle } = NEAR;
  const front = Array.from({ length: 19 }, (_, i) => [range, -angle + (2 * angle * i) / 18]);
  return [[edgeRange, -edgeAngle], ...front, [edgeRange, edgeAngle]];
}

function farOutline() {
  return Array.from({ length: 7 }, (_, i) => [FAR.range, -FAR.angle + (2 * FAR.angle * i) / 6]);
}

function drawVehicle(context, { x, y }) {
  context.fillStyle = "#f2f6fa";
  context.beginPath();
  context.moveTo(x, y - 9);
  context.lineTo(x + 7, y + 7);
  context.lineTo(x, y + 3);
  context.lineTo(x - 7, y + 7);
  context.fill();
}

const shades = new Map();

function shadeOf(mode, share) {
  const key = `${mode}${share}`;
  if (!shades.has(key)) {
    const { stops } = COLOURS[mode];
    const place = share * (stops.length - 1);
    const [one, other] = [stops[Math.floor(place)], stops[Math.ceil(place)]];
    shades.set(key, mix(one, other, place % 1));
  }
  return shades.get(key);
}

function mix(one, other, share) {
  const part = (text, i) => parseInt(text.slice(1 + 2 * i, 3 + 2 * i), 16);
  const channels = [0, 1, 2].map((i) => Math.round(part(one, i) * (1 - share) + part(other, i) * share));
  return `rgb(${channels.join(" ")})`;
}
