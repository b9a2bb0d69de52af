// The driller's page: receives the state from the server, shows it, and shows when it is old.

import { showAlarms, toggleSound } from "./alarms_tab.js";
import { refresh, valueBox } from "./cells.js";
import { ChartsTab } from "./charts_tab.js";
import { Connection } from "./connection.js";
import { showControl } from "./control_panel.js";
import { Dial } from "./dial.js";
import { byId, scale, setText } from "./dom.js";
import { showDownlink } from "./downlink_panel.js";
import { showAlarmStrip, showBanner, showClock, showPills, showTitle, showWell } from "./header.js";
import { act, mayCommand, operatorName, showControls, showRods } from "./operator_tab.js";
import { showLink, showLinkStrip } from "./link_tab.js";
import { showLogs } from "./logs_tab.js";
import { showTool } from "./tool_tab.js";
import { showBranches, showClosure, showDeviation, showPath } from "./path_tab.js";
import { showReplay } from "./replay_bar.js";
import { slideSheet } from "./slide_sheet.js";
import { showOffset, showProgress, showQuality } from "./survey_quality.js";
import { SurveyTable } from "./survey_table.js";
import { showDiagnostics, showInputs, showStreams } from "./system_tab.js";
import { select, startTabs } from "./tabs.js";
import * as units from "./units.js";
import { current, setView } from "./view.js";
import { chooseLanguage, say, t } from "./words.js";

const memory = {
  get: (key) => { try { return localStorage.getItem(key); } catch { return null; } },
  set: (key, value) => { try { localStorage.setItem(key, value); } catch { /* a private window keeps nothing */ } },
};

units.setField(memory.get("units") === "field");
document.documentElement.dataset.theme = memory.get("theme") === "day" ? "day" : "night";

const dial = new Dial(byId("dial"), byId("dial-side"), byId("dial-legend"));
const table = new SurveyTable(byId("tab-surveys"), (name, values) => act(name, { ...values, operator_name: operatorName() }));

byId("head-values").append(
  valueBox("rig.bit_depth", t("Bit depth"), "depth"),
  valueBox("rig.hole_depth", t("Hole depth"), "depth"),
  valueBox("rig.rate_of_penetration", t("ROP"), "penetration"),
);
byId("big").append(
  valueBox("attitude.inclination", t("Inclination"), "inclination", { big: true, label: () => units.titled("inclination", t("Inclination")) }),
  valueBox("attitude.azimuth", t("Azimuth"), "angle", {
    big: true, bearing: true, decimals: 2,
    label: (s) => s.attitude?.north ? t`Azimuth, ${say(s.attitude.north)} north` : t("Azimuth, north unknown"),
  }),
);
// A wired tool sends values continuously. Over a telemetry link it sends few, so the rig's values are more useful.
const OF_TOOL = [
  valueBox("drilling.rotary_speed", t("Rotary"), "rotation"),
  valueBox("drilling.vibration", t("Vibration"), "vibration"),
  valueBox("drilling.temperature", t("Temperature"), "temperature"),
  valueBox("drilling.total_field", t("Total field"), "field"),
  valueBox("drilling.axial_interference", t("Axial interf."), "field"),
  valueBox("rig.weight_on_bit", t("WOB"), "force"),
];
const OF_RIG = [
  valueBox("rig.flow_rate", t("Flow in"), "flow"),
  valueBox("rig.pressure", t("Standpipe"), "pressure"),
  valueBox("rig.torque", t("Torque"), "torque"),
  valueBox("rig.rotary_speed", t("Top drive"), "rotation"),
  valueBox("rig.weight_on_bit", t("WOB"), "force"),
  valueBox("rig.hookload", t("Hookload"), "force"),
];
byId("small").append(...OF_TOOL, ...OF_RIG);

const SHOW = {
  well: ({ well }) => {
    showWell(well);
    if (units.setConvention(well.convention)) redraw();
    for (const box of OF_TOOL) box.hidden = Boolean(well.over_link);
    for (const box of OF_RIG) box.hidden = !well.over_link;
  },
  attitude: ({ well }) => showTitle(well),
  quality: ({ quality }) => showQuality(quality),
  offset: showOffPlan,
  rods: ({ rods }) => showRods(rods),
  deviation: ({ deviation }) => showDeviation(deviation),
  branches: ({ branches }) => showBranches(branches),
  closure: ({ closure }) => showClosure(closure),
  clearance: showWellPath,
  surveys: () => { showSurveys(); charts.show(); },
  steering: () => { showSteering(); charts.show(); },
  control: showControlAndAdvice,
  advice: showControlAndAdvice,
  depth_log: showCharts,
  logs: showLogs,
  tool_health: showTool,
  path: (sections) => { showSurveys(); showWellPath(); showOffPlan(sections); },
  plan: (sections) => { showWellPath(); showOffPlan(sections); },
  alarms: showAlarmsAndEvents,
  events: showAlarmsAndEvents,
  diagnostics: ({ diagnostics }) => showDiagnostics(diagnostics),
  inputs: ({ inputs }) => showInputs(inputs),
  link: ({ link, well }) => showLink(link, well?.over_link),
  downlink: ({ downlink }) => showDownlink(downlink, connection.server),
  history: () => { if (!charts.byDepth) charts.showHistory(); },
};

// changed: names of the changed sections; null: all sections.
const connection = new Connection((names) => {
  showSections([...(names || Object.keys(connection.sections))]);
  showReplay(connection.server.replay);
  const restart = () => {
    showSurveys();
    showAlarmsAndEvents();
    showControlAndAdvice();
    showDownlink(connection.sections.downlink, connection.server);
  };
  if (names === null) {
    showControls(connection.server, restart);
    showRods(connection.sections.rods);
  }
  tick();
});
const charts = new ChartsTab(byId("tab-charts"), connection, memory);

function showSections(names) {
  const { sections } = connection;
  for (const show of new Set(names.map((name) => SHOW[name]).filter(Boolean))) show(sections);
}

// Age of the word from which a link's toolface was predicted, s; null without a link.
const wordAge = (link, since) => (link && link.toolface_age !== null ? link.toolface_age + since : null);

function tick() {
  const { sections } = connection;
  const now = connection.now();
  const silent = connection.silent();
  showBanner(connection, silent);
  if (now === null) return;
  refresh(sections, now, silent);
  const linkSince = sections.link?.since ? Math.max(0, now - sections.link.since) : 0;
  dial.show(sections, now, silent, wordAge(sections.link, linkSince));
  showProgress(sections, now, silent);
  showPills(sections, now, silent, select, Boolean(connection.server.replay));
  showAlarmStrip(sections, now);
  showClock(now, sections.alarms?.epoch, connection.server.time_zone);
  showLinkStrip(sections.link, linkSince);
  showStreams(connection, now, silent);
  showSince(now);
}

function showOffPlan({ offset, plan, path }) {
  if (offset !== undefined) showOffset(offset, plan, path);
}

function showCharts() {
  charts.show();
}

function showWellPath() {
  showPath(connection.sections);
}

function showAlarmsAndEvents() {
  showAlarms(connection);
}

function showSteering() {
  const { steering } = connection.sections;
  if (steering) byId("slide-sheet").replaceChildren(...slideSheet(steering));
}

function showControlAndAdvice() {
  const { control, advice } = connection.sections;
  const judge = (decision, number) => act("judge_control", { decision, operator_name: operatorName(), number });
  showControl(byId("control-panel"), control, advice, mayCommand(connection.server) ? judge : null);
}

function showSurveys() {
  const { surveys, path, well } = connection.sections;
  if (surveys) table.show(surveys, path, well, mayCommand(connection.server));
}

function showSince(now) {
  for (const box of document.querySelectorAll("[data-since]")) setText(box, t`${units.age(Math.max(0, now - Number(box.dataset.since)))} ago`);
}

function redraw() {
  charts.rebuild();
  showSections(Object.keys(connection.sections));
  tick();
}

function showSwitches() {
  setText(byId("units"), units.isField() ? t("Metric units") : t("US units"));
  setText(byId("theme"), document.documentElement.dataset.theme === "day" ? t("Night") : t("Day"));
}

byId("units").addEventListener("click", () => {
  units.setField(!units.isField());
  memory.set("units", units.isField() ? "field" : "metric");
  showSwitches();
  for (const unit of document.querySelectorAll(".length-unit")) setText(unit, units.unit("length"));
  redraw();
});
byId("theme").addEventListener("click", () => {
  const next = document.documentElement.dataset.theme === "day" ? "night" : "day";
  document.documentElement.dataset.theme = next;
  memory.set("theme", next);
  showSwitches();
  redraw();
});
byId("sound").addEventListener("click", toggleSound);
byId("alarm").addEventListener("click", () => {
  if (current() === "toolface") setView("all");
  select("alarms", true);
});

byId("view").addEventListener("click", () => {
  const wanted = current() === "toolface" ? "all" : "toolface";
  setView(wanted);
  // A browser may refuse full screen; the layout of the page does not depend on it.
  if (wanted === "toolface") document.documentElement.requestFullscreen?.().catch(() => {});
  else if (document.fullscreenElement) document.exitFullscreen();
});

// A chart takes its font size when it is created, so the charts are created anew when the font size changes.
let typeScale = scale();
window.addEventListener("resize", () => {
  if (scale() === typeScale) return;
  typeScale = scale();
  redraw();
});
new ResizeObserver(showWellPath).observe(byId("tab-path"));
new ResizeObserver(() => showLogs(connection.sections)).observe(byId("tab-logs"));
new ResizeObserver(() => showTool(connection.sections)).observe(byId("tab-tool"));

showSwitches();
chooseLanguage(byId("language"));
startTabs(() => {
  showLink(connection.sections.link, connection.sections.well?.over_link);
  showWellPath();
  showLogs(connection.sections);
  charts.show();
  tick();
});
setInterval(tick, 250);
setInterval(() => { if (!charts.byDepth) charts.showHistory(); }, 5000);
