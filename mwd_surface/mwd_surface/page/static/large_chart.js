// The large chart: chosen signals above each other over the same time, up to a day, with a cursor and zoom.

import { axesOf, colour, drawShades, inUnits, padded, shadesOf, sizeTo, spanOf, traceOf } from "./charts.js";
import { el, mark, scale, setText } from "./dom.js";
import { SIGNALS } from "./signals.js";
import * as units from "./units.js";
import { t } from "./words.js";

const RANGES = [[600, t("10 min")], [3600, t("1 h")], [6 * 3600, t("6 h")], [86400, t("24 h")]];
const LEAST = 20; // s, the shortest time that zoom shows
const FIRST = ["inclination", "azimuth", "vibration", "rotary_speed"];
const FIRST_OVER_LINK = ["pressure", "flow", "inclination", "azimuth"];

export class LargeChart {
  // chosen: names of the signals, or null for the default ones; onChoice is called with the signals a person chooses.
  constructor(place, chosen, onChoice) {
    this.chosen = chosen;
    this.onChoice = onChoice;
    this.range = RANGES[0][0];
    this.window = null; // [from, to] in s before now (negative), null: the whole range
    this.at = null; // time of the cursor, s before now
    this.panes = [];
    this.ranges = RANGES.map(([seconds, text]) => el("button", { type: "button", class: "choice", onclick: () => this.setRange(seconds) }, text));
    this.whole = el("button", { type: "button", class: "choice", onclick: () => this.setRange(this.range) }, t("Whole range"));
    this.moment = el("span", { class: "chart-moment", role: "status" });
    this.choices = el("div", { class: "signal-choices", role: "group", "aria-label": t("Signals of the chart") });
    this.stack = el("div", { class: "chart-stack", tabindex: "0", role: "group", "aria-label": t("Chart: arrow keys move the cursor, plus and minus zoom") });
    this.box = el("div", { class: "large-chart" },
      el("div", { class: "chart-ranges" }, this.ranges, this.whole, this.moment), this.choices, this.stack);
    place.append(this.box);
    this.listen();
    new ResizeObserver(() => this.panes.forEach(({ plot, box }) => sizeTo(plot, box))).observe(this.stack);
  }

  names() {
    return this.chosen || (this.overLink ? FIRST_OVER_LINK : FIRST);
  }

  choose(name) {
    const names = this.names();
    const next = names.includes(name) ? names.filter((other) => other !== name) : [...names, name];
    if (!next.length) return;
    this.chosen = Object.keys(SIGNALS).filter((other) => next.includes(other));
    this.onChoice(this.chosen);
    this.rebuild();
    this.draw();
  }

  setRange(seconds) {
    [this.range, this.window] = [seconds, null];
    this.draw();
  }

  view() {
    return this.window || [-this.range, 0];
  }

  // Zoom the time axis by `factor` around the point at `share` of the width (0 to 1), then move it by `by` s.
  zoom(factor, share = 1, by = 0) {
    const [from, to] = this.view();
    const longest = RANGES[RANGES.length - 1][0];
    const span = Math.min(longest, Math.max(LEAST, (to - from) * factor));
    let right = Math.min(0, from + share * (to - from) + (1 - share) * span + by);
    right = Math.max(right, span - longest);
    this.window = [right - span, right];
    this.draw();
  }

  listen() {
    const share = (event) => {
      const plot = this.panes[0]?.plot;
      if (!plot) return 1;
      const left = plot.over.getBoundingClientRect();
      return Math.max(0, Math.min(1, (event.clientX - left.left) / left.width));
    };
    this.stack.addEventListener("wheel", (event) => {
      event.preventDefault();
      const [from, to] = this.view();
      if (event.shiftKey || Math.abs(event.deltaX) > Math.abs(event.deltaY)) this.zoom(1, 1, ((to - from) * (event.deltaX || event.deltaY)) / 1000);
      else this.zoom(event.deltaY > 0 ? 1.25 : 0.8, share(event));
    }, { passive: false });
    // One finger or the mouse moves the time or, while nothing is pressed, the cursor; two fingers zoom.
    const held = new Map();
    this.stack.addEventListener("pointerdown", (event) => {
      held.set(event.pointerId, event.clientX);
      try { this.stack.setPointerCapture(event.pointerId); } catch { /* a pointer that is gone already */ }
    });
    this.stack.addEventListener("pointermove", (event) => {
      const before = held.get(event.pointerId);
      const [from, to] = this.view();
      if (before !== undefined && held.size === 2) {
        const [other] = [...held].filter(([id]) => id !== event.pointerId).map(([, x]) => x);
        const [was, is] = [Math.abs(before - other), Math.abs(event.clientX - other)];
        if (was > 10 && is > 10) this.zoom(was / is, share(event));
      } else if (before !== undefined && this.panes.length) {
        this.zoom(1, 1, ((before - event.clientX) / this.panes[0].plot.over.clientWidth) * (to - from));
      }
      if (before !== undefined) held.set(event.pointerId, event.clientX);
      this.at = from + share(event) * (to - from);
      this.showCursor();
    });
    for (const name of ["pointerup", "pointercancel"]) this.stack.addEventListener(name, (event) => held.delete(event.pointerId));
    this.stack.addEventListener("pointerleave", () => { if (!held.size) { this.at = null; this.showCursor(); } });
    this.stack.addEventListener("keydown", (event) => {
      const [from, to] = this.view();
      const step = { ArrowLeft: -0.02, ArrowRight: 0.02 }[event.key];
      if (step) {
        event.preventDefault();
        this.at = Math.max(from, Math.min(to, (this.at ?? to) + step * (to - from)));
        this.showCursor();
      }
      if (event.key === "+") this.zoom(0.8, 1);
      if (event.key === "-") this.zoom(1.25, 1);
    });
  }

  rebuild() {
    for (const { plot } of this.panes) plot.destroy();
    this.choices.replaceChildren(...Object.entries(SIGNALS).map(([name, [title, kind]]) =>
      el("button", { type: "button", class: "choice", "aria-pressed": String(this.names().includes(name)), onclick: () => this.choose(name) }, units.titled(kind, title))));
    const splits = (_, __, low, high) => ticksOf(low, high);
    this.panes = this.names().map((name, k, all) => {
      const [own, kind] = SIGNALS[name];
      const title = units.titled(kind, own);
      const value = el("span", { class: "chart-value" });
      const box = el("div", { class: "chart-box" });
      const last = k === all.length - 1;
      const times = { splits, values: (_, ticks) => ticks.map((time) => (last ? agoOf(time) : "")), size: (last ? 24 : 6) * scale() };
      const plot = new window.uPlot(
        {
          width: 600, height: 120, legend: { show: false }, cursor: { show: false },
          scales: { x: { time: false, range: () => this.view() }, y: { range: (_, low, high) => padded(low, high) } },
          series: [{}, { stroke: colour("--trace"), width: 1.5 * scale(), points: { show: false }, spanGaps: false }],
          axes: axesOf(kind, times, 64),
          hooks: { drawClear: [(u) => drawShades(u, this.shades || [])], draw: [(u) => this.drawCursor(u)] },
        },
        [[], []],
        box,
      );
      return { name, title, kind, value, box, plot, figure: el("figure", {}, el("figcaption", {}, el("span", { class: "name" }, `${title}${units.unit(kind) ? `, ${units.unit(kind)}` : ""}`), value), box) };
    });
    this.stack.replaceChildren(...this.panes.map(({ figure }) => figure));
    this.panes.forEach(({ plot, box }) => sizeTo(plot, box));
  }

  show(history, trend, now, overLink) {
    if (!history || !trend) return;
    if (overLink !== this.overLink || !this.panes.length) {
      this.overLink = overLink;
      this.rebuild();
    }
    // The last minutes have one row per second; older rows are in larger steps.
    const fine = history.rows.length ? history.rows[0][0] : Infinity;
    this.columns = history.columns;
    this.rows = [...trend.rows.filter((row) => row[0] < fine), ...history.rows];
    this.now = now;
    this.draw();
  }

  draw() {
    if (!this.rows) return;
    this.ranges.forEach((button, k) => mark(button, "aria-pressed", String(!this.window && RANGES[k][0] === this.range)));
    this.whole.hidden = !this.window;
    const [from, to] = this.view();
    const times = this.rows.map((row) => row[0] - this.now);
    // Include one row beyond each edge, so that the lines reach the edges.
    const first = Math.max(0, times.findIndex((t) => t >= from) - 1);
    const after = times.findIndex((t) => t > to);
    const rows = this.rows.slice(first, after < 0 ? undefined : after + 1);
    const chart = { columns: this.columns };
    this.times = rows.map((row) => row[0] - this.now);
    const doubt = this.columns.indexOf("doubt");
    this.shades = shadesOf(this.times, rows.map((row) => row[doubt]));
    for (const pane of this.panes) {
      pane.raw = traceOf(chart, rows, pane.name);
      pane.plot.setData([this.times, inUnits(pane.raw, pane.kind)]);
    }
    this.showCursor();
  }

  showCursor() {
    let nearest = null;
    if (this.at !== null && this.times?.length) {
      nearest = this.times.reduce((best, t, k) => (Math.abs(t - this.at) < Math.abs(this.times[best] - this.at) ? k : best), 0);
    }
    setText(this.moment, nearest === null ? "" : agoOf(this.times[nearest]));
    for (const { raw, kind, value, plot } of this.panes) {
      const known = (raw || []).filter((v) => v !== null);
      const at = nearest === null ? null : raw[nearest];
      const there = at === null || at === undefined ? t("no value") : `${kind === "bearing" ? units.bearing(at, 2) : units.number(kind, at)}${units.after(kind)}`;
      setText(value, nearest !== null ? there : known.length ? spanOf(known, kind) : t("no data"));
      plot.redraw(false);
    }
  }

  drawCursor(plot) {
    if (this.at === null) return;
    const { ctx, bbox } = plot;
    const x = plot.valToPos(this.at, "x", true);
    if (x < bbox.left || x > bbox.left + bbox.width) return;
    ctx.save();
    ctx.fillStyle = colour("--info");
    ctx.fillRect(x - 1, bbox.top, 2, bbox.height);
    ctx.restore();
  }
}

const STEPS = [5, 10, 30, 60, 120, 300, 600, 1800, 3600, 7200, 14400];

function ticksOf(low, high) {
  const step = STEPS.find((s) => (high - low) / s <= 8) || 14400;
  const found = [];
  for (let t = Math.ceil(low / step) * step; t <= high; t += step) found.push(t);
  return found;
}

// Time before now in words: "now", "−30 s", "−12 min", "−3 h 20 min".
function agoOf(time) {
  const ago = Math.round(-time);
  if (ago <= 0) return t("now");
  if (ago < 120) return t`−${ago} s`;
  if (ago < 7200) return t`−${Math.floor(ago / 60)} min` + (ago % 60 ? t` ${ago % 60} s` : "");
  return t`−${Math.floor(ago / 3600)} h` + (Math.floor(ago / 60) % 60 ? t` ${Math.floor(ago / 60) % 60} min` : "");
}
