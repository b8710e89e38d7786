// Tables of the class `sortable` sort on a click on a heading: numbers by their <data>, other cells as text.

/** Value of a cell by which its row is sorted; null of an empty cell. */
function keyOf(cell) {
  const number = cell.querySelector("data")?.value,
    text = cell.textContent.trim();
  return number === undefined ? text || null : Number(number);
}

/** Order of two keys; an empty cell comes last in both directions. */
function order(a, b, sign) {
  if (a === null || b === null) return Number(a === null) - Number(b === null);
  const both = typeof a === "number" && typeof b === "number";
  return sign * (both ? a - b : String(a).localeCompare(String(b), undefined, { numeric: true }));
}

/** Give the headings of a table buttons. */
function makeSortable(table) {
  const [head, ...rows] = table.rows;
  for (const [column, heading] of [...head.cells].entries()) {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...heading.childNodes);
    heading.append(button);
    button.addEventListener("click", () => {
      const falls = heading.getAttribute("aria-sort") === "ascending";
      for (const other of head.cells) other.removeAttribute("aria-sort");
      heading.setAttribute("aria-sort", falls ? "descending" : "ascending");
      const keyed = rows.map((row) => ({ row, key: keyOf(row.cells[column]) }));
      keyed.sort((a, b) => order(a.key, b.key, falls ? -1 : 1));
      head.parentElement.append(...keyed.map(({ row }) => row));
    });
  }
}

export function sortTables() {
  for (const table of document.querySelectorAll("table.sortable")) makeSortable(table);
}
