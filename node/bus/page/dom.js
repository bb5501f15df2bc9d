/** Small helpers for elements: build them, and change only what has changed. */

/** Build an element from its name, attributes and children (elements or text). */
export function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

export function setText(target, text) {
  if (target.textContent !== text) target.textContent = text;
}

export function setAttribute(target, name, value) {
  if (target.getAttribute(name) !== value) target.setAttribute(name, value);
}

/** A group of buttons of which one is pressed; calls back with the chosen value. */
export function choice(label, values, chosen, onChoose) {
  const group = element("div", { role: "group", "aria-label": label, class: "choice" });
  const press = (value) => {
    for (const button of group.children) {
      button.setAttribute("aria-pressed", String(button.dataset.value === String(value)));
    }
  };
  for (const [value, text] of values) {
    const button = element("button", { type: "button", "data-value": value }, text);
    button.addEventListener("click", () => {
      press(value);
      onChoose(value);
    });
    group.append(button);
  }
  press(chosen);
  return group;
}

/** Remember a viewer's choice where the browser lets us. */
export function remember(key, value) {
  try {
    localStorage.setItem(`murk-${key}`, value);
  } catch {
    // Private windows may forbid it; the choice then lasts as long as the page.
  }
}

export function remembered(key, otherwise) {
  try {
    return localStorage.getItem(`murk-${key}`) ?? otherwise;
  } catch {
    return otherwise;
  }
}

/** Fit a canvas to its box in device pixels; returns a context that draws in CSS pixels. */
export function fitted(canvas) {
  const { clientWidth: width, clientHeight: height } = canvas;
  const scale = window.devicePixelRatio || 1;
  const [w, h] = [Math.round(width * scale), Math.round(height * scale)];
  if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
  const context = canvas.getContext("2d");
  context.setTransform(scale, 0, 0, scale, 0, 0);
  context.clearRect(0, 0, width, height);
  return { context, width, height };
}

export const FONT = "system-ui, sans-serif";
