// The driller's page: asks the server what is, shows it, and says when that is old.

import { Charts } from "./charts.js";
import { Connection, command } from "./connection.js";
import { depthTracks } from "./depth_tracks.js";
import { Dial } from "./dial.js";
import { byId, el, mark, pill, say } from "./dom.js";
import { refresh, valueBox } from "./cells.js";
import { legend, planView, sectionView, spaceView } from "./path_plot.js";
import { slideSheet } from "./slide_sheet.js";
import { SurveyTable } from "./survey_table.js";
import * as units from "./units.js";

const TABS = [
  ["surveys", "Surveys"], ["path", "Path"], ["charts", "Charts"], ["steering", "Steering"], ["alarms", "Alarms"], ["system", "System"], ["controls", "Operator"],
];
const LIGHTS = { good: "good", doubtful: "doubtful", reject: "reject", "no reference": "idle" };
const VERDICTS = { accept: ["good", "accept"], doubtful: ["doubtful", "doubtful"], reject: ["reject", "reject"] };
const SEVERITIES = { info: "info", warning: "doubtful", critical: "reject" };
const EXPORTS = [["html", "HTML report"], ["pdf", "PDF report"], ["csv", "CSV, definitive"], ["raw_csv", "CSV, every survey"], ["las", "LAS 2.0"], ["witsml", "WITSML 1.4.1.1"]];
const KINDS = { "m/s^2": "gravity_deviation", T: "field", rad: "angle" };
const STREAM_NAMES = {
  sonde: "Sonde", estimator: "Estimator", magnetometer: "Magnetometer", temperature: "Temperature",
  interference: "Interference", dynamics: "Dynamics", rig: "Rig data", recorder: "Recorder",
};

const memory = {
  get: (key) => { try { return localStorage.getItem(key); } catch { return null; } },
  set: (key, value) => { try { localStorage.setItem(key, value); } catch { /* a private window forgets; that is its wish */ } },
};

let tab = "surveys";
let path3d = { on: false, turn: 0.6, tilt: 0.35 };
let byDepth = false;
let sound = null;
let beeped = "";
const operator = { name: sessionStorage.getItem("operator") || "", token: "" };

units.setField(memory.get("units") === "field");
document.documentElement.dataset.theme = memory.get("theme") === "day" ? "day" : "night";

const dial = new Dial(byId("dial"), byId("dial-legend"));
const table = new SurveyTable(byId("tab-surveys"), (name, given) => act(name, { ...given, operator_name: operator.name }));
const overDepth = el("button", { type: "button", class: "choice", "aria-pressed": "false", onclick: () => { byDepth = !byDepth; showCharts(); } }, "Over depth");
const depthBox = el("div", { class: "depth-box", hidden: true });
byId("tab-charts").append(el("div", { class: "chart-head" }, overDepth, el("span", { class: "quiet-text" }, "shaded: doubtful data")));
const charts = new Charts(byId("tab-charts"));
byId("tab-charts").append(depthBox);

byId("head-values").append(
  valueBox("rig.bit_depth", "Bit depth", "depth"),
  valueBox("rig.hole_depth", "Hole depth", "depth"),
  valueBox("rig.rate_of_penetration", "ROP", "penetration"),
);
byId("big").append(
  valueBox("attitude.inclination", "Inclination", "angle", { big: true }),
  valueBox("attitude.azimuth", "Azimuth", "angle", {
    big: true, bearing: true, decimals: 2,
    label: (s) => `Azimuth, ${s.attitude?.north ? `${s.attitude.north} north` : "north unknown"}`,
  }),
);
byId("small").append(
  valueBox("drilling.rotary_speed", "Rotary", "rotation"),
  valueBox("drilling.vibration", "Vibration", "vibration"),
  valueBox("drilling.temperature", "Temp.", "temperature"),
  valueBox("drilling.total_field", "Total field", "field"),
  valueBox("drilling.axial_interference", "Axial int.", "field"),
  valueBox("rig.weight_on_bit", "WOB", "force"),
);
const rigBox = el("div", { class: "small-grid" },
  valueBox("rig.hookload", "Hookload", "force"),
  valueBox("rig.weight_on_bit", "WOB", "force"),
  valueBox("rig.torque", "Torque", "torque"),
  valueBox("rig.rig_rotary_speed", "Rotary, rig", "rotation"),
  valueBox("rig.flow_rate", "Flow", "flow"),
  valueBox("rig.pressure", "Standpipe", "pressure"),
  valueBox("rig.block_position", "Block", "length"),
  valueBox("drilling.cross_axial_interference", "Cross-axial interf.", "field"),
);

const SHOW = {
  well: showWell,
  attitude: showStatus,
  quality: showQuality,
  offset: showOffset,
  survey_progress: showProgress,
  surveys: () => { showSurveys(); showCharts(); },
  steering: () => { showSteering(); showCharts(); },
  depth_log: showCharts,
  path: () => { showSurveys(); showPath(); },
  plan: showPath,
  alarms: showAlarms,
  events: showAlarms,
  findings: showFindings,
  history: () => { if (!byDepth) showCharts(); },
};

const connection = new Connection((names) => {
  const wanted = new Set([...(names || Object.keys(connection.sections))].map((name) => SHOW[name]).filter(Boolean));
  for (const show of wanted) show();
  if (names === null) showControls();
  tick();
});

function tick() {
  const { sections } = connection;
  const now = connection.now();
  const silent = connection.silent();
  showBanner(silent);
  if (now === null) return;
  refresh(sections, now, silent);
  dial.show(sections.toolface, sections.quill, now, silent);
  showPills(now, silent);
  showStreams(now, silent);
  showSince(now);
}

function showBanner(silent) {
  const banner = byId("banner");
  mark(document.body, "data-connected", silent ? "no" : "yes");
  if (!silent) {
    banner.hidden = true;
    return;
  }
  const gone = connection.silence();
  const text = gone === Infinity
    ? "CONNECTING: nothing heard from the surface unit yet"
    : "DISCONNECTED: nothing heard from the surface unit; all values below are old";
  say(banner, text);
  banner.hidden = false;
  if (gone !== Infinity) document.title = "DISCONNECTED · MWD";
}

function showWell() {
  const well = connection.sections.well;
  say(byId("well-name"), well.wellbore || well.name);
  const angle = (v) => (v === null ? "unknown" : `${v < 0 ? "−" : "+"}${units.size("angle", Math.abs(v))}°`);
  const parts = [`${well.depth_datum} datum`, `${well.north_reference} north`];
  if (well.field_declination === null && well.field_convergence === null) parts.push("no reference field");
  else {
    parts.push(`decl ${angle(well.field_declination)}`, `conv ${angle(well.field_convergence)}`);
    if (well.field_declination !== null && well.field_convergence !== null) {
      const total = { grid: well.field_declination - well.field_convergence, true: well.field_declination, magnetic: 0 }[well.north_reference];
      parts.push(`total correction ${angle(total)}`);
    }
  }
  if (well.field_source) parts.push(well.field_source);
  say(byId("datum"), parts.join(" · "));
  document.title = `${well.wellbore || well.name} · MWD`;
}

function showStatus() {
  document.title = `${connection.sections.well?.wellbore || "Well"} · MWD`;
}

function stateWord(row, now, silent) {
  if (!row || row.at === null) return "none";
  return silent || row.state !== "live" || now - row.at > row.stale_after ? "stale" : "live";
}

function pillTo(tabName, kind, text) {
  const button = el("button", { type: "button", class: `pill ${kind}`, onclick: () => select(tabName, true) });
  button.append(...pill(kind, text).childNodes);
  return button;
}

let pillsText = "";

function showPills(now, silent) {
  const { links, recorder, alarms, attitude, rig } = connection.sections;
  const list = [];
  if (links) {
    const down = ["sonde", "estimator", "rig"].filter((name) => stateWord(links[name], now, silent) !== "live");
    const word = (name) => `${STREAM_NAMES[name].toLowerCase()} ${stateWord(links[name], now, silent) === "none" ? "" : units.age(now - links[name].at)}`.trim();
    list.push(silent ? ["system", "reject", "link lost"] : down.length ? ["system", "doubtful", `no ${down.map(word).join(", no ")}`] : ["system", "good", "link"]);
  }
  if (recorder) {
    const fresh = recorder.since !== null && !silent && now - recorder.since <= recorder.stale_after;
    const kind = !fresh ? "stale" : recorder.state === "recording" ? (recorder.dropped ? "doubtful" : "good") : recorder.state === "stopped" ? "idle" : "reject";
    list.push(["system", kind, fresh ? `${recorder.state === "recording" ? "recording" : `recorder ${recorder.state}`}${recorder.dropped ? `, ${recorder.dropped} dropped` : ""}` : "recorder no data"]);
  }
  if (alarms) {
    const active = alarms.rows.filter((a) => a.active || !a.acknowledged);
    const waiting = alarms.rows.filter((a) => !a.acknowledged);
    const worst = Math.max(-1, ...active.map((a) => a.severity));
    list.push(["alarms", active.length ? ["info", "doubtful", "reject"][worst] : "good", active.length ? `${active.length} alarm${active.length > 1 ? "s" : ""}, ${waiting.length} new` : "no alarms"]);
  }
  if (attitude?.status.length) {
    const known = ["still", "rotating", "sliding"].find((word) => attitude.status.includes(word));
    if (known) list.push(["system", "info", `tool ${known}`]);
    const bad = attitude.status.filter((word) => ["sensor_fault", "sensor_suspect", "clipped", "mag_disturbed", "no_mag", "initialising", "aliased", "no_reference", "correction_refused"].includes(word));
    if (bad.length) list.push(["system", "doubtful", bad.map((word) => word.replace("_", " ")).join(", ")]);
  }
  if (rig?.in_slips) list.push(["system", "info", "in slips"]);
  const text = JSON.stringify(list);
  if (text === pillsText) return;
  const held = [...byId("pills").children].indexOf(document.activeElement);
  pillsText = text;
  byId("pills").replaceChildren(...list.map((item) => pillTo(...item)));
  if (held >= 0) byId("pills").children[Math.min(held, list.length - 1)]?.focus();
}

function showProgress() {
  const progress = connection.sections.survey_progress;
  const place = byId("progress");
  if (!progress.active) {
    place.replaceChildren(...(progress.result ? [el("p", { class: "result" }, progress.result)] : []));
    return;
  }
  const total = progress.elapsed + progress.remaining;
  const share = total > 0 ? progress.elapsed / total : 0;
  const words = `TAKING SURVEY · ${Math.ceil(progress.remaining)} s to go`;
  place.replaceChildren(
    el("p", { class: "taking" }, words),
    el("p", { class: "quiet-text" }, progress.state),
    el("progress", { max: 1, value: share.toFixed(3), "aria-label": "Survey in progress" }),
  );
}

function showQuality() {
  const quality = connection.sections.quality;
  const place = byId("lights");
  if (!quality.known) {
    place.replaceChildren(el("p", { class: "empty" }, "No survey yet."));
    byId("reasons").replaceChildren();
    return;
  }
  const [kind, word] = VERDICTS[quality.verdict];
  const rows = quality.lights.map((light) => {
    const unit = KINDS[light.unit];
    const text = light.deviation === null
      ? (light.value === null ? "no data" : "no reference")
      : `${units.signed(unit, light.deviation)} of ± ${units.size(unit, light.limit)}${units.after(unit)}`;
    const share = light.deviation === null ? 0 : Math.max(-1, Math.min(1, light.deviation / (2 * light.limit)));
    const bar = el("span", { class: "bar", "aria-hidden": "true" }, el("span", { class: `fill ${LIGHTS[light.light]}` }));
    const fill = bar.firstChild.style;
    fill.left = `${50 + Math.min(0, share) * 50}%`;
    fill.width = `${Math.abs(share) * 50}%`;
    return el("div", { class: "light", "data-light": light.light },
      pill(LIGHTS[light.light], light.light), el("span", { class: "name" }, light.corrected ? `${light.name}, corrected` : light.name), el("span", { class: "deviation" }, text), bar);
  });
  place.replaceChildren(
    el("p", { class: "verdict" }, `No. ${quality.sequence}, ${units.clock(quality.stamp_ns)}`, pill(kind, word)),
    ...rows,
  );
  byId("reasons").replaceChildren(...quality.reasons.map((text) => el("li", {}, text)));
}

function showOffset() {
  const o = connection.sections.offset;
  const place = byId("offset");
  if (!o.known) {
    place.replaceChildren(el("p", { class: "empty" }, "No plan loaded."));
    return;
  }
  const length = (v) => `${units.number("length", Math.abs(v))} ${units.unit("length")}`;
  const facts = [
    ["Well is", `${length(o.up)} ${o.up < 0 ? "below" : "above"}, ${length(o.right)} ${o.right < 0 ? "left" : "right"}`],
    ["Steer back at", `${units.bearing(o.toolface, 0)}° GTF`],
  ];
  if (o.dogleg_to_target !== null) facts.push(["To hit target", `${units.number("dogleg", o.dogleg_to_target)}${units.after("dogleg")}`]);
  place.replaceChildren(el("dl", { class: "facts" }, facts.map(([name, text]) => el("div", {}, el("dt", {}, name), el("dd", {}, text)))));
}

function showCharts() {
  mark(overDepth, "aria-pressed", String(byDepth));
  charts.grid.hidden = byDepth;
  depthBox.hidden = !byDepth;
  if (byId("tab-charts").hidden) return;
  if (!byDepth) {
    charts.resize();
    charts.show(connection.sections.history, connection.now());
    return;
  }
  const { depth_log: log, steering, surveys } = connection.sections;
  if (log) depthBox.replaceChildren(depthTracks(log, steering, surveys, { width: Math.max(330, depthBox.clientWidth), height: Math.max(220, depthBox.clientHeight) }));
}

function showSteering() {
  const { steering } = connection.sections;
  if (steering) byId("tab-steering").replaceChildren(...slideSheet(steering));
}

function showSurveys() {
  const { surveys, path, well } = connection.sections;
  if (surveys) table.show(surveys, path, well, connection.server.controls && operator.token !== "");
}

function showPath() {
  const { path, plan, offset } = connection.sections;
  const place = byId("tab-path");
  if (!path || !plan || place.hidden) return;
  if (!path.measured_depth.length && !plan.north.length) {
    place.replaceChildren(el("p", { class: "empty" }, "No path yet: it starts with the first accepted survey."));
    return;
  }
  const choice = el("button", { type: "button", class: "choice", "aria-pressed": String(path3d.on), onclick: () => { path3d.on = !path3d.on; showPath(); place.querySelector(".choice").focus(); } }, "3-D");
  const box = el("div", { class: "plots" });
  place.replaceChildren(el("div", { class: "path-head" }, legend(plan, path), choice), box);
  // Drawn at the size it has, so that letters keep theirs.
  const [width, height] = [Math.max(260, box.clientWidth), Math.max(190, box.clientHeight)];
  if (path3d.on) box.append(turnable(path, plan, { width, height }));
  else {
    const beside = width >= 560;
    const size = { width: Math.floor(beside ? width / 2 - 4 : width), height: beside ? height : 280 };
    box.append(planView(path, plan, offset, size), sectionView(path, plan, offset, size));
  }
}

function turnable(path, plan, size) {
  const box = el("div", { class: "turnable", tabindex: "0", role: "group", "aria-label": "View in space; arrow keys or a finger turn it" });
  const draw = () => box.replaceChildren(spaceView(path, plan, path3d.turn, path3d.tilt, size));
  const turn = (across, up) => {
    path3d.turn += across;
    path3d.tilt = Math.max(-0.2, Math.min(1.5, path3d.tilt + up));
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

function showSince(now) {
  for (const box of document.querySelectorAll("[data-since]")) say(box, `${units.age(Math.max(0, now - Number(box.dataset.since)))} ago`);
}

function showAlarms() {
  const { alarms, events } = connection.sections;
  if (!alarms || !events) return;
  const may = connection.server.controls && operator.token !== "";
  const rows = alarms.rows.map((a) => el("li", { class: "alarm", "data-severity": a.severity_word },
    pill(SEVERITIES[a.severity_word], a.severity_word),
    el("div", {},
      el("strong", {}, a.text),
      el("p", {}, a.remedy),
      el("p", { class: "quiet-text" }, [
        `since ${units.clock(a.raised_ns)} UTC`, a.count > 1 ? `${a.count} times` : "", a.active ? "still there" : "gone",
        a.acknowledged ? `seen by ${a.acknowledged_by}` : "not yet acknowledged",
      ].filter(Boolean).join(" · ")),
    ),
    may && !a.acknowledged ? el("button", { type: "button", onclick: () => act("acknowledge_alarm", { id: a.id, operator_name: operator.name }) }, "Acknowledge") : null,
  ));
  const log = events.rows.slice(0, 100).map((e) => el("tr", {},
    el("td", {}, units.clock(e.stamp_ns)), el("td", {}, e.kind), el("td", {}, e.source), el("td", {}, e.text)));
  byId("tab-alarms").replaceChildren(
    el("div", { class: "split two" },
      el("div", {}, el("h2", {}, "Alarms"), rows.length ? el("ul", { class: "alarms" }, rows) : el("p", { class: "empty" }, "No alarms.")),
      el("div", {}, el("h2", {}, `Events, UTC, ${connection.sections.well?.name || ""}`), log.length
        ? el("table", { class: "log" }, el("thead", {}, el("tr", {}, ["Time", "What", "Source", "Text"].map((t) => el("th", { scope: "col" }, t)))), el("tbody", {}, log))
        : el("p", { class: "empty" }, "No events yet."))),
  );
  const critical = alarms.rows.filter((a) => a.severity === 2 && !a.acknowledged).map((a) => `${a.id}${a.raised_ns}`).join();
  if (critical && critical !== beeped) beep();
  beeped = critical;
}

function beep() {
  if (!sound) return;
  const tone = sound.createOscillator();
  tone.frequency.value = 880;
  tone.connect(sound.destination);
  tone.start();
  tone.stop(sound.currentTime + 0.4);
}

const streamRows = {};
const streamBody = el("tbody", {});
const recorderBox = el("div", {});
const browserBox = el("div", {});
const findingsBox = el("div", {});
byId("tab-system").append(el("div", { class: "split" },
  el("div", {},
    el("h2", {}, "Link"),
    el("table", { class: "log" }, el("thead", {}, el("tr", {}, ["Stream", "State", "Age", "Rate", "Lost"].map((t) => el("th", { scope: "col" }, t)))), streamBody),
    browserBox),
  el("div", {}, el("h2", {}, "Recorder"), recorderBox, el("h2", {}, "Rig"), rigBox),
  el("div", {}, el("h2", {}, "Diagnostics"), findingsBox)));

function showStreams(now, silent) {
  const { links, recorder } = connection.sections;
  if (!links || byId("tab-system").hidden) return;
  for (const [name, row] of Object.entries(links)) {
    if (!streamRows[name]) {
      const cells = [1, 2, 3, 4].map(() => el("td", {}));
      streamRows[name] = { cells, word: "" };
      streamBody.append(el("tr", {}, el("th", { scope: "row" }, STREAM_NAMES[name] || name), cells));
    }
    const { cells } = streamRows[name];
    const state = stateWord(row, now, silent);
    if (streamRows[name].word !== state) {
      streamRows[name].word = state;
      cells[0].replaceChildren(pill({ live: "good", stale: "doubtful", none: "idle" }[state], { live: "live", stale: "STALE", none: "no data" }[state]));
    }
    say(cells[1], row.at === null ? "–" : units.age(Math.max(0, now - row.at)));
    say(cells[2], row.rate === null ? "–" : `${row.rate.toFixed(row.rate < 10 ? 1 : 0)}/s`);
    say(cells[3], row.at === null ? "–" : String(row.lost));
  }
  if (recorder) {
    const text = recorder.since === null ? "no data" : [
      recorder.state, recorder.reason, recorder.path, units.duration(recorder.duration), `${recorder.messages} messages`,
      `${units.bytes(recorder.bytes)} on disk`, `${recorder.dropped} dropped`, `${units.bytes(recorder.free_bytes)} free`,
    ].filter(Boolean).join(" · ");
    say(recorderBox, text);
  }
  if (connection.mode === "polling") say(browserBox, "This page polls: no WebSocket gets through.");
  else say(browserBox, connection.server.skipped ? `Slow link to this browser: ${connection.server.skipped} states skipped.` : "");
}

function showFindings() {
  const rows = connection.sections.findings.rows;
  findingsBox.replaceChildren(rows.length
    ? el("ul", { class: "findings" }, rows.map((f) => el("li", {},
      pill({ ok: "good", warning: "doubtful", error: "reject", stale: "stale" }[f.level], f.level),
      el("div", {}, el("strong", {}, f.name), ` ${f.message}`, f.remedy && f.level !== "ok" ? el("p", { class: "quiet-text" }, f.remedy) : null))))
    : el("p", { class: "empty" }, "Nothing reported yet."));
}

// Operator controls: a name for the log, a token for the server.

let answerBox = null;

async function act(name, given) {
  const asked = Object.fromEntries(Object.entries(given).filter(([, value]) => value !== ""));
  if ("operator_name" in given && !operator.name.trim()) {
    const message = "give your name under Operator first";
    if (answerBox) say(answerBox, message);
    return { ok: false, message };
  }
  const answer = await command(name, operator.token, asked);
  if (answerBox) say(answerBox, `${name.replace("_", " ")}: ${answer.message}`);
  return answer;
}

function showControls() {
  const place = byId("tab-controls");
  if (!connection.server.controls) {
    place.replaceChildren(el("h2", {}, "Operator"), el("p", { id: "read-only" }, "This page is read-only: the surface unit has no token configured."));
    answerBox = null;
    return;
  }
  if (answerBox) return;
  answerBox = el("output", { class: "answer", id: "answer" });
  const name = el("input", { type: "text", id: "operator-name", autocomplete: "off", maxlength: 80 });
  const token = el("input", { type: "password", id: "operator-token", autocomplete: "off", maxlength: 200 });
  name.value = operator.name;
  name.addEventListener("input", () => { operator.name = name.value; sessionStorage.setItem("operator", name.value); });
  token.addEventListener("input", () => {
    const had = operator.token !== "";
    operator.token = token.value;
    for (const one of all) one.disabled = operator.token === "";
    if (had !== (operator.token !== "")) { showSurveys(); showAlarms(); }
  });
  const button = (id, text, command_, given = () => ({})) => el("button", { type: "button", id, disabled: true, onclick: () => act(command_, given()) }, text);
  const depth = el("input", { type: "text", id: "bit-depth", inputmode: "decimal", autocomplete: "off", maxlength: 12 });
  const format = el("select", { id: "export-format" }, EXPORTS.map(([key, text]) => el("option", { value: key }, text)));
  const setDepth = el("button", { type: "button", id: "set-depth", disabled: true, onclick: () => {
    const metres = units.metres(depth.value);
    if (metres === null) say(answerBox, `bit depth: ${depth.value || "nothing"} is no number of ${units.unit("length")}`);
    else act("set_depth", { bit_depth: metres, operator_name: operator.name });
  } }, "Set bit depth");
  const buttons = [
    button("take-survey", "Take survey", "take_survey"),
    button("start-recording", "Start recording", "start_recording"),
    button("stop-recording", "Stop recording", "stop_recording"),
    button("split-recording", "Split recording", "split_recording"),
    button("snapshot-recording", "Snapshot", "snapshot_recording"),
  ];
  const writing = button("export", "Export", "export", () => ({ format: format.value }));
  const all = [...buttons, setDepth, writing];
  place.replaceChildren(
    el("h2", {}, "Operator"),
    el("p", { class: "quiet-text" }, "With the token surveys can be judged in their table line and alarms acknowledged; without it this page only shows."),
    el("form", { class: "form", onsubmit: (event) => event.preventDefault() }, el("label", { for: "operator-name" }, "Your name, for the log"), name, el("label", { for: "operator-token" }, "Token"), token),
    el("div", { class: "buttons" }, buttons),
    el("div", { class: "buttons" },
      el("label", { for: "bit-depth" }, "Bit depth, ", el("span", { id: "bit-depth-unit" }, units.unit("length"))), depth, setDepth,
      el("label", { for: "export-format" }, "Survey list as"), format, writing),
    answerBox,
  );
}

// Tabs, or all at once where there is room.

const wide = window.matchMedia("(min-width: 1500px) and (min-height: 850px)");
const ALWAYS = ["surveys", "path"];

function select(name, focus = false) {
  if (wide.matches && ALWAYS.includes(name)) name = "charts";
  tab = name;
  const tabs = TABS.filter(([key]) => !wide.matches || !ALWAYS.includes(key));
  byId("tabs").replaceChildren(...tabs.map(([key, text]) => el("button", {
    type: "button", role: "tab", id: `select-${key}`, "aria-selected": String(key === tab), "aria-controls": `tab-${key}`,
    tabindex: key === tab ? "0" : "-1", onclick: () => select(key, true),
  }, text)));
  for (const [key] of TABS) {
    const panel = byId(`tab-${key}`);
    const always = wide.matches && ALWAYS.includes(key);
    panel.hidden = !(always || key === tab);
    mark(panel, "role", always ? "region" : "tabpanel");
  }
  if (focus) byId(`select-${tab}`).focus();
  showPath();
  showCharts();
  tick();
}

byId("tabs").addEventListener("keydown", (event) => {
  const keys = [...byId("tabs").children].map((b) => b.id.slice("select-".length));
  const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
  const k = keys.indexOf(tab);
  if (step) select(keys[(k + step + keys.length) % keys.length], true);
  if (event.key === "Home") select(keys[0], true);
  if (event.key === "End") select(keys[keys.length - 1], true);
});

function redraw() {
  charts.rebuild();
  for (const show of new Set(Object.entries(SHOW).filter(([name]) => connection.sections[name]).map(([, act_]) => act_))) show();
  tick();
}

function showSwitches() {
  say(byId("units"), units.isField() ? "US field" : "Metric");
  say(byId("theme"), document.documentElement.dataset.theme === "day" ? "Night" : "Day");
}

byId("units").addEventListener("click", () => {
  units.setField(!units.isField());
  memory.set("units", units.isField() ? "field" : "metric");
  showSwitches();
  if (byId("bit-depth-unit")) say(byId("bit-depth-unit"), units.unit("length"));
  redraw();
});
byId("theme").addEventListener("click", () => {
  const next = document.documentElement.dataset.theme === "day" ? "night" : "day";
  document.documentElement.dataset.theme = next;
  memory.set("theme", next);
  showSwitches();
  redraw();
});
byId("sound").addEventListener("click", () => {
  sound = sound ? null : new AudioContext();
  say(byId("sound"), sound ? "Sound on" : "Sound off");
  mark(byId("sound"), "aria-pressed", String(sound !== null));
});
wide.addEventListener("change", () => select(tab));

new ResizeObserver(() => showPath()).observe(byId("tab-path"));

showSwitches();
select(tab);
setInterval(tick, 250);
setInterval(() => { if (!byDepth) showCharts(); }, 5000);
