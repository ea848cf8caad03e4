// What belongs to this display alone: true or magnetic courses, a screen that stays on, codes for other displays.
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

export function setUpDisplay() {
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
  if (!known) words.push("True and magnetic courses can be chosen where the vessel file has sensors.variation_deg.");
  if (!navigator.wakeLock) words.push("This browser keeps the screen on only over https (autopilot web --cert) or on the boat's own computer: set the display's own time-out.");
  byId("device-word").textContent = words.join(" ");
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
