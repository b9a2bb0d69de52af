// Health of the tool: battery, run time, exposure to temperature and vibration, self-tests, parts and their calibration.

import { byId, el, pill, svg } from "./dom.js";
import * as units from "./units.js";
import { say, t } from "./words.js";

const HOUR = 3600;
const KIND = { degC: "temperature", "m/s^2": "vibration" };
const TITLE = { temperature: t("Temperature"), lateral_vibration: t("Vibration, lateral"), axial_vibration: t("Vibration, axial"), shock_peak: t("Shocks") };
const [WARNING, LIMIT] = [0.8, 1.0]; // shares of the life, as in live/log_monitor.py
const [WIDE, HIGH] = [220, 46]; // of a histogram

const hours = (seconds) => (seconds === null ? "–" : `${units.decimal((seconds / HOUR).toFixed(seconds < 100 * HOUR ? 1 : 0))} h`);
const row = (name, ...cells) => el("tr", {}, el("th", { scope: "row" }, name), cells.map((cell) => el("td", {}, cell)));
const table = (heads, rows, id) => el("table", { class: "log", id }, el("thead", {}, el("tr", {}, heads.map((h) => el("th", { scope: "col" }, h)))), el("tbody", {}, rows));

export function showTool({ tool_health: health }) {
  const place = byId("tab-tool");
  if (place.hidden) return;
  if (!health || (!health.stamp_ns && !health.parts.length)) {
    place.replaceChildren(el("p", { class: "empty" }, t("Nothing is known about the tool yet: its health is computed from its log samples.")));
    return;
  }
  place.replaceChildren(el("div", { class: "split" },
    el("div", {}, el("h2", {}, t("Battery")), battery(health.battery),
      el("h2", {}, t("Run")), table([t("Quantity"), t("Value")], [
        row(t("Run time"), hours(health.run_time)),
        row(t("Pumps on"), hours(health.pumping)),
        row(t("Self-tests"), selfTests(health)),
      ], "tool-run")),
    el("div", {}, el("h2", {}, t("Exposure")), health.exposures.length
      ? health.exposures.map(exposure)
      : el("p", { class: "empty" }, t("No temperature and no vibration yet."))),
    el("div", {}, el("h2", {}, t("Parts")), health.parts.length
      ? table([t("Part"), t("Serial number"), t("Calibrated")], health.parts.map((part) => row(part.name, part.serial_number || "–", [
        part.calibrated || "–", " ", part.overdue_days ? pill("doubtful", t`${part.overdue_days} days too old`) : null])), "tool-parts")
      : el("p", { class: "empty" }, t("The tool file names no parts.")))));
}

function selfTests({ failed_tests: failed, unreported_tests: unreported }) {
  if (failed === null) return t("not reported");
  const names = (tests) => tests.map((name) => say(name)).join(t(", "));
  const found = [];
  if (failed.length) found.push(pill("reject", t`failed: ${names(failed)}`));
  if (unreported.length) found.push(pill("doubtful", t`not reported: ${names(unreported)}`));
  return found.length ? found : pill("good", t("passed"));
}

function battery(b) {
  if (!b) return el("p", { class: "empty" }, t("Neither the tool nor its tool file describes a battery."));
  const with_sigma = (kind, value, sigma) => (value === null ? "–" : `${units.number(kind, value)}${sigma ? ` ± ${units.spread(kind, 2 * sigma)}` : ""} ${units.unit(kind)}`);
  const range = b.remaining === null ? "–" : t`${units.decimal((b.remaining / HOUR).toFixed(0))} ± ${units.decimal(((2 * b.sigma_remaining) / HOUR).toFixed(0))} h`;
  return [
    table([t("Quantity"), t("Value")], [
      row(t("Remaining"), [el("strong", {}, range), " ", b.assumed.length ? pill("doubtful", t("assumed")) : null]),
      row(t("Remaining, pumps on"), hours(b.remaining_active)),
      row(t("Remaining, pumps off"), hours(b.remaining_idle)),
      row(t("Voltage"), with_sigma("voltage", b.voltage, b.sigma_voltage)),
      row(t("Used"), t`${with_sigma("charge", b.used, b.sigma_used)} of ${with_sigma("charge", b.capacity, 0)}`),
      row(t("Mean current"), with_sigma("current", b.current, 0)),
    ], "tool-battery"),
    b.assumed.length ? el("p", { class: "quiet-text" }, t`Assumed: ${b.assumed.map((text) => say(text)).join(t("; "))}`) : null,
  ].filter(Boolean).map((one) => el("div", {}, one));
}

function exposure(one) {
  const kind = KIND[one.unit] || "index";
  const value = (v) => `${units.number(kind, v)} ${units.unit(kind)}`;
  const share = Math.round(100 * one.dose);
  const level = one.dose >= LIMIT ? "reject" : one.dose >= WARNING ? "doubtful" : "good";
  // The axis runs from the smallest level (at most zero) to the largest level (at least the limit).
  const least = Math.min(0, ...one.bins.map(([low]) => low));
  const span = Math.max(one.limit ?? 0, ...one.bins.map(([low]) => low + one.width)) - least || one.width;
  const most = Math.max(...one.bins.map((bin) => bin[1]), 1e-9);
  const x = (level) => ((level - least) / span) * WIDE;
  const y = (seconds) => HIGH * (1 - seconds / most);
  const bar = ([low, seconds]) => svg("rect", {
    class: low + one.width > one.limit ? "bin-beyond" : "bin", x: x(low), width: Math.max(1, x(low + one.width) - x(low) - 1), y: y(seconds), height: HIGH - y(seconds),
  }, svg("title", {}, t`${value(low)} to ${value(low + one.width)}: ${hours(seconds)}`));
  return el("div", { class: "exposure", "data-source": one.source },
    el("p", {}, el("strong", {}, TITLE[one.source] || say(one.source.replaceAll("_", " "))), " ",
      pill(level, t`${share} % of the life used`), " ", one.assumed ? pill("doubtful", t("assumed limits")) : null),
    svg("svg", { class: "plot", width: WIDE, height: HIGH + 16, role: "img", "aria-label": t`Hours by level, to ${value(one.largest)}` },
      one.bins.map(bar),
      svg("line", { class: "grid", x1: 0, x2: WIDE, y1: HIGH, y2: HIGH }),
      svg("text", { class: "tick", x: 0, y: HIGH + 13 }, value(least)),
      svg("text", { class: "tick", x: WIDE, y: HIGH + 13, "text-anchor": "end" }, value(least + span))),
    el("p", { class: "quiet-text" }, t`now ${value(one.newest)}, largest ${value(one.largest)}, observed ${hours(one.observed)}, limit from ${value(one.limit)}`));
}
