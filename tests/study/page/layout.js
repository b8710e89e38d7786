// What is too small, cut or run together on a page: texts, controls and bars; called by test_access.py.
(() => {
  const LEAST = 8, // px
    ROUND = 1.5, // px, of boxes at fractions of a pixel
    GAP = 5; // px between texts of neighbouring cells, as a space is wide
  const problems = [];
  const named = (e) => `${e.tagName.toLowerCase()}.${e.getAttribute("class") ?? ""} "${e.textContent.trim().slice(0, 40)}"`;
  const said = (e) => e.closest(".hidden, .skip, [aria-hidden=true]") || getComputedStyle(e).clipPath !== "none";
  const seen = (e) => e.checkVisibility({ visibilityProperty: true }) && !said(e);

  /** Whether a box reaches out of what clips it: an element around it that does not scroll, or the page. */
  function cut(box, element) {
    let [across, down] = [true, true];
    for (let e = element.parentElement; e && e !== document.body; e = e.parentElement) {
      const { overflowX, overflowY } = getComputedStyle(e), room = e.getBoundingClientRect();
      if (/auto|scroll/.test(overflowX)) across = false;
      if (/auto|scroll/.test(overflowY)) down = false;
      if (across && /hidden|clip/.test(overflowX) && (box.left < room.left - ROUND || box.right > room.right + ROUND)) return true;
      if (down && /hidden|clip/.test(overflowY) && (box.top < room.top - ROUND || box.bottom > room.bottom + ROUND)) return true;
    }
    return across && (box.left < -ROUND || box.right > document.documentElement.clientWidth + ROUND);
  }

  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const { parentElement: e, nodeValue } = walker.currentNode;
    if (!nodeValue.trim() || /SCRIPT|STYLE|NOSCRIPT|OPTION|TITLE/i.test(e.tagName) || !seen(e)) continue;
    const range = document.createRange();
    range.selectNodeContents(walker.currentNode);
    for (const box of range.getClientRects()) {
      if (!box.width) continue;
      if (box.height < LEAST && e.tagName !== "tspan") // an index of the diagram, which is seldom read
        problems.push(`small text: ${named(e)} ${box.height}`);
      if (cut(box, e)) problems.push(`cut text: ${named(e)}`);
    }
  }
  /** Boxes of the lines of an element's text. */
  function lines(element) {
    const range = document.createRange();
    range.selectNodeContents(element);
    return [...range.getClientRects()].filter((box) => box.width);
  }

  for (const row of document.querySelectorAll("tr")) {
    const cells = [...row.cells].filter((cell) => cell.textContent.trim() && seen(cell));
    cells.slice(1).forEach((cell, k) => {
      const close = lines(cells[k]).some((left) => lines(cell).some((right) =>
        right.left - left.right < GAP && left.left <= right.left && left.top < right.bottom - ROUND && right.top < left.bottom - ROUND));
      if (close) problems.push(`texts run together: ${named(cells[k])} ${named(cell)}`);
    });
  }
  for (const e of document.querySelectorAll("a[href], button, select, input, summary")) {
    if (!seen(e)) continue;
    const box = e.getBoundingClientRect();
    if (Math.min(box.width, box.height) < LEAST) problems.push(`small control: ${named(e)}`);
    if (cut(box, e)) problems.push(`cut control: ${named(e)}`);
    if (e.tagName !== "SELECT") continue;
    const pen = document.createElement("canvas").getContext("2d");
    pen.font = getComputedStyle(e).font;
    // without an arrow, which a browser draws as wide as it likes
    if (pen.measureText(e.selectedOptions[0]?.text ?? "").width > e.clientWidth) problems.push(`cut choice: ${named(e)}`);
  }
  for (const e of document.querySelectorAll(".track, .key i, .scale i"))
    if (seen(e) && Math.min(e.offsetHeight, e.offsetWidth) < LEAST) problems.push(`thin bar: ${named(e.parentElement)}`);
  for (const table of document.querySelectorAll(".readout, .budget, .modes")) {
    const bars = [...table.querySelectorAll(":is(.gauge, .share) i")].filter(seen);
    if (!bars.length) continue;
    if (Math.min(...bars.map((e) => e.offsetHeight)) < LEAST) problems.push(`thin bars: ${named(table)}`);
    if (Math.max(...bars.map((e) => e.offsetWidth)) < LEAST) problems.push(`short bars: ${named(table)}`);
    for (const e of bars) if (cut(e.getBoundingClientRect(), e)) problems.push(`cut bar: ${named(table)}`);
  }
  return [...new Set(problems)];
})()
