// Alarms: the bar at the top with the most urgent one, the page with all of them, and their history.
import { boat, clockOf, may } from "./boat.js";
import { sound } from "./sound.js";

const byId = (id) => document.getElementById(id);
const SIGNS = { emergency: "▲▲", alarm: "▲", warning: "●", caution: "■" };
const make = (name, words = "", className = "") => Object.assign(document.createElement(name), { textContent: words, className });
let give = null;

export function setUpAlarms(order) {
  give = order;
  new ResizeObserver(fit).observe(document.querySelector("main"));
  addEventListener("hashchange", fit);
  byId("bar").addEventListener("click", ({ target }) => { if (!target.closest("button, a")) location.hash = "alarms"; });
  byId("all-seen").addEventListener("click", () => give({ do: "acknowledge" }, byId("all-seen")));
}

/* What is wrong stands before the colon, behind the part that it is about; what to do behind it. */
function split({ words: all }) {
  const words = all.charAt(0).toUpperCase() + all.slice(1);
  const at = words.indexOf(": ", /^(Steering gear|Heading monitor|Heading frozen|Rudder limit): /.exec(words)?.[0].length);
  return at < 0 ? [words, ""] : [words.slice(0, at), words.slice(at + 2)];
}

function tag(alarm, lit) {
  const element = make("b", SIGNS[alarm.priority] ?? "●", `tag ${alarm.priority}`);
  element.append(make("span", ` ${alarm.priority}`));
  element.classList.toggle("blinks", lit);
  return element;
}

function seen(alarm) {
  const button = make("button", "Acknowledge");
  button.type = "button";
  button.addEventListener("click", () => give({ do: "acknowledge", name: alarm.name }, button));
  return button;
}

function line(alarm) {
  const [wrong, todo] = split(alarm);
  const words = make("p", "", "words");
  const what = make("span", "", "wrong");
  what.append(tag(alarm, alarm.sounds), ` ${wrong}`);
  words.append(what);
  if (alarm.acknowledged) words.append(make("i", " acknowledged"));
  if (todo) words.append(make("small", todo));
  return words;
}

/* As many lines as leave what steers, or the chart, whole below; all of them stand on the page of alarms, a touch away. */
function fit() {
  const bar = byId("bar"), main = document.querySelector("main");
  if (bar.hidden) return;
  const below = document.querySelector(document.body.dataset.page === "chart" ? ".sea" : ".first");
  const fits = (todo, wrong) => {
    bar.style.setProperty("--lines", todo);
    bar.style.setProperty("--wrong", wrong);
    return below.getBoundingClientRect().bottom + main.scrollTop <= main.getBoundingClientRect().bottom + 1;
  };
  let lines = 7;
  while (!fits(lines, lines) && lines > 1) lines--;
  if (lines < 7 && !fits(lines, lines + 1) && !fits(lines + 1, lines)) fits(lines, lines);
}

function drawBar(alarms) {
  const bar = byId("bar"), [first] = alarms, sounding = alarms.filter((alarm) => alarm.sounds).length;
  bar.hidden = !first;
  if (!first) return;
  bar.className = first.sounds ? first.priority : `seen ${first.priority}`;
  const rest = alarms.length - 1;
  const more = make("a", rest ? `${rest} more` : "History", "more");
  more.href = "#alarms";
  bar.replaceChildren(line(first), ...(sounding && may() ? [seen(first)] : []), ...(rest ? [more] : []));
  fit();
}

function drawPage(alarms) {
  byId("alarms-word").hidden = alarms.length > 0;
  byId("all-seen").hidden = !may() || alarms.filter((alarm) => alarm.sounds).length < 2;
  byId("alarm-rows").replaceChildren(...alarms.map((alarm) => {
    const row = make("li", "", "alarm"), text = line(alarm);
    text.append(make("small", `since ${clockOf(alarm.since)}`, "hint"));
    row.append(text, ...(alarm.sounds && may() ? [seen(alarm)] : []));
    return row;
  }));
}

function drawHistory() {
  const time = (done, at, open) => at === null ? open : `${done} ${clockOf(at)}`;
  byId("history-rows").replaceChildren(...boat.history.slice().reverse().map((record) => {
    const row = make("li"), [wrong, todo] = split(record);
    const times = [time("raised", record.raised, "raised"), time("acknowledged", record.acknowledged, "not acknowledged"), time("cleared", record.cleared, "still on")].join(", ");
    row.append(make("b", `${SIGNS[record.priority]} ${record.priority} `), wrong, make("small", times, "hint"), ...(todo ? [make("small", todo, "hint")] : []));
    return row;
  }), ...(boat.history.length ? [] : [make("li", "No alarm since this page's server was started.")]));
}

export function drawAlarms() {
  const alarms = boat.alarms ?? [];
  sound(boat.isStale("beat") ? null : boat.sound);
  const key = JSON.stringify([alarms, boat.history, may()]);
  if (drawAlarms.key === key) return;
  drawAlarms.key = key;
  drawBar(alarms);
  drawPage(alarms);
  drawHistory();
  const count = byId("alarm-count");
  count.hidden = !alarms.length;
  count.textContent = String(alarms.length);
  count.className = alarms[0]?.priority ?? "";
}
