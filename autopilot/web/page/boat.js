// What is known of the boat, as the server tells it, and how old it is by this machine's own clock.
const STALE_S = { beat: 3, attitude: 1.5, rudder: 2, loop: 3, navigation: 3, speed: 3, learning: 10, position: 5, wind: 5, mob: 3, compass: 6 };
const SILENT_MS = 4000;

export const boat = {
  state: null, alarms: [], history: [], orders: [], sound: null, learning: {}, trial: null, dodge: null, texts: [],
  route: [], compasses: [], track: [], courses: "steered", received: -Infinity, refused: "", ended: false,
  onState() {}, onRow() {}, onHistory() {}, onText() {}, onMay() {},
  silence() { return ((moment ?? performance.now()) - (Number.isFinite(this.received) ? this.received : started)) / 1000; },
  age(group) {
    const age = this.state?.ages[group];
    return age === undefined ? null : age + this.silence();
  },
  isStale(group) {
    const age = this.age(group);
    return age === null || age > (STALE_S[group] ?? 3);
  },
};
const TRACK_MOST = 1800;

/* The time of day of a time [s] by the boat's own clock. */
export function clockOf(time) {
  return new Date(Date.now() - 1000 * Math.max(0, (boat.state?.t ?? time) - time)).toLocaleTimeString([], { hour12: false });
}

/* Degrees to add to a course as it is steered, for the north that this display has chosen. */
export function shift() {
  const { magnetic, variation } = boat.state ?? {};
  if (typeof variation !== "number" || boat.courses === "steered") return 0;
  return boat.courses === "true" ? magnetic ? variation : 0 : magnetic ? 0 : -variation;
}

export const isMagnetic = () => shift() === 0 ? Boolean(boat.state?.magnetic) : !boat.state.magnetic;

const started = performance.now();
let moment = null;

/* Ages asked for while this works are those of its beginning: one picture shows one moment. */
export function atOneMoment(work) {
  moment = performance.now();
  try { work(); } finally { moment = null; }
}

let token = null, allowed = false, source = null, tried = started;

/* The token stands behind the # of the address, which no browser sends on. It is kept for this browser. */
export function learnToken() {
  const match = /token=([\w-]+)/.exec(location.hash);
  try {
    if (match) localStorage.setItem("token", match[1]);
    token = match ? match[1] : localStorage.getItem("token");
  } catch { token = match ? match[1] : token; }
  if (match) history.replaceState(null, "", location.pathname);
  return Boolean(match);
}

export const may = () => allowed;

function send(path, options = {}) {
  return fetch(path, { ...options, headers: token ? { authorization: `Bearer ${token}` } : {} });
}

export async function get(path, options) {
  return (await send(path, options)).json();
}

/* With the time of the newest state: an order that was held up on its way is not carried out.
   An order that was taken is answered with 200, a bad one with 400, one that cannot be carried out now with 409. */
export async function ask(request) {
  try {
    const answer = await send("/api/order", { method: "POST", body: JSON.stringify({ ...request, seen: boat.state?.t }) });
    return { taken: answer.ok, words: (await answer.json()).words };
  } catch {
    return { taken: false, words: "no connection: look whether the order was taken" };
  }
}

async function begin() {
  try {
    allowed = (await get("/api/may")).may;
    boat.onMay();
    const history = await get("/api/history");
    boat.track = history.track;
    boat.onHistory(history);
  } catch { /* the next connection asks again */ }
}

const events = new EventTarget();

function heard(name, take) {
  events.addEventListener(name, (event) => {
    boat.received = performance.now();
    take(JSON.parse(event.data));
  });
}

heard("state", (state) => { boat.state = state; boat.ended = false; boat.onState(); });
heard("row", (row) => boat.onRow(row));
for (const name of ["alarms", "sound", "history", "orders", "route", "compasses", "learning", "trial", "dodge"]) {
  heard(name, (content) => { boat[name] = content; });
}
heard("point", (point) => { boat.track.push(point); boat.track.splice(0, boat.track.length - TRACK_MOST); });
heard("end", () => { boat.ended = true; });
heard("text", (text) => {
  if (boat.texts.some((each) => each.number === text.number && each.words === text.words)) return;
  boat.texts.push({ ...text, at: new Date(Date.now() - 1000 * Math.max(0, (boat.state?.t ?? text.time) - text.time)) });
  boat.texts.splice(0, boat.texts.length - 50);
  if (boat.state && boat.state.t - text.time < 2) boat.onText(text);
});

/* Not by EventSource, which cannot say who asks: who has the token keeps its place where there are few. */
export async function connect() {
  source?.abort();
  const ours = source = new AbortController();
  tried = performance.now();
  try {
    const answer = await send("/api/events", { signal: ours.signal, cache: "no-store" });
    boat.refused = answer.ok ? "" : (await answer.json()).words;
    if (!answer.ok) return;
    begin();
    const reader = answer.body.pipeThrough(new TextDecoderStream()).getReader();
    for (let rest = "", piece; !(piece = await reader.read()).done;) {
      const blocks = (rest + piece.value).split("\n\n");
      rest = blocks.pop();
      for (const block of blocks) {
        const [, name, data] = /^event: (.*)\ndata: (.*)$/.exec(block);
        events.dispatchEvent(new MessageEvent(name, { data }));
      }
    }
  } catch { /* it is tried again */ } finally {
    if (source === ours) source = null;
  }
}

/* Tried again when it has ended, and when nothing comes, as after a phone has slept. */
setInterval(() => {
  if (!source || performance.now() - Math.max(boat.received, tried) > SILENT_MS) connect();
}, 1000);
