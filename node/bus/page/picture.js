/** The newest picture of a camera. */

import { element } from "./dom.js";

export class Picture {
  constructor(figure) {
    this.canvas = element("canvas", { role: "img", "aria-label": "Newest picture of the camera" });
    this.note = element("p", { class: "waiting" }, "no picture yet");
    this.busy = false;
    figure.append(this.canvas, this.note);
  }

  /** Decode away from the page's own thread; a picture that comes meanwhile is left out. */
  async show(blob) {
    if (this.busy) return;
    this.busy = true;
    try {
      const bitmap = await createImageBitmap(blob);
      [this.canvas.width, this.canvas.height] = [bitmap.width, bitmap.height];
      this.canvas.getContext("2d").drawImage(bitmap, 0, 0);
      bitmap.close();
      this.note.hidden = true;
    } finally {
      this.busy = false;
    }
  }

  draw() {}
}
