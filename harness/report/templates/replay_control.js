/* Playing, seeking, zooming, following: by pointer, by key and by the controls. */

function redraw() {
  drawRoad();
  drawTimeline();
  if (courses) drawChart();
  describe();
  element("scrub").value = view.step;
}

function seek(step) {
  view.step = Math.max(0, Math.min(steps - 1, Math.round(step)));
  redraw();
}

function setPlaying(playing, until = Infinity) {
  view.playing = playing && steps > 1;
  view.until = until;
  if (view.playing && view.step >= steps - 1) view.step = 0;
  element("play").textContent = view.playing ? "❚❚ Pause" : "▶ Play";
  element("play").setAttribute("aria-pressed", String(view.playing));
  view.clock = performance.now();
  view.left = 0;
  if (view.playing) requestAnimationFrame(tick);
  else rememberMoment();
  redraw();
}

/* The address tells the moment and the vehicle, so that it can be sent to somebody else. */
function rememberMoment() {
  const name = view.followed < 0 ? "" : `&vehicle=${encodeURIComponent(data.vehicles.names[view.followed])}`;
  history.replaceState(null, "", `#t=${data.time_s[view.step].toFixed(1)}${name}`);
}

const stepAt = (time) => {
  const found = data.time_s.findIndex((moment) => moment >= time - 1e-6);
  return found < 0 ? steps - 1 : found;
};

/* Goes to the moment that the address tells (report.html#t=12.3&vehicle=car.4), or else to the end of the worst failure. */
function openAtMoment() {
  const told = new URLSearchParams(location.hash.slice(1)), worst = document.querySelector("button[data-vehicle]");
  const first = data.opens_at || (worst ? [Number(worst.dataset.end), worst.dataset.vehicle] : [0, null]);
  const [time, vehicle] = told.has("t") ? [Number(told.get("t")), told.get("vehicle")] : first;
  const number = data.vehicles.names.indexOf(vehicle);
  if (number >= 0 || told.has("t")) follow(number);
  seek(Number.isFinite(time) ? stepAt(time) : 0);
  if (told.has("t")) element("replay").scrollIntoView({ block: "start" });
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
  if (view.step >= Math.min(steps - 1, view.until)) setPlaying(false);
  else requestAnimationFrame(tick);
}

function follow(vehicle) {
  view.followed = vehicle;
  view.pan = view.across = 0;
  courses = vehicle >= 0 ? panes.map((pane) => courseOf(vehicle, pane.data)) : null;
  element("course").hidden = !courses;
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
  view.scale = road.lines ? canvas.clientHeight / 130 : Math.max(whole, Math.min(8.5, canvas.clientWidth / 70));
  view.pan = view.across = 0;
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

function listenToPointer(canvas) {
  let from = null;
  canvas.addEventListener("pointerdown", (event) => {
    from = { x: event.offsetX, y: event.offsetY, pan: view.pan, across: view.across, moved: false };
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!from) {
      const over = vehicleAt(event.offsetX, event.offsetY);
      canvas.style.cursor = over >= 0 ? "pointer" : "grab";
      canvas.title = over >= 0 ? data.vehicles.names[over] : "";
      return;
    }
    if (Math.hypot(event.offsetX - from.x, event.offsetY - from.y) > 5) from.moved = true;
    if (from.moved) {
      view.pan = from.pan - (event.offsetX - from.x) / view.scale;
      view.across = from.across + (event.offsetY - from.y) / view.scale;
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
}

function listenToPictures() {
  for (const pane of panes) listenToPointer(pane.canvas);
  const jump = (target, span) => target.addEventListener("pointerdown", (event) => span(event.offsetX));
  jump(timeline, (x) => seek((x / timeline.clientWidth) * (steps - 1)));
  jump(chart, (x) => {
    if (!chartSpan) return;
    const share = (x - chartSpan.left) / (chartSpan.right - chartSpan.left);
    const time = chartSpan.from + share * (chartSpan.to - chartSpan.from);
    seek(stepAt(time - stepS / 2));
  });
}

function toggleFullScreen() {
  if (document.fullscreenElement) document.exitFullscreen();
  else element("replay").requestFullscreen();
}

function listenToKeys() {
  const actions = {
    " ": () => setPlaying(!view.playing),
    ArrowRight: (event) => seek(view.step + (event.shiftKey ? Math.round(1 / stepS) : 1)),
    ArrowLeft: (event) => seek(view.step - (event.shiftKey ? Math.round(1 / stepS) : 1)),
    ArrowUp: () => zoom(1.25), ArrowDown: () => zoom(0.8), "+": () => zoom(1.25), "-": () => zoom(0.8),
    Home: () => seek(0), End: () => seek(steps - 1), Escape: () => follow(-1), f: toggleFullScreen,
    n: () => seekDifference(1), p: () => seekDifference(-1),
  };
  /* What a control does with a key itself; every other key works there too. */
  const takes = (control, key) => {
    if (control.tagName === "SELECT") return key.length === 1 || key.startsWith("Arrow") || key === "Home" || key === "End";
    if (control.id === "scrub") return ![" ", "f", "n", "p", "Escape"].includes(key);
    return key === " " || key === "Enter";
  };
  element("replay").addEventListener("keydown", (event) => {
    const control = event.target.closest("input, select, button, summary");
    if ((control && takes(control, event.key)) || event.ctrlKey || event.metaKey || event.altKey || !actions[event.key]) return;
    event.preventDefault();
    actions[event.key](event);
  });
  document.addEventListener("keydown", (event) => {
    const free = event.target === document.body || event.target === document.documentElement;
    if (!free || event.ctrlKey || event.metaKey || event.altKey) return;
    if (![" ", "ArrowLeft", "ArrowRight", "f", "n", "p"].includes(event.key)) return;
    event.preventDefault();
    actions[event.key](event);
  });
}

function listenToControls() {
  element("play").addEventListener("click", () => setPlaying(!view.playing));
  element("back").addEventListener("click", () => seek(view.step - 1));
  element("ahead").addEventListener("click", () => seek(view.step + 1));
  element("scrub").addEventListener("input", (event) => seek(Number(event.target.value)));
  element("scrub").addEventListener("change", rememberMoment);
  element("speed").addEventListener("change", (event) => { view.speed = Number(event.target.value); });
  element("nearer").addEventListener("click", () => zoom(1.25));
  element("further").addEventListener("click", () => zoom(0.8));
  element("fit").addEventListener("click", fit);
  element("full").addEventListener("click", toggleFullScreen);
  data.plots.forEach(([name], number) => element("plot").add(new Option(name, String(number))));
  element("plot").addEventListener("change", (event) => {
    view.plot = Number(event.target.value);
    follow(view.followed);
  });
  element("follow").addEventListener("change", (event) => follow(Number(event.target.value)));
  if (data.marks) listenToDifferences();
  for (const box of document.querySelectorAll("#replay input[data-layer]")) {
    box.checked = shown[box.dataset.layer];
    box.addEventListener("change", () => { shown[box.dataset.layer] = box.checked; redraw(); });
  }
  for (const button of document.querySelectorAll("button[data-vehicle]")) {
    button.addEventListener("click", () => {
      follow(data.vehicles.names.indexOf(button.dataset.vehicle));
      seek(stepAt(Number(button.dataset.time)));
      element("replay").scrollIntoView({ block: "start" });
      canvas.focus({ preventScroll: true });
      setPlaying(true, stepAt(Number(button.dataset.until)));
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
  listenToPictures();
  listenToKeys();
  let width = 0;
  new ResizeObserver(() => {
    if (canvas.clientWidth !== width) fit();
    width = canvas.clientWidth;
  }).observe(canvas);
  fit();
  openAtMoment();
  matchMedia("screen and (prefers-color-scheme: dark)").addEventListener("change", () => {
    colours = {};
    redraw();
  });
  window.addEventListener("hashchange", () => { if (location.hash.includes("t=")) openAtMoment(); });
}

/* What tests and other scripts on the page may ask. */
window.replay = {
  step: () => view.step,
  playing: () => view.playing,
  followed: () => (view.followed < 0 ? null : data.vehicles.names[view.followed]),
  colours: () => ({ marks: [...EDGES, ...STATE_COLOURS.slice(2), "track", "unseen", "trail"].map(colourOf), grounds: ["seen", "shadow", "beyond"].map(colourOf) }),
  words: () => written,
  gaps: () => (courses ? gapsOf(courses[0]) : []),
  positions: () => {
    const camera = makeCamera(), [begin, end] = range(data.truth, view.step), found = {};
    for (let row = begin; row < end; row++) {
      const [x, y] = camera.at(data.truth.lon[row], data.truth.lat[row]);
      if (x > 0 && x < camera.width && y > 0 && y < camera.height) found[data.vehicles.names[data.truth.vehicle[row]]] = [x, y];
    }
    return found;
  },
};
start();
