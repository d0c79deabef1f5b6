// Where the reader is, in the page's address: #rule=ETS201&episode=ID&t=3.21, or #results.

/** What a list can be narrowed to and ordered by; each stands in the address under its name. */
export const WANTED = ["text", "outcome", "verdict", "stage", "rule", "task", "policy", "prompt", "sort"];

function addressed() {
  const hash = location.hash.slice(1);
  return new URLSearchParams(hash.includes("=") ? hash.replaceAll("+", "%2B") : "");
}

function written(pairs) {
  const said = [...pairs].filter(([, value]) => value);
  const hash = said.length ? `#${said.map(([name, value]) => `${name}=${encodeURIComponent(value)}`).join("&")}` : "";
  if (location.hash !== hash) history.replaceState(null, "", hash || location.pathname + location.search);
}

const filtersOf = (said) => WANTED.map((name) => [name, said.get(name) ?? ""]);
const momentOf = (episode, time) => [["episode", episode], ["t", time === null ? null : time.toFixed(2)]];

/** {episode, time, wanted, part} of the address now; `wanted` is null where it names no filter. */
export function placeNow() {
  const hash = location.hash.slice(1), said = addressed(), time = Number.parseFloat(said.get("t"));
  const wanted = Object.fromEntries(filtersOf(said));
  return {
    episode: said.get("episode"), time: Number.isFinite(time) ? time : null, part: hash.includes("=") ? "" : hash,
    wanted: Object.values(wanted).some(Boolean) ? wanted : null,
  };
}

/** Put an episode, and a moment if one is given, into the address; filters stay. */
export function setPlace(episode, time = null) { written([...filtersOf(addressed()), ...momentOf(episode, time)]); }

/** Put what the list is narrowed to into the address; the episode stays. */
export function setFilters(wanted) {
  if (placeNow().part) return;
  const said = addressed();
  written([...WANTED.map((name) => [name, wanted[name]]), ["episode", said.get("episode")], ["t", said.get("t")]]);
}

/** The whole address of a moment, to hand on. */
export const linkTo = (episode, time) =>
  `${location.href.split("#")[0]}#episode=${encodeURIComponent(episode)}&t=${time.toFixed(2)}`;
