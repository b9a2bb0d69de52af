// Names of the streams, and their state by the page's own clock.

export const STREAM_NAMES = {
  sonde: "Sonde", estimator: "Estimator", magnetometer: "Magnetometer", temperature: "Temperature",
  interference: "Interference", dynamics: "Dynamics", rig: "Rig data", recorder: "Recorder",
};

export function stateOfStream(row, now, silent) {
  if (!row || row.at === null) return "none";
  return silent || row.state !== "live" || now - row.at > row.stale_after ? "stale" : "live";
}
