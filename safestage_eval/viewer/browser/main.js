// The run browser: the list of episodes, one episode, the results; from files or from a server.

import { alarm, byId } from "./elements.js";
import { jsonPiece } from "./pieces.js";
import { RunTable } from "./run_table.js";
import { EpisodeList } from "./episode_list.js";
import { EpisodePane } from "./episode_pane.js";
import { makeFilters } from "./filters.js";
import { writeHeadline } from "./run_headline.js";
import { makeKeyboard } from "./keyboard.js";
import { makeResults, showResults } from "./results_view.js";
import { placeNow } from "./page_place.js";
import { wordsFor } from "./appendix.js";

const live = document.body.dataset.carried === "live";
let table = null, list = null, pane = null, refilter = null;

function back() {
  document.body.classList.remove("opened");
  byId("list").focus({ preventScroll: true });
}

async function choose(place, time = null) {
  if (place === null || place === undefined) return;
  document.body.classList.add("opened");
  list.mark(place);
  const index = list.places.indexOf(place);
  pane.previous.disabled = index <= 0;
  pane.next.disabled = index < 0 || index >= list.places.length - 1;
  try {
    await pane.open(place, time);
  } catch (error) {
    alarm(`The episode cannot be shown: ${error.message}.`);
  }
}

const step = (by) => choose(list.neighbour(by));

function follow() {
  const { episode, time, part, wanted } = placeNow();
  if (part) {
    const target = document.getElementById(part);
    if (part === "results" || byId("results").contains(target)) {
      showResults(true);
      target?.closest("details")?.setAttribute("open", "");
      if (part !== "results") target?.scrollIntoView();
    }
    return;
  }
  showResults(false);
  refilter(wanted ?? {});
  const place = episode === null ? list.places[0] ?? -1 : table.placeOf(episode);
  if (place < 0) return void (episode === null || alarm(`This run has no episode ${episode}.`));
  alarm("");
  if (!list.places.includes(place)) refilter({});
  if (pane.place === place && pane.data) { if (time !== null) pane.seek(time); } else choose(place, time);
}

function fill(data) {
  table = new RunTable(data);
  list?.watch.disconnect();
  list = new EpisodeList(table, choose);
  if (pane) pane.table = table; else pane = new EpisodePane(table, step, back);
  refilter = makeFilters(table, (wanted) => { list.chosen = pane.place; list.show(table.found(wanted)); });
  writeHeadline(table);
  byId("index").setAttribute("aria-busy", String(Boolean(table.state?.left)));
}

// A server judges while people look: the list is asked for again until all is judged.
async function wait() {
  while (table.state?.left) {
    byId("count").textContent += ` · judging: ${table.state.left} left`;
    await new Promise((resolve) => setTimeout(resolve, 1500));
    try {
      const data = await jsonPiece("run", true);
      if (data.state?.left !== table.state.left) fill(data);
    } catch (error) {
      alarm(`${error.message}.`);
      return;
    }
    if (!table.state?.left && !document.body.dataset.results) alarm("All episodes are judged: reload this page to see the results.");
  }
  if (table.state?.problems) alarm(table.state.problems);
}

async function start() {
  if (typeof DecompressionStream === "undefined") throw new Error("this browser is older than 2023");
  makeResults();
  fill(await jsonPiece("run"));
  makeKeyboard({
    step, back, toggle: () => pane.player.toggle(), nudge: (by) => pane.nudge(by), violation: () => pane.nextViolation(),
    enter: () => choose(list.chosen ?? list.places[0]).then(() => byId("pane").focus()),
    end: (by) => choose(list.places.at(by > 0 ? -1 : 0)),
  });
  byId("print").onclick = () => globalThis.print();
  addEventListener("hashchange", follow);
  addEventListener("beforeprint", () => { if (byId("results").hidden) wordsFor(table, list.places); });
  globalThis.safestage = { get pane() { return pane; }, get list() { return list; }, get table() { return table; } };
  follow();
  byId("index").dataset.ready = "yes";
  if (live) wait();
}

start().catch((error) => {
  byId("count").textContent = "";
  alarm(`The list cannot be opened: ${error.message}. It needs its data, and a browser of 2023 or later.`);
});
