// The timeline of an episode: its phases, a lane for every finding with the stretches in violation, and the moments.

import { element, seconds, spoken } from "./elements.js";
import { counts } from "./finding_cards.js";

function block(kind, [from, to], data, title) {
  const length = data.end - data.start || 1, node = element("span", { class: `block ${kind}`, title });
  node.style.left = `${100 * (from - data.start) / length}%`;
  node.style.width = `max(3px, ${100 * Math.min(to - from, data.end - from) / length}%)`;
  return node;
}

function mark(kind, time, data, title) {
  const node = element("span", { class: `mark ${kind}`, title });
  node.style.left = `${100 * (time - data.start) / (data.end - data.start || 1)}%`;
  return node;
}

function lane(name, kind, blocks) {
  return element("div", { class: `lane ${kind}` }, element("span", { class: "lane-name" }, name),
    element("div", { class: "track" }, ...blocks));
}

export class PhaseTimeline {
  /** `seek` is called with a time that was pressed. */
  constructor(seek) {
    this.slider = element("input", { type: "range", step: "any", "aria-label": "Time" });
    this.lanes = element("div", { class: "lanes" });
    this.head = element("span", { class: "playhead" });
    this.node = element("section", { class: "timeline", "aria-label": "Timeline" },
      element("div", { class: "lane time" }, element("span", { class: "lane-name" }, "time"),
        element("div", { class: "track no-print" }, this.slider)),
      this.lanes);
    this.slider.oninput = () => seek(Number(this.slider.value));
    this.lanes.onclick = (event) => {
      const track = event.target.closest(".track");
      if (!track) return;
      const box = track.getBoundingClientRect();
      seek(this.data.start + (event.clientX - box.left) / box.width * (this.data.end - this.data.start));
    };
  }

  show(data) {
    this.data = data;
    this.slider.min = data.start; this.slider.max = data.end;
    const lanes = data.phases.map((phase) => lane(spoken(phase.name), "phase", phase.true.map((span) =>
      block("phase", span, data, `${phase.name}: ${seconds(span[0])} to ${seconds(span[1])}`))));
    for (const finding of data.findings) {
      const { rule, verdict } = finding;
      if (!counts(data, finding) || (verdict !== "violation" && !finding.judged.length)) continue;
      const judged = finding.judged.map((span) => block("judged", span, data, `${rule} judged from ${seconds(span[0])} to ${seconds(span[1])}`));
      const bad = finding.intervals.map((span) => block("bad", span, data, `${rule} in violation from ${seconds(span[0])} to ${seconds(span[1])}`));
      const name = verdict === "violation" ? "worst" : "closest";
      const worst = finding.worst === null ? [] : [mark("worst", finding.worst, data, `${name}: ${seconds(finding.worst)}`)];
      lanes.push(lane(`${this.sign(verdict)} ${rule}`, verdict, [...judged, ...bad, ...worst]));
    }
    if (data.goal && data.success !== null) {
      lanes.unshift(lane("goal", "goal", [mark("goal", data.success, data, `goal reached at ${seconds(data.success)}`)]));
    }
    this.lanes.replaceChildren(...lanes, this.head);
  }

  sign(verdict) { return JSON.parse(document.body.dataset.signs)[verdict] ?? ""; }

  tell(time) {
    const { start, end } = this.data, share = (time - start) / (end - start || 1);
    this.slider.value = time;
    this.slider.setAttribute("aria-valuetext", seconds(time));
    this.head.style.left = `calc(var(--names) + (100% - var(--names)) * ${share})`;
  }
}
