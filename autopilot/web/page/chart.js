// A small chart without tiles: north up, the track, the route, the wind, the boat to its heading, a scale.
import { boat } from "./boat.js";

const byId = (id) => document.getElementById(id);
const M_PER_DEG = 111195, NM = 1852;
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
let fitted = true, metres = 400, drawn = "";

export function setUpChart() {
  const zoom = (factor) => () => { fitted = false; metres = Math.min(2e6, Math.max(20, metres * factor)); drawChart(); };
  byId("nearer").addEventListener("click", zoom(0.5));
  byId("further").addEventListener("click", zoom(2));
  byId("fit").addEventListener("click", () => { fitted = true; drawChart(); });
  addEventListener("resize", () => { drawn = ""; drawChart(); });
}

/* [east, north] in metres from the boat */
export function seen([latitude, longitude], here) {
  const east = ((longitude - here[1] + 540) % 360 + 360) % 360 - 180; // the date line is crossed, not gone back round to
  return [east * M_PER_DEG * Math.cos(here[0] * Math.PI / 180), (latitude - here[0]) * M_PER_DEG];
}

/* Half the width shown: the leg that is sailed and the last minutes of the track. */
function fit(route, track) {
  const next = Math.min(boat.state.waypoint ?? 0, route.length - 1);
  const shown = [...route.slice(Math.max(0, next - 1), next + 1), ...track.slice(-150)];
  return Math.max(50, ...shown.map(([east, north]) => 1.15 * Math.hypot(east, north)));
}

function scaleOf(metresPerPixel) {
  const most = 120 * metresPerPixel, unit = most > 0.5 * NM ? NM : 1;
  const power = 10 ** Math.floor(Math.log10(most / unit));
  const count = [5, 2, 1].find((each) => each * power <= most / unit) * power;
  return [count * unit / metresPerPixel, unit === NM ? `${+count.toPrecision(3)} nm` : `${count} m`];
}

export function drawChart() {
  const canvas = byId("sea"), state = boat.state;
  if (canvas.offsetParent === null || !state) return;
  const known = typeof state.lat === "number" && typeof state.lon === "number";
  byId("chart-word").textContent = known ? boat.isStale("position") ? "The position is old." : "" : "No position comes from the boat.";
  const key = JSON.stringify([state.lat, state.lon, state.heading, state.twd, boat.track.length, boat.route, metres, fitted, state.waypoint, state.mob_distance, document.documentElement.dataset.theme, canvas.clientWidth, canvas.clientHeight]);
  if (!known || key === drawn) return;
  drawn = key;
  const ratio = devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
  canvas.width = width * ratio;
  canvas.height = height * ratio;
  const pen = canvas.getContext("2d"), here = [state.lat, state.lon];
  const route = boat.route.map((place) => seen(place, here)), track = boat.track.map(([, ...place]) => seen(place, here));
  if (fitted) metres = fit(route, track);
  const perPixel = 2 * metres / Math.min(width, height);
  const at = ([east, north]) => [width / 2 + east / perPixel, height / 2 - north / perPixel];
  pen.scale(ratio, ratio);
  pen.font = "600 15px system-ui, sans-serif";
  const path = (points, ink, thick, dash = []) => {
    pen.beginPath();
    pen.setLineDash(dash);
    points.forEach((point, index) => pen[index ? "lineTo" : "moveTo"](...at(point)));
    Object.assign(pen, { strokeStyle: colour(ink), lineWidth: thick, lineJoin: "round" });
    pen.stroke();
    pen.setLineDash([]);
  };
  path([...track, [0, 0]], "dim", 2);
  path(route, "order", 2, [8, 5]);
  route.forEach((place, index) => {
    const [x, y] = at(place), isNext = state.mode === "route" && index === state.waypoint;
    pen.beginPath();
    pen.arc(x, y, isNext ? 8 : 5, 0, 7);
    pen.fillStyle = colour("order");
    pen.fill();
    pen.fillText(String(index), x + 10, y - 8);
  });
  if (typeof state.mob_bearing === "number" && !boat.isStale("mob")) {
    const bearing = state.mob_bearing * Math.PI / 180, overboard = [Math.sin(bearing), Math.cos(bearing)].map((part) => part * state.mob_distance);
    path([[0, 0], overboard], "port", 3);
    pen.fillStyle = colour("port");
    const [x, y] = at(overboard);
    pen.fillText("MOB", x + 12, y + 5); // beside the boat that lies over the place
  }
  drawBoat(pen, width / 2, height / 2, state.heading);
  drawFrame(pen, width, height, perPixel, state);
  canvas.setAttribute("aria-label", `Chart: ${route.length} waypoints, ${Math.round(2 * metres)} m across`);
}

function drawBoat(pen, x, y, heading) {
  pen.save();
  pen.translate(x, y);
  pen.rotate((heading ?? 0) * Math.PI / 180);
  pen.beginPath();
  for (const point of [[0, -15], [8, 3], [6, 12], [-6, 12], [-8, 3]]) pen.lineTo(...point);
  pen.closePath();
  Object.assign(pen, { fillStyle: colour("text"), strokeStyle: colour("back"), lineWidth: 2 });
  pen.fill();
  pen.stroke();
  pen.restore();
}

function arrow(pen, x, y, degrees, words) {
  pen.save();
  pen.translate(x, y);
  pen.rotate(degrees * Math.PI / 180);
  pen.beginPath();
  for (const point of [[0, -18], [7, -4], [2, -4], [2, 16], [-2, 16], [-2, -4], [-7, -4]]) pen.lineTo(...point);
  pen.closePath();
  pen.fill();
  pen.restore();
  pen.fillText(words, x - pen.measureText(words).width / 2, y + 34);
}

/* North, wind and scale. The wind comes from the side at which the arrow begins. */
function drawFrame(pen, width, height, perPixel, state) {
  pen.fillStyle = colour("text");
  arrow(pen, 28, 30, 0, "N");
  const angle = state.twa ?? state.awa, speed = state.twa === undefined ? state.aws : state.tws;
  if (typeof angle === "number" && typeof state.heading === "number" && !boat.isStale("wind")) {
    arrow(pen, 84, 30, state.heading + angle + 180, `${typeof speed === "number" ? speed.toFixed(0) : "--"} kn`);
  }
  const [pixels, words] = scaleOf(perPixel);
  pen.fillRect(16, height - 14, pixels, 3);
  for (const x of [16, 13 + pixels]) pen.fillRect(x, height - 20, 3, 9);
  pen.fillText(words, 16, height - 26);
}
