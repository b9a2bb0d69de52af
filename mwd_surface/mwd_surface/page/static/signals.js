// The signals of the charts: title, kind of unit, and whether the sonde or the rig measures them.

export const SIGNALS = {
  inclination: ["Inclination", "angle", "tool"],
  azimuth: ["Azimuth", "bearing", "tool"],
  vibration: ["Vibration, peak", "vibration", "tool"],
  lateral_vibration: ["Vibration, lateral", "vibration", "tool"],
  axial_vibration: ["Vibration, axial", "vibration", "tool"],
  rotary_speed: ["Rotary, tool", "rotation", "tool"],
  stick_slip: ["Stick-slip", "index", "tool"],
  shocks: ["Shocks in 10 s", "count", "tool"],
  temperature: ["Temperature", "temperature", "tool"],
  total_field: ["Total field", "field", "tool"],
  axial_interference: ["Axial interf.", "field", "tool"],
  pressure: ["Standpipe pressure", "pressure", "rig"],
  flow: ["Flow", "flow", "rig"],
  top_drive_speed: ["Top drive", "rotation", "rig"],
  top_drive_torque: ["Torque", "torque", "rig"],
  weight_on_bit: ["WOB", "force", "rig"],
  hookload: ["Hookload", "force", "rig"],
  rate_of_penetration: ["ROP", "penetration", "rig"],
  bit_depth: ["Bit depth", "depth", "rig"],
};
