// Alarms with their acknowledgement, the log of events, and a sound for a new critical alarm.

import { byId, el, mark, pill, setText } from "./dom.js";
import { notEvaluated } from "./header.js";
import { act, mayCommand, operatorName } from "./operator_tab.js";
import * as units from "./units.js";

const SEVERITIES = { info: "info", warning: "doubtful", critical: "reject" };

let sound = null;
let beeped = "";

export function toggleSound() {
  sound = sound ? null : new AudioContext();
  setText(byId("sound"), sound ? "Sound on" : "Sound off");
  mark(byId("sound"), "aria-pressed", String(sound !== null));
}

function beep() {
  if (!sound) return;
  const tone = sound.createOscillator();
  tone.frequency.value = 880;
  tone.connect(sound.destination);
  tone.start();
  tone.stop(sound.currentTime + 0.4);
}

export function showAlarms({ sections, server }) {
  const { alarms, events } = sections;
  if (!alarms || !events) return;
  const may = mayCommand(server);
  const unknown = notEvaluated(alarms);
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
    may && !a.acknowledged ? el("button", { type: "button", onclick: () => act("acknowledge_alarm", { id: a.id, operator_name: operatorName() }) }, "Acknowledge") : null,
  ));
  const log = events.rows.slice(0, 100).map((e) => el("tr", {},
    el("td", {}, units.clock(e.stamp_ns)), el("td", {}, e.kind), el("td", {}, e.source), el("td", {}, e.text)));
  byId("tab-alarms").replaceChildren(
    el("div", { class: "split two" },
      el("div", {}, el("h2", {}, "Alarms"), 
        rows.length ? el("ul", { class: "alarms" }, rows) : el("p", { class: "empty" }, unknown ? "No alarm is known." : "No alarms."),
        unknown ? el("p", {}, pill("unknown", "not evaluated"), ` ${unknown.replace(/^not evaluated: /, "")}: no data that would show this alarm has come`) : null),
      el("div", {}, el("h2", {}, `Events, UTC, ${sections.well?.name || ""}`), log.length
        ? el("table", { class: "log" }, el("thead", {}, el("tr", {}, ["Time", "What", "Source", "Text"].map((t) => el("th", { scope: "col" }, t)))), el("tbody", {}, log))
        : el("p", { class: "empty" }, "No events yet."))),
  );
  const critical = alarms.rows.filter((a) => a.severity === 2 && !a.acknowledged).map((a) => `${a.id}${a.raised_ns}`).join();
  if (critical && critical !== beeped) beep();
  beeped = critical;
}
