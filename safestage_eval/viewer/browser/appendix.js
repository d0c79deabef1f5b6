// Paper: the evidence of the episodes that the list shows, in words, the gravest first.

import { badge, byId, element, spoken } from "./elements.js";
import { plainCard } from "./finding_cards.js";

const MOST_ARTICLES = 300;

let made = null;

function articleOf(table, place) {
  const cell = (name) => table.at(name, place);
  const labels = ["stage", "policy", "prompt", "seed", "rollout"].filter((name) => cell(name) !== null && cell(name) !== "–")
    .map((name) => `${name} ${cell(name)}`).join(", ");
  const rows = table.own[place].map((row) => table.finding(row)).filter((row) => row.verdict !== "pass");
  return element("article", { class: "evidence" },
    element("h3", {}, spoken(cell("task")) || cell("id"), " ", badge(cell("verdict"))),
    element("p", { class: "small soft" }, `${cell("id")} · ${labels}`), ...rows.map(plainCard));
}

/** Fill the appendix; for the same list it stays as it is. */
export function wordsFor(table, places) {
  if (made === places) return;
  made = places;
  const some = places.slice(0, MOST_ARTICLES), count = places.length.toLocaleString("en");
  byId("appendix").replaceChildren(
    element("h2", {}, `Evidence: ${table.title}`),
    element("p", { class: "soft" }, places.length > some.length ? `The ${MOST_ARTICLES} gravest of ${count} episodes.` : `${count} ${places.length === 1 ? "episode" : "episodes"}.`),
    ...some.map((place) => articleOf(table, place)));
}
