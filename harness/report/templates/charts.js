/* Draws the page's charts, each in its place, and makes their points lead to what they are made of. */
(async () => {
  const places = [...document.querySelectorAll(".chart-place")];
  const views = [];

  async function openLibrary() {
    const bytes = Uint8Array.from(atob(document.getElementById("vega").textContent.trim()), (letter) => letter.charCodeAt(0));
    const inflated = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    const script = document.createElement("script");
    script.textContent = await new Response(inflated).text();
    document.head.append(script);
  }

  function lead(event, item) {
    const row = item && item.datum;
    if (row && row.cells) showCells(row.cells);
    else if (row && row.at !== undefined) location.hash = `#t=${row.at}`;
  }

  function showCells(numbers) {
    const found = numbers.map((number) => document.getElementById(`cell-${number}`)).filter((cell) => cell);
    for (const cell of found) cell.closest("details").open = true;
    if (!found.length) return;
    found[0].closest("details").scrollIntoView({ block: "start" });
    found[0].focus({ preventScroll: true });
  }

  /* One line of a group alone, or all again. */
  function listenToLegends() {
    for (const button of document.querySelectorAll("button[data-line]")) {
      button.addEventListener("click", () => {
        const group = button.closest(".charts-group"), was = button.getAttribute("aria-pressed") === "true";
        for (const each of group.querySelectorAll("button[data-line]")) each.setAttribute("aria-pressed", String(each === button && !was));
        for (const { place, view } of views) {
          if (group.contains(place)) view.signal("only", was ? null : button.dataset.line).run();
        }
      });
    }
  }

  try {
    await openLibrary();
    const specs = JSON.parse(document.getElementById("chart-data").textContent);
    const options = { renderer: "svg", actions: false, ast: true, tooltip: { disableDefaultStyle: true } };
    for (const [number, place] of places.entries()) {
      const { view } = await vegaEmbed(place, specs[number], options);
      view.addEventListener("click", lead);
      views.push({ place, view });
    }
    listenToLegends();
  } catch (error) {
    for (const place of places) if (!place.querySelector("svg")) place.textContent = `This browser can't draw the chart (${error.message}); the tables hold its numbers.`;
  }
  document.documentElement.dataset.charts = String(views.length);
})();
