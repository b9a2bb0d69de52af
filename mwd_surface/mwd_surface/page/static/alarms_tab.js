// Alarms with their acknowledgement, the log of events, and a sound that repeats while an alarm waits.

import { byId, el, pill, setText } from "./dom.js";
import { alarmState, byUrgency, notEvaluated } from "./header.js";
import { act, mayCommand, operatorName } from "./operator_tab.js";
import * as units from "./units.js";
import { say, t } from "./words.js";

const SEVERITIES = { info: "info", warning: "doubtful", critical: "reject" };

const REPEAT = 4000; // ms between two tones while an alarm waits

let sound = null;
let waiting = []; // active alarms that nobody has acknowledged
let silenced = new Set(); // active alarms that somebody has silenced at this screen

const keyOf = (a) => `${a.id} ${a.raised_ns} ${a.severity}`;
const sounding = () => waiting.some((key) => !silenced.has(key));

// The button turns the sound on, silences the present alarms, or turns the sound off. It needs no token.
export function toggleSound() {
  if (!sound) sound = new AudioContext();
  else if (sounding()) silenced = new Set(waiting);
  else {
    sound.close();
    sound = null;
  }
  beep();
}

function beep() {
  setText(byId("sound"), !sound ? t("Turn sound on") : sounding() ? t("Silence") : t("Turn sound off"));
  if (!sound || !sounding()) return;
  const tone = sound.createOscillator();
  tone.frequency.value = 880;
  tone.connect(sound.destination);
  tone.start();
  tone.stop(sound.currentTime + 0.4);
}

setInterval(beep, REPEAT);

export function showAlarms({ sections, server }) {
  const { alarms, events } = sections;
  if (!alarms || !events) return;
  const may = mayCommand(server);
  const unknown = notEvaluated(alarms);
  const rows = byUrgency(alarms.rows).map((a) => el("li", { class: "alarm", "data-severity": a.severity_word, "data-state": alarmState(a) },
    pill(a.active ? SEVERITIES[a.severity_word] : "idle", say(a.severity_word)),
    el("div", {},
      el("strong", {}, say(a.text)),
      el("p", {}, say(a.remedy)),
      el("p", { class: "quiet-text" }, [
        t`since ${units.clock(a.raised_ns)} UTC`, a.count > 1 ? t`${a.count} times` : "", a.active ? t("active") : t`gone since ${units.clock(a.last_ns)} UTC`,
        a.acknowledged ? t`acknowledged by ${a.acknowledged_by}` : t("not yet acknowledged"),
      ].filter(Boolean).join(" · ")),
    ),
    may && !a.acknowledged ? el("button", { type: "button", onclick: () => act("acknowledge_alarm", { id: a.id, operator_name: operatorName() }) }, t("Acknowledge")) : null,
  ));
  const log = events.rows.slice(0, 100).map((e) => el("tr", {},
    el("td", {}, units.clock(e.stamp_ns)), el("td", {}, say(e.kind)), el("td", {}, say(e.source)), el("td", {}, say(e.text))));
  byId("tab-alarms").replaceChildren(
    el("div", { class: "split two" },
      el("div", {}, el("h2", {}, t("Alarms")), 
        rows.length ? el("ul", { class: "alarms" }, rows) : el("p", { class: "empty" }, unknown ? t("No alarm is known.") : t("No alarms.")),
        unknown ? el("p", {}, pill("unknown", t("not evaluated")), ` ${alarms.not_evaluated.map(say).join(t(", ")) || unknown}${t(": ")}`, t("no data for this check has arrived")) : null),
      el("div", {}, el("h2", {}, t`Events, UTC, ${sections.well?.name || ""}`), log.length
        ? el("table", { class: "log" }, el("thead", {}, el("tr", {}, [t("Time"), t("What"), t("Source"), t("Text")].map((t) => el("th", { scope: "col" }, t)))), el("tbody", {}, log))
        : el("p", { class: "empty" }, t("No events yet.")))),
  );
  const before = waiting;
  waiting = alarms.rows.filter((a) => a.active && !a.acknowledged && a.severity > 0).map(keyOf);
  if (waiting.some((key) => !before.includes(key))) beep();
}
