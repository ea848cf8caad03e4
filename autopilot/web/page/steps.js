// The steps of a new boat to its first hold: what to prepare, what is good enough, what is done. Left and taken up at will.
import { get, may } from "./boat.js";

const byId = (id) => document.getElementById(id);
const make = (name, words = "", className = "") => Object.assign(document.createElement(name), { textContent: words, className });
let tell = null, drawn = "";

export function setUpSteps(say) {
  tell = say;
  showSteps();
}

async function mark(name, done) {
  const { steps, words } = await get("/api/steps", { method: "POST", body: JSON.stringify({ name, done }) });
  if (words) tell(words);
  else {
    draw(steps);
    // the button that was pressed is gone; the next one's would take a second press for its own
    (document.querySelector("#step-rows > .next") ?? byId("begin")).focus({ preventScroll: true });
  }
}

function draw(steps) {
  byId("begin-link").hidden = !steps;
  if (!steps) return;
  // rows that are drawn anew take the keyboard's place with them
  const shown = JSON.stringify([steps, may()]);
  if (shown !== drawn) fill(steps);
  drawn = shown;
  document.querySelector("#step-rows > .next")?.scrollIntoView();
}

function fill(steps) {
  const left = steps.filter((step) => step.state !== "done").length, command = steps[0].command;
  byId("steps-word").textContent = left ? `${steps.length - left} of ${steps.length} done.` : `All done: the boat steers. In a terminal, ${command} shows the commands of every day.`;
  byId("step-rows").replaceChildren(...steps.map((step, place) => {
    const row = make("li", "", step.state), head = make("div"), isDone = step.state === "done";
    head.append(make("b", `${isDone ? "✓" : place + 1} ${step.title}`));
    if (step.when) head.append(make("small", `done ${step.when.slice(0, 16)}`));
    row.append(head);
    if (step.state === "next") {
      row.tabIndex = -1;
      const otherwise = make("ul");
      otherwise.append(...step.otherwise.split("; ").map((words) => make("li", words)));
      row.append(make("p", step.before), make("p", "In a terminal of the boat's computer:"), make("code", step.command), make("p", `Good enough: ${step.good}.`), make("p", "If not:"), otherwise);
      if (step.question) row.append(make("p", step.question));
    }
    if (may() && step.state !== "later") {
      const button = make("button", isDone ? "Do again" : "It is done");
      button.type = "button";
      button.setAttribute("aria-label", `${button.textContent}: ${step.title}`);
      button.addEventListener("click", () => mark(step.name, !isDone));
      row.append(button);
    }
    return row;
  }));
}

export async function showSteps() {
  try { draw((await get("/api/steps")).steps); } catch { /* asked again when it is looked at */ }
}
