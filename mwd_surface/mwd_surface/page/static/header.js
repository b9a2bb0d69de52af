// The head of the page: banner of a lost connection, facts of the well, states of streams, recorder and alarms.

import { byId, el, mark, pill, setText } from "./dom.js";
import { STREAM_NAMES, stateOfStream } from "./streams.js";
import * as units from "./units.js";

export function showBanner(connection, silent) {
  const banner = byId("banner");
  mark(document.body, "data-connected", silent ? "no" : "yes");
  if (!silent) {
    banner.hidden = true;
    return;
  }
  const gone = connection.silence();
  const text = gone === Infinity
    ? "CONNECTING: no data from the surface unit yet"
    : "DISCONNECTED: no data from the surface unit; all values below are old";
  setText(banner, text);
  banner.hidden = false;
  if (gone !== Infinity) document.title = "DISCONNECTED · MWD";
}

export function showWell(well) {
  setText(byId("well-name"), well.wellbore || well.name);
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
  setText(byId("datum"), parts.join(" · "));
  document.title = `${well.wellbore || well.name} · MWD`;
}

export function showTitle(well) {
  document.title = `${well?.wellbore || "Well"} · MWD`;
}

function pillTo(select, [tabName, kind, text]) {
  const button = el("button", { type: "button", class: `pill ${kind}`, onclick: () => select(tabName, true) });
  button.append(...pill(kind, text).childNodes);
  return button;
}

let pillsText = "";

export function showPills(sections, now, silent, select) {
  const { links, recorder, alarms, attitude, rig } = sections;
  const list = [];
  if (links) {
    const down = ["sonde", "estimator", "rig"].filter((name) => stateOfStream(links[name], now, silent) !== "live");
    const word = (name) => `${STREAM_NAMES[name].toLowerCase()} ${stateOfStream(links[name], now, silent) === "none" ? "" : units.age(now - links[name].at)}`.trim();
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
  byId("pills").replaceChildren(...list.map((item) => pillTo(select, item)));
  if (held >= 0) byId("pills").children[Math.min(held, list.length - 1)]?.focus();
}
