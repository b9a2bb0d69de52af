// The signals of the charts: title, kind of unit, and whether the sonde or the rig measures them.

import { t } from "./words.js";

export const SIGNALS = {
  inclination: [t("Inclination"), "inclination", "tool"],
  azimuth: [t("Azimuth"), "bearing", "tool"],
  vibration: [t("Vibration, peak"), "vibration", "tool"],
  lateral_vibration: [t("Vibration, lateral"), "vibration", "tool"],
  axial_vibration: [t("Vibration, axial"), "vibration", "tool"],
  rotary_speed: [t("Rotary, tool"), "rotation", "tool"],
  stick_slip: [t("Stick-slip"), "index", "tool"],
  shocks: [t("Shocks in 10 s"), "count", "tool"],
  temperature: [t("Temperature"), "temperature", "tool"],
  total_field: [t("Total field"), "field", "tool"],
  axial_interference: [t("Axial interf."), "field", "tool"],
  pressure: [t("Standpipe pressure"), "pressure", "rig"],
  flow: [t("Flow"), "flow", "rig"],
  top_drive_speed: [t("Top drive"), "rotation", "rig"],
  top_drive_torque: [t("Torque"), "torque", "rig"],
  weight_on_bit: [t("WOB"), "force", "rig"],
  hookload: [t("Hookload"), "force", "rig"],
  rate_of_penetration: [t("ROP"), "penetration", "rig"],
  bit_depth: [t("Bit depth"), "depth", "rig"],
};
