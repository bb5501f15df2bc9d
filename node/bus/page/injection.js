/** Buttons and sliders that inject: a button a kind, a slider for each kind that is on. */

import { element, setAttribute, setText } from "./dom.js";

const FIRST = 4; // kinds shown at once; the others on request
const FIRST_LEVEL = 50;
const SETTLE_MS = 1200; // how long a slider that was moved is not overruled by the node's report
const SEND_MS = 120;

export class Injection {
  constructor(sensor, ask) {
    this.sensor = sensor.name;
    this.ask = ask;
    this.injected = {};
    this.sliders = new Map();
    this.buttons = new Map(sensor.kinds.map((kind) => [kind, this.button(kind)]));
    this.message = element("p", { class: "refused", role: "alert", hidden: "" });
    this.rows = element("div", { class: "sliders" });
    this.element = element("section", { class: "inject", "aria-label": `Injection into ${sensor.name}` });
    this.element.append(this.heading(), this.chips(), this.rows, this.message);
  }

  heading() {
    const off = element("button", { type: "button", class: "quiet" }, "All off");
    off.addEventListener("click", () => {
      for (const kind of new Set([...Object.keys(this.injected), ...this.sliders.keys()])) this.set(kind, 0);
    });
    const scene = element("button", { type: "button", class: "quiet" }, "As in the scene");
    scene.addEventListener("click", () => {
      for (const kind of this.buttons.keys()) this.send(kind, null);
      this.sliders.forEach((slider) => (slider.touchedAt = -Infinity));
    });
    return element("header", {}, element("h3", {}, "Inject"), scene, off);
  }

  chips() {
    const group = element("div", { class: "kinds-on-off", role: "group", "aria-label": "Kinds" });
    const others = [...this.buttons.values()].slice(FIRST);
    const more = element("button", { type: "button", class: "quiet", "aria-expanded": "false" });
    const show = (all) => {
      others.forEach((button) => (button.hidden = !all && button.getAttribute("aria-pressed") !== "true"));
      more.setAttribute("aria-expanded", String(all));
      setText(more, all ? "Fewer" : `${others.length} more`);
    };
    more.addEventListener("click", () => show(more.getAttribute("aria-expanded") !== "true"));
    show(false);
    group.append(...this.buttons.values(), more);
    return group;
  }

  button(kind) {
    const button = element("button", { type: "button", "aria-pressed": "false", "data-kind": kind });
    button.append(element("span", {}, kind.replaceAll("_", " ")), element("b"));
    button.addEventListener("click", () => {
      this.set(kind, button.getAttribute("aria-pressed") === "true" ? 0 : FIRST_LEVEL);
    });
    return button;
  }

  slider(kind) {
    const name = kind.replaceAll("_", " ");
    const input = element("input", {
      type: "range", min: "0", max: "100", step: "5",
      "aria-label": `Level of ${name} in ${this.sensor}`, "data-kind": kind,
    });
    const value = element("output");
    const row = element("label", { class: "slider" }, element("span", {}, name), input, value);
    const slider = { input, value, row, touchedAt: -Infinity, sent: 0, timer: null };
    input.addEventListener("input", () => this.moved(kind, slider));
    this.sliders.set(kind, slider);
    this.rows.append(row);
    return slider;
  }

  /** Send at most every SEND_MS while a slider moves, and its last position always. */
  moved(kind, slider) {
    slider.touchedAt = performance.now();
    paint(slider, Number(slider.input.value));
    slider.timer ??= setTimeout(() => {
      slider.timer = null;
      this.send(kind, Number(slider.input.value));
    }, SEND_MS);
  }

  set(kind, level) {
    const slider = this.sliders.get(kind) ?? this.slider(kind);
    slider.touchedAt = level > 0 ? performance.now() : -Infinity;
    paint(slider, level);
    this.send(kind, level);
  }

  async send(kind, level) {
    const answer = await this.ask(this.sensor, kind, level);
    this.message.hidden = answer.ok;
    if (!answer.ok) {
      const parts = [answer.where, answer.what, answer.remedy].filter(Boolean);
      setText(this.message, `Not done: ${parts.join(", ")}`);
    }
  }

  /** Show what the node says that it injects. */
  show(injected) {
    this.injected = injected ?? {};
    const now = performance.now();
    for (const [kind, button] of this.buttons) {
      const level = this.injected[kind] ?? 0;
      setAttribute(button, "aria-pressed", String(level > 0));
      setText(button.lastChild, level > 0 ? `${Math.round(level)} %` : "");
      if (level > 0) button.hidden = false;
      let slider = this.sliders.get(kind);
      if (level > 0 && !slider) slider = this.slider(kind);
      if (!slider || now - slider.touchedAt < SETTLE_MS) continue;
      if (level > 0 || document.activeElement === slider.input) {
        paint(slider, level);
      } else {
        slider.row.remove();
        this.sliders.delete(kind);
      }
    }
  }

  enable(enabled) {
    for (const control of this.element.querySelectorAll("button, input")) control.disabled = !enabled;
  }
}

function paint(slider, level) {
  slider.input.value = String(level);
  slider.input.style.setProperty("--share", `${level}%`);
  setText(slider.value, `${Math.round(level)} %`);
}
