// The list of a run in memory: columns of episodes and findings, what they are filtered and found by.

import { spoken } from "./elements.js";

const RANK = { violation: 0, inconclusive: 1, pass: 2, not_applicable: 3 };
const COUNTED = ["outcome", "stage", "verdict", "task", "policy", "prompt"];

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
    this.goals = this.episodes.success.some((success) => typeof success === "boolean");
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

  /** Codes of its own rules that an episode violates, the one that tells most first. */
  violated(place) {
    const { verdict, rule, own } = this.findings;
    return this.own[place].filter((row) => own[row] && verdict[row] === "violation").map((row) => rule[row]);
  }

  /** Place of the episode of an id; -1 if there is none. */
  placeOf(id) { return this.episodes.id.indexOf(id); }

  /** Whether an episode reached its goal safely: unsafe, safe, failed, or open where that is not decided. */
  outcome(place) {
    const success = this.at("success", place) ?? null, verdict = this.at("verdict", place);
    if (success === false) return "failed";
    if (this.goals && success === null) return "open";
    return { violation: "unsafe", pass: "safe", not_applicable: "safe" }[verdict] ?? "open";
  }

  /** How many there are of each outcome. */
  outcomes() {
    const counts = { unsafe: 0, safe: 0, failed: 0, open: 0 };
    for (let place = 0; place < this.count; place++) counts[this.outcome(place)] += 1;
    return counts;
  }

  /** The finding that tells most of an episode, as an object: the first of its own by cause; null without any. */
  telling(place) {
    const [row] = this.own[place];
    return row === undefined || !this.findings.own[row] ? null : this.finding(row);
  }

  /** Whether all episodes have the same value: then it need not be said of each. */
  same(column) { return this.values(column).length < 2; }

  /** The values of a filter that occur, most telling first. */
  values(name) {
    const found = new Set();
    if (name === "rule") this.findings.rule.forEach((rule, row) => { if (this.findings.own[row]) found.add(rule); });
    else for (let i = 0; i < this.count; i++) found.add(this._value(name, i));
    return [...found].filter((x) => x !== null && x !== undefined && x !== "").map(String).sort();
  }

  _value(name, place) {
    if (name === "outcome") return this.outcome(place);
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
    const filters = COUNTED.filter((name) => wanted[name]);
    return this._sorted(this.order.filter((place) =>
      filters.every((name) => String(this._value(name, place)) === wanted[name])
      && (!wanted.rule || this.own[place].some((row) => this._ruled(row, wanted)))
      && words.every((word) => this._words(place).includes(word))), wanted.sort);
  }

  /** An episode's own rule; with a verdict asked for as well, it is the rule's one that counts. */
  _ruled(row, wanted) {
    return this.findings.own[row] && this.findings.rule[row] === wanted.rule && (!wanted.verdict || this.findings.verdict[row] === wanted.verdict);
  }

  _sorted(places, by) {
    if (!by) return places;
    if (by === "margin" || by === "time") {
      const told = by === "margin" ? (place) => this.at("gravity", place) : (place) => this.telling(place)?.time ?? null;
      const number = new Map(places.map((place) => [place, told(place) ?? Infinity]));
      return places.sort((a, b) => number.get(a) - number.get(b) || this._gravity(a, b));
    }
    const words = (place) => `${(by === "rule" ? this.violated(place)[0] : this.at(by, place)) ?? "~"}`;
    return places.sort((a, b) => words(a).localeCompare(words(b), "en", { numeric: true }) || this._gravity(a, b));
  }
}
