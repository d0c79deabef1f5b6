/* The page of one episode: player, strip, timelines and findings share one time. */
(() => {
"use strict";
const $ = (what) => document.querySelector(what);
const data = JSON.parse($("#view").textContent);
const canvas = $("canvas"), slider = $(".strip input"), clock = $("[data-clock]"), button = $("[data-play]");
const cards = new Map(data.findings.map((finding) => [document.getElementById(finding.rule), finding]));

const heads = [...document.querySelectorAll("svg.timeline")].map((svg) => {
  const line = document.createElementNS("http://www.w3.org/2000/svg", "line");
  line.setAttribute("class", "playhead");
  line.setAttribute("y1", "14"); line.setAttribute("y2", svg.viewBox.baseVal.height - 26);
  svg.append(line);
  svg.addEventListener("click", (event) => {
    const box = svg.getBoundingClientRect(), x = (event.clientX - box.left) / box.width * svg.viewBox.baseVal.width;
    seek(data.start + (x - data.plot.left) / (data.plot.right - data.plot.left) * (data.end - data.start));
  });
  return line;
});

let replay = null;
const within = ([a, b], t) => a <= t && t < b;

function show(t) {
  slider.value = t - data.start;
  clock.textContent = `${t.toFixed(2)} s`;
  const x = data.plot.left + (t - data.start) / (data.end - data.start) * (data.plot.right - data.plot.left);
  for (const line of heads) { line.setAttribute("x1", x); line.setAttribute("x2", x); }
  const guilty = new Set();
  for (const [card, finding] of cards) {
    const now = finding.intervals.some((span) => within(span, t));
    card.classList.toggle("now", now);
    if (now) finding.bodies.forEach((name) => guilty.add(name));
  }
  if (!replay) return;
  for (const name of new Set(data.findings.flatMap((finding) => finding.bodies))) {
    const colour = guilty.has(name) ? [0.95, 0.2, 0.1] : null;
    if ((replay.tints[name] ?? null)?.join() !== colour?.join()) replay.tint(name, colour);
  }
}

function seek(t) {
  t = Math.min(Math.max(t, data.start), data.end);
  if (replay) replay.seek(t); else show(t);
}

const toggle = () => replay && (replay.playing ? replay.pause() : replay.play());
const now = () => data.start + Number(slider.value);

try {
  const bytes = Uint8Array.from(atob($("#film").textContent), (c) => c.charCodeAt(0));
  replay = new SafestageReplay(canvas, bytes.buffer, {
    onTime: show,
    onState: (playing) => {
      button.textContent = playing ? "Pause" : "Play";
      button.setAttribute("aria-pressed", playing);
    },
  });
} catch {
  canvas.hidden = true; $(".failed").hidden = false; button.disabled = true;
}
globalThis.view = { replay, seek, now };

button.addEventListener("click", toggle);
slider.addEventListener("input", () => { replay?.pause(); seek(now()); });
$("[data-speed]").addEventListener("change", (event) => { if (replay) replay.speed = Number(event.target.value); });
for (const look of document.querySelectorAll("[data-look]")) look.addEventListener("click", () => replay?.look(look.dataset.look));
for (const moment of document.querySelectorAll("[data-seek]")) {
  moment.addEventListener("click", () => { replay?.pause(); seek(Number(moment.dataset.seek)); });
}
const begins = data.findings.flatMap((finding) => finding.intervals.map(([a]) => a)).sort((a, b) => a - b);
document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.matches("select")) return;
  if (event.key === " " && event.target.matches("button")) return;  // it presses the button
  const act = {
    " ": toggle, ",": () => seek(now() - 1 / 15), ".": () => seek(now() + 1 / 15),
    v: () => begins.length && seek(begins.find((t) => t > now() + 1e-3) ?? begins[0]),
  }[event.key];
  if (act) { act(); event.preventDefault(); }
});
const [begin] = begins;
seek(begin ?? data.success ?? data.start);
})();
