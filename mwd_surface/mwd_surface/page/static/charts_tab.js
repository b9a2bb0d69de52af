// The charts: small strips over time, a large chart where the tab fills the page, or tracks over depth.

import { Charts } from "./charts.js";
import { depthTracks } from "./depth_tracks.js";
import { el, mark } from "./dom.js";
import { LargeChart } from "./large_chart.js";
import { SIGNALS } from "./signals.js";
import { fills } from "./view.js";
import { t } from "./words.js";

// Signals that the user chose earlier, without signals that no longer exist.
const known = (text) => (text || "").split(",").filter((name) => name in SIGNALS);

export class ChartsTab {
  constructor(panel, connection, memory) {
    this.panel = panel;
    this.connection = connection;
    this.byDepth = false;
    const toggle = () => {
      this.byDepth = !this.byDepth;
      this.show();
    };
    this.overDepth = el("button", { type: "button", class: "choice", "aria-pressed": "false", onclick: toggle }, t("Over depth"));
    this.depthBox = el("div", { class: "depth-box", hidden: true });
    panel.append(el("div", { class: "chart-head" }, this.overDepth, el("span", { class: "quiet-text" }, t("shaded: doubtful data"))));
    this.charts = new Charts(panel);
    const chosen = known(memory.get("signals"));
    this.large = new LargeChart(panel, chosen.length ? chosen : null, (names) => memory.set("signals", names.join()));
    panel.append(this.depthBox);
  }

  show() {
    const large = fills();
    mark(this.overDepth, "aria-pressed", String(this.byDepth));
    this.charts.grid.hidden = this.byDepth || large;
    this.large.box.hidden = this.byDepth || !large;
    this.depthBox.hidden = !this.byDepth;
    if (this.panel.hidden) return;
    if (this.byDepth) this.showTracks();
    else {
      this.charts.resize();
      this.showHistory();
    }
  }

  showTracks() {
    const { depth_log: log, steering, surveys } = this.connection.sections;
    const { clientWidth, clientHeight } = this.depthBox;
    if (log) this.depthBox.replaceChildren(depthTracks(log, steering, surveys, { width: clientWidth, height: clientHeight }));
  }

  showHistory() {
    const { history, trend, well } = this.connection.sections;
    const now = this.connection.now();
    if (this.panel.hidden || now === null) return;
    if (fills()) this.large.show(history, trend, now, Boolean(well?.over_link));
    else this.charts.show(history, now, Boolean(well?.over_link));
  }

  rebuild() {
    this.charts.rebuild();
    this.large.rebuild();
  }
}
