// The list of episodes: of any length, since only the rows in view exist.

import { byId, element, howMuch, spoken } from "./elements.js";

const ROW_HEIGHT = 76;  // px, of a row; layout.css has the same
const BEYOND = 6;   // rows that exist above and below the view

export class EpisodeList {
  /** `choose` is called with the place of an episode that was chosen. */
  constructor(table, choose) {
    Object.assign(this, { table, choose, places: [], chosen: null, drawn: new Map() });
    this.box = byId("list"); this.rows = byId("rows");
    this.box.onscroll = () => this.draw();
    this.rows.onclick = (event) => {
      const row = event.target.closest("[data-place]");
      if (row) this.choose(Number(row.dataset.place));
    };
    this.watch?.disconnect();
    this.watch = new ResizeObserver(() => this.draw());
    this.watch.observe(this.box);
  }

  /** Another list: of these episodes, in this order. */
  show(places) {
    this.places = places;
    this.rows.style.height = `${places.length * ROW_HEIGHT}px`;
    this.rows.replaceChildren(); this.drawn.clear();
    const { count } = this.table, some = places.length.toLocaleString("en");
    const all = `${count.toLocaleString("en")} ${count === 1 ? "episode" : "episodes"}`;
    byId("count").textContent = !places.length ? "No episode matches."
      : places.length === count ? all : `${some} of ${all}`;
    this.draw();
  }

  /** Mark an episode as the one that is open, and bring it into view. */
  mark(place) {
    this.chosen = place;
    const index = this.places.indexOf(place), { box } = this;
    if (index >= 0) {
      const top = index * ROW_HEIGHT;
      if (top < box.scrollTop) box.scrollTop = top;
      else if (top + ROW_HEIGHT > box.scrollTop + box.clientHeight) box.scrollTop = top + ROW_HEIGHT - box.clientHeight;
    }
    this.rows.replaceChildren(); this.drawn.clear();
    this.draw();
  }

  /** The episode so many places on from the one that is open; null at the ends. */
  neighbour(step) {
    const index = this.places.indexOf(this.chosen);
    if (index < 0) return this.places[step > 0 ? 0 : this.places.length - 1] ?? null;
    return this.places[index + step] ?? null;
  }

  /** Rows that left the view show those that came into it: a frame makes no elements. */
  draw() {
    const { box, drawn } = this;
    const first = Math.max(Math.floor(box.scrollTop / ROW_HEIGHT) - BEYOND, 0);
    const last = Math.min(Math.ceil((box.scrollTop + box.clientHeight) / ROW_HEIGHT) + BEYOND, this.places.length);
    const spare = [];
    for (const [index, row] of drawn) {
      if (index < first || index >= last) { spare.push(row); drawn.delete(index); }
    }
    const fresh = [];
    for (let index = first; index < last; index++) {
      if (drawn.has(index)) continue;
      const row = spare.pop() ?? blankRow();
      this._fill(row, index);
      drawn.set(index, row);
      if (!row.isConnected) fresh.push(row);
    }
    for (const row of spare) row.remove();
    if (fresh.length) this.rows.append(...fresh);
    const open = drawn.get(this.places.indexOf(this.chosen));
    if (open) box.setAttribute("aria-activedescendant", open.id); else box.removeAttribute("aria-activedescendant");
  }

  _fill(row, index) {
    const place = this.places[index], { table } = this, cell = (name) => table.at(name, place);
    const [name, told, line] = row.children, [codes, which, who] = line.children;
    row.id = `row-${place}`; row.dataset.place = place;
    row.setAttribute("aria-posinset", index + 1);
    row.setAttribute("aria-setsize", this.places.length);
    row.setAttribute("aria-selected", String(place === this.chosen));
    row.style.top = `${index * ROW_HEIGHT}px`;
    name.textContent = spoken(cell("task")) || cell("id") || "–";
    const goal = cell("success") ?? null, verdict = cell("verdict");
    told.replaceChildren(...(goal === null ? [] : [element("span", { class: "soft" }, goal ? "✓ goal" : "– no goal"), " · "]),
      element("b", { class: `told ${verdict ?? "none"}` }, outcomeOf(verdict, table.telling(place))));
    codes.textContent = table.violated(place).join(" ");
    which.textContent = ["seed", "rollout"].filter((label) => cell(label) !== null && !table.same(label))
      .map((label) => `${label} ${cell(label)}`).join(" · ");
    who.textContent = ["policy", "prompt", "stage"].filter((label) => cell(label) && cell(label) !== "–" && !table.same(label))
      .map(cell).join(" · ");
  }
}

function outcomeOf(verdict, finding) {
  if (verdict === "violation") return `✕ ${finding ? howMuch(finding) || "unsafe" : "unsafe"}`;
  return { pass: "✓ safe", not_applicable: "✓ safe: hazard not met", inconclusive: "? undecided" }[verdict] ?? "not judged";
}

function blankRow() {
  const part = (name) => element("span", { class: name });
  return element("div", { class: "row", role: "option" }, part("name"), part("telling"),
    element("span", { class: "line soft" }, part("codes"), part("which"), part("labels")));
}
