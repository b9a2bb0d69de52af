// Log channels over depth, first pass: a track for each channel, the gamma with its sigma, and the image of its sectors.

import { EDGE, depthPlot, lines, range } from "./depth_axis.js";
import { byId, el, scale, svg } from "./dom.js";
import * as units from "./units.js";
import { say, t } from "./words.js";

// Kind of the numbers by the unit of a channel; another unit is shown as it comes.
const KIND = { rad: "angle", degC: "temperature", "m/s^2": "vibration", "rad/s": "rotation", V: "voltage", A: "current", C: "charge" };
const TITLE = { gamma: t("Gamma"), inclination: t("Inclination"), temperature: t("Temperature"), lateral_vibration: t("Vibration"), battery_voltage: t("Battery"), consumed_charge: t("Charge used") };
const ORDER = Object.keys(TITLE);
const GAP = 14; // px between tracks
const MOST_SHOWN = 300; // m of hole at most
const [SATURATED, ONE_SIDED] = [4, 16]; // qualities, as in mwd_msgs/LogSample
const LEAST_ROW = 2; // px of one row of the image

const kindOf = ({ name, unit }) => (name === "inclination" ? name : KIND[unit]);
const title = (name) => units.titled(name, TITLE[name]) || say(name.replaceAll("_", " "));
const plain = (channel, v) => (kindOf(channel) ? units.plain(kindOf(channel), v) : v);
const symbol = (channel) => (kindOf(channel) ? units.unit(kindOf(channel)) : channel.unit.replace("gAPI", "API"));

export function showLogs(sections) {
  const place = byId("tab-logs");
  const rank = (c) => (ORDER.includes(c.name) ? ORDER.indexOf(c.name) : ORDER.length);
  const channels = [...(sections.logs?.channels || [])].sort((a, b) => rank(a) - rank(b));
  if (place.hidden) return;
  if (!channels.length) {
    place.replaceChildren(el("p", { class: "empty" }, t("No logs yet: they grow with the samples of the tool while the rig sends its depth.")));
    return;
  }
  const box = el("div", { class: "depth-box" });
  place.replaceChildren(el("p", { class: "quiet-text", id: "log-gaps" }, gapText(channels)), box);
  const size = { width: Math.max(330, box.clientWidth / scale()), height: Math.max(240, box.clientHeight / scale() - 6) };
  box.append(tracks(channels, size));
}

function gapText(channels) {
  const found = channels.filter((c) => c.gaps.length);
  if (!found.length) return t("First pass, without gaps");
  const one = (gap) => t`${units.number("depth", gap[0])} to ${units.number("depth", gap[1])}`;
  const gaps = found.map((c) => `${title(c.name)} ${c.gaps.map(one).join(", ")}` + (c.gap_count > c.gaps.length ? t` and ${c.gap_count - c.gaps.length} more` : ""));
  return t`First pass; no data: ${gaps.join(t("; "))} ${units.unit("depth")}`;
}

function tracks(channels, { width, height }) {
  const depths = channels.flatMap((c) => [c.rows[0][0], c.rows[c.rows.length - 1][0]]);
  const bottom = Math.max(...depths);
  const top = Math.max(Math.min(...depths), bottom - MOST_SHOWN);
  const { plot, y } = depthPlot({ width, height, top, bottom, label: t`Logs to ${units.number("depth", bottom)} ${units.unit("depth")}` });
  const wanted = channels.flatMap((c) => [[curve, c], ...(c.sectors.some((row) => row.some((v) => v !== null)) ? [[image, c]] : [])]);
  const shown = wanted.slice(0, Math.max(1, Math.floor((width - EDGE.left) / 100)));
  const wide = (width - EDGE.left) / shown.length - GAP;
  shown.forEach(([draw, channel], k) => draw(plot, channel, { left: EDGE.left + GAP + k * (wide + GAP), wide: wide - GAP, height, y, top }));
  return plot;
}

function frame(plot, text, { left, wide, height }) {
  plot.append(
    svg("rect", { class: "grid", x: left, y: EDGE.top, width: wide, height: height - EDGE.top - EDGE.bottom }),
    svg("text", { class: "axis", x: left + wide / 2, y: 14, "text-anchor": "middle" }, text),
  );
}

// Why a value is not the mean around the hole; empty if it is.
function doubtOf(row) {
  const quality = row[4] || 0;
  return [quality & SATURATED ? t("Detector saturated: a lower bound") : "", quality & ONE_SIDED ? t("Measured on one side of the hole") : ""].filter(Boolean).join(t("; "));
}

function curve(plot, channel, room) {
  const rows = channel.rows.filter((row) => row[0] >= room.top);
  const known = rows.filter((row) => row[1] !== null);
  const sigma = (row) => (row[2] === null ? 0 : row[2]);
  const [low, high] = range(known.flatMap((row) => [plain(channel, row[1] - sigma(row)), plain(channel, row[1] + sigma(row))]), 0.01);
  const x = (v) => room.left + ((plain(channel, v) - low) / (high - low)) * room.wide;
  frame(plot, `${title(channel.name)}${symbol(channel) ? `, ${symbol(channel)}` : ""}`, room);
  const digits = high - low < 10 ? 1 : 0;
  plot.append(
    svg("text", { class: "tick", x: room.left, y: EDGE.top - 8 }, units.decimal(low.toFixed(digits))),
    svg("text", { class: "tick", x: room.left + room.wide, y: EDGE.top - 8, "text-anchor": "end" }, units.decimal(high.toFixed(digits))),
  );
  for (const row of known) {
    if (sigma(row)) plot.append(svg("line", { class: "log-sigma", x1: x(row[1] - row[2]), x2: x(row[1] + row[2]), y1: room.y(row[0]), y2: room.y(row[0]) }));
  }
  // A value without neighbours is drawn as a point: a word of a link gives the value of one depth step only.
  const apart = 12 * channel.step;
  const points = known.flatMap((row, k) => [...(k && row[0] - known[k - 1][0] > apart ? [null] : []), [x(row[1]), room.y(row[0])]]);
  for (const part of lines(points)) plot.append(svg("polyline", { class: "track", points: part.join(" ") }));
  for (const row of known) {
    const doubt = doubtOf(row);
    const point = svg("circle", { class: doubt ? "log-doubt" : "log-point", cx: x(row[1]), cy: room.y(row[0]), r: doubt ? 3 : 1.5 });
    if (doubt) point.append(svg("title", {}, doubt));
    plot.append(point);
  }
}

// Image of the sectors, side by side: up, right, down, left. Darker means more gamma; faded means that an earlier value is repeated.
function image(plot, channel, room) {
  const count = channel.sectors[0].length;
  const values = channel.sectors.flat().filter((v) => v !== null);
  const [low, high] = [Math.min(...values), Math.max(...values)];
  frame(plot, `${title(channel.name)}, ${low.toFixed(0)}–${high.toFixed(0)}`, room);
  const cell = room.wide / count;
  [t("U"), t("R"), t("D"), t("L")].forEach((letter, k) => plot.append(
    svg("text", { class: "tick", x: room.left + (k * count / 4 + 0.5) * cell, y: EDGE.top - 8, "text-anchor": "middle" }, letter),
  ));
  const thick = Math.max(LEAST_ROW, room.y(room.top + channel.step) - room.y(room.top));
  const paint = (row, k, value, held) => {
    const depth = channel.rows[row][0];
    if (depth < room.top) return;
    const part = (value - low) / Math.max(high - low, 1e-9);
    plot.append(svg("rect", { class: held ? "log-held" : "", x: room.left + k * cell, y: room.y(depth) - thick / 2, width: cell + 0.5, height: thick + 0.5, fill: `hsl(${(48 - 24 * part).toFixed(0)} 75% ${(82 - 62 * part).toFixed(0)}%)` }));
  };
  for (let k = 0; k < count; k += 1) {
    const known = channel.rows.flatMap((_, row) => (channel.sectors[row][k] === null ? [] : [row]));
    known.forEach((row, n) => {
      // Over a link, a sector arrives less often than once per depth step: repeat its value, faded, until the next value of this
      // sector. If the next value is too far away, draw nothing in between.
      const next = known[n + 1];
      const end = next - row <= channel.held[k] ? next : row + 1;
      for (let at = row; at < end; at += 1) paint(at, k, channel.sectors[row][k], at > row);
    });
  }
}
