/* The road from above, replayed from a run's recorded tables. Positions are in the road frame (metres along the road,
   metres to the left); the picture is the plane that the road lies in, turned so that the road points to the right. */
"use strict";
(() => {
  const data = unpack(JSON.parse(document.getElementById("replay-data").textContent));
  const element = (id) => document.getElementById(id);
  const canvas = element("road"), chart = element("chart"), timeline = element("timeline");
  const STATES = ["visible", "partly hidden", "hidden", "out of range"];
  const GREEN = "#009E73", ORANGE = "#E69F00", VERMILION = "#D55E00", PURPLE = "#882255";
  const OUT_OF_SIGHT = "#efece6", SEEN = "#ffffff", SHADOW = "#d3d3d3";
  const STATE_COLOURS = [GREEN, ORANGE, VERMILION, "#9a9a9a"];
  const ELLIPSE_SCALE = 2.4477; // a two-dimensional normal distribution holds 95 % within so many deviations
  const NO_ERROR = 65535, TENTATIVE = 0, TRACK_HIDDEN = 2, HIDDEN = 2;
  const steps = data.time_s.length;
  const stepS = steps > 1 ? (data.time_s[steps - 1] - data.time_s[0]) / (steps - 1) : 0.1;
  const road = openRoad(data.road);
  const view = { step: 0, playing: false, speed: 1, scale: 0, pan: 0, followed: -1, clock: 0, left: 0 };
  const shown = { vehicles: true, shadows: true, detections: true, tracks: true, tentative: false, numbers: true,
    particles: false };

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
      lanes: fields.lanes, middle, straight: headings.length === 1,
      width: Math.max(...fields.lanes.map((l) => l[1])) - Math.min(...fields.lanes.map((l) => l[0])),
      heading: (lon) => headings[segment(lon)],
      plane: (lon, lat) => {
        const k = segment(lon), along = lon - starts[k], c = Math.cos(headings[k]), s = Math.sin(headings[k]);
        return [points[k][0] + along * c - lat * s, points[k][1] + along * s + lat * c];
      },
    };
  }

  function makeCamera() {
    const row = rowOf(view.followed, view.step), ego = egoRow(view.step);
    const lon = data.truth.lon[row >= 0 ? row : ego] + view.pan;
    const [cx, cy] = road.plane(lon, road.middle), turn = road.heading(lon);
    const cos = Math.cos(turn), sin = Math.sin(turn);
    const width = canvas.clientWidth, height = canvas.clientHeight, scale = view.scale;
    return {
      lon, turn, scale, width, height, reach: width / (2 * scale) + 12,
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

  /* ---- the road picture ---- */

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
    const pen = sharpen(canvas), camera = makeCamera();
    pen.save();
    clipToRoad(pen, camera);
    pen.fillStyle = OUT_OF_SIGHT;
    pen.fillRect(0, 0, camera.width, camera.height);
    drawSensorView(pen, camera);
    pen.restore();
    drawLaneLines(pen, camera);
    if (shown.vehicles) drawVehicles(pen, camera);
    if (shown.particles && data.particles) drawParticles(pen, camera);
    if (shown.detections) drawDetections(pen, camera);
    if (shown.tracks) drawTracks(pen, camera);
    drawFollowed(pen, camera);
    drawScale(pen, camera);
  }

  function clipToRoad(pen, camera) {
    pen.beginPath();
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
    pen.fillStyle = SEEN;
    pen.beginPath();
    if (half < Math.PI) pen.moveTo(x, y);
    pen.arc(x, y, data.range_m * camera.scale, -forward - half, -forward + half);
    pen.fill();
    if (!shown.shadows) return;
    pen.fillStyle = SHADOW;
    const [begin, end] = range(data.detections, view.step);
    for (let k = begin; k < end; k++) drawShadow(pen, camera, sensor, data.detections.lon[k], data.detections.lat[k]);
  }

  function drawShadow(pen, camera, sensor, lon, lat) {
    const [length, width] = data.nominal_m, [x, y] = road.plane(lon, lat), heading = road.heading(lon);
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
    pen.strokeStyle = "#8c8c8c";
    pen.lineWidth = 1;
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
        pen.fillStyle = data.truth.ego[row] ? "#000000" : STATE_COLOURS[state];
        pen.fill();
      } else {
        pen.strokeStyle = STATE_COLOURS[state];
        pen.lineWidth = state === HIDDEN ? 2 : 1;
        pen.stroke();
      }
    }
    const ego = egoRow(view.step), [x, y] = camera.at(data.truth.lon[ego], data.truth.lat[ego]);
    if (camera.scale > 5.5) write(pen, "ego", x, y + 4, "#ffffff", "", "11px");
  }

  function drawParticles(pen, camera) {
    const [begin, end] = range(data.particles, view.step), egoLon = data.truth.lon[egoRow(view.step)];
    pen.fillStyle = "rgba(0, 114, 178, 0.75)";
    for (let k = begin; k < end; k++) {
      const [x, y] = camera.at(egoLon + data.particles.away[k] / 10, data.particles.lat[k] / 100);
      pen.fillRect(x - 1, y - 1, 2, 2);
    }
  }

  function drawDetections(pen, camera) {
    const [begin, end] = range(data.detections, view.step), arm = 4;
    pen.strokeStyle = "#000000";
    pen.lineWidth = 1.5;
    pen.beginPath();
    for (let k = begin; k < end; k++) {
      const [x, y] = camera.at(data.detections.lon[k], data.detections.lat[k]);
      pen.moveTo(x - arm, y - arm); pen.lineTo(x + arm, y + arm);
      pen.moveTo(x - arm, y + arm); pen.lineTo(x + arm, y - arm);
    }
    pen.stroke();
  }

  function drawTracks(pen, camera) {
    const t = data.tracks, [begin, end] = range(t, view.step);
    const row = rowOf(view.followed, view.step), own = row >= 0 ? data.truth.track[row] : -1;
    for (let k = begin; k < end; k++) {
      if (t.state[k] === TENTATIVE && !shown.tentative) continue;
      if (Math.abs(t.lon[k] - camera.lon) > camera.reach + 10) continue;
      const [x, y] = camera.at(t.lon[k], t.lat[k]), turn = camera.turn - road.heading(t.lon[k]);
      const long = Math.max(2, (ELLIPSE_SCALE * t.std_lon[k] * camera.scale) / 100);
      const wide = Math.max(2, (ELLIPSE_SCALE * t.std_lat[k] * camera.scale) / 100);
      pen.globalAlpha = t.state[k] === TENTATIVE ? 0.45 : 1;
      pen.strokeStyle = PURPLE;
      pen.lineWidth = t.id[k] === own ? 3 : 1.6;
      pen.setLineDash(t.state[k] === TRACK_HIDDEN ? [5, 3] : []);
      pen.beginPath();
      pen.ellipse(x, y, long, wide, turn, 0, 2 * Math.PI);
      pen.stroke();
      pen.setLineDash([]);
      if (shown.numbers && camera.scale > 4.5) {
        write(pen, String(t.id[k]), x, y - Math.min(Math.max(wide, 1.0 * camera.scale), 2.2 * camera.scale) - 2, PURPLE);
      }
      pen.globalAlpha = 1;
    }
  }

  function drawFollowed(pen, camera) {
    const row = rowOf(view.followed, view.step);
    if (row < 0) return;
    outline(pen, bodyOf(camera, row, 7 / camera.scale)); // a ring round the body leaves its colour to be seen
    pen.strokeStyle = "#000000";
    pen.lineWidth = 2.5;
    pen.stroke();
    const [x, y] = camera.at(data.truth.lon[row], data.truth.lat[row]);
    write(pen, data.vehicles.names[view.followed], x, y + 1.1 * camera.scale + 18, "#000000", "bold ", "13px");
  }

  function drawScale(pen, camera) {
    const y = camera.height - 10, long = [50, 20, 10, 5].find((m) => m * camera.scale < 0.3 * camera.width) || 5;
    pen.fillStyle = "#444444";
    pen.fillRect(12, y, long * camera.scale, 2);
    pen.font = "12px system-ui, sans-serif";
    pen.textAlign = "left";
    pen.fillText(`${long} m, driving direction →`, 12, y - 5);
  }

  function write(pen, text, x, y, colour, weight = "", size = "11px") {
    pen.font = `${weight}${size} system-ui, sans-serif`;
    pen.textAlign = "center";
    if (colour !== "#ffffff") {
      pen.lineWidth = 3;
      pen.strokeStyle = "rgba(255,255,255,0.9)";
      pen.strokeText(text, x, y);
    }
    pen.fillStyle = colour;
    pen.fillText(text, x, y);
  }

  /* ---- one vehicle over time ---- */

  let course = null;

  function courseOf(vehicle) {
    const points = [];
    for (let step = 0; step < steps; step++) {
      const row = rowOf(vehicle, step);
      if (row < 0) continue;
      const error = data.truth.error[row];
      points.push({ step, time: data.time_s[step], state: data.truth.state[row], visible: data.truth.visible[row],
        error: error === NO_ERROR ? NaN : error / 100 });
    }
    return points;
  }

  function drawChart() {
    const pen = sharpen(chart), width = chart.clientWidth, height = chart.clientHeight;
    if (!course || !course.length) return;
    const left = 46, right = width - 10, errorTop = 18, errorBottom = height * 0.6, seenTop = height * 0.6 + 26;
    const seenBottom = height - 24, from = course[0].time, to = Math.max(course[course.length - 1].time, from + stepS);
    const x = (time) => left + ((time - from) / (to - from)) * (right - left);
    const most = niceCeiling(Math.max(1, ...course.map((p) => p.error || 0)));
    chartSpan = { left, right, from, to };
    for (const { state, points } of stretches(course)) {
      if (state > HIDDEN) continue;
      const begin = x(points[0].time), end = Math.min(right, x(points[points.length - 1].time + stepS));
      const height = (point) => seenBottom - Math.max(2, ((seenBottom - seenTop) * point.visible) / 100);
      pen.fillStyle = STATE_COLOURS[state];
      pen.globalAlpha = 0.16;
      pen.fillRect(begin, errorTop, end - begin, errorBottom - errorTop);
      pen.globalAlpha = 1;
      outline(pen, [[begin, seenBottom], ...points.map((point) => [x(point.time), height(point)]),
        [end, height(points[points.length - 1])], [end, seenBottom]]);
      pen.fill();
    }
    pen.strokeStyle = "#000000";
    pen.lineWidth = 1.8;
    pen.beginPath();
    let pending = true;
    for (const point of course) {
      if (Number.isNaN(point.error)) { pending = true; continue; }
      const y = errorBottom - (point.error / most) * (errorBottom - errorTop);
      if (pending) pen.moveTo(x(point.time), y); else pen.lineTo(x(point.time), y);
      pending = false;
    }
    pen.stroke();
    drawChartFrame(pen, { left, right, errorTop, errorBottom, seenTop, seenBottom, most, from, to, x });
  }

  let chartSpan = null;

  /* Successive points of one state. */
  function stretches(points) {
    const found = [];
    for (const point of points) {
      const last = found[found.length - 1];
      const before = last && last.points[last.points.length - 1];
      if (last && last.state === point.state && before.step + 1 === point.step) last.points.push(point);
      else found.push({ state: point.state, points: [point] });
    }
    return found;
  }

  function drawChartFrame(pen, at) {
    pen.fillStyle = "#333333";
    pen.font = "12px system-ui, sans-serif";
    pen.textAlign = "left";
    pen.fillText("distance to its track, m", at.left, at.errorTop - 5);
    pen.fillText("visible part, %", at.left, at.seenTop - 5);
    pen.textAlign = "right";
    pen.fillText(String(at.most), at.left - 6, at.errorTop + 8);
    pen.fillText("0", at.left - 6, at.errorBottom);
    pen.fillText("100", at.left - 6, at.seenTop + 8);
    pen.fillText("0", at.left - 6, at.seenBottom);
    pen.strokeStyle = "#888888";
    pen.lineWidth = 1;
    pen.strokeRect(at.left, at.errorTop, at.right - at.left, at.errorBottom - at.errorTop);
    pen.strokeRect(at.left, at.seenTop, at.right - at.left, at.seenBottom - at.seenTop);
    pen.textAlign = "left";
    pen.fillText(`${at.from.toFixed(1)} s`, at.left, at.seenBottom + 16);
    pen.textAlign = "right";
    pen.fillText(`${at.to.toFixed(1)} s`, at.right, at.seenBottom + 16);
    const now = data.time_s[view.step];
    if (now < at.from || now > at.to) return;
    pen.fillStyle = "#0072B2";
    pen.fillRect(at.x(now) - 1, at.errorTop, 2, at.seenBottom - at.errorTop);
  }

  function niceCeiling(value) {
    const unit = 10 ** Math.floor(Math.log10(value));
    return unit * [1, 2, 5, 10].find((factor) => factor * unit >= value);
  }

  /* ---- the timeline of occlusions ---- */

  function drawTimeline() {
    const pen = sharpen(timeline), width = timeline.clientWidth, height = timeline.clientHeight;
    const x = (step) => (width * step) / Math.max(1, steps - 1);
    const rank = { same_id: 0, survived: 1, hijacked: 2, lost: 2 };
    for (const [vehicle, from, to, outcome] of [...data.events].sort((a, b) => rank[a[3]] - rank[b[3]])) {
      const bad = rank[outcome] === 2, mine = vehicle === view.followed;
      pen.fillStyle = bad ? VERMILION : "#b5b5b5";
      pen.globalAlpha = mine ? 1 : 0.75;
      const high = bad ? height : height / 2;
      pen.fillRect(x(from), height - high, Math.max(3, x(to) - x(from)), high);
      pen.globalAlpha = 1;
    }
    pen.fillStyle = "#0072B2";
    pen.fillRect(x(view.step) - 1, 0, 2, height);
  }

  /* ---- words ---- */

  function describe() {
    element("clock").textContent = `${data.time_s[view.step].toFixed(1)} s`;
    element("scrub").setAttribute("aria-valuetext", `${data.time_s[view.step].toFixed(1)} seconds`);
    const line = element("followed-line");
    line.setAttribute("aria-live", view.playing ? "off" : "polite");
    if (view.followed < 0) {
      line.textContent = "Click a vehicle to follow it and to see its error and visibility over time.";
      return;
    }
    line.textContent = describeVehicle(data.vehicles.names[view.followed], rowOf(view.followed, view.step));
  }

  function describeVehicle(name, row) {
    if (row < 0) return `${name}: far away at this time.`;
    const t = data.truth, parts = [`${name}: ${(t.speed[row] / 10).toFixed(1)} m/s`];
    if (t.ego[row]) return `${name}: the ego, the car that carries the sensor, ${(t.speed[row] / 10).toFixed(1)} m/s.`;
    parts.push(t.state[row] < HIDDEN ? `${STATES[t.state[row]]} (${t.visible[row]} % seen)` : STATES[t.state[row]]);
    const outcome = data.outcomes[t.outcome[row]];
    const off = t.error[row] === NO_ERROR ? "" : `, ${(t.error[row] / 100).toFixed(1)} m off`;
    parts.push({
      tracked: `followed by track ${t.track[row]}${off}`,
      missed: "no track on it",
      lost: "its track was given up",
      hijacked: `its track ${t.track[row]} now sits on another vehicle${off}`,
      untracked: "had no track when it was last seen",
    }[outcome] || "not detected in the last 10 s");
    return `${parts.join(", ")}.`;
  }

  /* ---- control ---- */

  function redraw() {
    drawRoad();
    drawTimeline();
    if (course) drawChart();
    describe();
    element("scrub").value = view.step;
  }

  function seek(step) {
    view.step = Math.max(0, Math.min(steps - 1, Math.round(step)));
    redraw();
  }

  function setPlaying(playing) {
    view.playing = playing && steps > 1;
    if (view.playing && view.step >= steps - 1) view.step = 0;
    element("play").textContent = view.playing ? "❚❚ Pause" : "▶ Play";
    element("play").setAttribute("aria-pressed", String(view.playing));
    view.clock = performance.now();
    view.left = 0;
    if (view.playing) requestAnimationFrame(tick);
    redraw();
  }

  function tick(now) {
    if (!view.playing) return;
    view.left += (view.speed * (now - view.clock)) / 1000;
    view.clock = now;
    const ahead = Math.floor(view.left / stepS);
    if (ahead > 0) {
      view.left -= ahead * stepS;
      seek(view.step + ahead);
    }
    if (view.step >= steps - 1) setPlaying(false);
    else requestAnimationFrame(tick);
  }

  function follow(vehicle) {
    view.followed = vehicle;
    view.pan = 0;
    course = vehicle >= 0 ? courseOf(vehicle) : null;
    element("course").hidden = !course;
    element("follow").value = String(vehicle);
    redraw();
  }

  function zoom(factor) {
    const least = canvas.clientWidth / (2 * data.range_m + 60), most = 40;
    view.scale = Math.max(least, Math.min(most, view.scale * factor));
    redraw();
  }

  function fit() {
    const whole = canvas.clientWidth / (2 * data.range_m + 10);
    view.scale = Math.max(whole, 8.5);
    view.pan = 0;
    redraw();
  }

  function vehicleAt(x, y) {
    const camera = makeCamera(), [begin, end] = range(data.truth, view.step);
    let best = -1, nearest = Infinity;
    for (let row = begin; row < end; row++) {
      const [px, py] = camera.at(data.truth.lon[row], data.truth.lat[row]), vehicle = data.truth.vehicle[row];
      const long = Math.abs(px - x) - (data.vehicles.length_m[vehicle] * camera.scale) / 2;
      const wide = Math.abs(py - y) - (data.vehicles.width_m[vehicle] * camera.scale) / 2;
      const away = Math.max(long, wide, 0) + 0.01 * Math.hypot(px - x, py - y);
      if (away < 9 && away < nearest) [best, nearest] = [vehicle, away];
    }
    return best;
  }

  function listenToPointer() {
    let from = null;
    canvas.addEventListener("pointerdown", (event) => {
      from = { x: event.offsetX, y: event.offsetY, pan: view.pan, moved: false };
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!from) {
        const over = vehicleAt(event.offsetX, event.offsetY);
        canvas.style.cursor = over >= 0 ? "pointer" : "grab";
        canvas.title = over >= 0 ? data.vehicles.names[over] : "";
        return;
      }
      if (Math.abs(event.offsetX - from.x) > 5) from.moved = true;
      if (from.moved) {
        view.pan = from.pan - (event.offsetX - from.x) / view.scale;
        redraw();
      }
    });
    canvas.addEventListener("pointerup", (event) => {
      if (from && !from.moved) {
        const hit = vehicleAt(event.offsetX, event.offsetY);
        if (hit >= 0) follow(hit);
      }
      from = null;
    });
    canvas.addEventListener("pointercancel", () => { from = null; });
    canvas.addEventListener("wheel", (event) => {
      if (!event.ctrlKey && document.activeElement !== canvas) return;
      event.preventDefault();
      zoom(Math.exp(-event.deltaY / 400));
    }, { passive: false });
    const jump = (target, span) => target.addEventListener("pointerdown", (event) => span(event.offsetX));
    jump(timeline, (x) => seek((x / timeline.clientWidth) * (steps - 1)));
    jump(chart, (x) => {
      if (!chartSpan) return;
      const share = (x - chartSpan.left) / (chartSpan.right - chartSpan.left);
      const time = chartSpan.from + share * (chartSpan.to - chartSpan.from);
      seek(data.time_s.findIndex((moment) => moment >= Math.min(time, data.time_s[steps - 1])));
    });
  }

  function listenToKeys() {
    const actions = {
      " ": () => setPlaying(!view.playing),
      ArrowRight: (event) => seek(view.step + (event.shiftKey ? Math.round(1 / stepS) : 1)),
      ArrowLeft: (event) => seek(view.step - (event.shiftKey ? Math.round(1 / stepS) : 1)),
      ArrowUp: () => zoom(1.25), ArrowDown: () => zoom(0.8), "+": () => zoom(1.25), "-": () => zoom(0.8),
      Home: () => seek(0), End: () => seek(steps - 1), Escape: () => follow(-1),
    };
    element("replay").addEventListener("keydown", (event) => {
      const control = event.target.closest("input, select, button, summary");
      const taken = control && (control.id !== "scrub" || event.key !== " ");
      if (taken || event.ctrlKey || event.metaKey || event.altKey || !actions[event.key]) return;
      event.preventDefault();
      actions[event.key](event);
    });
    document.addEventListener("keydown", (event) => {
      const free = event.target === document.body || event.target === document.documentElement;
      if (!free || event.ctrlKey || event.metaKey || event.altKey) return;
      if (![" ", "ArrowLeft", "ArrowRight"].includes(event.key)) return;
      event.preventDefault();
      actions[event.key](event);
    });
  }

  function listenToControls() {
    element("play").addEventListener("click", () => setPlaying(!view.playing));
    element("back").addEventListener("click", () => seek(view.step - 1));
    element("ahead").addEventListener("click", () => seek(view.step + 1));
    element("scrub").addEventListener("input", (event) => seek(Number(event.target.value)));
    element("speed").addEventListener("change", (event) => { view.speed = Number(event.target.value); });
    element("nearer").addEventListener("click", () => zoom(1.25));
    element("further").addEventListener("click", () => zoom(0.8));
    element("fit").addEventListener("click", fit);
    element("follow").addEventListener("change", (event) => follow(Number(event.target.value)));
    for (const box of document.querySelectorAll("#replay input[data-layer]")) {
      box.checked = shown[box.dataset.layer];
      box.addEventListener("change", () => { shown[box.dataset.layer] = box.checked; redraw(); });
    }
    for (const button of document.querySelectorAll("button[data-vehicle]")) {
      button.addEventListener("click", () => {
        follow(data.vehicles.names.indexOf(button.dataset.vehicle));
        seek(data.time_s.findIndex((time) => time >= Number(button.dataset.time) - 1e-6));
        element("replay").scrollIntoView({ block: "start" });
        canvas.focus({ preventScroll: true });
        setPlaying(true);
      });
    }
  }

  function fillVehicleList() {
    const list = element("follow");
    const byName = data.vehicles.names.map((name, vehicle) => [name, vehicle]);
    byName.sort((a, b) => a[0].localeCompare(b[0], "en", { numeric: true }));
    for (const [name, vehicle] of byName) list.add(new Option(name, String(vehicle)));
  }

  function start() {
    element("scrub").max = String(steps - 1);
    fillVehicleList();
    listenToControls();
    listenToPointer();
    listenToKeys();
    let width = 0;
    new ResizeObserver(() => {
      if (canvas.clientWidth !== width) fit();
      width = canvas.clientWidth;
    }).observe(canvas);
    fit();
  }

  /* What tests and other scripts on the page may ask. */
  window.replay = {
    step: () => view.step,
    playing: () => view.playing,
    followed: () => (view.followed < 0 ? null : data.vehicles.names[view.followed]),
    positions: () => {
      const camera = makeCamera(), [begin, end] = range(data.truth, view.step), found = {};
      for (let row = begin; row < end; row++) {
        const [x, y] = camera.at(data.truth.lon[row], data.truth.lat[row]);
        if (x > 0 && x < camera.width) found[data.vehicles.names[data.truth.vehicle[row]]] = [x, y];
      }
      return found;
    },
  };
  start();
})();
