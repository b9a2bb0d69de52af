// Strip charts of the last minutes; time runs in minutes before now, by the server's clock.

import { byId, el, setText } from "./dom.js";
import * as units from "./units.js";

// Title, unit kind, and lines (column, word, colour, dashes). Several lines differ in dashes as well as in colour.
const CHARTS = [
  ["Vibration", "vibration", [["vibration", "─ peak", "--trace", []], ["lateral_vibration", "╌ lat.", "--text", [6, 4]], ["axial_vibration", "┈ axial", "--good", [2, 3]]]],
  ["Rotary, tool", "rotation", [["rotary_speed", "", "--trace", []]]],
  ["Stick-slip", "index", [["stick_slip", "", "--trace", []]]],
  ["Shocks in 10 s", "count", [["shocks", "", "--trace", []]]],
  ["Temperature", "temperature", [["temperature", "", "--trace", []]]],
  ["Total field", "field", [["total_field", "", "--trace", []]]],
  ["Axial interf.", "field", [["axial_interference", "", "--trace", []]]],
  ["Inclination", "angle", [["inclination", "", "--trace", []]]],
  ["Azimuth", "bearing", [["azimuth", "", "--trace", []]]],
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

  // Charts must be rebuilt for new colours or units, because these are fixed when a chart is made.
  rebuild() {
    for (const item of this.charts) item.plot.destroy();
    this.grid.replaceChildren();
    this.shades = [];
    this.charts = CHARTS.map(([title, kind, lines]) => {
      const value = el("span", { class: "chart-value" });
      const box = el("div", { class: "chart-box" });
      const names = lines.filter(([, word]) => word).map(([, word, tone]) => el("span", { class: `line-name ${tone.slice(2)}` }, word));
      this.grid.append(el("figure", {}, el("figcaption", {}, el("span", { class: "name" }, title, names), value), box));
      const axis = { stroke: colour("--muted"), grid: { stroke: colour("--line"), width: 1 }, ticks: { show: false }, font: "12px system-ui" };
      const plot = new window.uPlot(
        {
          width: 280, height: 110, legend: { show: false }, cursor: { show: false },
          scales: { x: { time: false, range: [-MINUTES, 0] }, y: { range: (_, low, high) => padded(low, high) } },
          series: [{}, ...lines.map(([, , tone, dash]) => ({ stroke: colour(tone), dash, width: 1.5, points: { show: false }, spanGaps: false }))],
          axes: [
            { ...axis, size: 24, values: (_, ticks) => ticks.map((t) => (t === 0 ? "now" : `${t} min`)), splits: () => [-10, -5, 0] },
            { ...axis, size: 50, space: 18, values: (_, ticks) => ticks.map((t) => String(Number((kind === "bearing" ? units.turn(t) : t).toFixed(3)))) },
          ],
          hooks: { drawClear: [(u) => this.shade(u)] },
        },
        [[], ...lines.map(() => [])],
        box,
      );
      return { lines, kind, plot, box, value };
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

  // Draw shading behind the lines where the data was doubtful or bad.
  shade(plot) {
    const { ctx, bbox } = plot;
    ctx.save();
    for (const [from, to, level] of this.shades) {
      const left = Math.max(bbox.left, plot.valToPos(from, "x", true));
      const right = plot.valToPos(to, "x", true);
      ctx.fillStyle = colour(level > 1 ? "--reject-bg" : "--doubtful-bg");
      if (right > left) ctx.fillRect(left, bbox.top, right - left, bbox.height);
    }
    ctx.restore();
  }

  show(history, now) {
    if (!history || byId("tab-charts").hidden || this.grid.hidden) return;
    const rows = history.rows.filter((row) => now - row[0] <= MINUTES * 60 + 5);
    const times = rows.map((row) => (row[0] - now) / 60);
    const doubt = history.columns.indexOf("doubt");
    this.shades = shadesOf(times, rows.map((row) => row[doubt]));
    for (const { lines, kind, plot, value } of this.charts) {
      const columns = lines.map(([name]) => history.columns.indexOf(name));
      const traces = columns.map((k) => rows.map((row) => row[k])).map((trace) => (kind === "bearing" ? unwrapped(trace) : trace));
      plot.setData([times, ...traces.map((trace) => trace.map((v) => (v === null ? null : units.plain(kind, v))))]);
      const raw = traces.flat().filter((v) => v !== null);
      setText(
        value,
        raw.length ? spanOf(raw, kind, lines.length > 1)
          : "no data",
      );
    }
  }
}

// Let a bearing continue beyond 0 or 360 degrees, so that its line does not jump at north.
export function unwrapped(angles) {
  let last = null;
  return angles.map((v) => {
    if (v === null) return null;
    last = last === null ? v : last + Math.atan2(Math.sin(v - last), Math.cos(v - last));
    return last;
  });
}

const spanOf = (raw, kind, most) => {
  const text = (v) => (kind === "bearing" ? units.bearing(v, 1) : units.number(kind, v));
  const high = `${text(Math.max(...raw))}${units.after(kind)}`;
  return most ? `≤ ${high}` : `${text(Math.min(...raw))} to ${high}`;
};

// Intervals with one level of doubt: from, to, level.
export function shadesOf(places, levels) {
  const found = [];
  levels.forEach((level, k) => {
    const from = k > 0 ? places[k - 1] : places[k];
    const last = found[found.length - 1];
    if (!level) return;
    if (last && last[2] === level && last[1] === from) last[1] = places[k];
    else found.push([from, places[k], level]);
  });
  return found;
}

function padded(low, high) {
  if (low === null || high === null) return [0, 1];
  const room = Math.max((high - low) * 0.1, Math.abs(high) * 0.002, 0.05);
  return [low >= 0 ? Math.max(0, low - room) : low - room, high + room];
}
