// Tables that are wider than the page, and lists that are longer: the keyboard reaches those that scroll.

const sizes = new ResizeObserver((entries) => {
  for (const { target } of entries) {
    const { scrollWidth, clientWidth, scrollHeight, clientHeight } = target;
    const scrolls = scrollWidth > clientWidth || scrollHeight > clientHeight;
    target.removeAttribute("tabindex");
    if (scrolls) target.setAttribute("tabindex", "0");
  }
});

/** Watch what is on the page now. */
export function watchScrollers() {
  for (const element of document.querySelectorAll(".wide, .readout")) sizes.observe(element);
}
