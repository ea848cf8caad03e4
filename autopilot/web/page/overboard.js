// Man overboard: one touch keeps the place; its bearing and distance stand on top until it is taken back.
import { boat } from "./boat.js";

const byId = (id) => document.getElementById(id);
let isOver = false;

export function setUpOverboard(order, surely) {
  const over = byId("mob-off");
  over.addEventListener("click", surely(over, () => order({ do: "mob_off" }, over)));
}

export function drawOverboard() {
  const { mob_bearing: bearing, mob_distance: distance, mob_since: since } = boat.state ?? {};
  // kept while nothing comes, not once the boat has spoken without it; then only a newer one counts, however ages round
  const placed = typeof bearing === "number", without = placed && boat.age("mob") - boat.age("beat") >= 3;
  isOver = without || (isOver && !(boat.age("mob") < 3));
  const known = placed && !isOver;
  byId("overboard").hidden = !known;
  if (!known) return;
  const is = (value) => typeof value === "number"; // of three messages one may be lost
  const time = is(since) ? `${Math.floor(since / 60)}:${String(Math.floor(since % 60)).padStart(2, "0")}` : "--";
  byId("overboard-word").textContent = `Man overboard: ${String(Math.round(bearing) % 360).padStart(3, "0")}°, ${is(distance) ? Math.round(distance) : "--"}\u00a0m, ${time}\u00a0ago${boat.isStale("mob") ? " (old)" : ""}`;
}
