// What the page shows, in the fragment of its address, so that a link opens just that: #t=4.2&K_p=1.5.

const WRITE_PAUSE = 200; // ms between two changes of the address, which browsers limit
const fragment = { state: readFragment(), listeners: [] };

/** A value by its name as text, as the address had it when the page was opened or as it was remembered since; null for none. */
export const recalled = (name) => fragment.state.get(name);

/** Keep a value in the address; null, undefined or "" removes it. */
export function remember(name, value) {
  if (value === null || value === undefined || value === "") fragment.state.delete(name);
  else fragment.state.set(name, value);
  fragment.waiting ??= setTimeout(writeFragment, WRITE_PAUSE);
}

/** Call a function when another address is opened in this page. */
export const whenRecalled = (listener) => fragment.listeners.push(listener);

/** Address of the page as it is now. */
export const address = () =>
  `${location.href.split("#")[0]}${fragment.state.size ? `#${fragment.state}` : ""}`;

function readFragment() {
  return new URLSearchParams(location.hash.includes("=") ? location.hash.slice(1) : "");
}

function writeFragment() {
  fragment.waiting = undefined;
  if (location.protocol !== "about:") history.replaceState(history.state, "", address()); // a frame without an address has none to keep
}

addEventListener("hashchange", () => {
  if (!location.hash.includes("=")) return; // a link within the page
  fragment.state = readFragment();
  for (const listener of fragment.listeners) listener();
});
