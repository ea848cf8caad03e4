// What is known of the boat, as the server tells it, and how old it is by this machine's own clock.
const STALE_S = { beat: 3, attitude: 1.5, rudder: 2, loop: 3, navigation: 3, speed: 3, learning: 10 };
const SILENT_MS = 4000;

export const boat = {
  state: null, alarms: [], learning: {}, trial: null, dodge: null, texts: [],
  received: -Infinity,
  onState() {}, onRow() {}, onHistory() {}, onText() {},
  silence() { return Number.isFinite(this.received) ? (performance.now() - this.received) / 1000 : (performance.now() - started) / 1000; },
  age(group) {
    const age = this.state?.ages[group];
    return age === undefined ? null : age + this.silence();
  },
  isStale(group) {
    const age = this.age(group);
    return age === null || age > (STALE_S[group] ?? 3);
  },
};
const started = performance.now();
let token = null, allowed = false, source = null;

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

export async function get(path, options = {}) {
  const headers = token ? { authorization: `Bearer ${token}` } : {};
  const answer = await fetch(path, { ...options, headers });
  return answer.json();
}

export async function ask(wish) {
  try {
    return await get("/api/order", { method: "POST", body: JSON.stringify(wish) });
  } catch {
    return { taken: false, words: "no connection: the order was not given" };
  }
}

async function begin() {
  try {
    allowed = (await get("/api/may")).may;
    boat.onHistory(await get("/api/history"));
  } catch { /* the next connection asks again */ }
}

export function connect() {
  source?.close();
  source = new EventSource("/api/events");
  const heard = (name, take) => source.addEventListener(name, (event) => {
    boat.received = performance.now();
    take(JSON.parse(event.data));
  });
  source.addEventListener("open", begin);
  heard("state", (state) => { boat.state = state; boat.onState(); });
  heard("row", (row) => boat.onRow(row));
  heard("alarms", (alarms) => { boat.alarms = alarms; });
  heard("learning", (learning) => { boat.learning = learning; });
  heard("trial", (trial) => { boat.trial = trial; });
  heard("dodge", (heading) => { boat.dodge = heading; });
  heard("text", (text) => {
    if (boat.texts.some((each) => each.number === text.number && each.words === text.words)) return;
    boat.texts.push({ ...text, at: new Date(Date.now() - 1000 * Math.max(0, (boat.state?.t ?? text.time) - text.time)) });
    boat.texts.splice(0, boat.texts.length - 50);
    if (boat.state && boat.state.t - text.time < 2) boat.onText(text);
  });
}

/* The browser tries again by itself, but not after every kind of failure, nor soon after the phone has slept. */
setInterval(() => {
  const quiet = performance.now() - Math.max(boat.received, connect.tried ?? started);
  if (quiet > SILENT_MS || source?.readyState === EventSource.CLOSED) {
    connect.tried = performance.now();
    connect();
  }
}, 1000);
