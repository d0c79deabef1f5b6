// The results beside the episodes: which of the two is shown, and the rate of the task table.

import { byId } from "./elements.js";

const RATES = { VR: "Violation rate", USR: "Unsafe success rate", SSR: "Safe success rate", SR: "Success rate" };

/** Show the results or the episodes. */
export function showResults(yes) {
  byId("results").hidden = !yes;
  byId("episodes").hidden = yes;
  byId("to-results").setAttribute("aria-pressed", String(yes));
  byId("to-episodes").setAttribute("aria-pressed", String(!yes));
  document.body.classList.toggle("reading", yes);
}

function chooseRate(button) {
  const buttons = [...button.parentElement.children], place = buttons.indexOf(button), { metric } = button.dataset;
  for (const other of buttons) other.setAttribute("aria-pressed", String(other === button));
  const table = document.querySelector("table.heat");
  table.classList.toggle("good", metric === "SR" || metric === "SSR");
  for (const cell of table.querySelectorAll("td[data-k]")) {
    const [share, most] = [cell.dataset.k, cell.dataset.most].map((counts) => Number(counts.split(" ")[place]) / Number(cell.dataset.n));
    const [low, high] = [share, most].map((one) => (100 * one).toFixed(0));
    cell.firstChild.textContent = low === high ? low : `${low}–${high}`;
    cell.className = `h${share <= 0 ? 0 : Math.max(1, Math.min(10, Math.round(10 * share)))}`;
  }
  byId("heatmap-what").textContent = RATES[metric];
}

/** Listen to the switch between the two views, and to the choice of a rate. */
export function makeResults() {
  const there = Boolean(document.body.dataset.results);
  byId("to-results").hidden = byId("to-episodes").hidden = !there;
  byId("to-results").onclick = () => showResults(true);
  byId("to-episodes").onclick = () => showResults(false);
  byId("results").addEventListener("click", (event) => {
    const button = event.target.closest("button[data-metric]");
    if (button) chooseRate(button);
  });
  return there;
}
