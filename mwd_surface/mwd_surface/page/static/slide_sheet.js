// The slide sheet: slid and rotated intervals, newest at the top, and the yield of the slides between surveys.

import { el } from "./dom.js";
import * as units from "./units.js";
import { say, t } from "./words.js";

// Heading and unit of a column; columns marked wide are left out on a phone.
const head = (names) => el("thead", {}, el("tr", {}, names.map(([name, unit, wide]) => el("th", { scope: "col", class: wide ? "at-1" : "" }, name, unit ? el("small", {}, unit) : null))));
const cells = (texts, wide = []) => texts.map((text, k) => el("td", { class: wide.includes(k) ? "at-1" : "" }, text));
const length = (v) => units.number("length", v);

function toolface(s) {
  if (s.toolface === null) return "–";
  const steady = s.steadiness === null ? "" : ` ${Math.round(s.steadiness * 100)} %`;
  return `${units.bearing(s.toolface, 0)}° ${s.magnetic ? t("MTF") : t("GTF")}${steady}`;
}

export function slideSheet(steering) {
  const { rows, yields, left_out: left } = steering;
  if (!rows.length) return [el("p", { class: "empty" }, t("Nothing drilled yet: the sheet grows while the rig sends bit and hole depth."))];
  const unit = units.unit("length");
  const total = (mode) => rows.filter((s) => s.mode === mode).reduce((sum, s) => sum + s.length, 0);
  const [slid, turned] = [total("slide"), total("rotate")];
  const share = slid + turned > 0 ? Math.round((slid / (slid + turned)) * 100) : 0;
  const list = el("table", { class: "sheet" },
    head([[t("From"), unit], [t("To"), unit, true], [t("Length"), unit], [t("Mode")], [t("Toolface, steady")], [t("Rotary"), units.unit("rotation"), true], [t("Begun, UTC"), "", true]]),
    el("tbody", {}, [...rows].reverse().map((s) => el("tr", { class: s.mode }, cells([
      length(s.from_depth), length(s.to_depth), length(s.length), say(s.mode), toolface(s),
      s.mode === "rotate" ? units.number("rotation", s.rotary_speed) : "–", units.clock(s.begin_ns),
    ], [1, 5, 6])))));
  const gave = yields.length
    ? el("table", { class: "sheet" },
      head([[t("From"), unit], [t("To"), unit], [t("Slid"), unit], [t("Rotated"), unit], [t("Dogleg"), "°"], [t("Motor yield"), units.unit("dogleg")]]),
      el("tbody", {}, [...yields].reverse().map((one) => el("tr", {}, cells([
        length(one.from_depth), length(one.to_depth), length(one.slid), length(one.rotated), units.number("angle", one.dogleg),
        one.motor === null ? "–" : units.number("dogleg", one.motor),
      ])))))
    : el("p", { class: "empty" }, t("This sheet covers no interval between two surveys yet."));
  return [
    el("div", { class: "split two" },
      el("div", {}, el("h2", {}, t("Slide sheet")),
        el("p", { class: "quiet-text" }, t`slid ${length(slid)} ${unit}, rotated ${length(turned)} ${unit}, ${share} % slid` + (left ? t`; ${left} earlier lines are in the file` : "")), list),
      el("div", {}, el("h2", {}, t("Yield of the slides")), gave)),
  ];
}
