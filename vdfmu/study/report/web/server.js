// The server of a page, if one serves it: its events, and requests to it.

/** What the server says of the page; null without one. @type {HTMLMetaElement} */
export const served = document.querySelector('meta[name="live"]');
const door = `/${location.pathname.split("/")[1]}/`; // the token

/**
 * Listen to the server, if one serves this page.
 * @param {(event: any) => void} [take] gets its events
 * @param {(lost: boolean) => void} [lost] gets whether it cannot be reached
 */
export function hearServer(take = () => {}, lost = () => {}) {
  if (!served) return;
  const source = new EventSource(`${door}events?page=${served.content}`);
  source.onopen = () => lost(false);
  source.onerror = () => lost(true);
  source.onmessage = ({ data }) => {
    const event = JSON.parse(data);
    if (!event?.page) take(event);
    else if (event.page !== Number(served.content)) {
      source.close();
      location.reload();
    }
  };
}

/** Send a request to the server. */
export const askServer = (request) =>
  fetch(`${door}ask`, { method: "POST", body: JSON.stringify(request) }).catch(() => {}); // the line of the state says so
