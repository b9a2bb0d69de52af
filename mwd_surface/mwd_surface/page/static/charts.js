// Strip charts of the last minutes; time runs in minutes before now, by the server's clock.

import { byId, el, say } from "./dom.js";
import * as units from "./units.js";

const CHANNELS = [
  ["vibration", "Vibration", "vibration"],
  ["rotary_speed", "Rotary speed, tool", "rotation"],
  ["temperature", "Temperature", "temperature"],
  ["total_field", "Total field", "field"],
  ["axial_interference", "Axial interference", "field"],
  ["inclination", "Inclination", "angle"],
];
const MINUTES = 10;

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

export class Charts {
  constructor(place) {
    this.grid = el("div", { class: "charts" });
    place.append(this.grid);
    this.charts = [];
    this.sizes = new ResizeObserver(() => this.resize());
    this.rebuild();
    this.sizes.observe(this.grid);
  }

  // Colours and units are fixed when a chart is made.
  rebuild() {
    for (const item of this.charts) item.plot.destroy();
    this.grid.replaceChildren();
    this.charts = CHANNELS.map(([column, title, kind]) => {
      const value = el("span", { class: "chart-value" });
      const box = el("div", { class: "chart-box" });
      this.grid.append(el("figure", {}, el("figcaption", {}, el("span", { class: "name" }, title), value), box));
      const axis = { stroke: colour("--muted"), grid: { stroke: colour("--line"), width: 1 }, ticks: { show: false }, font: "12px system-ui" };
      const plot = new window.uPlot(
        {
          width: 280, height: 110, legend: { show: false }, cursor: { show: false },
          scales: { x: { time: false, range: [-MINUTES, 0] }, y: { range: (_, low, high) => padded(low, high) } },
          series: [{}, { stroke: colour("--trace"), width: 1.5, points: { show: false }, spanGaps: false }],
          axes: [
            { ...axis, size: 24, values: (_, ticks) => ticks.map((t) => (t === 0 ? "now" : `${t} min`)), splits: () => [-10, -5, 0] },
            { ...axis, size: 58, space: 18, values: (_, ticks) => ticks.map((t) => String(Number(t.toFixed(3)))) },
          ],
        },
        [[], []],
        box,
      );
      return { column, kind, plot, box, value };
    });
    this.resize();
  }

  resize() {
    for (const { box, plot } of this.charts) {
      const width = Math.floor(box.clientWidth);
      const height = Math.floor(box.clientHeight);
      if (width > 60 && height > 40 && (plot.width !== width || plot.height !== height)) plot.setSize({ width, height });
    }
  }

  show(history, now) {
    if (!history || byId("tab-charts").hidden) return;
    const rows = history.rows.filter((row) => now - row[0] <= MINUTES * 60 + 5);
    const times = rows.map((row) => (row[0] - now) / 60);
    for (const { column, kind, plot, value } of this.charts) {
      const k = history.columns.indexOf(column);
      const values = rows.map((row) => (row[k] === null ? null : units.plain(kind, row[k])));
      plot.setData([times, values]);
      const known = values.filter((v) => v !== null);
      const raw = rows.map((row) => row[k]).filter((v) => v !== null);
      say(
        value,
        known.length
          ? `${units.number(kind, Math.min(...raw))} to ${units.number(kind, Math.max(...raw))}${units.after(kind)}`
          : "no data",
      );
    }
  }
}

function padded(low, high) {
  if (low === null || high === null) return [0, 1];
  const room = Math.max((high - low) * 0.1, Math.abs(high) * 0.002, 0.05);
  return [low - room, high + room];
}
