// What belongs to this display alone: true or magnetic courses, a screen that stays on, codes for other displays. And
// the compass that the boat is steered by, which is the boat's own.
import { boat, get, may } from "./boat.js";

const byId = (id) => document.getElementById(id);
let lock = null, asked = "";

function kept(name, value) {
  try {
    if (value !== undefined) localStorage.setItem(name, value);
    return localStorage.getItem(name);
  } catch { return value ?? null; }
}

async function stayAwake() {
  if (byId("awake").value === "off") { await lock?.release(); lock = null; return; }
  if (document.visibilityState !== "visible" || !navigator.wakeLock) return;
  try { lock = await navigator.wakeLock.request("screen"); } catch { /* a battery that is low may refuse it */ }
}

export function setUpDisplay(order) {
  byId("compass").addEventListener("change", () => order({ do: "compass", number: Number(byId("compass").value) }, byId("compass")));
  for (const id of ["courses", "awake"]) {
    byId(id).value = kept(id) ?? byId(id).value;
    byId(id).addEventListener("change", () => { kept(id, byId(id).value); apply(); });
  }
  document.addEventListener("visibilitychange", stayAwake);
  apply();
}

function apply() {
  boat.courses = byId("courses").value;
  stayAwake();
}

export function drawDisplay() {
  const known = typeof boat.state?.variation === "number";
  byId("courses").disabled = !known;
  const words = [];
  if (!known) words.push("True and magnetic courses can be chosen where the variation is known.");
  if (boat.state?.ours) words.push(`Courses are shown as chosen; the boat steers ${boat.state.magnetic ? "magnetic" : "true"} ones, until sensors.magnetic is changed and the pilot restarts.`);
  if (!navigator.wakeLock) words.push("This browser keeps the screen on only over https (autopilot web --cert) or on the boat's own computer: set the display's time-out.");
  byId("device-word").textContent = words.join(" ");
  drawCompasses();
}

const SAYERS = ["", "vessel file", "instrument", "World Magnetic Model"];

function drawCompasses() {
  const { compasses, state } = boat, select = byId("compass");
  byId("compasses").hidden = compasses.length < 2;
  const names = ["the best of the list", ...compasses.map(({ name, link, magnetic }) => `${name} ${magnetic ? "magnetic" : "true"}, ${link}`)];
  if (select.dataset.key !== String(names)) {
    select.dataset.key = String(names);
    select.replaceChildren(...names.map((name, index) => new Option(name, index)));
  }
  if (document.activeElement !== select) select.value = state?.compass_chosen ?? 0;
  const words = compasses.map(({ name }, index) => {
    const heading = state?.[`compass_${index + 1}`];
    return `${name} ${heading?.toFixed(1) ?? "--"}°${state?.compass === index + 1 ? " steers" : ""}`;
  });
  const { variation, variation_from: from, variation_year: year } = state ?? {};
  if (from) words.push(`variation ${variation?.toFixed(1)}° (east +), ${SAYERS[from]} ${year?.toFixed(1) ?? ""}`);
  byId("north-word").textContent = words.join("; ");
}

/* The code to steer holds the token: the server gives it only to who may. */
export async function showCodes() {
  if (!may() || asked) return;
  asked = "yes";
  for (const what of ["steer", "look"]) {
    let answer;
    try { answer = await get(`/api/code/${what}`); } catch { asked = ""; return; }
    byId(`code-${what}`).innerHTML = answer.svg ?? "";
    byId("code-word").textContent = answer.words ?? "";
  }
}
