// Plan view, vertical section and a rotatable 3D view of well path and plan, drawn to scale.

import { niceStep } from "./depth_axis.js";
import { el, svg } from "./dom.js";
import * as units from "./units.js";
import { say, t } from "./words.js";

const EDGE = { left: 62, right: 10, top: 8, bottom: 38 };

const scaled = (values) => values.map((v) => (v === null ? null : units.plain("depth", v)));

const points = (xs, ys, x, y) =>
  xs.map((v, k) => (v === null || ys[k] === null ? null : `${x(v).toFixed(1)},${y(ys[k]).toFixed(1)}`))
    .filter((text) => text !== null)
    .join(" ");

// Use the same scale across and up, whatever the shape of the window.
function frame(plot, across, up, downwards) {
  const { width, height } = sizeOf(plot);
  const xs = across.filter((v) => v !== null);
  const ys = up.filter((v) => v !== null);
  let [x0, x1] = [Math.min(0, ...xs), Math.max(0, ...xs)];
  let [y0, y1] = [Math.min(0, ...ys), Math.max(0, ...ys)];
  const inner = [width - EDGE.left - EDGE.right, height - EDGE.top - EDGE.bottom];
  const perPixel = Math.max((x1 - x0) / inner[0], (y1 - y0) / inner[1], 0.02) * 1.08;
  // Put spare width on the right; share spare height between top and bottom.
  x0 -= Math.min((x1 - x0) * 0.06, perPixel * 14);
  x1 = x0 + perPixel * inner[0];
  const midY = (y0 + y1) / 2;
  [y0, y1] = [midY - (perPixel * inner[1]) / 2, midY + (perPixel * inner[1]) / 2];
  const x = (v) => EDGE.left + (v - x0) / perPixel;
  const y = (v) => (downwards ? EDGE.top + (v - y0) / perPixel : height - EDGE.bottom - (v - y0) / perPixel);
  const step = niceStep(Math.min(x1 - x0, y1 - y0), 4);
  for (let v = Math.ceil(x0 / step) * step; v <= x1; v += step) {
    plot.append(
      svg("line", { class: v === 0 ? "zero" : "grid", x1: x(v), x2: x(v), y1: EDGE.top, y2: height - EDGE.bottom }),
      svg("text", { class: "tick", x: x(v), y: height - EDGE.bottom + 17, "text-anchor": "middle" }, v.toFixed(0)),
    );
  }
  for (let v = Math.ceil(y0 / step) * step; v <= y1; v += step) {
    plot.append(
      svg("line", { class: v === 0 ? "zero" : "grid", y1: y(v), y2: y(v), x1: EDGE.left, x2: width - EDGE.right }),
      svg("text", { class: "tick", x: EDGE.left - 7, y: y(v) + 4, "text-anchor": "end" }, v.toFixed(0)),
    );
  }
  return { x, y, perPixel };
}

function label(plot, across, up) {
  const { width, height } = sizeOf(plot);
  plot.append(
    svg("text", { class: "axis", x: (EDGE.left + width) / 2, y: height - 6, "text-anchor": "middle" }, across),
    svg("text", {
      class: "axis", x: 0, y: 0, "text-anchor": "middle",
      transform: `translate(15 ${(height - EDGE.bottom) / 2}) rotate(-90)`,
    }, up),
  );
}

function wells(plot, planX, planY, wellX, wellY, kinds, x, y) {
  if (planX.length) plot.append(svg("polyline", { class: "planned", points: points(planX, planY, x, y) }));
  const last = kinds.lastIndexOf("survey") >= 0 ? kinds.lastIndexOf("survey") : kinds.length - 1;
  const line = (kind, from, to) => plot.append(svg("polyline", { class: kind, points: points(wellX.slice(from, to), wellY.slice(from, to), x, y) }));
  // The start of the hole was not given, so draw the path above the first survey as a guess.
  const first = kinds[0] === "assumed" ? 1 : 0;
  if (first) line("assumed", 0, 2);
  line("drilled", first, last + 1);
  kinds.forEach((kind, k) => {
    if (wellX[k] === null || wellY[k] === null) return;
    const [px, py] = [x(wellX[k]), y(wellY[k])];
    if (kind === "survey") plot.append(svg("circle", { class: "station", cx: px, cy: py, r: 3 }));
    if (kind === "assumed") plot.append(svg("rect", { class: "guess", x: px - 4, y: py - 4, width: 8, height: 8 }));
    if (kind === "tie-on") plot.append(svg("rect", { class: "station", x: px - 4, y: py - 4, width: 8, height: 8 }));
    if (kind === "projected") {
      plot.append(
        svg("polyline", { class: "projected", points: points(wellX.slice(last), wellY.slice(last), x, y) }),
        svg("path", { class: "bit", d: `M ${px} ${py - 8} L ${px + 8} ${py} L ${px} ${py + 8} L ${px - 8} ${py} Z` }),
      );
    }
  });
}

// The angle counts from the first axis (north, or along the section) to the second (east, or down).
function ellipses(plot, path, name, wellX, wellY, { x, y, perPixel }, firstIsUp) {
  for (const item of path.ellipses) {
    const [major, minor, angle] = item[name];
    if (wellX[item.station] === null) continue;
    const scale = units.plain("depth", 1) / perPixel;
    const turn = (angle * 180) / Math.PI + (firstIsUp ? -90 : 0);
    plot.append(svg("ellipse", {
      class: "ellipse", rx: major * scale, ry: minor * scale,
      transform: `translate(${x(wellX[item.station])} ${y(wellY[item.station])}) rotate(${turn.toFixed(1)})`,
    }));
  }
}

const canvas = (title, { width, height }) =>
  svg("svg", { viewBox: `0 0 ${width} ${height}`, width: `${width / 16}rem`, height: `${height / 16}rem`, role: "img", "aria-label": title, class: "plot" });

const sizeOf = (plot) => {
  const [, , width, height] = plot.getAttribute("viewBox").split(" ").map(Number);
  return { width, height };
};

function describe(path, offset) {
  const k = path.measured_depth.length - 1;
  if (k < 0) return t("no stations yet");
  const where = t`at ${units.number("depth", path.measured_depth[k])} ${units.unit("depth")}`;
  return offset ? t`${where}, ${units.number("length", offset.distance)} ${units.unit("length")} from the plan` : where;
}

export function planView(path, plan, offset, size) {
  const plot = canvas(t`Plan view: ${describe(path, offset)}`, size);
  const [wellX, wellY] = [scaled(path.east), scaled(path.north)];
  const [planX, planY] = [scaled(plan.east), scaled(plan.north)];
  const place = frame(plot, wellX.concat(planX), wellY.concat(planY), false);
  ellipses(plot, path, "plan", wellX, wellY, place, true);
  wells(plot, planX, planY, wellX, wellY, path.kind, place.x, place.y);
  const north = path.north_reference ? t`North (${say(path.north_reference)})` : t("North");
  label(plot, t`East, ${units.unit("depth")}`, `${north}, ${units.unit("depth")}`);
  return plot;
}

export function sectionView(path, plan, offset, size) {
  const plot = canvas(t`Vertical section: ${describe(path, offset)}`, size);
  const [wellX, wellY] = [scaled(path.vertical_section), scaled(path.vertical_depth)];
  const [planX, planY] = [scaled(plan.vertical_section), scaled(plan.vertical_depth)];
  const place = frame(plot, wellX.concat(planX), wellY.concat(planY), true);
  ellipses(plot, path, "section", wellX, wellY, place, false);
  wells(plot, planX, planY, wellX, wellY, path.kind, place.x, place.y);
  const azimuth = path.section_azimuth === undefined || path.section_azimuth === null ? "" : t` at ${units.bearing(path.section_azimuth, 1)}°`;
  label(plot, t`Vertical section${azimuth}, ${units.unit("depth")}`, t`TVD, ${units.unit("depth")}`);
  return plot;
}

export function spaceView(path, plan, turn, tilt, size) {
  const { width, height } = size;
  const plot = canvas(t("3D view from one side; the arrow keys turn it"), size);
  const [s, c] = [Math.sin(turn), Math.cos(turn)];
  const [st, ct] = [Math.sin(tilt), Math.cos(tilt)];
  const view = (n, e, d) => (n === null ? [null, null] : [e * c - n * s, d * ct - (n * c + e * s) * st]);
  const project = (table) => {
    const [n, e, d] = [scaled(table.north), scaled(table.east), scaled(table.vertical_depth)];
    const both = n.map((_, k) => view(n[k], e[k], d[k]));
    return [both.map((p) => p[0]), both.map((p) => p[1]), n, e, d];
  };
  const [wellX, wellY, wn, we, wd] = project(path);
  const [planX, planY, pn, pe, pd] = project(plan);
  const top = Math.max(1, ...[...wn, ...we, ...pn, ...pe].filter((v) => v !== null).map(Math.abs));
  const deep = Math.max(1, ...[...wd, ...pd].filter((v) => v !== null));
  const box = [];
  for (const [n, e] of [[-top, -top], [-top, top], [top, top], [top, -top], [-top, -top]]) box.push(view(n, e, 0));
  const floor = box.map(([x, y]) => [x, y + deep * ct]);
  const all = [...box, ...floor, ...wellX.map((v, k) => [v, wellY[k]])].filter((p) => p[0] !== null);
  const span = (k) => [Math.min(...all.map((p) => p[k])), Math.max(...all.map((p) => p[k]))];
  const [[x0, x1], [y0, y1]] = [span(0), span(1)];
  const scale = Math.min((width - 40) / (x1 - x0), (height - 40) / (y1 - y0));
  const x = (v) => width / 2 + (v - (x0 + x1) / 2) * scale;
  const y = (v) => height / 2 + (v - (y0 + y1) / 2) * scale;
  const line = (list, kind) => svg("polyline", { class: kind, points: list.map((p) => `${x(p[0]).toFixed(1)},${y(p[1]).toFixed(1)}`).join(" ") });
  plot.append(line(box, "grid"), line(floor, "grid"));
  for (let k = 0; k < 4; k += 1) plot.append(line([box[k], floor[k]], "grid"));
  const [nx, ny] = view(top, 0, 0);
  const [ex, ey] = view(0, top, 0);
  plot.append(line([[0, 0], [nx, ny]], "zero"), line([[0, 0], [ex, ey]], "zero"));
  plot.append(
    svg("text", { class: "axis", x: x(nx), y: y(ny) - 5, "text-anchor": "middle" }, t("N")),
    svg("text", { class: "axis", x: x(ex), y: y(ey) - 5, "text-anchor": "middle" }, t("E")),
  );
  wells(plot, planX, planY, wellX, wellY, path.kind, x, y);
  return plot;
}

export function legend(plan, path) {
  const sample = (kind, mark) => svg("svg", { viewBox: "0 0 34 12", class: "key", "aria-hidden": "true" }, mark(kind));
  const line = (kind) => svg("polyline", { class: kind, points: "2,6 32,6" });
  return el(
    "p", { class: "key-row" },
    el("span", {}, sample("drilled", line), path.assumptions.length ? t(" drilled, place assumed") : t(" drilled")),
    path.kind[0] === "assumed" ? el("span", {}, sample("assumed", line), t(" assumed, not surveyed")) : null,
    plan.north.length ? el("span", {}, sample("planned", line), t` plan ${plan.name}`) : null,
    path.kind.includes("projected") ? el("span", {}, sample("projected", line), t(" projected to bit")) : null,
    path.ellipses.length ? el("span", {}, sample("ellipse", (kind) => svg("ellipse", { class: kind, cx: 17, cy: 6, rx: 13, ry: 5 })), t(" 2σ")) : null,
  );
}
