/** All about one sensor: how bad it is now, why, what it sees, and its last minute. */

import { BirdsEye } from "./birds_eye.js";
import { Chart } from "./chart.js";
import { element, setAttribute, setText } from "./dom.js";
import { Injection } from "./injection.js";
import { Picture } from "./picture.js";

const KINDS_SHOWN = 5;
const FAIR = 20;
const POOR = 50;
const MARKS = { good: "●", fair: "▲", poor: "■", unknown: "○" };
const HEALTH = { ok: "ok", stale: "silent", lost: "lost", never_seen: "never seen" };
const SILENT_CYCLES = 3;
const SHORTEST_SILENCE_MS = 1000;

export class Card {
  constructor(sensor, ask) {
    this.sensor = sensor;
    this.record = null;
    this.parts = {};
    this.element = element("article", {
      class: "card", id: `sensor-${sensor.name}`, "data-sensor": sensor.name, "data-type": sensor.type,
      "aria-label": `${sensor.type} ${sensor.name}`, tabindex: "-1",
    });
    const view = element("figure", { class: "view" });
    this.view = sensor.type === "camera" ? new Picture(view) : new BirdsEye(sensor.name, view);
    this.age = element("p", { class: "age", hidden: "" });
    view.append(this.age);
    const sees = element("div", { class: "sees" }, view, this.facts());
    this.element.append(this.heading(), this.nowPart(), sees, this.chartPart());
    if (sensor.kinds.length) {
      this.injection = new Injection(sensor, ask);
      this.element.append(this.injection.element);
    }
    this.tile = this.makeTile();
  }

  part(name, kind = "span", attributes = {}) {
    return (this.parts[name] = element(kind, { "data-value": name, ...attributes }));
  }

  heading() {
    const title = element("h2", {}, this.sensor.name.replaceAll("_", " "));
    const source = element("span", { class: "source", title: this.sensor.source });
    const type = this.sensor.name === this.sensor.type ? "" : `${this.sensor.type} · `;
    source.append(type + this.sensor.source);
    return element("header", {}, title, source, this.part("injecting", "span", { class: "chip warn", hidden: "" }),
      this.part("health", "span", { class: "chip" }));
  }

  nowPart() {
    const figure = element("p", { class: "figure" }, this.part("level", "output"), element("small", {}, "%"));
    const words = element("p", { class: "words" }, this.part("verdict", "strong"), this.part("std"),
      this.part("injected", "span", { class: "injected" }));
    this.gauge = element("div", { class: "gauge", role: "meter", "aria-valuemin": "0", "aria-valuemax": "100" });
    this.gauge.setAttribute("aria-label", `Estimated noise level of ${this.sensor.name}`);
    this.gauge.append(...["fill", "band", "mark"].map((name) => element("i", { class: name })));
    const scale = element("div", { class: "scale", "aria-hidden": "true" });
    for (const level of [0, FAIR, POOR, 100]) {
      const tick = element("span", {}, String(level));
      tick.style.left = `${level}%`;
      scale.append(tick);
    }
    const meter = element("div", { class: "meter" }, this.gauge, scale);
    return element("section", { class: "now", "aria-label": "Noise level" }, figure, words, meter);
  }

  facts() {
    this.kinds = element("ul", { class: "kinds", "aria-label": "Kind of noise, probability" });
    const stats = element("dl", { class: "stats" });
    for (const [name, label] of [["rate", "Rate"], ["dropped", "Dropped"], ["p50", "Latency p50"], ["p99", "Latency p99"]]) {
      stats.append(element("div", {}, element("dt", {}, label), this.part(name, "dd")));
    }
    return element("section", { class: "facts", "aria-label": "Kind, rate and latency" }, this.kinds, stats);
  }

  chartPart() {
    const canvas = element("canvas", { role: "img" });
    canvas.setAttribute("aria-label", `Noise level of ${this.sensor.name} over the last minute`);
    const injectable = this.sensor.kinds.length > 0;
    this.chart = new Chart(canvas, injectable);
    const caption = element("figcaption", {}, element("span", { class: "key" }, "estimated ± σ"));
    if (injectable) caption.append(element("span", { class: "key injected" }, "injected"));
    return element("figure", { class: "chart" }, caption, canvas);
  }

  makeTile() {
    const tile = element("a", { href: `#sensor-${this.sensor.name}` });
    tile.append(element("span", {}, this.sensor.name.replaceAll("_", " ")), element("b"));
    return tile;
  }

  /** Take in a snapshot; `anew` where it is the whole state. */
  take(record, anew) {
    this.record = record;
    if (anew) this.chart.reset();
    this.chart.add(record.points);
    if (record.scan) this.view.show(record.scan);
    this.injection?.show(record.injected);
    this.showKinds(record.kinds ?? {}, record.kind);
    const injected = Object.entries(record.injected ?? {});
    setText(this.parts.injecting, injected.length ? "injecting" : "");
  }

  /** Show the likeliest kinds, the likeliest first; equals stay in the node's order. */
  showKinds(kinds, likeliest) {
    const percents = Object.entries(kinds).map(([kind, p]) => [kind, Math.round(p * 100)]);
    const first = percents.sort(([, one], [, other]) => other - one).slice(0, KINDS_SHOWN);
    while (this.kinds.children.length < first.length) {
      this.kinds.append(element("li", {}, element("span"), element("i"), element("b")));
    }
    first.forEach(([kind, percent], i) => {
      const [name, bar, value] = this.kinds.children[i].children;
      setText(name, kind.replaceAll("_", " "));
      bar.style.setProperty("--share", `${percent}%`);
      setText(value, `${percent} %`);
      this.kinds.children[i].classList.toggle("likeliest", kind === likeliest);
    });
  }

  /** Why the newest level is not the present one, and how old it is; null where it is present. */
  silence(now, linked) {
    if (!this.record || this.record.t === undefined) return ["no data yet", ""];
    const age = now - this.record.t;
    const old = `${(age / 1000).toFixed(age < 10000 ? 1 : 0)} s old`;
    if (!linked) return ["not live", old];
    const cycle = 1000 / (this.record.rate ?? 10);
    const silent = age > Math.max(SHORTEST_SILENCE_MS, SILENT_CYCLES * cycle);
    const health = this.record.health;
    if (silent || (health && health !== "ok")) return [HEALTH[health] ?? "silent", old];
    return null;
  }

  /** Show values, or that there are none; called often. */
  refresh(now, linked) {
    const silence = this.silence(now, linked);
    const { record, parts } = this;
    const verdict = silence ? "unknown" : verdictOf(Math.round(record.level));
    setAttribute(this.element, "data-verdict", verdict);
    setAttribute(this.tile, "data-verdict", verdict);
    const number = silence ? "–" : String(Math.round(record.level));
    setText(parts.level, number);
    setText(this.tile.lastChild, `${MARKS[verdict]} ${number} %`);
    setText(parts.verdict, `${MARKS[verdict]} ${silence ? silence[0] : wordsOf(verdict, record)}`);
    setText(parts.std, silence ? silence[1] : `± ${record.std.toFixed(record.std < 10 ? 1 : 0)} %`);
    setText(parts.injected, silence ? "" : injectedText(record));
    parts.injecting.hidden = Boolean(silence) || !parts.injecting.textContent;
    setText(parts.health, silence ? silence[0] : "live");
    setAttribute(parts.health, "data-state", silence ? "bad" : "good");
    setText(parts.rate, silence || !record.rate ? "–" : `${record.rate.toFixed(1)} Hz`);
    setText(parts.dropped, record?.dropped === undefined ? "–" : String(record.dropped));
    setText(parts.p50, milliseconds(record?.p50));
    setText(parts.p99, milliseconds(record?.p99));
    this.age.hidden = !silence || record?.t === undefined;
    setText(this.age, silence?.join(", ") ?? "");
    this.showGauge(silence);
    this.injection?.enable(linked);
  }

  showGauge(silence) {
    const { level = 0, std = 0, injected } = this.record ?? {};
    const style = this.gauge.style;
    setAttribute(this.gauge, "aria-valuenow", silence ? "0" : String(level));
    setAttribute(this.gauge, "aria-valuetext", silence?.join(", ") ?? `${Math.round(level)} percent, plus or minus ${Math.round(std)}`);
    style.setProperty("--level", silence ? "0%" : `${level}%`);
    style.setProperty("--low", `${silence ? 0 : Math.max(0, level - std)}%`);
    style.setProperty("--high", `${silence ? 0 : Math.min(100, level + std)}%`);
    const strongest = silence ? 0 : Math.max(0, ...Object.values(injected ?? {}));
    style.setProperty("--injected-level", `${strongest}%`);
    this.gauge.classList.toggle("has-injected", strongest > 0);
  }

  draw(now) {
    this.chart.draw(now);
    this.view.draw();
  }
}

function verdictOf(level) {
  return level < FAIR ? "good" : level < POOR ? "fair" : "poor";
}

function wordsOf(verdict, { kind }) {
  return kind === "clean" ? verdict : `${verdict}, ${kind.replaceAll("_", " ")}`;
}

function injectedText({ injected }) {
  const parts = Object.entries(injected ?? {}).map(
    ([kind, level]) => `${kind.replaceAll("_", " ")} ${Math.round(level)}\u00a0%`,
  );
  return parts.length ? `injected: ${parts.join(", ")}` : "";
}

function milliseconds(value) {
  return value === undefined ? "–" : `${value.toFixed(value < 10 ? 1 : 0)} ms`;
}
