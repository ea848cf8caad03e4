// The wind: what blows, the angle held, tack and gybe. The boat asks back, and turns when it is confirmed.
import { boat } from "./boat.js";
import { sideOf, tile, turn } from "./dial.js";

const byId = (id) => document.getElementById(id);
const TURNS = { tack: ["Tack", 1], gybe: ["Gybe", 2] };
let isHeard = false;

export function setUpWind(order) {
  for (const [name, [, number]] of Object.entries(TURNS)) {
    const button = byId(name);
    button.addEventListener("click", () => order({ do: boat.state?.wind_ask === number ? "confirm" : name }, button));
  }
}

export function drawWind() {
  const state = boat.state;
  const known = typeof state?.awa === "number" && !boat.isStale("wind");
  const held = state?.mode === "wind";
  // once heard, its places stay: no button moves away below a finger when the vane falls silent
  isHeard ||= known || held;
  const hold = byId("hold-wind");
  byId("wind").hidden = hold.hidden = !isHeard;
  if (!isHeard) return;
  for (const name of ["awa", "twa"]) turn(`${name}-mark`, known && typeof state[name] === "number" ? state[name] : null);
  for (const name of ["awa", "aws", "twa", "tws"]) {
    const value = known && typeof state[name] === "number" ? Math.round(state[name]) : null;
    tile(`t-${name}`, value === null ? null : String(Math.abs(value)), name.endsWith("wa") ? sideOf(value % 180) : "");
  }
  hold.disabled = !known && !held;
  hold.setAttribute("aria-pressed", String(held));
  for (const [name, [word, number]] of Object.entries(TURNS)) {
    const asked = held && state.wind_ask === number, button = byId(name);
    button.hidden = !held;
    if (asked && !button.classList.contains("sure")) button.scrollIntoView({ block: "nearest" });
    button.classList.toggle("sure", asked);
    button.textContent = asked ? `${word} now` : word;
  }
}
