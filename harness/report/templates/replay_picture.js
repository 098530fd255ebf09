/* The road picture: what the sensor sees, vehicles, detections, tracks, particles. */

function sharpen(target) {
  const ratio = window.devicePixelRatio || 1, width = target.clientWidth, height = target.clientHeight;
  if (target.width !== Math.round(width * ratio) || target.height !== Math.round(height * ratio)) {
    target.width = Math.round(width * ratio);
    target.height = Math.round(height * ratio);
  }
  const pen = target.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  return pen;
}

function outline(pen, points) {
  pen.beginPath();
  points.forEach(([x, y], k) => (k ? pen.lineTo(x, y) : pen.moveTo(x, y)));
  pen.closePath();
}

function alongLane(camera, lane, lat) {
  const from = Math.max(lane[2], camera.lon - camera.reach), to = Math.min(lane[3], camera.lon + camera.reach);
  if (from >= to) return [];
  const pieces = road.straight ? 1 : Math.ceil((to - from) / 4);
  return Array.from({ length: pieces + 1 }, (_, k) => camera.at(from + ((to - from) * k) / pieces, lat));
}

function drawRoad() {
  panes.forEach(drawPane);
}

function drawPane(pane, side) {
  const pen = sharpen(pane.canvas), camera = makeCamera(pane), marks = marksAt(view.step, side);
  written = [];
  pen.save();
  clipToRoad(pen, camera);
  pen.fillStyle = colourOf("beyond");
  pen.fillRect(0, 0, camera.width, camera.height);
  drawSensorView(pen, camera);
  pen.restore();
  if (shown.unseen && pane.data.unseen) drawUnseen(pen, camera);
  drawLaneLines(pen, camera);
  drawMarks(pen, camera, marks);
  if (shown.trails) drawTrails(pen, camera);
  if (shown.vehicles) drawVehicles(pen, camera);
  if (shown.particles && pane.data.particles) drawParticles(pen, camera);
  if (shown.detections) drawDetections(pen, camera);
  if (shown.tracks && shown.arrows) drawArrows(pen, camera);
  drawFollowed(pen, camera);
  if (shown.tracks) drawTracks(pen, camera);
  drawScale(pen, camera);
  nameFollowed(pen, camera);
  nameMarks(pen, camera, marks);
  if (shown.tracks && shown.numbers && camera.scale > 4.5) numberTracks(pen, camera, side);
}

/* Stretches of lane, the bluer the more vehicles are expected there; they are told twice a second. */
function drawUnseen(pen, camera) {
  const t = camera.data.unseen;
  let step = view.step;
  while (step > 0 && t.first[step] === t.first[step + 1] && data.episode[step - 1] === data.episode[view.step]) step--;
  const [begin, end] = range(t, step);
  pen.save();
  pen.strokeStyle = colourOf("unseen");
  pen.lineWidth = UNSEEN_WIDTH_M * camera.scale;
  for (let k = begin; k < end; k++) {
    const [x, y] = camera.at(t.lon[k], t.lat[k]), [toX, toY] = camera.at(t.to_lon[k], t.to_lat[k]);
    if (Math.max(x, toX) < 0 || Math.min(x, toX) > camera.width) continue;
    pen.globalAlpha = Math.min(0.75, (0.75 * t.expected[k]) / 1000);
    pen.beginPath();
    pen.moveTo(x, y);
    pen.lineTo(toX, toY);
    pen.stroke();
  }
  pen.restore();
}

/* The outline of a lane of a network, as wide as the lane and some more to either side. */
function ribbon(camera, line, moreM) {
  const half = line.width / 2 + moreM, left = [], right = [];
  line.xy.forEach(([x, y], k) => {
    const [ax, ay] = line.xy[Math.max(k - 1, 0)], [bx, by] = line.xy[Math.min(k + 1, line.xy.length - 1)];
    const long = Math.hypot(bx - ax, by - ay) || 1, nx = (-(by - ay) / long) * half, ny = ((bx - ax) / long) * half;
    left.push(camera.point(x + nx, y + ny));
    right.push(camera.point(x - nx, y - ny));
  });
  return [left, right];
}

function clipToRoad(pen, camera) {
  if (![road.lines || [], road.ramps, road.lanes].some((parts) => parts.length)) return; // no lanes: the whole plane
  pen.beginPath();
  for (const line of road.lines || []) {
    const [left, right] = ribbon(camera, line, 1.2);
    [...left, ...right.reverse()].forEach(([x, y], k) => (k ? pen.lineTo(x, y) : pen.moveTo(x, y)));
    pen.closePath();
  }
  for (const ramp of road.ramps) {
    ramp.forEach(([lon, lat], k) => (k ? pen.lineTo(...camera.at(lon, lat)) : pen.moveTo(...camera.at(lon, lat))));
    pen.closePath();
  }
  for (const lane of road.lanes) {
    const edge = [...alongLane(camera, lane, lane[0] - 1.2), ...alongLane(camera, lane, lane[1] + 1.2).reverse()];
    edge.forEach(([x, y], k) => (k ? pen.lineTo(x, y) : pen.moveTo(x, y)));
    if (edge.length) pen.closePath();
  }
  pen.clip();
}

function drawSensorView(pen, camera) {
  const row = egoRow(view.step), lon = data.truth.lon[row];
  const sensor = road.plane(lon, data.truth.lat[row]);
  const forward = road.heading(lon) + data.truth.heading[row] / 1e4 - camera.turn;
  const half = (Math.min(data.field_of_view_deg, 360) * Math.PI) / 360, [x, y] = camera.point(...sensor);
  pen.fillStyle = colourOf("seen");
  pen.beginPath();
  if (half < Math.PI) pen.moveTo(x, y);
  pen.arc(x, y, data.range_m * camera.scale, -forward - half, -forward + half);
  pen.fill();
  if (!shown.shadows) return;
  pen.clip(); // what hides reaches beyond the sensor's range, its shadow does not
  pen.fillStyle = colourOf("shadow");
  const [begin, end] = range(data.detections, view.step);
  for (let k = begin; k < end; k++) drawShadow(pen, camera, sensor, k);
  for (const wall of road.walls) drawWallShadow(pen, camera, sensor, wall);
}

function drawWallShadow(pen, camera, sensor, wall) {
  const ends = [[wall[0] - sensor[0], wall[1] - sensor[1]], [wall[2] - sensor[0], wall[3] - sensor[1]]];
  if (Math.min(...ends.map(([x, y]) => Math.hypot(x, y))) >= data.range_m) return;
  const from = Math.atan2(ends[1][1], ends[1][0]), turn = Math.atan2(ends[0][1], ends[0][0]) - from;
  const swept = turn - 2 * Math.PI * Math.round(turn / (2 * Math.PI)), pieces = Math.max(2, Math.ceil(Math.abs(swept) / 0.02));
  const points = [...ends];
  for (let k = 0; k <= pieces; k++) {
    const angle = from + (swept * k) / pieces;
    points.push([data.range_m * Math.cos(angle), data.range_m * Math.sin(angle)]);
  }
  outline(pen, points.map(([x, y]) => camera.point(x + sensor[0], y + sensor[1])));
  pen.fill();
}

function drawShadow(pen, camera, sensor, k) {
  const detected = data.detections, lon = detected.lon[k], [x, y] = road.plane(lon, detected.lat[k]);
  const length = detected.length[k] / 100, width = detected.width[k] / 100, heading = road.heading(lon) + (detected.turn ? detected.turn[k] / 1e4 : 0);
  const corners = boxCorners(x - sensor[0], y - sensor[1], heading, length, width);
  const towards = Math.atan2(y - sensor[1], x - sensor[0]);
  const along = Math.abs(Math.cos(heading) * (x - sensor[0]) + Math.sin(heading) * (y - sensor[1]));
  const across = Math.abs(Math.cos(heading) * (y - sensor[1]) - Math.sin(heading) * (x - sensor[0]));
  if (along < length / 2 && across < width / 2) return;
  if (Math.max(...corners.map(([cx, cy]) => Math.hypot(cx, cy))) >= data.range_m) return;
  const wrap = (angle) => angle - 2 * Math.PI * Math.round(angle / (2 * Math.PI));
  const offsets = corners.map(([cx, cy]) => wrap(Math.atan2(cy, cx) - towards));
  const right = offsets.indexOf(Math.min(...offsets)), left = offsets.indexOf(Math.max(...offsets));
  const points = [];
  for (let k = right; ; k = (k + 1) % 4) {
    points.push(corners[k]);
    if (k === left) break;
  }
  const pieces = Math.max(2, Math.ceil((offsets[left] - offsets[right]) / 0.02));
  for (let k = 0; k <= pieces; k++) {
    const angle = towards + offsets[left] + ((offsets[right] - offsets[left]) * k) / pieces;
    points.push([data.range_m * Math.cos(angle), data.range_m * Math.sin(angle)]);
  }
  outline(pen, points.map(([px, py]) => camera.point(px + sensor[0], py + sensor[1])));
  pen.fill();
}

function boxCorners(x, y, heading, length, width) {
  const c = Math.cos(heading), s = Math.sin(heading);
  return [[1, 1], [-1, 1], [-1, -1], [1, -1]].map(([a, b]) =>
    [x + (a * length * c - b * width * s) / 2, y + (a * length * s + b * width * c) / 2]);
}

function drawLaneLines(pen, camera) {
  const beside = (lon, lat) => road.lanes.some((l) => lat > l[0] && lat < l[1] && lon >= l[2] && lon < l[3]);
  pen.strokeStyle = colourOf("car-out");
  pen.lineWidth = 1;
  if (road.lines) return drawNetwork(pen, camera);
  for (const ramp of road.ramps) {
    outline(pen, ramp.map(([lon, lat]) => camera.at(lon, lat)));
    pen.stroke();
  }
  const sides = new Map();
  for (const lane of road.lanes) for (const lat of [lane[0], lane[1]]) sides.set(`${lat}/${lane[2]}`, [lane, lat]);
  const cuts = [...new Set(road.lanes.flatMap((lane) => [lane[2], lane[3]]))].sort((a, b) => a - b);
  for (const [lane, lat] of sides.values()) {
    for (let k = 0; k + 1 < cuts.length; k++) {
      const piece = [0, 0, Math.max(lane[2], cuts[k]), Math.min(lane[3], cuts[k + 1])];
      if (piece[2] >= piece[3]) continue;
      const inner = beside((piece[2] + piece[3]) / 2, lat - 0.5) && beside((piece[2] + piece[3]) / 2, lat + 0.5);
      const points = alongLane(camera, piece, lat), dash = 3 * camera.scale;
      pen.setLineDash(inner ? [dash, dash] : []);
      const from = Math.max(piece[2], camera.lon - camera.reach);
      pen.lineDashOffset = inner ? (from * camera.scale) % (2 * dash) : 0; // dashes stay put on the road
      pen.beginPath();
      points.forEach(([x, y], n) => (n ? pen.lineTo(x, y) : pen.moveTo(x, y)));
      pen.stroke();
    }
  }
  pen.setLineDash([]);
}

function drawNetwork(pen, camera) {
  for (const line of road.lines) {
    pen.globalAlpha = line.junction ? 0.25 : 1; // paths across a junction are no lines on the ground
    for (const edge of ribbon(camera, line, 0)) {
      pen.beginPath();
      edge.forEach(([x, y], k) => (k ? pen.lineTo(x, y) : pen.moveTo(x, y)));
      pen.stroke();
    }
  }
  pen.globalAlpha = 1;
  pen.strokeStyle = colourOf("wall");
  pen.lineWidth = 3;
  for (const wall of road.walls) {
    pen.beginPath();
    pen.moveTo(...camera.point(wall[0], wall[1]));
    pen.lineTo(...camera.point(wall[2], wall[3]));
    pen.stroke();
  }
}

function bodyOf(camera, row, grownM = 0) {
  const t = data.truth, vehicle = t.vehicle[row], [x, y] = road.plane(t.lon[row], t.lat[row]);
  const heading = road.heading(t.lon[row]) + t.heading[row] / 1e4;
  const length = data.vehicles.length_m[vehicle] + grownM, width = data.vehicles.width_m[vehicle] + grownM;
  return boxCorners(x, y, heading, length, width).map(([px, py]) => camera.point(px, py));
}

function drawVehicles(pen, camera) {
  const [begin, end] = range(data.truth, view.step);
  for (let row = begin; row < end; row++) {
    if (Math.abs(data.truth.lon[row] - camera.lon) > camera.reach + 10) continue;
    outline(pen, bodyOf(camera, row));
    const state = data.truth.state[row];
    if (data.truth.ego[row] || state < HIDDEN) {
      pen.fillStyle = colourOf(data.truth.ego[row] ? "black" : STATE_COLOURS[state]);
      pen.fill();
      if (data.truth.ego[row]) continue;
      pen.strokeStyle = colourOf(EDGES[state]);
      pen.lineWidth = 1.2;
      pen.stroke();
    } else {
      pen.strokeStyle = colourOf(STATE_COLOURS[state]);
      pen.lineWidth = state === HIDDEN ? 2 : 1;
      pen.stroke();
    }
  }
  const ego = egoRow(view.step), [x, y] = camera.at(data.truth.lon[ego], data.truth.lat[ego]);
  if (camera.scale > 5.5) write(pen, "ego", [[x, y + 4]], "paper");
}

const isShown = (t, k) => !t.id || shown.tentative || t.state[k] !== TENTATIVE;
const isNear = (camera, t, k) => Math.abs(t.lon[k] - camera.lon) <= camera.reach + 10;

/* Where vehicles and tracks were in the last seconds. */
function drawTrails(pen, camera) {
  const paths = new Map();
  for (let step = Math.max(0, view.step - Math.round(TRAIL_S / stepS)); step <= view.step; step++) {
    if (data.episode[step] !== data.episode[view.step]) continue;
    for (const [on, t, names, colour] of [[shown.vehicles, data.truth, data.truth.vehicle, colourOf("trail")],
      [shown.tracks, camera.data.tracks, camera.data.tracks.id, colourOf("track")]]) {
      const [begin, end] = range(t, step);
      for (let k = begin; on && k < end; k++) {
        if (!isShown(t, k) || !isNear(camera, t, k)) continue;
        const key = colour + names[k];
        if (!paths.has(key)) paths.set(key, { colour, points: [] });
        paths.get(key).points.push(camera.at(t.lon[k], t.lat[k]));
      }
    }
  }
  pen.globalAlpha = 0.6;
  pen.lineWidth = 1.5;
  for (const { colour, points } of paths.values()) {
    pen.strokeStyle = colour;
    pen.beginPath();
    points.forEach(([x, y], k) => (k ? pen.lineTo(x, y) : pen.moveTo(x, y)));
    pen.stroke();
  }
  pen.globalAlpha = 1;
}

/* Each arrow ends where the track is in a second if it goes on like this. */
function drawArrows(pen, camera) {
  const before = Math.max(0, view.step - Math.round(0.5 / stepS));
  const t = camera.data.tracks, [begin, end] = range(t, view.step);
  pen.strokeStyle = colourOf("track");
  pen.lineWidth = 1.2;
  for (let k = begin; k < end; k++) {
    const long = t.speed_mps[k] * ARROW_S * camera.scale;
    if (!isShown(t, k) || !isNear(camera, t, k) || long < 6) continue;
    let heading = Math.atan2(t.lat_speed_mps[k], Math.max(t.speed_mps[k], 1));
    if (road.lines) { // the table does not tell which way a track points: it goes on as it went
      const [first, last] = range(t, before), was = t.id.subarray(first, last).indexOf(t.id[k]);
      if (was < 0) continue;
      heading = Math.atan2(t.lat[k] - t.lat[first + was], t.lon[k] - t.lon[first + was]);
    }
    drawArrow(pen, ...camera.at(t.lon[k], t.lat[k]), road.heading(t.lon[k]) + heading - camera.turn, long);
  }
}

function drawArrow(pen, x, y, turn, long) {
  const toX = x + long * Math.cos(turn), toY = y - long * Math.sin(turn);
  pen.beginPath();
  pen.moveTo(x, y);
  pen.lineTo(toX, toY);
  for (const side of [2.7, -2.7]) {
    pen.moveTo(toX, toY);
    pen.lineTo(toX + 6 * Math.cos(turn + side), toY - 6 * Math.sin(turn + side));
  }
  pen.stroke();
}

function drawParticles(pen, camera) {
  const particles = camera.data.particles, [begin, end] = range(particles, view.step);
  const ego = egoRow(view.step), egoLon = data.truth.lon[ego], egoLat = data.truth.lat[ego];
  pen.fillStyle = colourOf("particle");
  for (let k = begin; k < end; k++) {
    const [x, y] = camera.at(egoLon + particles.away[k] / 10, egoLat + particles.lat[k] / 100);
    pen.fillRect(x - 1, y - 1, 2, 2);
  }
}

function drawDetections(pen, camera) {
  const [begin, end] = range(data.detections, view.step), arm = 4;
  pen.strokeStyle = colourOf("black");
  pen.lineWidth = 1.5;
  pen.beginPath();
  for (let k = begin; k < end; k++) {
    const [x, y] = camera.at(data.detections.lon[k], data.detections.lat[k]);
    pen.moveTo(x - arm, y - arm); pen.lineTo(x + arm, y + arm);
    pen.moveTo(x - arm, y + arm); pen.lineTo(x + arm, y - arm);
  }
  pen.stroke();
}

/* The number of the track that is on the followed vehicle; -1 without one. */
function ownTrack(camera) {
  const row = rowOf(view.followed, view.step);
  return row >= 0 ? camera.data.truth.track[row] : -1;
}

/* Half the axes of a track's ellipse in pixels, along the road and across. */
const axesOf = (camera, t, k) => [t.std_lon[k], t.std_lat[k]].map((std) => Math.max(2, (ELLIPSE_SCALE * std * camera.scale) / 100));

function drawTracks(pen, camera) {
  const t = camera.data.tracks, [begin, end] = range(t, view.step), own = ownTrack(camera);
  for (let k = begin; k < end; k++) {
    if (!isShown(t, k) || !isNear(camera, t, k)) continue;
    const [x, y] = camera.at(t.lon[k], t.lat[k]), turn = camera.turn - road.heading(t.lon[k]), [long, wide] = axesOf(camera, t, k);
    pen.globalAlpha = t.state[k] === TENTATIVE ? 0.65 : 1;
    pen.strokeStyle = colourOf("track");
    pen.lineWidth = t.id[k] === own ? 3 : 1.6;
    pen.setLineDash(t.state[k] === TRACK_HIDDEN ? [5, 3] : []);
    pen.beginPath();
    pen.ellipse(x, y, long, wide, turn, 0, 2 * Math.PI);
    pen.stroke();
    pen.setLineDash([]);
    pen.globalAlpha = 1;
  }
}

/* On which side of each track its number stood last, for each pane: it stays there as long as there is room. */
const lastSides = [new Map(), new Map()];

/* Numbers beside their tracks, that of the followed vehicle first; one without room is left out. */
function numberTracks(pen, camera, side) {
  const t = camera.data.tracks, [begin, end] = range(t, view.step), own = ownTrack(camera), sides = lastSides[side];
  const rows = Array.from({ length: end - begin }, (_, k) => begin + k).filter((k) => isShown(t, k) && isNear(camera, t, k));
  for (const k of rows.sort((a, b) => (t.id[b] === own) - (t.id[a] === own))) {
    const [x, y] = camera.at(t.lon[k], t.lat[k]), [long, wide] = axesOf(camera, t, k), text = String(t.id[k]);
    const up = Math.min(Math.max(wide, camera.scale), 2.2 * camera.scale) + 2;
    const away = Math.min(Math.max(long, 2.3 * camera.scale), 4 * camera.scale) + 4 + 3.2 * text.length;
    const spots = [[x, y - up], [x, y + up + 9], [x + away, y + 4], [x - away, y + 4]], last = sides.get(t.id[k]) || 0;
    const order = [last, ...spots.keys()], taken = write(pen, text, order.map((spot) => spots[spot]), "track");
    if (taken >= 0) sides.set(t.id[k], order[taken]);
  }
}

function drawFollowed(pen, camera) {
  const row = rowOf(view.followed, view.step);
  if (row < 0) return;
  outline(pen, bodyOf(camera, row, 7 / camera.scale)); // a ring round the body leaves its colour to be seen
  pen.strokeStyle = colourOf("black");
  pen.lineWidth = 2.5;
  pen.stroke();
  const [x, y] = [0, 1].map((axis) => bodyOf(camera, row).map((corner) => corner[axis])); // no other's number stands on it
  written.push([Math.min(...x) + 2, Math.max(...x) - 2, Math.min(...y) + 2, Math.max(...y) - 2]);
}

function nameFollowed(pen, camera) {
  const row = rowOf(view.followed, view.step);
  if (row < 0) return;
  const [x, y] = camera.at(data.truth.lon[row], data.truth.lat[row]), name = data.vehicles.names[view.followed];
  const away = 1.1 * camera.scale + 18, below = y + away < camera.height - 4;
  // Names of recordings may be longer than what they name is wide; the line below the picture has them in full.
  const told = name.length > 16 ? `${name.slice(0, 8)}…` : name, beside = x + 3.4 * camera.scale + 4 * told.length;
  write(pen, told, [...(below ? [[x, y + away], [beside, y + 4]] : []), [x, y - away - 8]], "black", "bold 13px");
}

function drawScale(pen, camera) {
  const y = camera.height - 10, long = [50, 20, 10, 5].find((m) => m * camera.scale < 0.3 * camera.width) || 5;
  pen.font = "12px system-ui, sans-serif";
  pen.textAlign = "left";
  const text = road.lines ? `${long} m, north is up` : `${long} m, driving direction →`;
  pen.fillStyle = colourOf("halo"); // no line of the road or of a vehicle's way crosses the words
  const wide = Math.max(long * camera.scale, pen.measureText(text).width) + 8;
  pen.fillRect(8, y - 18, wide, 23);
  written.push([8, 8 + wide, y - 18, y + 5]);
  pen.fillStyle = colourOf("words");
  pen.fillRect(12, y, long * camera.scale, 2);
  pen.fillText(text, 12, y - 5);
}

/* Where words stand in the pane that is drawn: left, right, top and bottom of each. */
let written = [];

/* Writes on the first of the spots, the middles of baselines, where no other words are, and returns which; -1 for none. */
function write(pen, text, spots, colour, font = "11px") {
  pen.font = `${font} system-ui, sans-serif`;
  pen.textAlign = "center";
  const half = pen.measureText(text).width / 2 + 1, boxOf = ([x, y]) => [x - half, x + half, y - 9, y + 2];
  const isFree = (a) => written.every((b) => a[0] >= b[1] || b[0] >= a[1] || a[2] >= b[3] || b[2] >= a[3]);
  const found = spots.findIndex((spot) => isFree(boxOf(spot)));
  if (found < 0) return found;
  const [x, y] = spots[found];
  written.push(boxOf(spots[found]));
  if (colour !== "paper") {
    pen.lineWidth = 3;
    pen.strokeStyle = colourOf("halo");
    pen.strokeText(text, x, y);
  }
  pen.fillStyle = colourOf(colour);
  pen.fillText(text, x, y);
  return found;
}
