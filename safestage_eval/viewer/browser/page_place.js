// Where the reader is, in the page's address: #episode=ID&t=3.21, or #results.

/** {episode, time, results, part} of the address now. */
export function placeNow() {
  const hash = location.hash.slice(1);
  if (!hash.includes("=")) return { episode: null, time: null, part: hash };
  const said = new URLSearchParams(hash.replaceAll("+", "%2B"));
  const time = Number.parseFloat(said.get("t"));
  return { episode: said.get("episode"), time: Number.isFinite(time) ? time : null, part: "" };
}

/** Put an episode, and a moment if one is given, into the address. */
export function setPlace(episode, time = null) {
  const at = time === null ? "" : `&t=${time.toFixed(2)}`;
  const hash = `#episode=${encodeURIComponent(episode)}${at}`;
  if (location.hash !== hash) history.replaceState(null, "", hash);
}

/** The whole address of a moment, to hand on. */
export const linkTo = (episode, time) =>
  `${location.href.split("#")[0]}#episode=${encodeURIComponent(episode)}&t=${time.toFixed(2)}`;
