/** Puts the page together: snapshots in, cards and panels out. */

import { Card } from "./card.js";
import { setAttribute, setText } from "./dom.js";
import { Link } from "./link.js";
import { EventLog, showModels } from "./side.js";
import { startTheme } from "./theme.js";

const FRAME_MS = 1000 / 30;
const REFRESH_MS = 100;
const HEARTBEAT_LOST_MS = 3000;
const LINK_WORDS = { connecting: "Connecting", live: "Live", silent: "Not live", disconnected: "Disconnected" };

const find = (id) => document.getElementById(id);
const log = new EventLog(find("log"));
let cards = [];
let sceneText = "";
let offset = null; // performance.now() minus the node's own time, ms
let node = null;
let nodeAt = 0;

startTheme(find("theme"));
const link = new Link({ onState, onImage, onChange: onLinkChange });
find("banner").querySelector("button").addEventListener("click", () => link.retryNow());
requestAnimationFrame(frame);
setInterval(refresh, REFRESH_MS);

function onState(snapshot) {
  const anew = snapshot.type === "full";
  const lag = performance.now() - snapshot.now;
  if (anew) {
    build(snapshot.scene);
    log.reset();
    offset = lag;
  }
  offset = Math.min(lag, offset + 1); // the quickest message tells the offset best
  for (const card of cards) card.take(snapshot.sensors[card.sensor.name], anew);
  log.add(snapshot.events);
  showModels(find("models"), snapshot.models);
  [node, nodeAt] = [snapshot.node, performance.now()];
}

/** Make the cards, where the scene is another than before. */
function build(scene) {
  const text = JSON.stringify(scene);
  if (text === sceneText) return;
  sceneText = text;
  document.title = `${scene.name} · murk`;
  setText(find("scene"), scene.name);
  cards = scene.sensors.map((sensor) => new Card(sensor, (...request) => link.inject(...request)));
  find("sensors").replaceChildren(...cards.map((card) => card.element));
  find("overview").replaceChildren(...cards.map((card) => card.tile));
  find("overview").hidden = cards.length < 2;
  find("overview").dataset.many = String(cards.length > 3);
}

function onImage(index, blob) {
  cards[index]?.view.show(blob);
}

function onLinkChange(state) {
  setAttribute(document.body, "data-link", state);
  setText(find("link").querySelector(".text"), LINK_WORDS[state]);
  const banner = find("banner");
  banner.hidden = state === "live" || (state === "connecting" && cards.length === 0);
  banner.querySelector("button").hidden = state !== "disconnected";
  if (!banner.hidden) setText(banner.querySelector(".text"), bannerText(state));
}

function bannerText(state) {
  const since = link.heardAt === null ? null : Math.round((performance.now() - link.heardAt) / 1000);
  const last = since === null ? "" : ` The last news came ${since} s ago.`;
  if (state === "silent") return `The node says nothing.${last}`;
  return `No connection to the node.${last} Trying again by itself.`;
}

function refresh() {
  if (offset === null) return;
  const now = performance.now() - offset;
  for (const card of cards) card.refresh(now, link.state === "live");
  showNode();
}

function showNode() {
  const chip = find("node");
  const age = node ? node.age + performance.now() - nodeAt : 0;
  const beating = Boolean(node) && link.state === "live" && age < HEARTBEAT_LOST_MS;
  chip.hidden = !node;
  setAttribute(chip, "data-state", beating ? "good" : "bad");
  setAttribute(chip, "data-beat", String(beating ? node.sequence % 2 : ""));
  setText(chip.querySelector(".text"), beating ? node.state : `no heartbeat, ${Math.round(age / 1000)} s`);
}

let drawnAt = 0;

function frame(at) {
  requestAnimationFrame(frame);
  if (offset === null || at - drawnAt < FRAME_MS - 2) return;
  drawnAt = at;
  const now = performance.now() - offset;
  for (const card of cards) card.draw(now);
}
