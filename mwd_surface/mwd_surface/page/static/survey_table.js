// The survey table, newest at the top; a row opens to show the reasons of its verdict and to take a person's decision.

import { el, pill } from "./dom.js";
import * as units from "./units.js";
import { say, t } from "./words.js";

const VERDICTS = { accepted: "good", waiting: "info", doubtful: "doubtful", rejected: "reject" };

const REVISED = { accept: "good", doubtful: "doubtful", reject: "reject" };

// Verdict of each quantity: first letter and mark in the row, full word in the title.
const QUANTITIES = ["inclination", "azimuth", "toolface"].map((name) => [say(name)[0].toUpperCase(), name]);
const MARKS = { accept: "✓", doubtful: "?", reject: "✕", "not determined": "–" };

const each = (row) => row.verdicts.every((word) => word === "accept") ? null : el("span",
  { class: "each-verdict", title: QUANTITIES.map(([, name], k) => `${say(name)}: ${say(row.verdicts[k])}`).join(t(", ")) },
  QUANTITIES.map(([letter], k) => `${letter}${MARKS[row.verdicts[k]]}`).join(" "));

// Another value of the survey than the definitive one: azimuth with sigma and verdict.
const otherValue = (value) =>
  `${or(value.azimuth, (v) => `${units.bearing(v, 2)}°`)} ± ${or(value.sigma_azimuth, (v) => `${units.size("angle", v)}°`)}, ${say(value.verdict)}`;

// Whether later surveys of the run have changed this one, or want to.
const revised = (row) => row.revised ? pill(REVISED[row.revised.verdict] || "info", t`revised value: ${say(row.revised.verdict)}`)
  : row.first ? pill("info", t("revised")) : null;

// Note on the assumptions behind depths and positions; null if there are none.
export const assumedNote = (path) => !path?.assumptions.length ? null : el("p", { class: "assumed-note" },
  pill("doubtful", t("coordinates assumed")), ` ${path.assumptions.map(say).join(t("; "))}`);

let remarksOpen = false;

// Other remarks on the lists behind these tables; null if there are none.
export function remarksNote(path, ...tables) {
  const said = new Set(path?.assumptions);
  const texts = [...new Set(tables.flatMap((table) => table?.remarks || []))].filter((text) => !said.has(text));
  return !texts.length ? null : el("details",
    { class: "remarks", open: remarksOpen, ontoggle: (event) => { remarksOpen = event.target.open; } },
    el("summary", { "data-keep": "remarks" }, pill("info", t`remarks: ${texts.length}`)),
    el("ul", {}, texts.map((text) => el("li", {}, say(text)))));
}

export const percent = (odds) => `${units.decimal((100 * odds).toFixed(odds < 0.1 ? 1 : 0))} %`;

// Values of a survey that a person can accept, as in JudgeSurvey.srv.
const DEFINITIVE = 0, REVISED_VALUE = 1, FIRST_VALUE = 2;

const BLANK = { reason: "", depth: "", replace: false };

const hemisphere = (value, plus, minus) =>
  value === null ? "–" : `${units.number("length", Math.abs(value))} ${t(value < 0 ? minus : plus)}`;
const or = (value, show) => (value === null || value === undefined ? "–" : show(value));

// Deviation from the reference, with the colour and mark of its light.
function delta(row, k, kind) {
  const total = row.totals?.[k];
  if (!total || total.deviation === null) return "–";
  const mark = { good: "✓", doubtful: "▲", reject: "✕" }[total.light];
  return el("span", { class: `word ${total.light}` }, `${units.signed(kind, total.deviation)} ${mark}`);
}

// Fields that depend on the path above, which may rest on an assumption.
const PLACES = new Set(["vertical_depth", "north", "east", "vertical_section"]);

const cell = (row, { field, text, width }) => row.assumed && PLACES.has(field)
  ? el("td", { class: `at-${width} assumed`, title: t("rests on an assumption") }, `${text(row)} ?`)
  : el("td", { class: `at-${width}` }, text(row));

// Fields with a special format, not the usual number format of their kind.
const SPECIAL = {
  north: (r) => hemisphere(r.north, "N", "S"),
  east: (r) => hemisphere(r.east, "E", "W"),
  g_total: (r) => or(r.g_total, (v) => units.number("gravity", v, -1)),
};

// Deviation of a total from its reference, next to the column of the total: place in `totals`, heading and unit kind.
const DEVIATIONS = { g_total: [0, "ΔG", "gravity_deviation"], b_total: [1, "ΔB", "field"], dip: [2, t("ΔDip"), "angle"] };

// Columns with heading, unit kind, text of a row, and least width at which they are shown (0 always, 1 tablet, 2 wide).
// The server chooses the columns from its table of signals.
function columns(listed, north) {
  const bearing = (r) => or(r.azimuth, (v) => units.bearing(v, 2)) + (r.azimuth !== null && r.azimuth_north !== north ? ` ${say(r.azimuth_north)}` : "");
  return listed.flatMap(({ field, title, kind, width }) => {
    const plain = (r) => or(r[field], (v) => units.number(kind, v));
    const column = field === "azimuth" ? { field, name: t`${say(title)} ${say(north)}`, kind, text: bearing, width }
      : { field, name: units.titled(kind, say(title)), kind, text: SPECIAL[field] || plain, width };
    if (!DEVIATIONS[field]) return [column];
    const [k, name, unit] = DEVIATIONS[field];
    return [column, { field: name, name, kind: unit, text: (r) => delta(r, k, unit), width: 1 }];
  });
}

export class SurveyTable {
  constructor(place, judge) {
    this.place = place;
    this.judge = judge;
    this.open = null;
    this.draft = { ...BLANK };
    this.body = el("div", { class: "table-box" });
    place.append(this.body);
  }

  show(surveys, path, well, controls) {
    this.last = [surveys, path, well, controls];
    const rows = surveys?.rows || [];
    const remarks = remarksNote(path, surveys) || "";
    if (!rows.length) {
      this.body.replaceChildren(remarks, el("p", { class: "empty" }, t("No surveys yet.")));
      return;
    }
    const wanted = columns(surveys.columns, well?.north_reference || "");
    const head = el("tr", {}, el("th", { scope: "col" }, t("No.")));
    for (const { name, kind, width } of wanted) {
      head.append(el("th", { scope: "col", class: `at-${width}` }, name, el("small", {}, units.unit(kind))));
    }
    head.append(el("th", { scope: "col" }, t("Verdict")), el("th", { scope: "col", class: "at-2 method" }, t("Method")), el("th", { scope: "col", class: "at-1" }, t("By")));
    const body = el("tbody", {});
    const bit = this.projected(path);
    if (bit) body.append(this.bitRow({ ...bit, azimuth_north: well?.north_reference || "" }, wanted));
    for (const row of [...rows].reverse()) {
      body.append(this.row(row, wanted));
      if (row.sequence === this.open) body.append(this.detail(row, wanted.length + 4, controls));
    }
    const table = el("table", { class: "surveys" }, el("caption", { class: "quiet" }, t("Survey list, deepest first")), el("thead", {}, head), body);
    // Keep the keyboard focus when the table is rebuilt while somebody types.
    const focused = document.activeElement?.getAttribute?.("data-keep");
    this.body.replaceChildren(assumedNote(path) || "", remarks, table);
    if (surveys.left_out) this.body.append(el("p", { class: "empty" }, t`${surveys.left_out} older lines are in the export.`));
    if (focused) this.body.querySelector(`[data-keep="${focused}"]`)?.focus();
  }

  projected(path) {
    const k = path ? path.kind.indexOf("projected") : -1;
    if (k < 0) return null;
    const names = ["measured_depth", "inclination", "azimuth", "vertical_depth", "north", "east", "vertical_section", "dogleg_severity"];
    return { ...Object.fromEntries(names.map((name) => [name, path[name][k]])), assumed: path.assumptions.length > 0 };
  }

  bitRow(bit, wanted) {
    const line = el("tr", { class: "projected-row" }, el("th", { scope: "row" }, t("bit")));
    line.append(...wanted.map((column) => cell(bit, column)));
    line.append(el("td", {}, pill("idle", t("projected"))), el("td", { class: "at-2" }, "–"), el("td", { class: "at-1" }, "–"));
    return line;
  }

  row(row, wanted) {
    const open = row.sequence === this.open;
    const toggle = el("button", {
      type: "button", class: "row-button", "aria-expanded": String(open), "data-keep": `row-${row.sequence}`,
      "aria-label": t`Survey ${row.sequence}, ${say(row.verdict)}, details`,
      onclick: () => this.toggle(row.sequence),
    }, `${open ? "▾" : "▸"} ${row.sequence}`);
    const line = el("tr", { class: row.in_use ? "used" : "unused", "data-sequence": row.sequence }, el("th", { scope: "row" }, toggle));
    line.append(...wanted.map((column) => cell(row, column)));
    line.append(
      el("td", {}, pill(VERDICTS[row.verdict] || "info", say(row.verdict)), each(row), revised(row)),
      el("td", { class: "at-2 method" }, say(row.method) || "–"),
      el("td", { class: "at-1 by" }, row.accepted_by === "automatic" ? t("auto") : row.accepted_by),
    );
    return line;
  }

  toggle(sequence) {
    this.open = this.open === sequence ? null : sequence;
    this.draft = { ...BLANK };
    this.answer = "";
    this.show(...this.last);
  }

  detail(row, span, controls) {
    const facts = [
      [t("Time"), units.clock(row.stamp_ns, true)],
      [t("Kind"), say(row.kind)],
      [t("Inclination 1σ"), or(row.sigma_inclination, (v) => `${units.size("angle", v)}°`)],
      [t("Azimuth 1σ"), or(row.sigma_azimuth, (v) => `${units.size("angle", v)}°`)],
      [t("TVD, VS"), `${or(row.vertical_depth, (v) => units.number("length", v))}, ${or(row.vertical_section, (v) => units.number("length", v))} ${units.unit("length")}`],
      [t("DLS / build / turn"), `${or(row.dogleg_severity, (v) => units.number("dogleg", v))} / ${or(row.build_rate, (v) => units.number("dogleg", v))} / ${or(row.turn_rate, (v) => units.number("dogleg", v))} ${units.unit("dogleg")}`],
      [t("N/S, E/W"), `${hemisphere(row.north, "N", "S")}, ${hemisphere(row.east, "E", "W")}`],
      [t("Gtot / Btot / dip"), `${or(row.g_total, (v) => units.number("gravity", v))} ${units.unit("gravity")} / ${or(row.b_total, (v) => units.number("field", v))} nT / ${or(row.dip, (v) => units.number("angle", v))}°`],
      [t("Azimuth by"), say(row.method) || "–"],
      [t("Automatic verdict"), say(row.automatic)],
      ...(row.first ? [[t("Azimuth as first decided"), otherValue(row.first)]] : []),
      ...(row.revised ? [[t("Azimuth revised, not applied"), otherValue(row.revised)]] : []),
      [t("Inclination, azimuth, toolface"), row.verdicts.map(say).join(t(", "))],
      ...(row.headline ? [[t("What to do"), say(row.headline)]] : []),
      ...(row.alternatives.length ? [[t("Other azimuths that fit"), row.alternatives.map(([azimuth, odds]) => `${units.bearing(azimuth, 1)}° (${percent(odds)})`).join(", ")]] : []),
      ...(row.disturbances.length ? [[t("May be disturbed by"), row.disturbances.map(([words, odds]) => `${say(words)} ${percent(odds)}`).join(", ")]] : []),
      [t("Judged by"), (row.accepted_by === "automatic" ? t("automatic") : row.accepted_by) + (row.judged_reason ? `: ${row.judged_reason}` : "")],
      [t("Leg, tool"), [row.leg, row.tool].filter(Boolean).join(", ") || "–"],
      [t("Comment"), say(row.comment) || "–"],
    ];
    const why = [...row.reasons, ...row.flags];
    const box = el("div", { class: "detail" },
      controls ? this.judging(row) : null,
      el("dl", {}, facts.map(([name, text]) => el("div", {}, el("dt", {}, name), el("dd", {}, text)))),
      why.length ? el("ul", { class: "reasons" }, why.map((text) => el("li", {}, say(text)))) : el("p", {}, t("No remarks.")),
    );
    return el("tr", { class: "detail-row" }, el("td", { colspan: span }, box));
  }

  judging(row) {
    const reason = el("input", { type: "text", maxlength: 300, "data-keep": "reason", "aria-label": t("Reason") });
    reason.value = this.draft.reason;
    reason.addEventListener("input", () => { this.draft.reason = reason.value; });
    const depth = el("input", { type: "text", inputmode: "decimal", maxlength: 12, "data-keep": "depth", "aria-label": t`Measured depth, ${units.unit("length")}`, placeholder: row.measured_depth === null ? t("none") : units.number("length", row.measured_depth) });
    depth.value = this.draft.depth;
    depth.addEventListener("input", () => { this.draft.depth = depth.value; });
    const replace = el("input", { type: "checkbox", "data-keep": "replace" });
    replace.checked = this.draft.replace;
    replace.addEventListener("change", () => { this.draft.replace = replace.checked; });
    const answer = el("output", { class: "answer" }, this.answer || "");
    const send = async (name, value = DEFINITIVE) => {
      const given = { sequence: row.sequence, reason: reason.value };
      if (name === "accept_survey") {
        if (value !== DEFINITIVE) given.value = value;
        if (replace.checked) given.replace = true;
        if (depth.value.trim()) {
          const metres = units.metres(depth.value);
          if (metres === null) {
            answer.textContent = t`depth "${depth.value}" is not a number (${units.unit("length")})`;
            return;
          }
          given.measured_depth = metres;
        }
      }
      answer.textContent = "…";
      const { message } = await this.judge(name, given);
      this.answer = say(message);
      answer.textContent = this.answer;
      // This decision's own update may already have rebuilt the table.
      const current = this.body.querySelector("output.answer");
      if (current) current.textContent = this.answer;
    };
    return el("div", { class: "judging" },
      el("label", {}, t("Reason "), reason),
      el("label", { class: "short" }, t`MD, ${units.unit("length")} `, depth),
      el("label", { class: "check" }, replace, t(" replace the one there")),
      el("button", { type: "button", "data-keep": "accept", onclick: () => send("accept_survey") }, t("✓ Accept")),
      row.revised ? el("button", { type: "button", "data-keep": "accept-revised", onclick: () => send("accept_survey", REVISED_VALUE) }, t("✓ Accept the revised value")) : null,
      row.first ? el("button", { type: "button", "data-keep": "accept-first", onclick: () => send("accept_survey", FIRST_VALUE) }, t("✓ Accept the first value")) : null,
      el("button", { type: "button", "data-keep": "reject", onclick: () => send("reject_survey") }, t("✕ Reject")),
      answer,
    );
  }
}
