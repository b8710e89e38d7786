// The compressed parts of the page: the libraries, and the modules of the units.

/** Response with the content of compressed bytes in base64. */
export function unzip(text) {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip")));
}
