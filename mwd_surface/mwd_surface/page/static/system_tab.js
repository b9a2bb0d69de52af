// The system: streams of the link, recorder, rig values and the diagnostics of the nodes.

import { valueBox } from "./cells.js";
import { byId, el, pill, setText } from "./dom.js";
import { STREAM_NAMES, stateOfStream } from "./streams.js";
import * as units from "./units.js";
import { say, t } from "./words.js";

const rigBox = el("div", { class: "small-grid" },
  valueBox("rig.hookload", t("Hookload"), "force"),
  valueBox("rig.weight_on_bit", t("WOB"), "force"),
  valueBox("rig.torque", t("Torque"), "torque"),
  valueBox("rig.rotary_speed", t("Rotary, rig"), "rotation"),
  valueBox("rig.flow_rate", t("Flow"), "flow"),
  valueBox("rig.pressure", t("Standpipe"), "pressure"),
  valueBox("rig.block_position", t("Block"), "length"),
  valueBox("drilling.cross_axial_interference", t("Cross-axial interf."), "field"),
);
// Values that a telemetry link does not carry.
const NOT_OVER_LINK = ["sonde", "magnetometer", "temperature", "interference", "dynamics"];
const streamRows = {};
const streamBody = el("tbody", {});
const recorderBox = el("div", {});
const inputBody = el("tbody", {});
const browserBox = el("div", {});
const diagnosticsBox = el("div", {});
byId("tab-system").append(el("div", { class: "split" },
  el("div", {},
    el("h2", {}, t("Streams")),
    el("table", { class: "log" }, el("thead", {}, el("tr", {}, [t("Stream"), t("State"), t("Age"), t("Rate")].map((t) => el("th", { scope: "col" }, t)))), streamBody),
    browserBox,
    el("h2", {}, t("Inputs")),
    el("table", { class: "log", id: "inputs" }, el("thead", {}, el("tr", {}, [t("Input"), t("Clock"), t("Offset"), t("Age"), t("Bit depth")].map((t) => el("th", { scope: "col" }, t)))), inputBody)),
  el("div", {}, el("h2", {}, t("Recorder")), recorderBox, el("h2", {}, t("Rig")), rigBox),
  el("div", {}, el("h2", {}, t("Diagnostics")), diagnosticsBox)));

export function showStreams(connection, now, silent) {
  const { streams, recorder } = connection.sections;
  if (!streams || byId("tab-system").hidden) return;
  for (const [name, row] of Object.entries(streams)) {
    if (!streamRows[name]) {
      const cells = [1, 2, 3].map(() => el("td", {}));
      streamRows[name] = { cells, word: "" };
      streamBody.append(el("tr", {}, el("th", { scope: "row" }, STREAM_NAMES[name] || name), cells));
    }
    const { cells } = streamRows[name];
    const state = stateOfStream(row, now, silent);
    const absent = connection.sections.well?.over_link && NOT_OVER_LINK.includes(name) ? t("not over the link") : t("no data");
    const word = { live: t("live"), stale: t("STALE"), none: absent }[state];
    if (streamRows[name].word !== word) {
      streamRows[name].word = word;
      cells[0].replaceChildren(pill({ live: "good", stale: "doubtful", none: "idle" }[state], word));
    }
    setText(cells[1], row.at === null ? "–" : units.age(Math.max(0, now - row.at)));
    setText(cells[2], row.rate === null ? "–" : `${units.decimal(row.rate.toFixed(row.rate < 10 ? 1 : 0))}/s`);
  }
  if (recorder !== undefined) {
    const text = recorder === null ? t("no data") : [
      say(recorder.state), say(recorder.reason), recorder.path, units.duration(recorder.duration), t`${recorder.messages} messages`,
      t`${units.bytes(recorder.bytes)} on disk`, t`${recorder.dropped} dropped`, recorder.free_bytes === null ? "" : t`${units.bytes(recorder.free_bytes)} free`,
    ].filter(Boolean).join(" · ");
    setText(recorderBox, text);
  }
  if (connection.mode === "polling") setText(browserBox, t("This page polls: no WebSocket gets through."));
  else setText(browserBox, connection.server.skipped ? t`Slow link to this browser: ${connection.server.skipped} states skipped.` : "");
}

export function showInputs({ inputs }) {
  inputBody.replaceChildren(...inputs.map((row) => el("tr", { title: say(row.reason) },
    el("th", { scope: "row" }, say(row.name)),
    el("td", {}, say(row.clock)),
    el("td", {}, row.clock_offset === null ? "–" : `${row.clock_offset < 0 ? "−" : "+"}${units.decimal(Math.abs(row.clock_offset).toFixed(3))} s`),
    el("td", {}, row.data_age === null ? "–" : units.age(row.data_age)),
    el("td", {}, row.bit_depth === null ? "" : `${units.number("depth", row.bit_depth)}${units.after("depth")} `,
      row.role ? pill({ "in force": "good", "stands by": "idle", silent: "stale" }[row.role], say(row.role)) : ""))));
}

export function showDiagnostics({ rows }) {
  diagnosticsBox.replaceChildren(rows.length
    ? el("ul", { class: "findings" }, rows.map((f) => el("li", {},
      pill({ ok: "good", warning: "doubtful", error: "reject", stale: "stale" }[f.level], say(f.level)),
      el("div", {}, el("strong", {}, say(f.name)), ` ${say(f.message)}`, f.remedy && f.level !== "ok" ? el("p", { class: "quiet-text" }, say(f.remedy)) : null))))
    : el("p", { class: "empty" }, t("Nothing reported yet.")));
}
