// Single values on the page: number, unit, sigma, age, and a word when the value is no longer valid.

import { el, mark, setText } from "./dom.js";
import * as units from "./units.js";
import { say, t } from "./words.js";

const shown = [];

export function lookup(sections, where) {
  return where.split(".").reduce((table, key) => (table ? table[key] : undefined), sections);
}

// State of a value by the page's clock: ages go on between two messages and after the last one.
export function stateOf(cell, now, silent) {
  if (!cell || cell.value === null || cell.value === undefined) return "none";
  if (silent || cell.state !== "live" || now - cell.at > cell.stale_after) return "stale";
  return "live";
}

// Values of a wired tool and of the rig come once a second or more often; their age need not be shown.
const USUAL = 3; // s

// Age of the measurement; over a telemetry link, the age of the word that brought it.
export const ageOf = (cell, now) => units.age(secondsOf(cell, now));
// Age of the measurement, or an empty text if it is less than USUAL.
export const unusualAge = (cell, now) => (secondsOf(cell, now) < USUAL ? "" : ageOf(cell, now));

const secondsOf = (cell, now) => Math.max(0, now - (cell.measured_at ?? cell.at));

export function valueBox(where, label, kind, options = {}) {
  const parts = {
    name: el("span", {}, label),
    number: el("span", { class: "number" }, t("no data")),
    unit: el("span", { class: "unit" }),
    sigma: el("span", { class: "sigma" }),
    age: el("span", { class: "age" }),
  };
  const box = el(
    "div",
    { class: `value ${options.big ? "big" : ""}`, "data-cell": where, "data-state": "none" },
    el("span", { class: "name" }, parts.name),
    el("span", { class: "reading" }, parts.number, parts.unit),
    el("span", { class: "under" }, parts.sigma, parts.age),
  );
  shown.push({ where, kind, options, parts, box });
  return box;
}

export function refresh(sections, now, silent) {
  for (const { where, kind, options, parts, box } of shown) {
    const cell = lookup(sections, where);
    const state = stateOf(cell, now, silent);
    mark(box, "data-state", state);
    if (options.label) setText(parts.name, options.label(sections));
    const reason = state === "live" ? "" : say(cell?.reason);
    if (state === "none") {
      setText(parts.number, t("no data"));
      setText(parts.unit, "");
      setText(parts.sigma, "");
      setText(parts.age, reason || (where.startsWith("drilling.") && sections.well?.over_link ? t("not sent over the link") : ""));
      continue;
    }
    const text = options.bearing ? units.bearing(cell.value, options.decimals ?? 2) : units.number(kind, cell.value);
    setText(parts.number, text);
    setText(parts.unit, units.unit(kind));
    const sigma = options.big ? " 1σ" : "";
    setText(parts.sigma, cell.sigma === null ? "" : `± ${units.spread(kind, cell.sigma)}${sigma}`);
    setText(parts.age, state === "stale" ? [t`STALE ${ageOf(cell, now)}`, reason].filter(Boolean).join(" · ") : unusualAge(cell, now));
  }
}
