/* Where two trackers on the same detections differ: marked on the road and on the timeline, told in words. */

const SIDES = ["a", "b"], UNFOLLOWED = 0, SWITCHED = 1;
const marks = data.marks;

/* What is marked in one pane at a step: rows of the truth with the kinds of difference. */
function marksAt(step, side) {
  const found = [];
  if (!marks) return found;
  const [begin, end] = range(marks, step);
  for (let k = begin; k < end; k++) {
    const row = marks.side[k] === side ? rowOf(marks.vehicle[k], step) : -1;
    if (row >= 0) found.push({ row, vehicle: marks.vehicle[k], kind: marks.kind[k] });
  }
  return found;
}

const errorAt = (side, row) => panes[side].data.truth.error[row] / 100;

function wordOf(kind, row) {
  if (kind === UNFOLLOWED) return "not followed";
  return kind === SWITCHED ? "identity switched" : `${Math.abs(errorAt(0, row) - errorAt(1, row)).toFixed(1)} m more`;
}

function drawMarks(pen, camera, found) {
  for (const { row } of found) {
    if (Math.abs(data.truth.lon[row] - camera.lon) > camera.reach + 10) continue;
    outline(pen, bodyOf(camera, row, Math.max(1.6, 14 / camera.scale)));
    pen.fillStyle = colourOf("mark");
    pen.fill();
    pen.strokeStyle = colourOf("black");
    pen.lineWidth = 1;
    pen.stroke();
    outline(pen, bodyOf(camera, row)); // an outlined body is as easy to see as elsewhere
    pen.fillStyle = colourOf("seen");
    pen.fill();
  }
}

function nameMarks(pen, camera, found) {
  if (camera.scale < 4.5) return;
  for (const { row, kind } of found) {
    const [x, y] = camera.at(data.truth.lon[row], data.truth.lat[row]), away = 1.1 * camera.scale + 16;
    write(pen, wordOf(kind, row), [0, 16, 29, 42].map((more) => [x, y + away + more]), "black", "bold 11px");
  }
}

/* For each side how many vehicles are marked at each step. */
const counts = marks ? SIDES.map((_, side) => data.time_s.map((__, step) => new Set(marksAt(step, side).map(({ row }) => row)).size)) : [];

/* The bars of a point up, those of b down. */
function drawDifferences(pen, width, height, x) {
  const most = counts.flat().reduce((high, count) => Math.max(high, count), 1), wide = Math.max(1.5, width / steps);
  counts.forEach((each, side) => each.forEach((count, step) => {
    if (!count) return;
    const high = Math.max(2, ((height / 2 - 1) * count) / most);
    pen.fillStyle = colourOf("car-hidden");
    pen.fillRect(x(step), side ? height / 2 + 1 : height / 2 - 1 - high, wide, high);
  }));
  pen.fillStyle = colourOf("car-out");
  pen.fillRect(0, height / 2 - 0.5, width, 1);
  pen.fillStyle = colourOf("unseen");
  pen.fillRect(x(view.step) - 1, 0, 2, height);
}

function describeDifferences() {
  if (!marks) return;
  const line = element("differences-line"), told = [];
  for (const [side, name] of SIDES.entries()) {
    const found = marksAt(view.step, side), other = SIDES[1 - side];
    const names = (kind) => found.filter((each) => each.kind === kind).map((each) => data.vehicles.names[each.vehicle]);
    const [lone, switched, worse] = [0, 1, 2].map(names);
    if (lone.length) told.push(`${other} alone follows ${lone.join(", ")}`);
    if (switched.length) told.push(`${name} switches the identity of ${switched.join(", ")}`);
    if (worse.length) told.push(`${name} is over 1 m farther from ${worse.join(", ")}`);
  }
  line.setAttribute("aria-live", view.playing ? "off" : "polite");
  line.textContent = told.length ? `Here ${told.join("; ")}.` : "Here the two do not differ.";
}

/* Where a difference begins that was not there for a second. */
function beginnings() {
  const last = new Map(), gap = Math.round(1 / stepS), found = [];
  for (let step = 0; step < steps; step++) {
    for (const side of [0, 1]) for (const { vehicle, kind } of marksAt(step, side)) {
      const key = `${side}/${kind}/${vehicle}`;
      if (!last.has(key) || step - last.get(key) > gap) found.push({ step, vehicle });
      last.set(key, step);
    }
  }
  return found;
}

const differences = marks ? beginnings() : [];

function seekDifference(direction) {
  const ahead = differences.filter(({ step }) => (step - view.step) * direction > 0);
  const next = direction > 0 ? ahead[0] : ahead[ahead.length - 1];
  if (!next) return;
  setPlaying(false);
  follow(next.vehicle);
  seek(next.step);
  rememberMoment();
}

function listenToDifferences() {
  element("previous-difference").addEventListener("click", () => seekDifference(-1));
  element("next-difference").addEventListener("click", () => seekDifference(1));
  element("stacked").addEventListener("change", (event) => element("panes").classList.toggle("stacked", event.target.checked));
}
