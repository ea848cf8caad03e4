// Scrolling plots of what has been, and the plot of a trial while it is sailed. The library comes when it is first needed.
const KEPT = 1200;
const byId = (id) => document.getElementById(id);
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
const wrap = (value) => ((Math.round(value) % 360) + 360) % 360;

const KINDS = {
  "plot-heading": {
    title: "Heading, °", height: 190, series: [["heading", "text", 2.5], ["reference", "order", 2, [6, 4]], ["order", "dim", 1.5]],
    labels: ["heading", "reference", "order"], wraps: true, least: 6,
  },
  "plot-rudder": {
    title: "Rudder, ° (+ starboard)", height: 150, series: [["rudder", "text", 2.5], ["rudder_order", "order", 1.5, [6, 4]]],
    labels: ["rudder", "order"], least: 6,
  },
  "plot-xte": { title: "Off track, m (+ starboard)", height: 120, series: [["xte", "text", 2]], labels: ["off track"], least: 4 },
  "plot-loop": { title: "Longest gap between two ticks, ms", height: 120, series: [["gap", "text", 2]], labels: ["gap"], least: 100, fromZero: true },
};

let loading = null;

function ready() {
  if (typeof uPlot !== "undefined") return true;
  loading ??= new Promise((done) => {
    const script = Object.assign(document.createElement("script"), { src: "uplot.js", onload: done });
    document.head.append(Object.assign(document.createElement("link"), { rel: "stylesheet", href: "uplot.css" }), script);
  });
  return false;
}

export class Plots {
  constructor() {
    this.columns = [];
    this.rows = [];
    this.charts = new Map();
    this.span = 120;
    this.held = false;
    byId("hold").addEventListener("click", () => this.hold(!this.held));
    byId("csv").addEventListener("click", () => this.save());
    byId("span").addEventListener("change", (event) => { this.span = Number(event.target.value); this.show(); });
    addEventListener("resize", () => this.resize());
  }

  fill({ columns, rows }) {
    this.columns = columns;
    this.rows = rows;
    this.show();
  }

  add(row) {
    const last = this.rows.at(-1);
    if (last && row[0] <= last[0]) {
      if (row[0] === last[0]) return;
      this.rows = []; // the server has started again
    }
    this.rows.push(row);
    if (this.rows.length > KEPT) this.rows.shift();
    this.show();
  }

  /* Held plots stand still and can be looked at closer. */
  hold(held) {
    this.held = held;
    byId("hold").setAttribute("aria-pressed", String(held));
    byId("hold-word").hidden = !held;
    this.restyle();
  }

  /* What is kept here as a table: seconds before now, degrees, metres, milliseconds. */
  save() {
    const end = this.rows.at(-1)?.[0] ?? 0;
    const units = { t: "time_s", xte: "off_track_m", gap: "longest_gap_ms", hz: "ticks_hz" };
    const heads = this.columns.map((name) => units[name] ?? `${name}_deg`);
    const rows = this.rows.map(([time, ...values]) => [(time - end).toFixed(2), ...values.map((value) => value ?? "")]);
    const text = [heads, ...rows].map((row) => row.join(",")).join("\n") + "\n";
    const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(new Blob([text], { type: "text/csv" })), download: "helm.csv" });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  }

  isShown() { return byId("plots").offsetParent !== null; }

  show() {
    if (!this.isShown() || !this.columns.length || (this.held && this.charts.size)) return;
    if (!ready()) { loading.then(() => this.show()); return; }
    const end = this.rows.at(-1)?.[0] ?? 0;
    const rows = this.rows.filter((row) => row[0] >= end - this.span);
    const times = rows.map((row) => row[0] - end);
    for (const [id, kind] of Object.entries(KINDS)) {
      const data = [times, ...kind.series.map(([name]) => rows.map((row) => row[this.columns.indexOf(name)]))];
      if (kind.wraps) unwrap(data);
      this.chart(id, kind).setData(data, true);
    }
  }

  chart(id, kind) {
    let chart = this.charts.get(id);
    if (!chart) {
      chart = makeChart(byId(id), kind, this.held ? (_, low, high) => [low ?? -this.span, high ?? 0] : () => [-this.span, 0], this.held);
      this.charts.set(id, chart);
    }
    return fitted(chart, id, kind);
  }

  restyle() {
    for (const chart of this.charts.values()) chart.destroy();
    this.charts.clear();
    trialChart?.destroy();
    learntChart?.destroy();
    trialChart = learntChart = null;
    this.show();
  }

  resize() {
    for (const [id, chart] of this.charts) fitted(chart, id, KINDS[id]);
    if (learntChart) fitted(learntChart, "plot-learning", LEARNT);
    if (trialChart) fitted(trialChart, "plot-trial", TRIAL);
  }
}

/* As wide as its place: one that was hidden when the window changed has none until it is shown. */
function fitted(chart, id, kind) {
  const width = byId(id).clientWidth;
  if (width && chart.width !== width) chart.setSize({ width, height: kind.height });
  return chart;
}

function makeChart(element, kind, range, zooms = false) {
  const axis = { stroke: colour("dim"), grid: { stroke: colour("panel"), width: 2 }, ticks: { show: false }, font: "14px system-ui", size: 46 };
  const limits = (_, low, high) => {
    if (low === null || high === null) return [kind.fromZero ? 0 : -kind.least / 2, kind.fromZero ? kind.least : kind.least / 2];
    if (kind.fromZero) return [0, Math.max(high * 1.1, kind.least)];
    const middle = (low + high) / 2, half = Math.max((high - low) * 0.55, kind.least / 2);
    return [middle - half, middle + half];
  };
  return new uPlot({
    title: kind.title, width: element.clientWidth || 320, height: kind.height, cursor: { drag: { x: zooms, y: false } }, legend: { live: false, markers: { fill: (chart, index) => chart.series[index].stroke() } },
    scales: { x: { time: false, range: range ?? undefined }, y: { range: limits } },
    axes: [
      { ...axis, size: 30, values: (_, ticks) => ticks.map((tick) => `${tick} s`) },
      { ...axis, ...(kind.wraps ? { incrs: [1, 2, 5, 10, 15, 30, 45, 90] } : {}), values: (_, ticks) => ticks.map((tick) => kind.wraps ? wrap(tick) : tick) },
    ],
    series: [
      { label: "time", value: (_, value) => value === null ? "--" : `${value.toFixed(0)} s` },
      ...kind.series.map(([, name, width, dash], index) => ({
        label: kind.labels[index], stroke: colour(name), width, dash, spanGaps: false, points: { show: false },
        value: (_, value) => value === null || value === undefined ? "--" : kind.wraps ? wrap(value).toFixed(0) : value.toFixed(1),
      })),
    ],
  }, [[], ...kind.series.map(() => [])], element);
}

/* Headings without the jump from 359 to 0, all columns on the same turn. */
function unwrap(data) {
  let last = null;
  for (let index = 0; index < data[0].length; index += 1) {
    for (let column = 1; column < data.length; column += 1) {
      const value = data[column][index];
      if (value === null || value === undefined) continue;
      const base = last ?? value;
      const near = base + ((value - base) % 360 + 540) % 360 - 180;
      data[column][index] = near;
      if (column === 1) last = near;
    }
  }
}

const TRIAL = {
  title: "Change of heading and rudder, ° (+ starboard)", height: 260, least: 10,
  series: [["heading", "text", 2.5], ["rudder", "starboard", 2], ["order", "order", 1.5, [6, 4]]], labels: ["heading change", "rudder", "rudder order"],
};
const LEARNT = {
  title: "Learnt, in % of the model in force", height: 180, least: 20,
  series: [["K", "text", 2.5], ["T", "order", 2, [6, 4]]], labels: ["K", "T"],
};
let trialChart = null, learntChart = null;

/* rows: [time, K, T], the latter in per cent of what is in force */
export function drawLearnt(rows) {
  if (byId("plot-learning").offsetParent === null || rows.length < 2 || !ready()) return;
  const end = rows.at(-1)[0];
  learntChart ??= makeChart(byId("plot-learning"), LEARNT);
  fitted(learntChart, "plot-learning", LEARNT).setData([rows.map((row) => row[0] - end), ...[1, 2].map((column) => rows.map((row) => row[column]))], true);
}

/* rows: [time since the start, change of heading, rudder, rudder order] */
export function drawTrial(rows) {
  if (byId("trials").offsetParent === null || !rows.length || !ready()) return;
  trialChart ??= makeChart(byId("plot-trial"), TRIAL, (_, low, high) => [0, Math.max(high ?? 0, 20)]);
  fitted(trialChart, "plot-trial", TRIAL).setData([0, 1, 2, 3].map((column) => rows.map((row) => row[column])), true);
}
