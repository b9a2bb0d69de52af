// The charts: strips over time, or tracks over depth.

import { Charts } from "./charts.js";
import { depthTracks } from "./depth_tracks.js";
import { el, mark } from "./dom.js";

export class ChartsTab {
  constructor(panel, connection) {
    this.panel = panel;
    this.connection = connection;
    this.byDepth = false;
    const toggle = () => {
      this.byDepth = !this.byDepth;
      this.show();
    };
    this.overDepth = el("button", { type: "button", class: "choice", "aria-pressed": "false", onclick: toggle }, "Over depth");
    this.depthBox = el("div", { class: "depth-box", hidden: true });
    panel.append(el("div", { class: "chart-head" }, this.overDepth, el("span", { class: "quiet-text" }, "shaded: doubtful data")));
    this.charts = new Charts(panel);
    panel.append(this.depthBox);
  }

  show() {
    mark(this.overDepth, "aria-pressed", String(this.byDepth));
    this.charts.grid.hidden = this.byDepth;
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
    const size = { width: Math.max(330, clientWidth), height: Math.max(220, clientHeight) };
    if (log) this.depthBox.replaceChildren(depthTracks(log, steering, surveys, size));
  }

  showHistory() {
    this.charts.show(this.connection.sections.history, this.connection.now());
  }

  rebuild() {
    this.charts.rebuild();
  }
}
