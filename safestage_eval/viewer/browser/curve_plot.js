// A measurement over time with its limits (uPlot): the side that is bad is hatched, stretches in violation are shaded.

import { library } from "./pieces.js";
import { colourNow } from "./theme_colours.js";

const PLOT_HEIGHT = 150;

function hatched(context, colour) {
  const tile = document.createElement("canvas");
  tile.width = tile.height = 8;
  const pen = tile.getContext("2d");
  pen.strokeStyle = colour; pen.globalAlpha = 0.35; pen.lineWidth = 1;
  pen.beginPath(); pen.moveTo(-2, 10); pen.lineTo(10, -2); pen.moveTo(-2, 2); pen.lineTo(2, -2); pen.moveTo(6, 10); pen.lineTo(10, 6); pen.stroke();
  return context.createPattern(tile, "repeat");
}

function underlay(plot, curve, finding) {
  const { ctx, bbox } = plot, red = colourNow("violation");
  ctx.save();
  ctx.beginPath(); ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height); ctx.clip();
  ctx.fillStyle = red; ctx.globalAlpha = 0.18;
  for (const [a, b] of finding.intervals) {
    const x = plot.valToPos(a, "x", true);
    ctx.fillRect(x, bbox.top, Math.max(plot.valToPos(b, "x", true) - x, 2), bbox.height);
  }
  ctx.globalAlpha = 1;
  for (const limit of curve.limits) {
    const y = plot.valToPos(limit.value, "y", true), end = limit.bad === "above" ? bbox.top : bbox.top + bbox.height;
    ctx.fillStyle = hatched(ctx, red);
    ctx.fillRect(bbox.left, Math.min(y, end), bbox.width, Math.abs(end - y));
  }
  ctx.restore();
}

function overlay(plot, curve, moment) {
  const { ctx, bbox } = plot, fine = devicePixelRatio, red = colourNow("violation");
  ctx.save();
  ctx.font = `${11 * fine}px system-ui, sans-serif`; ctx.textAlign = "right";
  for (const limit of curve.limits) {
    const y = plot.valToPos(limit.value, "y", true);
    ctx.strokeStyle = red; ctx.lineWidth = 1.4 * fine; ctx.setLineDash([6 * fine, 3 * fine]);
    ctx.beginPath(); ctx.moveTo(bbox.left, y); ctx.lineTo(bbox.left + bbox.width, y); ctx.stroke();
    const above = limit.bad === "above" ? y - 4 * fine > bbox.top + 10 * fine : y + 14 * fine > bbox.top + bbox.height;
    ctx.setLineDash([]); ctx.lineWidth = 3 * fine; ctx.strokeStyle = colourNow("surface"); ctx.fillStyle = red;
    const at = [limit.said, bbox.left + bbox.width - 4 * fine, above ? y - 4 * fine : y + 13 * fine];
    ctx.strokeText(...at); ctx.fillText(...at);
  }
  const x = plot.valToPos(moment(), "x", true);
  if (x >= bbox.left && x <= bbox.left + bbox.width) {
    ctx.strokeStyle = colourNow("accent"); ctx.lineWidth = 1.6 * fine;
    ctx.beginPath(); ctx.moveTo(x, bbox.top); ctx.lineTo(x, bbox.top + bbox.height); ctx.stroke();
  }
  ctx.restore();
}

// Limits that are far from all that was measured would flatten the curve: then only the nearest is kept in view.
function range(curve) {
  const values = [...curve.v, ...(curve.least ?? [])].filter((v) => v !== null);
  const all = [...values, ...curve.limits.map((limit) => limit.value)];
  if (!all.length) return [0, 1];
  const low = Math.min(...all), high = Math.max(...all), pad = 0.07 * (high - low) || Math.max(Math.abs(high), 1) * 0.1;
  return [low === 0 ? 0 : low - pad, high + pad];
}

/** Draw a curve into a box; `moment` says the time now, `seek` is called with a time that was pressed. */
export async function plotCurve(box, curve, finding, data, moment, seek) {
  await library("uplot");
  const ink = () => colourNow("ink"), soft = () => colourNow("ink-soft"), line = () => colourNow("line");
  const axis = { stroke: soft, grid: { stroke: line, width: 1 }, ticks: { stroke: line, width: 1 }, font: "11px system-ui, sans-serif" };
  const values = [curve.t, curve.v, ...(curve.least ? [curve.least] : [])];
  const series = [{}, { stroke: ink, width: 1.6, points: { show: false } },
    ...(curve.least ? [{ stroke: soft, width: 1.4, dash: [2, 3], points: { show: false } }] : [])];
  const plot = new uPlot({
    width: Math.max(box.clientWidth, 200), height: PLOT_HEIGHT, legend: { show: false }, series,
    cursor: { y: false, drag: { x: false, y: false }, points: { show: false } },
    scales: { x: { time: false, range: () => [data.start, data.end] }, y: { range: () => range(curve) } },
    axes: [{ ...axis, size: 26, gap: 2, values: (_, ticks) => ticks.map((t) => `${t} s`) }, { ...axis, size: 52, gap: 3 }],
    hooks: {
      drawClear: [(u) => underlay(u, curve, finding)],
      draw: [(u) => overlay(u, curve, moment)],
    },
  }, values, box);
  plot.over.addEventListener("click", () => seek(plot.posToVal(plot.cursor.left, "x")));
  const watch = new ResizeObserver(() => {
    if (box.clientWidth && box.clientWidth !== plot.width) plot.setSize({ width: box.clientWidth, height: PLOT_HEIGHT });
  });
  watch.observe(box);
  return { redraw: () => plot.redraw(false), destroy: () => { watch.disconnect(); plot.destroy(); }, canvas: plot.ctx.canvas };
}
