/* One vehicle over time, the timeline of occlusions, and what is said in words. */

let courses = null;
const CURVES = [["#000000", []], ["#0072B2", [6, 3]]];

function courseOf(vehicle, data) {
  const points = [];
  for (let step = 0; step < steps; step++) {
    const row = rowOf(vehicle, step);
    if (row < 0) continue;
    points.push({ step, time: data.time_s[step], state: data.truth.state[row], visible: data.truth.visible[row],
      value: plotted(row, step, data) });
  }
  return points;
}

/* The chosen column of a vehicle, or of the track that is on it. */
function plotted(row, step, data) {
  const [, table, key, factor] = data.plots[view.plot], t = data[table];
  if (key === "error" && t.error[row] === NO_ERROR) return NaN;
  if (table === "truth") return t[key][row] / factor;
  const [begin, end] = range(t, step), found = t.id.subarray(begin, end).indexOf(data.truth.track[row]);
  return found < 0 || data.truth.track[row] < 0 ? NaN : t[key][begin + found] / factor;
}

function drawChart() {
  const pen = sharpen(chart), width = chart.clientWidth, height = chart.clientHeight;
  if (!courses || !courses[0].length) return;
  const course = courses[0];
  const left = 46, right = width - 10, errorTop = 18, errorBottom = height * 0.6, seenTop = height * 0.6 + 26;
  const seenBottom = height - 24, from = course[0].time, to = Math.max(course[course.length - 1].time, from + stepS);
  const x = (time) => left + ((time - from) / (to - from)) * (right - left);
  const [least, most] = spanOf(courses.flat().map((point) => point.value).filter((value) => !Number.isNaN(value)));
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
  courses.forEach((each, side) => {
    [pen.strokeStyle] = CURVES[side];
    pen.setLineDash(CURVES[side][1]);
    pen.lineWidth = 1.8;
    pen.lineJoin = "round";
    pen.beginPath();
    let pending = true;
    for (const point of each) {
      if (Number.isNaN(point.value)) { pending = true; continue; }
      const y = errorBottom - ((point.value - least) / (most - least)) * (errorBottom - errorTop);
      if (pending) pen.moveTo(x(point.time), y); else pen.lineTo(x(point.time), y);
      pending = false;
    }
    pen.stroke();
    pen.setLineDash([]);
  });
  drawChartFrame(pen, { left, right, errorTop, errorBottom, seenTop, seenBottom, least, most, from, to, x });
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
  pen.fillText(`${data.plots[view.plot][0]}${panes.length > 1 ? " (a: solid; b: dashed)" : ""}`, at.left, at.errorTop - 5);
  pen.fillText("visible part, %", at.left, at.seenTop - 5);
  pen.textAlign = "right";
  pen.fillText(String(at.most), at.left - 6, at.errorTop + 8);
  pen.fillText(String(at.least), at.left - 6, at.errorBottom);
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

/* A span of round numbers around values: from zero, unless all are far from it. */
function spanOf(values) {
  if (!values.length) return [0, 1];
  const low = values.reduce((a, b) => Math.min(a, b)), high = values.reduce((a, b) => Math.max(a, b));
  if (low >= 0 && low <= 0.5 * high) return [0, niceCeiling(high)];
  if (low < 0 && high <= 0) return [-niceCeiling(-low), 0];
  if (low < 0 && high < 40 * -low && -low < 40 * high) return [-niceCeiling(-low), niceCeiling(high)];
  const unit = niceCeiling(Math.max(high - low, 1e-3)) / 10, round = (value) => Number((unit * value).toFixed(3));
  return [round(Math.floor(low / unit)), round(Math.floor(high / unit) + 1)];
}

function niceCeiling(value) {
  if (value <= 0) return 1;
  const unit = 10 ** Math.floor(Math.log10(value));
  return unit * [1, 2, 5, 10].find((factor) => factor * unit >= value);
}

/* ---- the timeline of occlusions ---- */

function drawTimeline() {
  const pen = sharpen(timeline), width = timeline.clientWidth, height = timeline.clientHeight;
  const x = (step) => (width * step) / Math.max(1, steps - 1);
  if (data.marks) {
    drawDifferences(pen, width, height, x);
    return;
  }
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
  describeDifferences();
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
  const fates = panes.map((pane) => fateOf(pane.data.truth, row));
  if (panes.length === 1) return `${[...parts, fates[0]].join(", ")}.`;
  return `${parts.join(", ")}; ${fates.map((fate, side) => `${SIDES[side]}: ${fate}`).join("; ")}.`;
}

function fateOf(t, row) {
  const outcome = data.outcomes[t.outcome[row]];
  const off = t.error[row] === NO_ERROR ? "" : `, ${(t.error[row] / 100).toFixed(1)} m off`;
  return {
    tracked: `followed by track ${t.track[row]}${off}`,
    missed: "no track on it",
    lost: "its track was deleted",
    hijacked: `its track ${t.track[row]} is now on another vehicle${off}`,
    untracked: "had no track when it was last seen",
  }[outcome] || "not detected yet, or not in the last 10 s";
}
