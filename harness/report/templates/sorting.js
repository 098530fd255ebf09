/* Tables whose headings sort them: a click sorts with the largest first, another one turns that round. */
for (const table of document.querySelectorAll(".sortable table")) {
  const headings = [...table.tHead.rows[0].cells], body = table.tBodies[0];
  headings.forEach((heading, column) => {
    const button = document.createElement("button");
    button.type = "button";
    button.className = "sorts";
    button.append(...heading.childNodes);
    heading.append(button);
    button.addEventListener("click", () => {
      const up = heading.getAttribute("aria-sort") === "descending";
      for (const each of headings) each.removeAttribute("aria-sort");
      heading.setAttribute("aria-sort", up ? "ascending" : "descending");
      const value = (row) => row.cells[column].textContent, number = (row) => Number.parseFloat(value(row));
      const rows = [...body.rows].sort((a, b) => {
        if (column === 0) return (up ? 1 : -1) * value(b).localeCompare(value(a), "en", { numeric: true });
        const [x, y] = [number(a), number(b)];
        if (Number.isNaN(x) || Number.isNaN(y)) return Number.isNaN(x) - Number.isNaN(y); // what is unknown stays below
        return (up ? 1 : -1) * (x - y);
      });
      body.append(...rows);
    });
  });
}
