// The wind: what blows, the angle held, tack and gybe. The boat asks back, and turns when it is confirmed.
import { boat } from "./boat.js";

const byId = (id) => document.getElementById(id);
const TURNS = { tack: ["Tack", 1], gybe: ["Gybe", 2] };
const sided = (angle) => `${Math.abs(Math.round(angle))}°${Math.round(angle) % 180 === 0 ? "" : angle < 0 ? " port" : " stb"}`;

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
  byId("wind").hidden = !known && !held;
  if (byId("wind").hidden) return;
  const words = known ? [`Wind ${sided(state.awa)}, ${Math.round(state.aws)} kn`] : ["No wind"];
  if (known && typeof state.twa === "number") words.push(`true ${sided(state.twa)}, ${Math.round(state.tws)} kn`);
  if (held && typeof state.wind_angle === "number") words.push(`holding ${sided(state.wind_angle)} ${state.wind_true ? "true" : "apparent"}`);
  byId("wind-word").textContent = words.join("; ");
  byId("hold-wind").setAttribute("aria-pressed", String(held));
  for (const [name, [word, number]] of Object.entries(TURNS)) {
    const asked = held && state.wind_ask === number, button = byId(name);
    button.disabled = !held;
    if (asked && !button.classList.contains("sure")) button.scrollIntoView({ block: "nearest" });
    button.classList.toggle("sure", asked);
    button.textContent = asked ? `${word} now` : word;
  }
}
