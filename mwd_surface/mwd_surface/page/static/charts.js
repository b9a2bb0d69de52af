// Charts over time: small strips of the last minutes, and functions that the large chart also uses.

import { byId, el, scale, setText } from "./dom.js";
import { SIGNALS } from "./signals.js";
import * as units from "./units.js";
import { t } from "./words.js";

// Title, and lines (column, word, colour, dashes). Several lines differ in dashes as well as in colour.
const VIBRATION = [t("Vibration"), [["vibration", t("─ peak"), "--trace", []], ["lateral_vibration", t("╌ lat."), "--text", [6, 4]], ["axial_vibration", t("┈ axial"), "--good", [2, 3]]]];
const one = (name) => [SIGNALS[name][0], [[name, "", "--trace", []]]];
const TOOL = [VIBRATION, ...["rotary_speed", "stick_slip", "shocks", "temperature", "total_field", "axial_interference", "inclination", "azimuth"].map(one)];
// Over a telemetry link the tool sends few of these signals, and rarely, but the rig sends its own continuously.
const LINK = ["pressure", "flow", "top_drive_speed", "top_drive_torque", "weight_on_bit", "rate_of_penetration", "bit_depth", "inclination", "azimuth"].map(one);

export const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

// Axes of a plot with a signal of a kind; `times` writes the labels of the time axis.
export function axesOf(kind, times, room = 50) {
  const axis = { stroke: colour("--muted"), grid: { stroke: colour("--line"), width: 1 }, ticks: { show: false }, font: `${12 * scale()}px ${getComputedStyle(document.body).fontFamily}` };
  const value = (v) => units.decimal(String(Number((kind === "bearing" ? units.turn(v) : v).toFixed(3))));
  return [{ ...axis, size: 24 * scale(), ...times }, { ...axis, size: room * scale(), space: 18 * scale(), values: (_, ticks) => ticks.map(value) }];
}

export class Charts {
  constructor(place) {
    this.grid = el("div", { class: "charts" });
    place.append(this.grid);
    this.charts = [];
    this.overLink = false;
    this.minutes = 10;
    this.sizes = new ResizeObserver(() => this.resize());
    this.rebuild();
    this.sizes.observe(this.grid);
  }

  // Charts must be rebuilt for new colours or units, because these are fixed when a chart is made.
  rebuild() {
    for (const item of this.charts) item.plot.destroy();
    this.grid.replaceChildren();
    this.shades = [];
    const { minutes } = this;
    const times = { values: (_, ticks) => ticks.map((v) => (v === 0 ? t("now") : t`${v} min`)), splits: () => [-minutes, -minutes / 2, 0] };
    this.charts = (this.overLink ? LINK : TOOL).map(([title, lines]) => {
      const kind = SIGNALS[lines[0][0]][1];
      const value = el("span", { class: "chart-value" });
      const box = el("div", { class: "chart-box" });
      const names = lines.filter(([, word]) => word).map(([, word, tone]) => el("span", { class: `line-name ${tone.slice(2)}` }, word));
      this.grid.append(el("figure", {}, el("figcaption", {}, el("span", { class: "name" }, units.titled(kind, title), names), value), box));
      const plot = new window.uPlot(
        {
          width: 280, height: 110, legend: { show: false }, cursor: { show: false },
          scales: { x: { time: false, range: [-minutes, 0] }, y: { range: (_, low, high) => padded(low, high) } },
          series: [{}, ...lines.map(([, , tone, dash]) => ({ stroke: colour(tone), dash, width: 1.5 * scale(), points: { show: false }, spanGaps: false }))],
          axes: axesOf(kind, times),
          hooks: { drawClear: [(u) => drawShades(u, this.shades)] },
        },
        [[], ...lines.map(() => [])],
        box,
      );
      return { lines, kind, plot, box, value };
    });
    this.resize();
  }

  resize() {
    for (const { box, plot } of this.charts) sizeTo(plot, box);
  }

  show(history, now, overLink) {
    if (!history || byId("tab-charts").hidden || this.grid.hidden) return;
    const minutes = history.length / 60;
    if (minutes !== this.minutes || overLink !== this.overLink) {
      [this.minutes, this.overLink] = [minutes, overLink];
      this.rebuild();
    }
    const rows = history.rows.filter((row) => now - row[0] <= history.length + 5);
    const times = rows.map((row) => (row[0] - now) / 60);
    const doubt = history.columns.indexOf("doubt");
    this.shades = shadesOf(times, rows.map((row) => row[doubt]));
    for (const { lines, kind, plot, value } of this.charts) {
      const traces = lines.map(([name]) => traceOf(history, rows, name));
      plot.setData([times, ...traces.map((trace) => inUnits(trace, kind))]);
      const raw = traces.flat().filter((v) => v !== null);
      setText(value, raw.length ? spanOf(raw, kind, lines.length > 1) : t("no data"));
    }
  }
}

// Fit a plot into its box, unless the box is not shown.
export function sizeTo(plot, box) {
  const width = Math.floor(box.clientWidth);
  const height = Math.floor(box.clientHeight);
  if (width > 60 && height > 40 && (plot.width !== width || plot.height !== height)) plot.setSize({ width, height });
}

// Values of a signal in rows; a bearing is unwrapped, so that it does not jump at north.
export function traceOf(chart, rows, name) {
  const k = chart.columns.indexOf(name);
  const trace = rows.map((row) => row[k]);
  return SIGNALS[name][1] === "bearing" ? unwrapped(trace) : trace;
}

export const inUnits = (trace, kind) => trace.map((v) => (v === null ? null : units.plain(kind, v)));

// Draw shading behind the lines where the data was doubtful or bad.
export function drawShades(plot, shades) {
  const { ctx, bbox } = plot;
  ctx.save();
  for (const [from, to, level] of shades) {
    const left = Math.max(bbox.left, plot.valToPos(from, "x", true));
    const right = Math.min(bbox.left + bbox.width, plot.valToPos(to, "x", true));
    ctx.fillStyle = colour(level > 1 ? "--reject-bg" : "--doubtful-bg");
    if (right > left) ctx.fillRect(left, bbox.top, right - left, bbox.height);
  }
  ctx.restore();
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

export function spanOf(raw, kind, most = false) {
  const text = (v) => (kind === "bearing" ? units.bearing(v, 1) : units.number(kind, v));
  const high = `${text(Math.max(...raw))}${units.after(kind)}`;
  return most ? `≤ ${high}` : t`${text(Math.min(...raw))} to ${high}`;
}

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

export function padded(low, high) {
  if (low === null || high === null) return [0, 1];
  const room = Math.max((high - low) * 0.1, Math.abs(high) * 0.002, 0.05);
  return [low >= 0 ? Math.max(0, low - room) : low - room, high + room];
}
