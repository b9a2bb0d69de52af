// Head of the page: banner for a lost connection, facts of the well, states of streams, recorder and alarms.

import { byId, el, mark, pill, setText } from "./dom.js";
import { STREAM_NAMES, stateOfStream } from "./streams.js";
import * as units from "./units.js";
import { withFont, say, t } from "./words.js";

export function showBanner(connection, silent) {
  const banner = byId("banner");
  mark(document.body, "data-connected", silent ? "no" : "yes");
  if (!silent) {
    banner.hidden = true;
    return;
  }
  const gone = connection.silence();
  const text = gone === Infinity
    ? t("CONNECTING: no data from the surface unit yet")
    : t("DISCONNECTED: no data from the surface unit; all values below are old");
  setText(banner, text);
  banner.hidden = false;
  if (gone !== Infinity) document.title = t("DISCONNECTED · MWD");
}

// Clock: UTC and, if the rig's time zone is set, local time at the rig. epoch: s, null if not known.
export function showClock(now, epoch, zone) {
  if (epoch === null || epoch === undefined) return setText(byId("clock"), "");
  const at = new Date((now + epoch) * 1000);
  return setText(byId("clock"), [`${at.toISOString().slice(11, 19)} UTC`, zone && timeIn(zone, at)].filter(Boolean).join(" · "));
}

function timeIn(zone, at) {
  try {
    return `${at.toLocaleTimeString("en-GB", { timeZone: zone })} ${zone.split("/").pop().replace("_", " ")}`;
  } catch {
    return t`unknown time zone ${zone}`;
  }
}

export function showWell(well) {
  const name = well.wellbore_name || well.name;
  withFont(name).then(() => { byId("well-name").textContent = ""; setText(byId("well-name"), name); });
  const angle = (v) => (v === null ? t("not given") : `${v < 0 ? "−" : "+"}${units.size("angle", Math.abs(v))}°`);
  const { declination, convergence, source } = well.field;
  const total = {
    grid: declination === null || convergence === null ? null : declination - convergence, true: declination, magnetic: 0,
  }[well.north_reference];
  // Mark values that were not given as assumed.
  const assumed = (text) => (well.given ? text : t`${text} (assumed)`);
  setText(byId("datum"), [
    well.depth_datum ? assumed(t`Depth from ${well.depth_datum}`) : t("Depth from a datum not given"),
    well.sensor_to_bit === null ? t("sensor to bit not given") : t`sensor ${units.number("length", well.sensor_to_bit)} ${units.unit("length")} above bit`,
    assumed(t`${say(well.north_reference)} north`),
    t`decl. ${angle(declination)}`,
    t`conv. ${angle(convergence)}`,
    t`total correction ${angle(total)}`,
    t`field ${say(source) || t("not given")}`,
  ].join(" · "));
  document.title = `${well.wellbore_name || well.name} · MWD`;
}

export function showTitle(well) {
  document.title = `${well?.wellbore_name || t("Well")} · MWD`;
}

function pillTo(select, [tabName, kind, text]) {
  const button = el("button", { type: "button", class: `pill ${kind}`, onclick: () => select(tabName, true) });
  button.append(...pill(kind, text).childNodes);
  return button;
}

let pillsText = "";

// Status words of the estimator in the driller's terms.
const TOOL = { still: t("tool still"), rotating: t("tool rotating"), sliding: t("tool sliding") };
const TROUBLE = {
  sensor_fault: t("sensor faulty"), sensor_suspect: t("sensor in doubt"), clipped: t("sensor at its limit"), mag_disturbed: t("magnetic disturbance"),
  no_mag: t("no magnetometer"), initialising: t("settling"), aliased: t("vibration too fast"),
  no_reference: t("no reference field"), correction_refused: t("azimuth not corrected"),
  tool_assumed: t("tool assumed"),
};

// State of the telemetry link; the tool is silent while no mud flows.
const LINK = {
  locked: ["good", t("words arrive")], doubtful: ["doubtful", t("words doubtful")], searching: ["info", t("searching for words")],
  "no flow": ["idle", t("no flow, tool silent")], "no pressure": ["reject", t("no pressure")],
};
const LINK_LASTS = 5; // s; the receiver reports its state once per second

function telemetryPill(link, now) {
  if (now - link.since > LINK_LASTS) return ["link", "stale", t`${say(link.name)}: receiver silent ${units.age(now - link.since)}`];
  // A locked link has a reason until its first words arrive; show this reason.
  const [kind, words] = link.state === "locked" && link.reason ? ["info", say(link.reason)] : LINK[link.state] || ["idle", say(link.state)];
  return ["link", kind, t`${say(link.name)}: ${words}`];
}

function linkPills(streams, now, silent, link, over) {
  const stream = (name) => stateOfStream(streams[name], now, silent);
  // If the data come over a link, the sonde and the estimator send nothing directly.
  const down = (link ? ["rig"] : ["sonde", "estimator", "rig"]).filter((name) => stream(name) !== "live");
  const word = (name) => t`no ${STREAM_NAMES[name].toLowerCase()}` + (stream(name) === "none" ? "" : ` ${units.age(now - streams[name].at)}`);
  if (silent) return [["system", "reject", t("link lost")]];
  if (over) return [["system", "idle", t("run is over")]];
  const pills = down.map((name) => ["system", "doubtful", word(name)]);
  if (link) return [...pills, telemetryPill(link, now)];
  return pills.length ? pills : [["system", "good", t("link")]];
}

function recorderPill(recorder, live) {
  if (!recorder || !live) return ["system", "stale", t("recorder no data")];
  const kind = { recording: recorder.dropped ? "doubtful" : "good", stopped: "idle" }[recorder.state] || "reject";
  const word = recorder.state === "recording" ? t("recording") : t`recorder ${say(recorder.state)}`;
  return ["system", kind, recorder.dropped ? t`${word}, ${recorder.dropped} dropped` : word];
}

// Show the states of tool and rig only while they are reported.
export function showPills(sections, now, silent, select, replayed) {
  const { streams, recorder, attitude, rig } = sections;
  const list = [];
  const alive = (name) => streams && stateOfStream(streams[name], now, silent) === "live";
  if (streams) list.push(...linkPills(streams, now, silent, sections.link, sections.well?.over));
  if (attitude && alive("estimator")) {
    const doing = Object.keys(TOOL).find((word) => attitude.status.includes(word));
    if (doing) list.push(["system", "info", TOOL[doing]]);
    // The alarm line names the faulty sensor; a missing magnetometer is shown with its consequence.
    const told = attitude.status.includes("no_mag") ? ["sensor_fault", "sensor_suspect"] : [];
    const bad = Object.keys(TROUBLE).filter((word) => attitude.status.includes(word) && !told.includes(word));
    list.push(...bad.map((word) => ["system", "doubtful", TROUBLE[word]]));
  }
  if (rig && alive("rig")) {
    if (rig.pumps_on !== null) list.push(["system", "info", rig.pumps_on ? t("pumps on") : t("pumps off")]);
    if (rig.in_slips) list.push(["system", "info", t("in slips")]);
  }
  // Items that do not fit are dropped from the end: the recorder comes first, because it is shown nowhere else, then faults.
  const rank = (kind) => ["reject", "doubtful", "stale"].indexOf(kind) + 1 || 9;
  list.sort((a, b) => rank(a[1]) - rank(b[1]));
  // Hide the recorder state while a recording is played.
  if (streams && !replayed) list.unshift(recorderPill(recorder, alive("recorder")));
  const text = JSON.stringify(list);
  if (text === pillsText) return;
  const held = [...byId("pills").children].indexOf(document.activeElement);
  pillsText = text;
  byId("pills").replaceChildren(...list.map((item) => pillTo(select, item)));
  if (held >= 0) byId("pills").children[Math.min(held, list.length - 1)]?.focus();
}

// Names of the alarms that are not evaluated; empty if all are evaluated.
export function notEvaluated(alarms) {
  if (alarms.since === null) return t("alarms are not evaluated yet");
  return alarms.not_evaluated.length ? t`not evaluated: ${alarms.not_evaluated.map(say).join(t(", "))}` : "";
}

// Alarms by urgency: active before ended, unacknowledged before acknowledged, then by severity, then newest first.
export function byUrgency(rows) {
  return [...rows].sort((a, b) => b.active - a.active || a.acknowledged - b.acknowledged || b.severity - a.severity || b.raised_ns - a.raised_ns);
}

// State of an alarm in terms of ISA-18.2; the page draws each state differently.
export const alarmState = (a) => (!a.active ? "returned" : a.acknowledged ? "acknowledged" : "unacknowledged");

// Line that is always shown: the most urgent active alarm or, if none is active, the ended alarms not acknowledged yet.
export function showAlarmStrip({ alarms, well }, now) {
  if (!alarms) return;
  const rows = byUrgency(alarms.rows);
  const [first] = rows;
  // A missing alarm proves nothing if the alarm is not evaluated.
  const unknown = notEvaluated(alarms);
  const strip = byId("alarm");
  mark(strip, "data-severity", first?.active ? first.severity_word : unknown ? "unknown" : "none");
  mark(strip, "data-state", first ? alarmState(first) : "none");
  if (!strip.firstChild) strip.append(...["what", "remedy", "age"].map((name) => el("span", { class: `alarm-${name}` })));
  const [what, remedy, age] = strip.children;
  const none = unknown ? t`No alarm is known; ${unknown}` : first ? t("✓ No alarm is active") : t("✓ No alarms");
  setText(what, first?.active ? `${{ info: "●", warning: "▲", critical: "✕" }[first.severity_word]} ${say(first.severity_word).toUpperCase()}${t(": ")}${say(first.text)}` : none);
  setText(remedy, first?.active ? say(first.remedy) : first ? t`cleared, not yet acknowledged: ${rows.map((a) => say(a.text)).join(t("; "))}` : well?.over ? t("The run is over: no more data comes.") : "");
  setText(age, first?.active ? [
    alarms.epoch === null ? t`since ${units.clock(first.raised_ns)} UTC` : t`for ${units.age(Math.max(0, now + alarms.epoch - first.raised_ns / 1e9))}`,
    first.acknowledged ? t("acknowledged") : "", rows.length > 1 ? t`+ ${rows.length - 1} more` : "",
  ].filter(Boolean).join(" · ") : "");
}
