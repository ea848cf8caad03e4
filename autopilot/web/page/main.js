// The page's entry: which panel is shown, who may steer, keys, and the parts that draw what comes from the boat.
import { drawAlarms, setUpAlarms } from "./alarms.js";
import { atOneMoment, boat, connect, ask, may, learnToken, shift } from "./boat.js";
import { drawChart, setUpChart } from "./chart.js";
import { compass, drawDial, sided } from "./dial.js";
import { drawDisplay, setUpDisplay, showCodes } from "./display.js";
import { Plots } from "./plots.js";
import { drawPanels, setUpPanels } from "./panels.js";
import { setUpParameters, showParameters } from "./parameters.js";
import { drawOrders, drawTexts, setUpLogs, showLogs } from "./logs.js";
import { drawOverboard, setUpOverboard } from "./overboard.js";
import { setUpSteps, showSteps } from "./steps.js";
import { drawWind, setUpWind } from "./wind.js";

const byId = (id) => document.getElementById(id);
const PAGES = ["helm", "chart", "plots", "alarms", "learning", "trials", "parameters", "logs", "more", "begin"];
const UNDER_MORE = ["learning", "trials", "parameters", "logs", "begin"];
const MODES = { standby: "Standby", heading: "Heading", route: "Route", trial: "Trial", wind: "Wind" };
const BAD = { 5: "Fail-safe", 6: "Fault" };
const NOTICE = 5; // MAV_SEVERITY
const THEMES = ["day", "dusk", "night"];
const plots = new Plots();

export function say(words, seconds = 5) {
  byId("said").textContent = words;
  clearTimeout(say.timer);
  say.timer = setTimeout(() => { byId("said").textContent = ""; }, seconds * 1000);
}

async function order(request, button) {
  if (!may()) {
    say("View only. To steer, open the address that autopilot web has printed, or scan its code.");
    return false;
  }
  navigator.vibrate?.(15);
  button?.classList.add("waits");
  const { taken, words } = await ask(request);
  button?.classList.remove("waits");
  if (!taken) say(words || "not taken");
  return taken;
}

function page() {
  const wanted = location.hash.slice(1);
  return PAGES.includes(wanted) ? wanted : "helm";
}

function turnPage() {
  const shown = page();
  document.body.dataset.page = shown;
  for (const link of document.querySelectorAll("nav a")) {
    if (link.hash.slice(1) === shown) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
    link.classList.toggle("above", link.hash === "#more" && UNDER_MORE.includes(shown));
  }
  document.querySelector("main").scrollTo(0, 0);
  if (shown === "parameters") showParameters();
  if (shown === "logs") showLogs();
  if (shown === "more") showCodes();
  if (shown === "more" || shown === "begin") showSteps();
  drawChart();
  plots.show();
}

function setTheme(theme) {
  document.documentElement.dataset.theme = theme;
  byId("theme").textContent = theme[0].toUpperCase() + theme.slice(1);
  try { localStorage.setItem("theme", theme); } catch { /* it lasts as long as the page */ }
  const back = getComputedStyle(document.documentElement).getPropertyValue("--back");
  document.querySelector('meta[name="theme-color"]').content = back.trim();
  plots.restyle();
}

function nextTheme() {
  const now = THEMES.indexOf(document.documentElement.dataset.theme);
  setTheme(THEMES[(now + 1) % THEMES.length]);
}

function keyPressed(event) {
  if (event.ctrlKey || event.altKey || event.metaKey) return;
  if (event.key === "Escape") { order({ do: "release" }, byId("release")); return; }
  if (event.target.closest("input, select, textarea, summary")) return;
  const step = event.shiftKey ? 10 : 1;
  const actions = {
    ArrowLeft: () => order({ do: "turn", degrees: -step }),
    ArrowRight: () => order({ do: "turn", degrees: step }),
    e: () => order({ do: "engage" }, byId("engage")),
    s: () => order({ do: "standby" }, byId("standby")),
    b: () => order({ do: "back" }, byId("back")),
    a: () => order({ do: "acknowledge" }),
    n: nextTheme,
  };
  const action = actions[event.key];
  if (action && !(event.repeat && event.key.length === 1)) {
    event.preventDefault();
    action();
  }
}

/* A button that asks once more before it acts: the second touch within three seconds counts. */
export function surely(button, act) {
  const words = button.textContent;
  let timer = 0;
  const calm = () => { clearTimeout(timer); timer = 0; button.classList.remove("sure"); button.textContent = words; };
  return () => {
    if (timer) { calm(); act(); return; }
    button.classList.add("sure");
    button.textContent = button.dataset.sure;
    timer = setTimeout(calm, 3000);
  };
}

function drawMode() {
  const state = boat.state;
  const element = byId("mode");
  let word = "No boat", kind = "off", more = "";
  if (state && state.ages.beat !== undefined) {
    word = state.ours ? MODES[state.mode] ?? state.mode : "Not ours";
    kind = state.mode === "standby" ? "off" : "on";
    if (BAD[state.status]) { word = BAD[state.status]; kind = "bad"; }
    if (boat.isStale("beat")) more = "";
    else if (!state.ours) more = "another kind of autopilot: view only";
    else if (kind === "off") more = state.armed ? "ready, you steer" : "you steer";
    else if (state.mode === "trial" && boat.trial?.result === 5) more = `${boat.trial.percent} %`;
    else if (state.mode === "route" && state.distance !== undefined) more = `waypoint ${state.waypoint ?? "?"} in ${Math.round(state.distance)} m`;
  }
  byId("mode-word").textContent = word;
  byId("mode-more").textContent = more;
  element.dataset.state = kind;
  const known = !boat.isStale("beat") && Boolean(state?.ours);
  for (const [id, mode] of [["engage", "heading"], ["route", "route"], ["standby", "standby"]]) {
    byId(id).setAttribute("aria-pressed", String(known && (kind === "off" ? mode === "standby" : state.mode === mode)));
  }
  const back = byId("back");
  back.disabled = boat.dodge === null || boat.dodge === undefined;
  back.textContent = back.disabled ? "Back" : `Back to ${state?.mode === "wind" ? sided(boat.dodge) : compass(boat.dodge + shift() + 360)}`;
}

function drawLink() {
  const silent = boat.silence();
  const age = boat.age("beat");
  const stale = byId("stale");
  let word = "live", trouble = "";
  if (silent > 2.5) {
    word = "no connection";
    trouble = boat.refused || (boat.ended ? "This page's server has stopped. The pilot carries on without it; start autopilot web again to see it." : "") || `This page has lost its server for ${Math.round(silent)} s. What you see is old. It comes back by itself.`;
  } else if (boat.state?.line) {
    word = "link down";
    trouble = boat.state.line;
  } else if (age === null) {
    word = "no boat yet";
    // a boat that is being set up has no pilot yet
    trouble = document.body.dataset.page === "begin" ? "" : "No pilot heard yet. Is autopilot run --serve running, and sending to this machine?";
  } else if (age > 3) {
    word = "no data";
    trouble = `No data from the boat for ${Math.round(age)} s. What you see is old: steer by hand if in doubt.`;
  }
  document.body.dataset.link = word;
  byId("link-word").textContent = word;
  // what is touched now does not arrive
  byId("who-word").textContent = !may() ? "view only" : word === "live" ? "you may steer" : "";
  byId("looking").hidden = document.body.dataset.may !== "no";
  stale.hidden = !trouble;
  if (stale.textContent !== trouble) stale.textContent = trouble;
}

function markStale() {
  for (const element of document.querySelectorAll("[data-group]")) {
    element.classList.toggle("stale", boat.isStale(element.dataset.group));
  }
}

const draw = () => atOneMoment(drawAll);

function drawAll() {
  markStale();
  drawMode();
  drawLink();
  drawAlarms();
  drawDial();
  drawChart();
  drawPanels();
  drawWind();
  drawOverboard();
  drawOrders();
  drawTexts();
  drawDisplay();
}

function setUp() {
  learnToken();
  for (const button of document.querySelectorAll("button[data-do]")) {
    button.addEventListener("click", () => order({ do: button.dataset.do }, button));
  }
  for (const button of document.querySelectorAll("button[data-turn]")) {
    button.addEventListener("click", () => order({ do: "turn", degrees: Number(button.dataset.turn) }, button));
  }
  for (const button of document.querySelectorAll("button[data-dodge]")) {
    button.addEventListener("click", () => order({ do: "dodge", degrees: Number(button.dataset.dodge) }, button));
  }
  setUpAlarms(order);
  setUpChart();
  setUpDisplay(order);
  setUpPanels(order, surely, say);
  setUpParameters(order, say);
  setUpLogs(say);
  setUpWind(order);
  setUpOverboard(order, surely);
  setUpSteps(say);
  byId("theme").addEventListener("click", nextTheme);
  document.addEventListener("keydown", keyPressed);
  addEventListener("hashchange", () => { if (learnToken()) connect(); turnPage(); });
  turnPage();
  setTheme(document.documentElement.dataset.theme);
  boat.onState = draw;
  boat.onText = (text) => { if (text.severity > NOTICE) say(text.words, 7); }; // the bar shows what is more urgent
  boat.onMay = () => { document.body.dataset.may = may() ? "yes" : "no"; if (page() === "more") showCodes(); if (page() === "begin") showSteps(); };
  boat.onRow = (row) => plots.add(row);
  boat.onHistory = (history) => plots.fill(history);
  setInterval(draw, 500);
  connect();
}

setUp();
