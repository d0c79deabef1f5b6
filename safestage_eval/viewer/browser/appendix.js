// Paper: the evidence of the episodes that the list shows, the gravest first, with key frames and curves.

import { badge, byId, element, seconds, spoken } from "./elements.js";
import { headOf } from "./film.js";
import { library, piece } from "./pieces.js";
import { SafestageReplay } from "./replay.js";
import { meshesOf } from "./player_panel.js";
import { culprits, plainCard } from "./finding_cards.js";
import { plotCurve } from "./curve_plot.js";
import { colourNow } from "./theme_colours.js";
import { WitnessDrawing } from "./witness_drawing.js";

const PICTURED = 24;   // episodes whose key frame and curves are drawn
const MOST_ARTICLES = 300;      // episodes of which there are words

let stage = null, made = null;

function theStage() {
  if (!stage) {
    const canvas = element("canvas"), tags = element("div");
    stage = { canvas, tags, box: element("div", { class: "offstage", "aria-hidden": "true" }, canvas, tags) };
    byId("appendix").before(stage.box);
  }
  return stage;
}

async function keyFrame(data, film, head, finding, time) {
  await library("three");
  const { canvas, tags } = theStage();
  const replay = new SafestageReplay(canvas, film, { shared: await meshesOf(head) });
  const drawing = finding.witness ? new WitnessDrawing(replay, finding, tags) : null;
  for (const name of finding.verdict === "violation" ? culprits(data, finding) : []) replay.tints[name] = colourNow("violation");
  replay.seek(time);
  const image = element("img", { src: canvas.toDataURL("image/png"), alt: `Key frame at ${seconds(time)}` });
  const said = drawing && !drawing.label.hidden ? `: ${drawing.label.textContent}` : "";
  drawing?.dispose(); replay.dispose();
  return element("figure", {}, element("figcaption", {}, `${finding.rule}, ${seconds(time)}${said}`), image);
}

async function drawnCurve(data, finding) {
  const [curve] = finding.curves;
  if (!curve) return null;
  const box = element("div", { class: "plot" });
  theStage().box.append(box);
  const plot = await plotCurve(box, curve, finding, data, () => finding.worst ?? data.start, () => {});
  await new Promise((resolve) => requestAnimationFrame(() => requestAnimationFrame(resolve)));
  const image = element("img", { src: plot.canvas.toDataURL("image/png"), alt: `${curve.signal} over time` });
  plot.destroy(); box.remove();
  return element("figure", {}, element("figcaption", {}, `${curve.signal} (${curve.unit})`), image);
}

async function pictures(table, place) {
  const name = table.at("piece", place);
  if (!name) return [];
  const buffer = await piece(name), { head: data, start } = headOf(buffer), film = buffer.slice(start);
  const finding = data.findings?.find((one) => one.verdict === "violation") ?? data.findings?.[0];
  if (!finding) return [];
  const time = finding.worst ?? finding.time ?? data.success ?? data.end;
  return [await keyFrame(data, film, headOf(film).head, finding, time), await drawnCurve(data, finding)];
}

function articleOf(table, place) {
  const cell = (name) => table.at(name, place);
  const labels = ["stage", "policy", "prompt", "seed", "rollout"].filter((name) => cell(name) !== null && cell(name) !== "–")
    .map((name) => `${name} ${cell(name)}`).join(", ");
  const rows = table.own[place].map((row) => table.finding(row)).filter((row) => row.verdict !== "pass");
  return element("article", { class: "evidence" },
    element("h3", {}, spoken(cell("task")) || cell("id"), " ", badge(cell("verdict"))),
    element("p", { class: "small soft" }, `${cell("id")} · ${labels}`), ...rows.map(plainCard));
}

/** Fill the appendix with words at once; for the same list it stays as it is, with its pictures. */
export function wordsFor(table, places) {
  if (made === places) return;
  made = places;
  const some = places.slice(0, MOST_ARTICLES), count = places.length.toLocaleString("en");
  byId("appendix").replaceChildren(
    element("h2", {}, `Evidence: ${table.title}`),
    element("p", { class: "soft" }, places.length > some.length ? `The ${MOST_ARTICLES} gravest of ${count} episodes.` : `${count} ${places.length === 1 ? "episode" : "episodes"}.`),
    ...some.map((place) => articleOf(table, place)));
}

async function drawAll(table, places, tell) {
  const articles = [...byId("appendix").querySelectorAll("article.evidence")];
  const some = places.slice(0, PICTURED);
  for (const [i, place] of some.entries()) {
    tell(`drawing ${i + 1} of ${some.length} …`);
    try {
      const row = element("div", { class: "pictures" }, ...(await pictures(table, place)).filter(Boolean));
      articles[i].querySelector("p").after(row);
    } catch (error) {
      articles[i].append(element("p", { class: "note" }, `No picture: ${error.message}.`));
    }
  }
  tell("");
}

/** Draw the pictures of the gravest in the colours of paper, then print; `tell` is called with how far it is. */
export async function printEvidence(table, places, tell) {
  made = null;
  wordsFor(table, places);
  const { dataset } = document.documentElement, chosen = dataset.theme;
  dataset.theme = "light";
  try {
    await drawAll(table, places, tell);
  } finally {
    if (chosen) dataset.theme = chosen; else delete dataset.theme;
  }
  globalThis.print();
}
