// The system: streams of the link, recorder, rig values and the diagnostics of the nodes.

import { valueBox } from "./cells.js";
import { byId, el, pill, setText } from "./dom.js";
import { STREAM_NAMES, stateOfStream } from "./streams.js";
import * as units from "./units.js";

const rigBox = el("div", { class: "small-grid" },
  valueBox("rig.hookload", "Hookload", "force"),
  valueBox("rig.weight_on_bit", "WOB", "force"),
  valueBox("rig.torque", "Torque", "torque"),
  valueBox("rig.rotary_speed", "Rotary, rig", "rotation"),
  valueBox("rig.flow_rate", "Flow", "flow"),
  valueBox("rig.pressure", "Standpipe", "pressure"),
  valueBox("rig.block_position", "Block", "length"),
  valueBox("drilling.cross_axial_interference", "Cross-axial interf.", "field"),
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
    el("h2", {}, "Streams"),
    el("table", { class: "log" }, el("thead", {}, el("tr", {}, ["Stream", "State", "Age", "Rate", "Lost"].map((t) => el("th", { scope: "col" }, t)))), streamBody),
    browserBox,
    el("h2", {}, "Inputs"),
    el("table", { class: "log", id: "inputs" }, el("thead", {}, el("tr", {}, ["Input", "Clock", "Offset", "Age", "Bit depth"].map((t) => el("th", { scope: "col" }, t)))), inputBody)),
  el("div", {}, el("h2", {}, "Recorder"), recorderBox, el("h2", {}, "Rig"), rigBox),
  el("div", {}, el("h2", {}, "Diagnostics"), diagnosticsBox)));

export function showStreams(connection, now, silent) {
  const { streams, recorder } = connection.sections;
  if (!streams || byId("tab-system").hidden) return;
  for (const [name, row] of Object.entries(streams)) {
    if (!streamRows[name]) {
      const cells = [1, 2, 3, 4].map(() => el("td", {}));
      streamRows[name] = { cells, word: "" };
      streamBody.append(el("tr", {}, el("th", { scope: "row" }, STREAM_NAMES[name] || name), cells));
    }
    const { cells } = streamRows[name];
    const state = stateOfStream(row, now, silent);
    const absent = connection.sections.well?.over_link && NOT_OVER_LINK.includes(name) ? "not over the link" : "no data";
    const word = { live: "live", stale: "STALE", none: absent }[state];
    if (streamRows[name].word !== word) {
      streamRows[name].word = word;
      cells[0].replaceChildren(pill({ live: "good", stale: "doubtful", none: "idle" }[state], word));
    }
    setText(cells[1], row.at === null ? "–" : units.age(Math.max(0, now - row.at)));
    setText(cells[2], row.rate === null ? "–" : `${row.rate.toFixed(row.rate < 10 ? 1 : 0)}/s`);
    setText(cells[3], row.at === null ? "–" : String(row.lost));
  }
  if (recorder !== undefined) {
    const text = recorder === null ? "no data" : [
      recorder.state, recorder.reason, recorder.path, units.duration(recorder.duration), `${recorder.messages} messages`,
      `${units.bytes(recorder.bytes)} on disk`, `${recorder.dropped} dropped`, recorder.free_bytes === null ? "" : `${units.bytes(recorder.free_bytes)} free`,
    ].filter(Boolean).join(" · ");
    setText(recorderBox, text);
  }
  if (connection.mode === "polling") setText(browserBox, "This page polls: no WebSocket gets through.");
  else setText(browserBox, connection.server.skipped ? `Slow link to this browser: ${connection.server.skipped} states skipped.` : "");
}

export function showInputs({ inputs }) {
  inputBody.replaceChildren(...inputs.map((row) => el("tr", { title: row.reason },
    el("th", { scope: "row" }, row.name),
    el("td", {}, row.clock),
    el("td", {}, row.clock_offset === null ? "–" : `${row.clock_offset < 0 ? "−" : "+"}${Math.abs(row.clock_offset).toFixed(3)} s`),
    el("td", {}, row.data_age === null ? "–" : units.age(row.data_age)),
    el("td", {}, row.bit_depth === null ? "" : `${units.number("depth", row.bit_depth)}${units.after("depth")} `,
      row.role ? pill({ "in force": "good", "stands by": "idle", silent: "stale" }[row.role], row.role) : ""))));
}

export function showDiagnostics({ rows }) {
  diagnosticsBox.replaceChildren(rows.length
    ? el("ul", { class: "findings" }, rows.map((f) => el("li", {},
      pill({ ok: "good", warning: "doubtful", error: "reject", stale: "stale" }[f.level], f.level),
      el("div", {}, el("strong", {}, f.name), ` ${f.message}`, f.remedy && f.level !== "ok" ? el("p", { class: "quiet-text" }, f.remedy) : null))))
    : el("p", { class: "empty" }, "Nothing reported yet."));
}
