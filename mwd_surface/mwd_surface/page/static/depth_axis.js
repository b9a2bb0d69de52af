// A plot with depth downwards, shared by the depth tracks and the logs.

import { svg } from "./dom.js";
import * as units from "./units.js";
import { t } from "./words.js";

// Space around the tracks: left for the depths, top for the titles.
export const EDGE = { left: 66, top: 44, bottom: 8 };

// The step of 1, 2 or 5 times a power of ten that gives about the wanted number of steps.
export function niceStep(span, wanted) {
  const raw = Math.max(span, 1e-6) / wanted;
  const power = 10 ** Math.floor(Math.log10(raw));
  return [1, 2, 5, 10].map((m) => m * power).find((step) => step >= raw);
}

// Least and greatest value of a track, with some room; `share`: least room as a share of the greatest value.
export function range(values, share) {
  if (!values.length) return [0, 1];
  const [low, high] = [Math.min(...values), Math.max(...values)];
  const room = Math.max((high - low) * 0.05, Math.abs(high) * share, 0.05);
  return [low >= 0 ? Math.max(0, low - room) : low - room, high + room];
}

// Points of polylines, which break where a point is null.
export function lines(points) {
  const parts = [[]];
  for (const point of points) {
    if (point === null) parts.push([]);
    else parts[parts.length - 1].push(`${point[0].toFixed(1)},${point[1].toFixed(1)}`);
  }
  return parts.filter((part) => part.length);
}

// The empty plot from a depth `top` to a depth `bottom`, m, with its grid, and the place of a depth in it.
export function depthPlot({ width, height, top, bottom, label }) {
  const plot = svg("svg", { viewBox: `0 0 ${width} ${height}`, width: `${width / 16}rem`, height: `${height / 16}rem`, role: "img", class: "plot", "aria-label": label });
  const y = (depth) => EDGE.top + ((depth - top) / Math.max(bottom - top, 1)) * (height - EDGE.top - EDGE.bottom);
  const [shallow, deep] = [units.plain("depth", top), units.plain("depth", bottom)];
  const step = niceStep(deep - shallow, Math.max(2, height / 60));
  for (let v = Math.ceil(shallow / step) * step; v <= deep; v += step) {
    const at = y(top + ((v - shallow) / Math.max(deep - shallow, 1e-9)) * (bottom - top));
    plot.append(
      svg("line", { class: "grid", x1: EDGE.left, x2: width, y1: at, y2: at }),
      svg("text", { class: "tick", x: EDGE.left - 6, y: at + 4, "text-anchor": "end" }, v.toFixed(0)),
    );
  }
  plot.append(svg("text", { class: "axis", x: EDGE.left - 6, y: 14, "text-anchor": "end" }, t`MD, ${units.unit("depth")}`));
  return { plot, y };
}
