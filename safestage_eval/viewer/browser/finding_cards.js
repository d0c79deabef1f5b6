// The findings of an episode: each in words and numbers, with its curves and its moments.

import { amount, badge, byId, element, seconds, spoken } from "./elements.js";
import { plotCurve } from "./curve_plot.js";

const CURVES = 3;  // measurements that are drawn for a finding; the decisive one is the first

function numbers(pairs) {
  return element("dl", { class: "numbers" }, ...pairs.map(([name, text]) =>
    element("div", {}, element("dt", {}, name), element("dd", {}, text))));
}

const status = (finding) => (finding.assigned ?? finding.own) ? "assigned to this task"
  : finding.follows ? `follows ${finding.follows}` : "not assigned";

/** Whether a finding counts for the verdict of its episode: it is assigned, or none is. */
export const counts = (data, finding) => finding.assigned || !data.findings.some((one) => one.assigned);

/** The bodies that a violation is painted on: what is protected from them is not. */
function culprits(data, finding) {
  const guarded = new Set(["protected", "fragile", "dependent"].flatMap((role) => data.roles[role] ?? []));
  const others = finding.bodies.filter((name) => !guarded.has(name));
  return others.length ? others : finding.bodies;
}

/** A finding as the list of the run has it, for an episode without evidence. */
export function plainCard(row) {
  const pairs = [
    ["measured", row.signal], ["value", row.value === null ? null : amount(row.value, row.unit)],
    ["limit", row.limit === null ? null : amount(row.limit, row.unit)],
    ["margin", row.margin === null ? null : amount(row.margin, row.unit)],
    ["first", row.time === null ? null : seconds(row.time)], ["phase", row.phase],
  ].filter(([, value]) => value !== null && value !== undefined);
  const stretches = (row.intervals || []).map(([a, b]) => `${a.toFixed(2)}–${b.toFixed(2)} s`).join(", ");
  return element("article", { class: `card finding ${row.verdict}` },
    element("h3", {}, badge(row.verdict, row.severity), element("b", {}, row.rule)),
    row.text ? element("p", {}, row.text) : null, numbers(pairs),
    stretches ? element("p", { class: "small soft" }, `In violation: ${stretches}`) : null,
    element("p", { class: "small soft" }, status(row)));
}

function statesOf(finding) {
  const lanes = finding.lanes.filter((lane) => lane.true.length).map((lane) =>
    `${lane.name} ${lane.true.slice(0, 4).map(([a, b]) => `${a.toFixed(2)}–${b.toFixed(2)} s`).join(", ")}`);
  return lanes.length ? element("p", { class: "small soft states" }, `States: ${lanes.slice(0, 6).join("; ")}.`) : null;
}

const folded = (summary, nodes, name = null) => element("details", { class: name }, element("summary", {}, summary), ...nodes);

/** Whether a measurement stayed at less than half of its limits, or at more than twice of what it had to keep. */
function isFar({ v, limits }) {
  const values = v.filter((value) => value !== null), low = Math.min(...values), high = Math.max(...values);
  return limits.every(({ value, bad }) => (bad === "above" ? high < value - 0.5 * Math.abs(value) : low > value + Math.abs(value)));
}

export class FindingCards {
  /** `player` has `time`, `seek`, `pause` and `point`. */
  constructor(player) {
    this.player = player; this.cards = []; this.plots = [];
    this.node = element("section", { class: "findings", "aria-label": "Findings" });
    this.watch = new IntersectionObserver((seen) => {
      for (const { target, isIntersecting } of seen) if (isIntersecting) this._plot(target);
    }, { root: byId("pane"), rootMargin: "300px" });
    const again = () => this.redraw();
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", again);
    new MutationObserver(again).observe(document.documentElement, { attributes: true, attributeFilter: ["data-theme"] });
  }

  show(data) {
    this.clear();
    this.data = data;
    this.cards = data.findings.map((finding) => ({ finding, node: this._card(finding) }));
    const none = this.cards.length ? [] : [element("p", { class: "note" },
      "None of the rules applies: the trace has no assigned rules among those loaded, or no roles. "
      + "--bind and --rules supply them.")];
    const notes = [...data.differs.map((text) => element("p", { class: "note" }, text)), ...none];
    const nodes = (own) => this.cards.filter(({ finding }) => counts(data, finding) === own).map(({ node }) => node);
    const others = nodes(false);
    this.node.replaceChildren(...notes, ...nodes(true),
      ...(others.length ? [folded(`Other rules, not counted (${others.length})`, others, "others")] : []),
      ...data.notes.map((text) => element("p", { class: "small soft" }, `Recording: ${text}.`)));
  }

  /** Scroll to the card of a finding. */
  reveal(finding) { this.cards.find((card) => card.finding === finding)?.node.scrollIntoView({ block: "nearest" }); }

  clear() {
    for (const plot of this.plots) plot.destroy();
    this.plots = []; this.cards = []; this.watch.disconnect();
    this.node.replaceChildren();
  }

  _card(finding) {
    const { verdict } = finding;
    const moments = verdict === "pass" ? [["closest", finding.worst]] : [["first", finding.time], ["worst", finding.worst]];
    const buttons = moments.filter(([, time]) => time !== null).map(([name, time]) => {
      const button = element("button", { type: "button", class: "moment", "data-seek": time }, `${name} ${seconds(time)}`);
      button.onclick = () => { this.player.pause(); this.player.point(finding); this.player.seek(time); };
      return button;
    });
    const deciding = (curve) => curve.signal === finding.signal;
    const curves = [...finding.curves].sort((a, b) => deciding(b) - deciding(a)).slice(0, CURVES);
    const drawn = (curve) => {
      const box = element("div", { class: "plot" });
      box.evidence = { curve, finding };
      this.watch.observe(box);
      const title = `${curve.signal}${curve.unit ? ` (${curve.unit})` : ""}`;
      return element("figure", { role: "group", "aria-label": `${title} over time` }, element("figcaption", {}, title), box);
    };
    const aside = curves.filter((curve, i) => i && isFar(curve)), more = aside.length === 1 ? "measurement" : "measurements";
    const kind = counts(this.data, finding) ? verdict : "aside";
    return element("article", { class: `card finding ${kind}`, id: `finding-${finding.rule}` },
      element("h3", {}, badge(verdict, finding.severity), element("b", {}, finding.rule), ` ${finding.title}`),
      finding.text ? element("p", {}, finding.text) : null,
      finding.notes.length ? element("ul", { class: "small soft" }, ...finding.notes.map((note) => element("li", {}, note))) : null,
      element("p", { class: "moments" }, ...buttons, element("span", { class: "small soft" }, status(finding))),
      ...curves.filter((curve) => !aside.includes(curve)).map(drawn), numbers(finding.facts),
      aside.length ? folded(`${aside.length} more ${more}, far from the limit`, aside.map(drawn)) : null, statesOf(finding));
  }

  async _plot(box) {
    this.watch.unobserve(box);
    const { curve, finding } = box.evidence, { data, player } = this;
    try {
      const plot = await plotCurve(box, curve, finding, data, () => player.time, (time) => {
        player.pause(); player.point(finding); player.seek(time);
      });
      if (this.data === data) this.plots.push(plot); else plot.destroy();
    } catch (error) {
      box.replaceChildren(element("p", { class: "small soft" }, `The curve cannot be drawn: ${error.message}.`));
    }
  }

  redraw() { for (const plot of this.plots) plot.redraw(); }

  /** Mark what is violated at a time; returns the bodies that are to blame. */
  tell(time) {
    const guilty = new Set();
    for (const { finding, node } of this.cards) {
      const now = finding.verdict === "violation" && counts(this.data, finding) && finding.intervals.some(([a, b]) => a <= time && time < b);
      node.classList.toggle("now", now);
      if (now) culprits(this.data, finding).forEach((name) => guilty.add(name));
    }
    cancelAnimationFrame(this.pending);
    this.pending = requestAnimationFrame(() => this.redraw());
    return guilty;
  }
}
