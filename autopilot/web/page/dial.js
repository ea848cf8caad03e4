// The compass and the rudder.
import { boat, isMagnetic, shift } from "./boat.js";

const byId = (id) => document.getElementById(id);
const SVG = "http://www.w3.org/2000/svg";
const CARDINALS = { 0: "N", 90: "E", 180: "S", 270: "W" };
const RUDDER_SHOWN = 40, RUDDER_PX = 180;
const shown = {};

function make(parent, name, attributes, words) {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  if (words !== undefined) element.textContent = words;
  parent.append(element);
  return element;
}

function drawRose() {
  const rose = byId("rose");
  make(rose, "circle", { r: 192 });
  for (let angle = 0; angle < 360; angle += 5) {
    const long = angle % 30 === 0, half = angle % 10 === 0;
    make(rose, "line", {
      y1: -192, y2: long ? -174 : half ? -180 : -186, transform: `rotate(${angle})`, class: half ? "" : "fine",
    });
    if (!long) continue;
    const cardinal = CARDINALS[angle];
    make(rose, "text", { y: cardinal ? -144 : -150, transform: `rotate(${angle})`, class: cardinal ? "cardinal" : "" },
      cardinal ?? String(angle).padStart(3, "0"));
  }
  const ticks = byId("rudder-ticks");
  for (let angle = -40; angle <= 40; angle += 10) {
    const x = angle / RUDDER_SHOWN * RUDDER_PX;
    make(ticks, "line", { x1: x, x2: x, y1: 16, y2: angle % 20 ? 22 : 26 });
    if (angle % 20 === 0) make(ticks, "text", { x, y: 42 }, String(Math.abs(angle)));
  }
}

/* Turns an element the short way round: 359 to 1 is two degrees, not 358. */
export function turn(id, degrees) {
  const element = byId(id);
  const known = typeof degrees === "number";
  element.setAttribute("visibility", known ? "visible" : "hidden");
  if (!known) { delete shown[id]; return; }
  const before = shown[id] ?? degrees;
  const angle = before + ((degrees - before) % 360 + 540) % 360 - 180;
  shown[id] = angle;
  element.style.transform = `rotate(${angle.toFixed(2)}deg)`;
}

/* An angle to the wind: negative is the wind from port. */
export const sided = (angle) => `${Math.abs(Math.round(angle))}°${Math.round(angle) % 180 ? angle < 0 ? " port" : " stb" : ""}`;
export const compass = (degrees) => String(Math.round(degrees) % 360).padStart(3, "0") + "°";
const side = (value, digits) => `${Math.abs(value).toFixed(digits)}°${Math.abs(value) < 0.05 ? "" : value < 0 ? " port" : " stbd"}`;
export const sideOf = (value) => typeof value !== "number" || Math.abs(value) < 0.05 ? "" : value < 0 ? "port" : "stb";
const put = (id, words) => { const element = byId(id); if (element.textContent !== words) element.textContent = words; };
export const tile = (id, value, unit) => {
  const element = byId(id);
  const words = value === null || value === undefined ? "--" : value;
  if (element.dataset.words === words + unit) return;
  element.dataset.words = words + unit;
  element.replaceChildren(words);
  if (words !== "--" && unit) {
    const small = document.createElement("small");
    small.textContent = ` ${unit}`;
    element.append(small);
  }
};
/* With a decimal below 10: more has no room beside its side on a phone. */
const sidedTile = (id, value) => tile(id, typeof value === "number" ? Math.abs(value).toFixed(Math.abs(value) < 9.95 ? 1 : 0) : null, sideOf(value));

export function drawDial() {
  const state = boat.state;
  if (!state) return;
  const north = shift(), shown = (degrees) => typeof degrees === "number" ? (degrees + north + 360) % 360 : degrees;
  const [heading, order, reference] = [state.heading, state.order, state.reference].map(shown);
  const known = typeof heading === "number";
  const steered = typeof order === "number" && state.mode !== "standby";
  if (known) turn("rose", -heading);
  turn("order-mark", known && steered ? order - heading : null);
  turn("reference-mark", known && steered && typeof reference === "number" ? reference - heading : null);
  put("heading", known ? compass(heading).slice(0, 3) : "---");
  put("heading-sign", isMagnetic() ? "°M" : "°");
  byId("heading-sign").style.visibility = known ? "" : "hidden";
  put("north", isMagnetic() ? "heading, magnetic" : "heading, true");
  const wind = state.mode === "wind" && typeof state.wind_angle === "number" && `${state.wind_true ? "TWA" : "AWA"} ${sided(state.wind_angle)}`;
  const ordered = wind || (steered ? `order ${compass(order)}` : "no course ordered");
  put("order", ordered);
  const now = state[state.wind_true ? "twa" : "awa"];
  put("steered", wind ? `${wind.slice(0, 3)} ${typeof now === "number" && !boat.isStale("wind") ? sided(now) : "--"}, order ${sided(state.wind_angle)}` : ordered);
  for (const id of ["order", "steered"]) byId(id).classList.toggle("none", !steered);
  const age = boat.age("attitude");
  put("heading-age", age !== null && boat.isStale("attitude") ? `${Math.round(age)} s old` : "");
  byId("dial").setAttribute("aria-label", known ? `Heading ${Math.round(heading)} degrees${steered ? `, ${wind || `order ${Math.round(order)}`}` : ""}` : "No heading");
  drawRudder(state);
  sidedTile("t-rudder", state.rudder);
  tile("t-rate", typeof state.rate === "number" ? (Math.abs(state.rate) < 0.05 ? "" : state.rate > 0 ? "+" : "−") + Math.abs(state.rate).toFixed(1) : null, "");
  tile("t-speed", typeof state.speed === "number" ? state.speed.toFixed(1) : null, "");
  sidedTile("t-xte", state.mode === "route" ? state.xte : null);
}

function drawRudder(state) {
  const clip = (value) => Math.max(-RUDDER_SHOWN, Math.min(RUDDER_SHOWN, value)) / RUDDER_SHOWN * RUDDER_PX;
  const known = typeof state.rudder === "number";
  const x = known ? clip(state.rudder) : 0;
  const fill = byId("rudder-fill");
  fill.setAttribute("x", Math.min(0, x));
  fill.setAttribute("width", Math.abs(x));
  fill.setAttribute("class", x < 0 ? "port" : "starboard");
  byId("rudder-now").setAttribute("transform", `translate(${x.toFixed(1)})`);
  byId("rudder-now").style.visibility = known ? "" : "hidden";
  const ordered = typeof state.rudder_order === "number";
  byId("rudder-order").style.visibility = ordered ? "" : "hidden";
  if (ordered) byId("rudder-order").setAttribute("transform", `translate(${clip(state.rudder_order).toFixed(1)})`);
  byId("rudder").setAttribute("aria-label", known ? `Rudder ${side(state.rudder, 0)}` : "Rudder not known");
}

drawRose();
