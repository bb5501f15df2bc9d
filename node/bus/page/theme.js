/** Dark, light, or as the system says; and the colours that canvases draw with. */

import { element, remember, remembered, setText } from "./dom.js";

const ORDER = ["auto", "dark", "light"];
const NAMES = { auto: "Auto", dark: "Dark", light: "Light" };
const probe = element("i", { hidden: "" });
let colours = {};

/** Colour by name of its custom property, e.g. colour("estimated"), as the theme resolves it. */
export function colour(name) {
  if (!(name in colours)) {
    probe.style.color = `var(--${name})`;
    colours[name] = getComputedStyle(probe).color;
  }
  return colours[name];
}

export function startTheme(button) {
  document.body.append(probe);
  const use = (theme) => {
    document.documentElement.dataset.theme = theme;
    setText(button, NAMES[theme]);
    button.setAttribute("aria-label", `Colours: ${NAMES[theme]}. Change`);
    colours = {};
  };
  button.addEventListener("click", () => {
    const next = ORDER[(ORDER.indexOf(document.documentElement.dataset.theme) + 1) % ORDER.length];
    use(next);
    remember("theme", next);
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => (colours = {}));
  const before = remembered("theme", "auto");
  use(ORDER.includes(before) ? before : "auto");
}
