// One episode: its head, the player, the timeline and the findings share one moment.

import { badge, byId, element, seconds, spoken } from "./elements.js";
import { headOf } from "./film.js";
import { piece } from "./pieces.js";
import { PlayerPanel } from "./player_panel.js";
import { PhaseTimeline } from "./phase_timeline.js";
import { FindingCards, counts, plainCard } from "./finding_cards.js";
import { linkTo, setPlace } from "./page_place.js";

export class EpisodePane {
  /** `step` is called with −1 or 1, `back` when the list is wanted. */
  constructor(table, step, back) {
    this.table = table; this.data = null; this.place = null;
    this.player = new PlayerPanel((time) => this._moved(time));
    this.timeline = new PhaseTimeline((time) => { this.player.pause(); this.player.seek(time); });
    this.cards = new FindingCards(this.player);
    const button = (name, act, more = {}) => {
      const node = element("button", { type: "button", ...more }, name);
      node.onclick = act;
      return node;
    };
    this.back = button("← list", back, { class: "to-list" });
    this.previous = button("Previous", () => step(-1), { "aria-keyshortcuts": "k" });
    this.next = button("Next", () => step(1), { "aria-keyshortcuts": "j" });
    this.link = button("Copy link", () => this._copy());
    this.head = element("header", { class: "head" });
    this.stretch = element("output", { class: "stretch small soft" });
    this.about = element("p", { class: "about small soft" });
    this.stage = element("div", { class: "stage" }, this.player.node, this.timeline.node, this.about);
    this.node = element("article", { class: "episode" },
      element("nav", { class: "steps no-print", "aria-label": "Episode" }, this.back, this.previous, this.next, this.stretch, this.link),
      this.head, this.stage, this.cards.node);
  }

  /** Open an episode of the list, at a moment or where it matters most. Raises Error where its data do not come. */
  async open(place, time = null) {
    this.place = place; this.data = null;
    this.player.close(); this.cards.clear();
    byId("pane").replaceChildren(this.node);
    byId("pane").scrollTop = 0;
    this.stretch.textContent = "";
    this._headOf(place, null);
    const name = this.table.at("piece", place), there = Boolean(name);
    this.stage.hidden = !there;
    this.link.hidden = !there;
    if (!there) return this._plain(place);
    this.cards.node.replaceChildren(element("p", { class: "soft", role: "status" }, "loading …"));
    let buffer;
    try {
      buffer = await piece(name);
    } catch (error) {
      if (this.place !== place) return undefined;
      this.stage.hidden = true;
      this._plain(place, `The evidence of this episode cannot be shown: ${error.message}.`);
      return undefined;
    }
    if (this.place !== place) return undefined;
    const { head: data, start } = headOf(buffer), film = buffer.slice(start);
    if (data.problem) {
      this.stage.hidden = true;
      return this._plain(place, `This episode cannot be shown: ${data.problem}`);
    }
    this.data = data;
    this._headOf(place, data);
    this.timeline.show(data);
    this.cards.show(data);
    const [grave] = data.findings;
    const begin = time ?? (grave?.verdict === "violation" ? grave.worst ?? grave.time : grave?.worst) ?? data.success ?? data.start;
    await this.player.open(data, film, headOf(film).head, this.table.films[name] ?? data.film ?? null);
    if (this.data !== data) return undefined;
    this.player.point(grave ?? null);
    this.player.seek(begin);
    return undefined;
  }

  _plain(place, why = null) {
    const rows = this.table.own[place].map((row) => this.table.finding(row));
    const note = why ?? (this.table.traces ? "No replay: the evidence of this episode is not in this report."
      : "No replay: the report was made without the traces.");
    this.cards.node.replaceChildren(element("p", { class: "note", role: "status" }, note), ...rows.map(plainCard));
  }

  _headOf(place, data) {
    const cell = (name) => this.table.at(name, place), success = data ? data.goal : cell("success");
    let goal = success === null ? "whether it reached its goal is not known" : success ? "✓ reached its goal" : "– did not reach its goal";
    if (data?.goal && data.success !== null) goal += ` at ${seconds(data.success)}`;
    const labels = ["stage", "policy", "prompt", "seed", "rollout"].map((name) => [name, cell(name)])
      .filter(([, value]) => value !== null && value !== "–").map(([name, value]) => `${name} ${value}`);
    const verdict = cell("verdict") ?? this._verdict(data), told = data?.findings.find((finding) => finding.assigned)?.short;
    this.head.replaceChildren(
      element("h2", {}, spoken(cell("task")) || cell("id"), " ",
        data?.instruction ? element("span", { class: "soft" }, `“${data.instruction}”`) : null),
      element("p", { class: "sentence" }, badge(verdict), " ", verdict === "pass" ? "No assigned rule was broken." : told || this.table.telling(place)?.text || null),
      element("p", { class: "facts soft" }, goal));
    this.about.replaceChildren(labels.join(", "), element("br"), element("code", {}, cell("id")));
  }

  /** The verdict of an episode that the list has not judged yet. */
  _verdict(data) {
    const own = data?.findings.filter((finding) => finding.assigned).map((finding) => finding.verdict) ?? [];
    return ["violation", "inconclusive", "pass", "not_applicable"].find((verdict) => own.includes(verdict)) ?? null;
  }

  _moved(time) {
    if (!this.data) return;
    this.timeline.tell(time);
    this.player.tint(this.cards.tell(time));
    if (!this.player.playing) {
      clearTimeout(this.noting);
      const id = this.table.at("id", this.place);
      this.noting = setTimeout(() => setPlace(id, time), 150);
    }
  }

  async _copy() {
    const link = linkTo(this.table.at("id", this.place), this.player.time);
    try {
      await navigator.clipboard.writeText(link);
      this.link.textContent = "Copied";
    } catch {
      setPlace(this.table.at("id", this.place), this.player.time);
      this.link.textContent = "In the address";
    }
    setTimeout(() => { this.link.textContent = "Copy link"; }, 1500);
  }

  /** Go to the next stretch in violation of a rule that counts, and to its card. */
  nextViolation() {
    const begins = (this.data?.findings ?? []).filter((finding) => counts(this.data, finding) && finding.verdict === "violation")
      .flatMap((finding) => finding.intervals.map(([a]) => ({ a, finding }))).sort((x, y) => x.a - y.a);
    if (!begins.length) return;
    const found = begins.find(({ a }) => a > this.player.time + 1e-3) ?? begins[0];
    this.stretch.textContent = `violation ${begins.indexOf(found) + 1} of ${begins.length}`;
    this.player.pause(); this.player.point(found.finding); this.player.seek(found.a);
    this.cards.reveal(found.finding);
  }

  nudge(step) { if (this.data) { this.player.pause(); this.player.seek(this.player.time + step); } }

  /** To a moment of the episode that is open. */
  seek(time) { this.player.pause(); this.player.seek(time); }
}
