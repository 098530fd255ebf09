/* One vehicle over time, the timeline of occlusions, and what is said in words. */

let courses = null;
const CURVES = [["black", []], ["unseen", [6, 3]]];
const NO_TRACK = "no track";
/* At the left edge, numbers of the axis take this width. */
const AXIS_WORDS_PX = 36;

/* A point for each step: the vehicle's state, the chosen value, and why there is no value where it is missing. */
function courseOf(vehicle, data) {
  const t = data.truth;
  let detected = false;
  return data.time_s.map((time, step) => {
    const row = rowOf(vehicle, step);
    if (row < 0) return { step, time, state: FAR, visible: 0, value: NaN, gap: "not on record" };
    detected = (detected && data.episode[step] === data.episode[step - 1]) || t.outcome[row] > 0;
    const gap = t.outcome[row] ? NO_TRACK : detected ? "not detected for 10 s" : "not detected yet";
    return { step, time, state: t.state[row], visible: t.visible[row], value: plotted(row, step, data),
      gap: t.state[row] > HIDDEN && !t.outcome[row] ? "out of range" : gap };
  });
}

/* Successive points without a value, for one reason. */
function gapsOf(course) {
  const found = [];
  for (const { step, value, gap } of course) {
    const last = found[found.length - 1];
    if (!Number.isNaN(value)) continue;
    if (last && last.gap === gap && last.end + 1 === step) last.end = step;
    else found.push({ gap, begin: step, end: step });
  }
  return found;
}

/* The whole run, as on the slider above; of a long run the part in which the vehicle is near. */
function spanOfTime(course) {
  const near = course.filter((point) => point.state !== FAR), whole = [course[0].time, course[course.length - 1].time];
  const span = near.length ? [near[0].time, near[near.length - 1].time] : whole;
  const [from, to] = 3 * (span[1] - span[0]) < whole[1] - whole[0] ? span : whole;
  return [from, Math.max(to, from + stepS)];
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
  if (!courses) return;
  const [from, to] = spanOfTime(courses[0]), shownOf = (course) => course.filter(({ time }) => time >= from && time <= to);
  const left = 0, right = width, errorTop = 18, errorBottom = height * 0.6, seenTop = height * 0.6 + 26;
  const seenBottom = height - 24;
  const x = (time) => left + ((time - from) / (to - from)) * (right - left);
  const [least, most] = spanOf(courses.flat().map((point) => point.value).filter((value) => !Number.isNaN(value)));
  chartSpan = { left, right, from, to };
  for (const { state, points } of stretches(shownOf(courses[0]))) {
    if (state > HIDDEN) continue;
    const begin = x(points[0].time), end = Math.min(right, x(points[points.length - 1].time + stepS));
    const height = (point) => seenBottom - Math.max(2, ((seenBottom - seenTop) * point.visible) / 100);
    pen.fillStyle = colourOf(STATE_COLOURS[state]);
    pen.globalAlpha = 0.28;
    pen.fillRect(begin, errorTop, end - begin, errorBottom - errorTop);
    pen.globalAlpha = 1;
    outline(pen, [[begin, seenBottom], ...points.map((point) => [x(point.time), height(point)]),
      [end, height(points[points.length - 1])], [end, seenBottom]]);
    pen.fill();
  }
  courses.forEach((each, side) => {
    pen.strokeStyle = colourOf(CURVES[side][0]);
    pen.setLineDash(CURVES[side][1]);
    pen.lineWidth = 1.8;
    pen.lineJoin = "round";
    pen.beginPath();
    let pending = true;
    for (const point of shownOf(each)) {
      if (Number.isNaN(point.value)) { pending = true; continue; }
      const y = errorBottom - ((point.value - least) / (most - least)) * (errorBottom - errorTop);
      if (pending) pen.moveTo(x(point.time), y); else pen.lineTo(x(point.time), y);
      pending = false;
    }
    pen.stroke();
    pen.setLineDash([]);
    drawGaps(pen, gapsOf(shownOf(each)), x, (errorTop + errorBottom) / 2, errorBottom - 5 * side, right);
  });
  drawChartFrame(pen, { left, right, errorTop, errorBottom, seenTop, seenBottom, least, most, from, to, x });
}

let chartSpan = null;

/* Bars where a vehicle that was detected has no track; in all other gaps words, where there is room for them. */
function drawGaps(pen, gaps, x, middle, bottom, right) {
  pen.font = "12px system-ui, sans-serif";
  pen.textAlign = "center";
  for (const { gap, begin, end } of gaps) {
    const from = x(data.time_s[begin]), wide = Math.min(right, x(data.time_s[end] + stepS)) - from;
    pen.fillStyle = gap === NO_TRACK ? colourOf("car-hidden") : colourOf("words");
    if (gap === NO_TRACK) pen.fillRect(from, bottom - 5, Math.max(2, wide), 5);
    else if (wide > 14) {
      const upright = pen.measureText(gap).width + 8 > wide;
      if (upright && from + wide / 2 < AXIS_WORDS_PX) continue;
      pen.save();
      pen.translate(from + wide / 2, middle);
      if (upright) pen.rotate(-Math.PI / 2);
      pen.fillText(gap, 0, 4);
      pen.restore();
    }
  }
}

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
  pen.fillStyle = colourOf("words");
  pen.font = "12px system-ui, sans-serif";
  pen.textAlign = "left";
  pen.fillText(`${data.plots[view.plot][0]}${panes.length > 1 ? " (a: solid; b: dashed)" : ""}`, at.left, at.errorTop - 5);
  pen.fillText("visible part, %", at.left, at.seenTop - 5);
  pen.lineWidth = 3;
  pen.strokeStyle = colourOf("halo");
  for (const [text, y] of [[at.most, at.errorTop + 13], [at.least, at.errorBottom - 7], [100, at.seenTop + 13], [0, at.seenBottom - 4]]) {
    pen.strokeText(String(text), at.left + 5, y);
    pen.fillText(String(text), at.left + 5, y);
  }
  pen.strokeStyle = colourOf("car-out");
  pen.lineWidth = 1;
  pen.strokeRect(at.left + 0.5, at.errorTop, at.right - at.left - 1, at.errorBottom - at.errorTop);
  pen.strokeRect(at.left + 0.5, at.seenTop, at.right - at.left - 1, at.seenBottom - at.seenTop);
  pen.textAlign = "left";
  pen.fillText(`${at.from.toFixed(1)} s`, at.left, at.seenBottom + 16);
  pen.textAlign = "right";
  pen.fillText(`${at.to.toFixed(1)} s`, at.right, at.seenBottom + 16);
  const now = data.time_s[view.step];
  if (now < at.from || now > at.to) return;
  pen.fillStyle = colourOf("unseen");
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
    pen.fillStyle = bad ? colourOf("car-hidden") : colourOf("trail");
    pen.globalAlpha = mine ? 1 : bad ? 0.85 : 0.75;
    const high = bad ? height : height / 2;
    pen.fillRect(x(from), height - high, Math.max(3, x(to) - x(from)), high);
    pen.globalAlpha = 1;
  }
  pen.fillStyle = colourOf("unseen");
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
  if (row < 0) return `${name}: not on record at this time: it is too far away, or not there.`;
  const t = data.truth, parts = [`${name}: ${(t.speed[row] / 10).toFixed(1)} m/s`];
  if (t.ego[row]) return `${name}: the ego, the car that carries the sensor, ${(t.speed[row] / 10).toFixed(1)} m/s.`;
  parts.push(t.state[row] < HIDDEN ? `${STATES[t.state[row]]} (${t.visible[row]} % of it)` : STATES[t.state[row]]);
  const fates = panes.map((pane) => fateOf(pane.data.truth, row));
  if (panes.length === 1) return `${[...parts, fates[0]].join(", ")}.`;
  return `${parts.join(", ")}; ${fates.map((fate, side) => `${SIDES[side]}: ${fate}`).join("; ")}.`;
}

function fateOf(t, row) {
  const outcome = data.outcomes[t.outcome[row]], known = t.error[row] !== NO_ERROR, offM = t.error[row] / 100;
  const off = known ? `, ${offM.toFixed(1)} m off` : "";
  const lost = known && offM >= data.follow_m; // a hidden vehicle's track lives on, but is somewhere else
  return {
    tracked: lost ? `its track ${t.track[row]} is elsewhere${off}` : `followed by track ${t.track[row]}${off}`,
    missed: "no track on it",
    lost: "its track was deleted",
    hijacked: `its track ${t.track[row]} is now on another vehicle${off}`,
    untracked: "had no track when it was last seen",
  }[outcome] || "not detected yet, or not in the last 10 s";
}
