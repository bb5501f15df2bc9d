/** The connection to the node: reconnects by itself, and knows how old its news is. */

const SILENT_MS = 1500; // ten snapshots a second come while the node lives
const GIVE_UP_MS = 5000; // a connection that is silent for longer is made anew
const LONGEST_WAIT_MS = 5000;
const ANSWER_MS = 5000;

export class Link {
  /**
   * @param {object} handlers onState(snapshot), onImage(index, Blob), onChange(state).
   * The state is "connecting", "live", "silent" or "disconnected".
   */
  constructor(handlers) {
    this.handlers = handlers;
    this.state = "connecting";
    this.heardAt = null; // performance.now() of the last news
    this.retryAt = 0;
    this.wait = 250;
    this.answers = new Map();
    this.count = 0;
    this.connect();
    setInterval(() => this.watch(), 250);
  }

  connect() {
    this.retryAt = Infinity;
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/live`);
    this.socket = socket;
    socket.binaryType = "arraybuffer";
    socket.addEventListener("message", ({ data }) => {
      if (socket === this.socket) this.hear(data);
    });
    socket.addEventListener("close", () => {
      if (socket === this.socket) this.lose();
    });
  }

  hear(data) {
    if (typeof data !== "string") {
      const index = new Uint8Array(data, 0, 1)[0];
      this.handlers.onImage(index, new Blob([new Uint8Array(data, 1)], { type: "image/jpeg" }));
      return;
    }
    const message = JSON.parse(data);
    if (message.type === "answer") {
      this.answers.get(message.id)?.(message);
      this.answers.delete(message.id);
      return;
    }
    this.heardAt = performance.now();
    this.wait = 250;
    this.become("live");
    this.handlers.onState(message);
  }

  lose() {
    this.become("disconnected");
    for (const give of this.answers.values()) give({ ok: false, what: "the connection is lost" });
    this.answers.clear();
    this.retryAt = performance.now() + this.wait * (0.75 + 0.5 * Math.random());
    this.wait = Math.min(LONGEST_WAIT_MS, this.wait * 2);
    this.reloadIfTokenIsAsked();
  }

  /** A WebSocket does not tell why it was refused; the page itself does. */
  async reloadIfTokenIsAsked() {
    try {
      if ((await fetch("/", { cache: "no-store" })).status === 401) location.reload();
    } catch {
      // The node is not there; the next attempt will show.
    }
  }

  watch() {
    const now = performance.now();
    if (this.state === "disconnected" && now >= this.retryAt) this.connect();
    if (this.state === "live" && now - this.heardAt > SILENT_MS) this.become("silent");
    if (this.state === "silent" && now - this.heardAt > GIVE_UP_MS) this.drop();
    this.handlers.onChange(this.state);
  }

  /** Leave a connection that says nothing; its own closing could take minutes. */
  drop() {
    const socket = this.socket;
    this.socket = null;
    socket.close();
    this.lose();
  }

  retryNow() {
    this.wait = 250;
    if (this.state === "disconnected") this.retryAt = 0;
    this.watch();
  }

  become(state) {
    if (this.state === state) return;
    this.state = state;
    this.handlers.onChange(state);
  }

  /** Ask for an injection; level null gives the kind back to the scene. Resolves to the answer. */
  inject(sensor, kind, level) {
    if (this.state !== "live") return Promise.resolve({ ok: false, what: "not connected" });
    const id = ++this.count;
    return new Promise((resolve) => {
      this.answers.set(id, resolve);
      setTimeout(() => {
        if (this.answers.delete(id)) resolve({ ok: false, what: "the node does not answer" });
      }, ANSWER_MS);
      this.socket.send(JSON.stringify({ id, sensor, kind, level }));
    });
  }
}
