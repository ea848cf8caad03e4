// The boat's parameters: with range and meaning, set one by one.
import { get, may } from "./boat.js";

const byId = (id) => document.getElementById(id);
const UNITS = { hz: "Hz", deg: "°", "deg/s": "°/s" };
const short = (number) => number === 1e-9 ? "above 0" : Math.abs(number) >= 1e5 || (number !== 0 && Math.abs(number) < 1e-3) ? number.toExponential().replace("e+", "e") : String(number);
const unitOf = ({ units }) => UNITS[units] ?? units.replace(/([a-z])2/g, "$1²");
let timer = 0, order = null, say = null, shown = "";

export function setUpParameters(give, tell) {
  order = give;
  say = tell;
  byId("find").addEventListener("input", filter);
}

export async function showParameters() {
  clearTimeout(timer);
  let table;
  try { table = await get("/api/parameters"); } catch { table = null; }
  if (!table || document.body.dataset.page !== "parameters") return;
  byId("parameters-word").textContent = table.complete ? "NOW takes effect at once, RESTART when the pilot next starts. Both are saved."
    : table.total ? `Reading ${table.done} of ${table.total}` : "Asking the boat";
  if (table.complete) fill(table.rows);
  const described = table.rows.some((row) => row.shortDesc);
  if (!table.complete || !described) timer = setTimeout(showParameters, 500);
}

function fill(rows) {
  const key = JSON.stringify(rows) + may();
  if (key === shown) return;
  shown = key;
  const groups = new Map();
  for (const row of rows) {
    const name = row.group ?? "All";
    groups.set(name, [...(groups.get(name) ?? []), row]);
  }
  const open = new Set([...document.querySelectorAll("#parameter-groups details[open]")].map((each) => each.dataset.group));
  byId("parameter-groups").replaceChildren(...[...groups].map(([name, members]) => {
    const details = document.createElement("details");
    details.dataset.group = name;
    details.open = open.has(name);
    const summary = Object.assign(document.createElement("summary"), { textContent: name });
    summary.append(Object.assign(document.createElement("small"), { textContent: String(members.length) }));
    details.append(summary, ...members.map(line));
    return details;
  }));
  filter();
}

function line(row) {
  const element = Object.assign(document.createElement("div"), { className: "parameter" });
  const words = Object.assign(document.createElement("span"), { textContent: row.shortDesc ?? row.name });
  const when = Object.assign(document.createElement("b"), { textContent: row.rebootRequired ? "RESTART" : "NOW", className: "when" });
  const name = Object.assign(document.createElement("code"), { textContent: row.name });
  const unit = row.units ? ` ${unitOf(row)}` : "";
  const range = row.values ? "" : row.min !== undefined && row.max !== undefined ? `${short(row.min)} to ${short(row.max)}${unit}` : row.min !== undefined ? `at least ${short(row.min)}${unit}` : unit;
  const about = Object.assign(document.createElement("span"), { className: "range", textContent: range.trim() });
  about.prepend(when, " ");
  element.dataset.words = `${row.name} ${row.shortDesc ?? ""} ${row.group ?? ""}`.toLowerCase();
  element.append(words, name, about, field(row));
  return element;
}

function field(row) {
  const form = document.createElement("form");
  const label = row.shortDesc ?? row.name;
  let input;
  if (row.values) {
    input = document.createElement("select");
    input.append(...row.values.map(({ value, description }) => new Option(description, value, false, value === row.value)));
  } else {
    input = Object.assign(document.createElement("input"), { type: "number", step: "any", value: row.value ?? "", required: true, inputMode: "decimal" });
    if (row.min !== undefined) input.min = row.min;
    if (row.max !== undefined) input.max = row.max;
  }
  input.setAttribute("aria-label", label);
  const button = Object.assign(document.createElement("button"), { textContent: "Set", disabled: !may() });
  button.setAttribute("aria-label", `Set ${label}`);
  form.append(input, ...(row.units ? [Object.assign(document.createElement("span"), { textContent: unitOf(row), className: "unit-of" })] : []), button);
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    const value = Number(input.value);
    if (await order({ do: "set", name: row.name, value }, button)) say(`${row.name} is ${value}`);
    else input.value = row.value;
    showParameters();
  });
  return form;
}

function filter() {
  const wanted = byId("find").value.trim().toLowerCase();
  let found = 0;
  for (const details of document.querySelectorAll("#parameter-groups details")) {
    let any = false;
    for (const each of details.querySelectorAll(".parameter")) {
      each.hidden = wanted !== "" && !each.dataset.words.includes(wanted);
      any ||= !each.hidden;
      found += !each.hidden;
    }
    details.hidden = !any;
    if (wanted) details.open = any;
  }
  byId("parameters-found").textContent = !wanted ? "" : found ? `${found} found` : `Nothing found for “${wanted}”. Try part of a name or of its meaning, like rudder or GUI.`;
}
