// Logs to download, who ordered what, and what the boat has said.
import { boat, clockOf, get } from "./boat.js";

const byId = (id) => document.getElementById(id);
const SEVERITIES = ["emergency", "alert", "critical", "error", "warning", "notice", "info", "debug"];
let reported = 0, say = null;

export function setUpLogs(tell) {
  say = tell;
  byId("logs-again").addEventListener("click", showLogs);
}

const size = (bytes) => bytes < 1e6 ? `${Math.ceil(bytes / 1000)} kB` : `${(bytes / 1e6).toFixed(1)} MB`;

export async function showLogs() {
  let list;
  try { list = await get("/api/logs"); } catch { return; }
  const word = byId("logs-word");
  word.textContent = list.words ?? (!list.folder ? "No folder of logs is offered: start autopilot web with --logs." : list.logs.length ? "" : "No logs yet.");
  byId("log-rows").replaceChildren(...(list.logs ?? []).map((log) => {
    const row = document.createElement("li"), about = document.createElement("span");
    const when = new Date(log.changed * 1000).toLocaleString("sv-SE").slice(0, 16);  // 2026-11-26 21:23, as the clock elsewhere
    about.append(log.name, Object.assign(document.createElement("small"), { textContent: `${size(log.bytes)}, ${when}` }));
    const button = Object.assign(document.createElement("button"), { type: "button", textContent: "Download" });
    button.setAttribute("aria-label", `Download ${log.name}`);
    button.addEventListener("click", () => download(log.name));
    row.append(about, button);
    return row;
  }));
}

async function download(name) {
  const answer = await get(`/api/logs/${encodeURIComponent(name)}/ticket`, { method: "POST" });
  if (!answer.href) { say(answer.words); return; }
  const link = Object.assign(document.createElement("a"), { href: answer.href, download: name });
  document.body.append(link);
  link.click();
  link.remove();
}

const outcome = ({ taken, words }) => taken ? "" : taken === null ? ": asked" : `: not taken, ${words}`;

export function drawOrders() {
  const key = JSON.stringify(boat.orders);
  if (drawOrders.key === key) return;
  drawOrders.key = key;
  const wordsOf = (given) => `${given.what}${outcome(given)}`;
  const last = boat.orders.at(-1);
  byId("last-order").textContent = last ? `${clockOf(last.time)}  ${wordsOf(last)} (${last.who})` : "";
  if (last) byId("order-rows").replaceChildren(...boat.orders.slice().reverse().map((given) => {
    const row = document.createElement("li");
    row.append(Object.assign(document.createElement("time"), { textContent: clockOf(given.time) }), wordsOf(given), Object.assign(document.createElement("small"), { textContent: given.who }));
    return row;
  }));
}

export function drawTexts() {
  const newest = boat.texts.at(-1);
  if (!newest || newest.number === reported) return;
  reported = newest.number;
  byId("texts").replaceChildren(...boat.texts.slice().reverse().map((text) => {
    const row = document.createElement("li");
    row.append(
      Object.assign(document.createElement("time"), { textContent: text.at.toLocaleTimeString([], { hour12: false }) }),
      `${SEVERITIES[text.severity] ?? ""}: ${text.words}`,
    );
    return row;
  }));
}
