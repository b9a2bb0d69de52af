// Names of the streams, and their state by the page's own clock.

import { t } from "./words.js";

export const STREAM_NAMES = {
  sonde: t("Sonde"), estimator: t("Estimator"), magnetometer: t("Magnetometer"), temperature: t("Temperature"),
  interference: t("Interference"), dynamics: t("Dynamics"), rig: t("Rig data"), recorder: t("Recorder"),
};

export function stateOfStream(row, now, silent) {
  if (!row || row.at === null) return "none";
  return silent || row.state !== "live" || now - row.at > row.stale_after ? "stale" : "live";
}
