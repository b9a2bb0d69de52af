// The well path: plan and section side by side, or one 3D view that can be rotated.

import { byId, el, pill, scale } from "./dom.js";
import { legend, planView, sectionView, spaceView } from "./path_plot.js";
import { assumedNote, remarksNote } from "./survey_table.js";
import * as units from "./units.js";
import { say, t } from "./words.js";

const LEVELS = { clear: "good", warning: "doubtful", stop: "reject" };
const CLOSURES = { consistent: "good", doubtful: "doubtful", "not consistent": "reject" };
const view = { on: false, turn: 0.6, tilt: 0.35 };

export function showPath(sections) {
  const { path, plan, offset } = sections;
  const place = byId("tab-path");
  if (!path || !plan || place.hidden) return;
  if (!path.measured_depth.length && !plan.north.length) {
    place.replaceChildren(el("p", { class: "empty" }, t("No path yet: it starts with the first accepted survey.")));
    return;
  }
  const choice = el("button", { type: "button", class: "choice", "aria-pressed": String(view.on), onclick: () => { view.on = !view.on; showPath(sections); place.querySelector(".choice").focus(); } }, t("3-D"));
  const box = el("div", { class: "plots" });
  place.replaceChildren(el("div", { class: "path-head" }, el("div", {}, legend(plan, path), assumedNote(path), remarksNote(path, sections.surveys, sections.clearance)), ...near(sections.clearance), choice), box);
  // Draw at the displayed size, so that letters keep their size.
  const [width, height] = [Math.max(260, box.clientWidth / scale()), Math.max(190, box.clientHeight / scale())];
  if (view.on) box.append(turnable(path, plan, { width, height }));
  else {
    const beside = width >= 560;
    const size = { width: Math.floor(beside ? width / 2 - 6 : width), height: beside ? height : 280 };
    box.append(planView(path, plan, offset, size), sectionView(path, plan, offset, size));
  }
}

// A distance and its sigma with the word for its side.
function way(value, sigma, more, less) {
  const spread = sigma === null ? "" : ` ± ${units.spread("length", sigma)}`;
  return `${units.size("length", Math.abs(value))}${spread} ${value < 0 ? less : more}`;
}

// The main leg has a word of the program for a name; the others have names that people typed.
const legName = (leg) => (leg === "main" ? say(leg) : leg);

// Branches of a mine hole: where each leaves its parent, and how far it reaches.
export function showBranches(branches) {
  const place = byId("branches");
  const rows = branches?.rows || [];
  place.hidden = !rows.length;
  if (!rows.length) return;
  const head = [[t("Branch"), ""], [t("Leaves"), ""], [t("At depth"), "length"], [t("Reaches"), "length"]];
  place.replaceChildren(el("table", { class: "deviation" },
    el("caption", {}, t("Branches")),
    el("thead", {}, el("tr", {}, head.map(([title, kind]) => el("th", { scope: "col" }, title, el("small", {}, kind && units.unit(kind)))))),
    el("tbody", {}, rows.map((row) => el("tr", {},
      el("th", { scope: "row" }, legName(row.name)),
      el("td", {}, legName(row.parent)),
      el("td", {}, units.number("length", row.measured_depth)),
      el("td", {}, units.number("length", row.end)),
    ))),
  ));
}

// Closure of a mine hole on its surveyed point, with the sigma of the path and the verdict.
export function showClosure(closure) {
  const place = byId("closure");
  place.hidden = !closure;
  if (!closure) return;
  const known = closure.distance !== null;
  const rows = known ? [
    [t("Left/right"), way(closure.right, closure.sigma_right, t("right"), t("left"))],
    [t("Up/down"), way(closure.up, closure.sigma_up, t("up"), t("down"))],
    [t("Along"), way(closure.along, closure.sigma_along, t("beyond"), t("short"))],
    [t("Distance"), `${units.size("length", closure.distance)} ${units.unit("length")}`],
  ] : [];
  const depth = closure.measured_depth === null ? "" : `${units.number("length", closure.measured_depth)} ${units.unit("length")}`;
  place.replaceChildren(
    el("table", { class: "deviation" },
      el("caption", {}, t`Closure on the surveyed point, ${legName(closure.leg)} ${depth}`, " ", pill(CLOSURES[closure.verdict] || "idle", say(closure.verdict))),
      el("tbody", {}, rows.map(([title, text]) => el("tr", {}, el("th", { scope: "row" }, title), el("td", {}, text)))),
    ),
    ...(closure.note ? [el("p", { class: "empty" }, say(closure.note))] : []),
  );
}

// Panel of a mine hole: left or right and up or down of the design at every station, at the bit and ahead of it.
export function showDeviation(deviation) {
  const place = byId("deviation");
  const rows = deviation?.rows || [];
  place.hidden = !rows.length;
  if (!rows.length) return;
  // In a hole with branches, show the leg of each survey.
  const several = new Set(rows.map((row) => row.leg)).size > 1;
  const name = (row) => row.station || (row.kind === "planned" ? t("ahead") : row.kind === "projected" ? t("bit") : say(row.kind));
  const head = [[t("Survey"), ""], ...(several ? [[t("Leg"), ""]] : []), [t("Depth"), "length"], [units.titled("inclination", t("Inclination")), "inclination"], [t("Azi"), "bearing"], [t("Left/right"), "length"], [t("Up/down"), "length"]];
  place.replaceChildren(el("table", { class: "deviation" },
    el("caption", {}, t("Deviation from the design, 1σ")),
    el("thead", {}, el("tr", {}, head.map(([title, kind]) => el("th", { scope: "col" }, title, el("small", {}, kind && units.unit(kind)))))),
    el("tbody", {}, rows.map((row) => el("tr", { class: row.kind === "survey" ? "" : "projected-row" },
      el("th", { scope: "row" }, name(row)),
      ...(several ? [el("td", {}, legName(row.leg))] : []),
      el("td", {}, units.number("length", row.measured_depth)),
      el("td", {}, units.number("inclination", row.inclination)),
      el("td", {}, units.bearing(row.azimuth, 2)),
      el("td", {}, way(row.right, row.sigma_right, t("right"), t("left"))),
      el("td", {}, way(row.up, row.sigma_up, t("up"), t("down"))),
    ))),
  ));
}

// Offset wells from the last survey on, sorted by the separation rule, nearest first.
function near(clearance) {
  if (!clearance?.rows.length) return [];
  const length = (v) => `${units.number("length", v)} ${units.unit("length")}`;
  const lines = clearance.rows.map((c) => el("div", {},
    el("dt", {}, c.name),
    el("dd", { title: t`${length(c.distance)} away at ${length(c.measured_depth)}; smallest allowed ${length(c.allowed)}` },
      pill(LEVELS[c.level], `${say(c.level)} ${units.decimal(c.factor.toFixed(2))}`)),
  ));
  return [el("dl", { id: "clearance", class: "near" }, lines)];
}

function turnable(path, plan, size) {
  const box = el("div", { class: "turnable", tabindex: "0", role: "group", "aria-label": t("3D view; turn it with the arrow keys or a finger") });
  const draw = () => box.replaceChildren(spaceView(path, plan, view.turn, view.tilt, size));
  const turn = (across, up) => {
    view.turn += across;
    view.tilt = Math.max(-0.2, Math.min(1.5, view.tilt + up));
    draw();
  };
  box.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] }[event.key];
    if (!step) return;
    event.preventDefault();
    turn(...step);
  });
  box.addEventListener("pointermove", (event) => {
    if (event.buttons) turn(event.movementX * 0.008, event.movementY * 0.008);
  });
  draw();
  return box;
}
