// Tracks over depth, deepest at the bottom: the values measured while the hole was drilled, with slides and surveys.

import { EDGE, depthPlot, lines, range } from "./depth_axis.js";
import { el, scale, svg } from "./dom.js";
import { shadesOf, unwrapped } from "./charts.js";
import * as units from "./units.js";
import { say, t } from "./words.js";

const TRACKS = [
  ["inclination", t("Inclination"), "inclination"],
  ["azimuth", t("Azimuth"), "bearing"],
  ["vibration", t("Vibration"), "vibration"],
  ["rotary_speed", t("Rotary, tool"), "rotation"],
  ["stick_slip", t("Stick-slip"), "index"],
  ["shocks", t("Shocks"), "count"],
];
const LEAST_WIDTH = 84;
const MODE = 26; // px of the column of slides
const GAP = 12; // px between tracks

const short = (v) => units.decimal(v.toFixed(Math.abs(v) < 10 ? 1 : 0));

export function depthTracks(log, steering, surveys, size) {
  const depths = log.rows.map((row) => row[0]);
  const stretches = steering?.rows || [];
  const stations = (surveys?.rows || []).filter((row) => row.in_use && row.measured_depth !== null);
  const all = [...depths, ...stretches.flatMap((s) => [s.from_depth, s.to_depth])];
  if (!all.length) return el("p", { class: "empty" }, t("No depth tracks yet: they begin when the hole is drilled and the rig sends its depth."));
  // Show only the last drilled part of a long hole.
  const [bottom, top] = [Math.max(...all), Math.max(Math.min(...all), Math.max(...all) - 600)];
  const [width, height] = [Math.max(330, size.width / scale()), Math.max(220, size.height / scale())];
  const { plot, y } = depthPlot({ width, height, top, bottom, label: t`Depth tracks to ${units.number("depth", bottom)} ${units.unit("depth")}` });
  modes(plot, stretches, y, top);
  const first = EDGE.left + MODE + GAP;
  // Show fewer tracks on a narrow screen instead of thinner ones.
  const tracks = TRACKS.slice(0, Math.max(1, Math.min(TRACKS.length, Math.floor((width - first) / LEAST_WIDTH))));
  const wide = (width - first) / tracks.length - GAP;
  const shades = shadesOf(depths, log.rows.map((row) => row[log.columns.indexOf("doubt")]));
  tracks.forEach(([column, title, kind], k) => {
    const left = first + k * (wide + GAP);
    const index = log.columns.indexOf(column);
    const raw = log.rows.map((row) => (row[0] < top ? null : row[index]));
    const values = (kind === "bearing" ? unwrapped(raw) : raw).map((v) => (v === null ? null : units.plain(kind, v)));
    const points = column === "inclination" ? stations.filter((s) => s.measured_depth >= top) : [];
    const marks = points.map((s) => units.plain(kind, s.inclination));
    const [low, high] = range([...values.filter((v) => v !== null), ...marks], 0.002);
    const x = (v) => left + ((v - low) / (high - low)) * wide;
    for (const [from, to, level] of shades) {
      if (to > top) plot.append(svg("rect", { class: level > 1 ? "shade-bad" : "shade-doubt", x: left, width: wide, y: y(Math.max(from, top)), height: Math.max(1, y(to) - y(Math.max(from, top))) }));
    }
    plot.append(
      svg("rect", { class: "grid", x: left, y: EDGE.top, width: wide, height: height - EDGE.top - EDGE.bottom }),
      svg("text", { class: "axis", x: left + wide / 2, y: 14, "text-anchor": "middle" }, `${units.titled(kind, title)}${units.unit(kind) ? `, ${units.unit(kind)}` : ""}`),
      svg("text", { class: "tick", x: left, y: EDGE.top - 8 }, short(kind === "bearing" ? units.turn(low) : low)),
      svg("text", { class: "tick", x: left + wide, y: EDGE.top - 8, "text-anchor": "end" }, short(kind === "bearing" ? units.turn(high) : high)),
    );
    for (const part of lines(values.map((v, i) => (v === null ? null : [x(v), y(depths[i])])))) plot.append(svg("polyline", { class: "track", points: part.join(" ") }));
    marks.forEach((v, n) => plot.append(svg("circle", { class: "station", cx: x(v), cy: y(points[n].measured_depth), r: 4 })));
  });
  return plot;
}

// Mark the mode with a letter as well as a colour: S slid, R rotated.
function modes(plot, stretches, y, top) {
  plot.append(svg("text", { class: "axis", x: EDGE.left + MODE / 2, y: 14, "text-anchor": "middle" }, t("S/R")));
  for (const s of stretches) {
    if (s.to_depth <= top) continue;
    const [from, to] = [y(Math.max(s.from_depth, top)), y(s.to_depth)];
    plot.append(svg("rect", { class: `mode-${s.mode}`, x: EDGE.left, y: from, width: MODE, height: Math.max(1, to - from) }));
    if (to - from > 14) plot.append(svg("text", { class: "mode-letter", x: EDGE.left + MODE / 2, y: (from + to) / 2 + 4, "text-anchor": "middle" }, say(s.mode)[0].toUpperCase()));
  }
}
