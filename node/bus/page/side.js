/** What is not one sensor's: which model is active and why, and what has happened. */

import { element, setText } from "./dom.js";

const MARKS = { ok: "●", stale: "▲", lost: "■", never_seen: "○", trouble: "▲", model: "◆" };
const WORDS = { never_seen: "never seen", stale: "silent", model: "" };
const MOST_EVENTS = 100;

export function showModels(panel, models) {
  const entries = Object.entries(models);
  panel.hidden = !entries.length;
  const list = panel.querySelector("ul");
  for (const [name, { model, previous, reason, stamp }] of entries) {
    let row = list.querySelector(`[data-switch="${CSS.escape(name)}"]`);
    if (!row) {
      row = element("li", { "data-switch": name });
      row.append(element("span", { class: "name" }), element("b"), element("span", { class: "reason" }));
      list.append(row);
    }
    setText(row.children[0], name);
    setText(row.children[1], `${MARKS.model} ${model}`);
    const before = previous ? `before: ${previous}` : "the first";
    setText(row.children[2], `${reason} (since ${time(stamp)}, ${before})`);
  }
}

export class EventLog {
  constructor(panel) {
    this.list = panel.querySelector("ol");
    this.none = panel.querySelector(".none");
    this.last = 0;
  }

  reset() {
    this.last = 0;
    this.list.replaceChildren();
    this.none.hidden = false;
  }

  add(events) {
    for (const event of events) {
      if (event.id <= this.last) continue;
      this.last = event.id;
      this.none.hidden = true;
      const what = element("strong", {}, `${MARKS[event.state] ?? "●"} ${event.source} ${WORDS[event.state] ?? event.state}`);
      const row = element("li", { "data-state": event.state }, element("time", {}, time(event.stamp)), what);
      row.append(element("span", {}, event.text));
      this.list.prepend(row);
      while (this.list.children.length > MOST_EVENTS) this.list.lastChild.remove();
    }
  }
}

function time(stampMs) {
  return new Date(stampMs).toLocaleTimeString([], { hour12: false });
}
