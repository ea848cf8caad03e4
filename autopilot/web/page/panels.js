// Patterns, response level, trials and live identification.
import { boat } from "./boat.js";
import { drawLearnt, drawTrial } from "./plots.js";

const byId = (id) => document.getElementById(id);
const PATTERNS = [
  ["U turn", []], ["Circle", [["radius, m", 60, 1, 10000]]], ["Spiral", [["radius, m", 60, 1, 10000], ["wider each turn, m", 10, -1000, 1000]]],
  ["Zigzag legs", [["to each side, °", 30, 1, 90], ["leg, m", 200, 1, 100000]]], ["Square", [["leg, m", 300, 1, 100000]]],
  ["S curves", [["to each side, °", 40, 1, 90], ["radius, m", 60, 1, 10000]]], ["Swing on one thruster", []],
];
const RESULTS = { 0: "done", 1: "refused for now", 2: "refused", 3: "not known", 4: "ended early: the helm was taken", 5: "under way", 6: "ended as you asked" };
const TRIAL_ROWS_MOST = 6000;
const SENSE_MOST = 400;  // % of the model in force
let learntRows = [], learntValues = "", trialRows = [], trialStart = null, trialHeading = null, wasRunning = false;

function patternSizes() {
  const [, sizes] = PATTERNS[Number(byId("pattern").elements.number.value)];
  byId("pattern-sizes").replaceChildren(...sizes.map(([name, value, min, max]) => {
    const label = document.createElement("label");
    const input = Object.assign(document.createElement("input"), { type: "number", name: "size", value, min, max, step: "any", required: true });
    label.append(name, " ", input);
    return label;
  }));
}

export function setUpPanels(order, surely, say) {
  const form = byId("pattern");
  form.elements.number.replaceChildren(...PATTERNS.map(([name], number) => new Option(name, number)));
  form.elements.number.addEventListener("change", patternSizes);
  patternSizes();
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    const sizes = [...form.querySelectorAll("input[name=size]")].map((input) => input.valueAsNumber);
    order({ do: "pattern", number: Number(form.elements.number.value), side: Number(event.submitter.value), sizes }, event.submitter);
  });
  for (const [id, step] of [["calmer", -1], ["quicker", 1]]) {
    byId(id).addEventListener("click", () => {
      const level = Math.max(1, Math.min(9, (boat.state?.level ?? 5) + step));
      order({ do: "level", level }, byId(id));
    });
  }
  for (const [id, done] of [["adopt", "Adopted: the learnt model is in force."], ["revert", "Taken back: the model before is in force again."]]) {
    byId(id).addEventListener("click", surely(byId(id), async () => { if (await order({ do: id }, byId(id))) say(done); }));
  }
  for (const id of ["zigzag", "turning"]) {
    const trial = byId(id), button = trial.querySelector("button");
    const begin = surely(button, () => {
      const request = { do: id };
      for (const input of trial.querySelectorAll("input")) request[input.name] = input.valueAsNumber;
      order(request, button);
    });
    trial.addEventListener("submit", (event) => { event.preventDefault(); begin(); });
  }
}

export function drawPanels() {
  const level = boat.state?.level;
  byId("level").textContent = typeof level === "number" ? String(level) : boat.state && !boat.isStale("loop") ? "default" : "--"; // the gains of the vessel file
  byId("level").classList.toggle("filed", typeof level !== "number");
  drawTrialPanel();
  drawLearning();
}

function drawTrialPanel() {
  const { trial, state } = boat;
  byId("trial").hidden = !trial;
  if (!trial || !state) return;
  const running = trial.result === 5;
  const name = trial.command === 31010 ? "Zigzag" : "Turn";
  byId("trial-word").textContent = `${name}: ${RESULTS[trial.result] ?? "ended"}${running ? `, ${trial.percent} %` : ""}`;
  byId("trial-progress").value = running ? trial.percent : trial.result === 0 ? 100 : byId("trial-progress").value;
  byId("cancel").disabled = !running;
  if (running && !wasRunning) { trialRows = []; trialStart = state.t; trialHeading = null; }
  wasRunning = running;
  if (running && typeof state.heading === "number" && !boat.isStale("attitude")) {
    trialHeading ??= state.heading;
    const last = trialRows.at(-1);
    const before = last ? last[1] : 0;
    const change = before + ((state.heading - trialHeading - before) % 360 + 540) % 360 - 180;
    const time = state.t - trialStart;
    if (!last || time > last[0]) trialRows.push([time, change, state.rudder ?? null, state.rudder_order ?? null]);
    if (trialRows.length > TRIAL_ROWS_MOST) trialRows.shift();
  }
  drawTrial(trialRows);
}

const number = (value, digits = 3) => typeof value === "number" ? Number(value.toPrecision(digits)).toString() : "--";
const within = (value, error) => typeof error === "number" ? `${number(value)} ± ${number(error, 1)}` : `${number(value)} ± ?`;

function drawLearning() {
  const learnt = boat.learning ?? {};
  const learns = Object.keys(learnt).length > 0;
  byId("learning-word").hidden = learns;
  byId("learning-body").hidden = !learns;
  if (!learns) return;
  const shares = [learnt.lrn_K / learnt.lrn_K_in, learnt.lrn_T / learnt.lrn_T_in].map((share) => 100 * share);
  // what is first learnt is anything: it would frighten, and flatten the plot
  const isSense = shares.every((share) => share > 0 && share < SENSE_MOST);
  const rows = [
    ["In force", number(learnt.lrn_K_in), number(learnt.lrn_T_in), number(learnt.lrn_n3_in)],
    ["Learnt so far", ...[learnt.lrn_K, learnt.lrn_T, learnt.lrn_n3].map((value) => isSense ? number(value) : "--")],
  ];
  if (learnt.lrn_state > 0) {
    rows.push(["Proposed", within(learnt.lrn_pK, learnt.lrn_sK), within(learnt.lrn_pT, learnt.lrn_sT), within(learnt.lrn_pn3, learnt.lrn_sn3)]);
  }
  const key = JSON.stringify(rows);
  const body = byId("learning-rows");
  if (body.dataset.key !== key) {
    body.dataset.key = key;
    body.replaceChildren(...rows.map((cells) => {
      const row = document.createElement("tr");
      row.append(...cells.map((words, index) => Object.assign(document.createElement(index ? "td" : "th"), { textContent: words })));
      return row;
    }));
  }
  const proof = learnt.lrn_n > 0
    ? `Heading ${number(learnt.lrn_ahead, 2)} s ahead: off by ${number(learnt.lrn_new, 2)}° with the proposal, ${number(learnt.lrn_old, 2)}° with the model in force, on ${learnt.lrn_n} stretches since.`
    : "Nothing yet to prove it by.";
  const words = [
    learnt.lrn_blown > 0 ? "Too rough for so little rudder: nothing is learnt. Turn with more rudder, or in calmer water."
      : `The rudder was moved for ${Math.round(learnt.lrn_moved ?? 0)} s. Not yet known well enough: turn, or sail a zigzag.`,
    `Proposed, and being tried against what comes${learnt.lrn_hard > 0 ? `; turn with ${number(learnt.lrn_hard)}° of rudder, too` : ""}. ${proof}`,
    `Proved: it predicts better than the model in force. ${proof}`,
  ];
  byId("learning-check").textContent = words[learnt.lrn_state ?? 0] ?? "";
  const values = JSON.stringify(learnt);
  if (values !== learntValues && isSense) {
    learntValues = values;
    if (learntRows.length && boat.state.t < learntRows.at(-1)[0]) learntRows = [];
    learntRows.push([boat.state.t, ...shares]);
    learntRows.splice(0, learntRows.length - 900);
  }
  drawLearnt(learntRows);
  byId("adopt").disabled = learnt.lrn_state !== 2;
}
