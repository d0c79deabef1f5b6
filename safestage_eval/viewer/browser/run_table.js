// The list of a run in memory: columns of episodes and findings, what they are filtered and found by.

import { spoken } from "./elements.js";

const RANK = { violation: 0, inconclusive: 1, pass: 2, not_applicable: 3 };
const COUNTED = ["stage", "verdict", "rule", "task", "policy", "prompt", "goal"];

// A column of distinct values and places in it reads like a plain list.
const plain = (column) => (Array.isArray(column) ? column : column.at.map((place) => column.values[place]));
const unpacked = (table) => Object.fromEntries(Object.entries(table).map(([name, column]) => [name, plain(column)]));

export class RunTable {
  constructor(data) {
    Object.assign(this, { title: data.title, films: data.films ?? {}, traces: data.traces, state: data.state ?? null });
    this.episodes = unpacked(data.episodes);
    this.findings = unpacked(data.findings);
    this.count = this.episodes.id.length;
    this.own = Array.from({ length: this.count }, () => []);
    this.findings.of.forEach((place, row) => this.own[place].push(row));
    this.words = new Array(this.count);
    this.order = Array.from({ length: this.count }, (_, i) => i).sort((a, b) => this._gravity(a, b));
  }

  _gravity(a, b) {
    const { verdict, gravity } = this.episodes, rank = (i) => RANK[verdict[i]] ?? 4;
    return rank(a) - rank(b) || (gravity[a] ?? 0) - (gravity[b] ?? 0) || a - b;
  }

  /** A cell of an episode. */
  at(column, place) { return this.episodes[column][place]; }

  /** A finding as an object. */
  finding(row) { return Object.fromEntries(Object.entries(this.findings).map(([name, column]) => [name, column[row]])); }

  /** Codes of the rules that an episode violates; its own come first. */
  violated(place) {
    const { verdict, rule, own } = this.findings;
    const rows = this.own[place].filter((row) => verdict[row] === "violation");
    return [...rows.filter((row) => own[row]), ...rows.filter((row) => !own[row])].map((row) => rule[row]);
  }

  /** Place of the episode of an id; -1 if there is none. */
  placeOf(id) { return this.episodes.id.indexOf(id); }

  _goal(place) {
    const success = this.at("success", place);
    return success === null ? "not known" : success ? "reached" : "not reached";
  }

  /** The values of a filter that occur, most telling first. */
  values(name) {
    const found = new Set();
    if (name === "rule") this.findings.rule.forEach((rule) => found.add(rule));
    else for (let i = 0; i < this.count; i++) found.add(this._value(name, i));
    return [...found].filter((x) => x !== null && x !== undefined && x !== "").map(String).sort();
  }

  _value(name, place) {
    if (name === "goal") return this._goal(place);
    if (name === "verdict") return this.at("verdict", place) ?? "not judged";
    return this.at(name, place);
  }

  _words(place) {
    if (this.words[place] === undefined) {
      const { rule, signal, text } = this.findings;
      const said = ["id", "task", "stage", "policy", "prompt"].map((name) => this.at(name, place) ?? "");
      for (const row of this.own[place]) said.push(rule[row], signal[row] ?? "", text[row]);
      said.push(spoken(this.at("task", place)));
      this.words[place] = said.join(" ").toLowerCase();
    }
    return this.words[place];
  }

  /** Places of the episodes that match, in order; `wanted` is {text, stage, verdict, rule, …}. */
  found(wanted) {
    const words = (wanted.text ?? "").toLowerCase().split(/\s+/).filter(Boolean);
    const filters = COUNTED.filter((name) => name !== "rule" && wanted[name]);
    return this._sorted(this.order.filter((place) =>
      filters.every((name) => String(this._value(name, place)) === wanted[name])
      && (!wanted.rule || this.own[place].some((row) => this._ruled(row, wanted)))
      && words.every((word) => this._words(place).includes(word))), wanted.sort);
  }

  /** With a verdict asked for as well, it is the rule's own one that counts. */
  _ruled(row, wanted) {
    return this.findings.rule[row] === wanted.rule && (!wanted.verdict || this.findings.verdict[row] === wanted.verdict);
  }

  _sorted(places, by) {
    if (!by) return places;
    const said = (place) => `${this.at(by, place) ?? ""}`;
    return places.sort((a, b) => said(a).localeCompare(said(b), "en", { numeric: true }) || this._gravity(a, b));
  }
}
