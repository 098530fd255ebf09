/* The road from above, replayed from a run's recorded tables. Positions are in the road frame (metres along the road,
   metres to the left); the picture is the plane that the road lies in, turned so that the road points to the right.
   On a network of many roads the frame is the plane itself (metres east, metres north), and north is up. */

const data = unpack(JSON.parse(document.getElementById("replay-data").textContent));
const element = (id) => document.getElementById(id);
/* Two trackers on the same detections have a pane each; what happened on the road is the same in both. */
const panes = [{ canvas: element("road"), data }];
if (data.other) {
  const truth = { ...data.truth, ...data.other.truth };
  panes.push({ canvas: element("road-b"), data: { ...data, ...data.other, truth } });
}
const canvas = panes[0].canvas, chart = element("chart"), timeline = element("timeline");
const STATES = ["visible", "partly hidden", "hidden", "out of range"];
const UNSEEN_WIDTH_M = 2.4, TRAIL_S = 2, ARROW_S = 1;
/* A colour of the page by its name in the style sheet, for the reader's light or dark scheme. */
let colours = {};
const colourOf = (name) => (colours[name] ||= getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim());
const STATE_COLOURS = ["car-visible", "car-partial", "car-hidden", "car-out"], EDGES = ["edge-visible", "edge-partial"];
const ELLIPSE_SCALE = 2.4477; // a two-dimensional normal distribution holds 95 % within so many deviations
const NO_ERROR = 65535, TENTATIVE = 0, TRACK_HIDDEN = 2, HIDDEN = 2, FAR = 4;
const steps = data.time_s.length;
const stepS = steps > 1 ? (data.time_s[steps - 1] - data.time_s[0]) / (steps - 1) : 0.1;
const road = openRoad(data.road);
if (road.lines) document.querySelectorAll(".road").forEach((each) => each.classList.add("square"));
const view = { step: 0, playing: false, speed: 1, scale: 0, pan: 0, across: 0, until: Infinity, followed: -1, clock: 0, left: 0, plot: 0 };
const shown = { vehicles: true, shadows: true, detections: true, tracks: true, tentative: false, numbers: true,
  unseen: true, particles: false, trails: true, arrows: true };

function unpack(value) {
  if (Array.isArray(value) || value === null || typeof value !== "object") return value;
  if (typeof value.data === "string" && value.type) {
    const bytes = Uint8Array.from(atob(value.data), (letter) => letter.charCodeAt(0)).buffer;
    const kinds = { f4: Float32Array, u4: Uint32Array, i4: Int32Array, u2: Uint16Array, i2: Int16Array,
      u1: Uint8Array };
    return new kinds[value.type](bytes);
  }
  return Object.fromEntries(Object.entries(value).map(([key, item]) => [key, unpack(item)]));
}

/* ---- the road's frame and the picture's ---- */

function openRoad(fields) {
  const points = fields.reference_xy, starts = [fields.reference_start_m], headings = [];
  for (let k = 0; k + 1 < points.length; k++) {
    const dx = points[k + 1][0] - points[k][0], dy = points[k + 1][1] - points[k][1];
    headings.push(Math.atan2(dy, dx));
    starts.push(starts[k] + Math.hypot(dx, dy));
  }
  const segment = (lon) => {
    let k = 0;
    while (k + 1 < headings.length && lon >= starts[k + 1]) k++;
    return k;
  };
  const middle = fields.lanes.reduce((sum, lane) => sum + lane[0] + lane[1], 0) / (2 * fields.lanes.length);
  return {
    lanes: fields.lanes, ramps: fields.ramps || [], middle, straight: headings.length === 1, lines: fields.lines, walls: fields.walls || [],
    width: Math.max(...fields.lanes.map((l) => l[1])) - Math.min(...fields.lanes.map((l) => l[0])),
    heading: (lon) => headings[segment(lon)],
    plane: (lon, lat) => {
      const k = segment(lon), along = lon - starts[k], c = Math.cos(headings[k]), s = Math.sin(headings[k]);
      return [points[k][0] + along * c - lat * s, points[k][1] + along * s + lat * c];
    },
  };
}

function makeCamera(pane = panes[0]) {
  const row = rowOf(view.followed, view.step), ego = egoRow(view.step);
  const lon = data.truth.lon[row >= 0 ? row : ego] + view.pan;
  const lat = data.truth.lat[row >= 0 ? row : ego], half = pane.canvas.clientHeight / (2 * view.scale) - 4;
  // Along one road the picture stays in its middle as long as that leaves the vehicle in sight.
  const middle = road.lines ? lat : Math.max(Math.min(road.middle, lat + Math.max(half, 0)), lat - Math.max(half, 0));
  const [cx, cy] = road.plane(lon, middle + view.across), turn = road.heading(lon);
  const cos = Math.cos(turn), sin = Math.sin(turn);
  const width = pane.canvas.clientWidth, height = pane.canvas.clientHeight, scale = view.scale;
  return {
    data: pane.data, lon, turn, scale, width, height, reach: width / (2 * scale) + 12,
    point: (x, y) => {
      const dx = x - cx, dy = y - cy;
      return [width / 2 + scale * (dx * cos + dy * sin), height / 2 - scale * (dy * cos - dx * sin)];
    },
    at(lonM, latM) { return this.point(...road.plane(lonM, latM)); },
  };
}

const range = (table, step) => [table.first[step], table.first[step + 1]];

function rowOf(vehicle, step) {
  const [begin, end] = range(data.truth, step);
  for (let row = begin; row < end; row++) if (data.truth.vehicle[row] === vehicle) return row;
  return -1;
}

function egoRow(step) {
  const [begin, end] = range(data.truth, step);
  for (let row = begin; row < end; row++) if (data.truth.ego[row]) return row;
  return begin;
}
