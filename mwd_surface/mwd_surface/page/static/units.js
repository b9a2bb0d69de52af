// Conversion from SI and rad to units for people. One switch changes all units.

import { decimal, t } from "./words.js";

export { decimal };

const DEG = 180 / Math.PI;
const FOOT = 0.3048;
const G = 9.80665;

// kind: [factor, offset, decimals, unit] for metric and US field units.
const KINDS = {
  angle: [[DEG, 0, 2, "°"]],
  bearing: [[DEG, 0, 2, "°"]],
  coarse_angle: [[DEG, 0, 1, "°"]],
  depth: [[1, 0, 1, "m"], [1 / FOOT, 0, 0, "ft"]],
  length: [[1, 0, 2, "m"], [1 / FOOT, 0, 1, "ft"]],
  penetration: [[3600, 0, 1, "m/h"], [3600 / FOOT, 0, 0, "ft/h"]],
  dogleg: [[DEG * 30, 0, 2, "°/30 m"], [DEG * 100 * FOOT, 0, 2, "°/100 ft"]],
  field: [[1e9, 0, 0, "nT"]],
  gravity: [[1, 0, 4, "m/s²"], [1000 / G, 0, 2, "mG"]],
  gravity_deviation: [[1000 / G, 0, 2, "mG"]],
  vibration: [[1, 0, 1, "m/s²"], [1 / G, 0, 2, "g"]],
  rotation: [[30 / Math.PI, 0, 0, "r/min"]],
  slow_rate: [[DEG * 3600, 0, 2, "°/h"]],
  seconds: [[1, 0, 1, "s"]],
  temperature: [[1, 0, 1, "°C"], [1.8, 32, 0, "°F"]],
  force: [[1e-3, 0, 1, "kN"], [1 / 4448.2216, 0, 1, "klbf"]],
  torque: [[1e-3, 0, 1, "kN·m"], [1 / 1355.818, 0, 2, "kft·lbf"]],
  flow: [[60000, 0, 0, "L/min"], [15850.323, 0, 0, "gal/min"]],
  index: [[1, 0, 2, ""]],
  count: [[1, 0, 0, ""]],
  voltage: [[1, 0, 1, "V"]],
  current: [[1000, 0, 0, "mA"]],
  gamma: [[1, 0, 0, "gAPI"]],
  charge: [[1 / 3600, 0, 1, "Ah"]],
  pressure: [[1e-5, 0, 0, "bar"], [1 / 6894.757, 0, 0, "psi"]],
};

// A gyro at rest shows a small rate; strings do not rotate slower than this.
const DEAD_BAND = { rotation: 0.16 }; // rad/s

// Sign and offset, deg, of the vertical angle that people of the well read; the same as core/angle_convention.py.
const CONVENTIONS = { inclination: [1, 0, ""], dip_up: [1, -90, t("Hole dip, up +")], dip_down: [-1, 90, t("Hole dip, down +")] };

let system = 0;
let [sign, offset, dipTitle] = CONVENTIONS.inclination;
let convention = "inclination";

export const isField = () => system === 1;
export const setField = (on) => { system = on ? 1 : 0; };

// Set the convention of the well; true if it has changed.
export function setConvention(name) {
  if (name === convention) return false;
  [sign, offset, dipTitle] = CONVENTIONS[name];
  convention = name;
  return true;
}

// Title of a quantity; that of the vertical angle of the hole follows the convention of the well.
export const titled = (kind, title) => (kind === "inclination" && dipTitle ? dipTitle : title);

const rule = (kind) => (kind === "inclination" ? [sign * DEG, offset, 2, "°"] : KINDS[kind][Math.min(system, KINDS[kind].length - 1)]);

export const unit = (kind) => rule(kind)[3];

// Unit as printed after a number: a degree sign follows without a space.
export const after = (kind) => (/^(°(?![CF])|$)/.test(unit(kind)) ? unit(kind) : ` ${unit(kind)}`);

export function number(kind, value, more = 0) {
  const [factor, offset, decimals] = rule(kind);
  if (Math.abs(value) < (DEAD_BAND[kind] || 0)) return "0";
  // Avoid "-0", to which a small negative number rounds.
  return decimal((value * factor + offset).toFixed(Math.max(0, decimals + more)).replace(/^-(0(\.0*)?)$/, "$1"));
}

// Give a small sigma enough decimals to show it.
export function spread(kind, value) {
  return value > 0 && Number(plainSize(kind, value)) === 0 ? decimal((value * Math.abs(rule(kind)[0])).toPrecision(1)) : size(kind, value);
}

// For a difference, the offset of a temperature scale does not apply.
export const size = (kind, value, more = 0) => decimal(plainSize(kind, value, more));

function plainSize(kind, value, more = 0) {
  const [factor, , decimals] = rule(kind);
  return (value * Math.abs(factor)).toFixed(Math.max(0, decimals + more));
}

// Length typed in the shown units; null if it is not a number. A comma counts as a decimal point.
export function metres(text) {
  const value = Number(text.trim().replace(",", "."));
  return text.trim() !== "" && Number.isFinite(value) && value >= 0 ? value / rule("length")[0] : null;
}

export const plain = (kind, value) => value * rule(kind)[0] + rule(kind)[1];

// Degrees within one turn.
export const turn = (degrees) => ((degrees % 360) + 360) % 360;

// Write 359.97 rounded to one decimal as 0.0, not 360.0.
export function bearing(value, decimals = 1) {
  const text = turn(value * DEG).toFixed(decimals);
  return decimal(Number(text) >= 360 ? (0).toFixed(decimals) : text);
}

export function signed(kind, value) {
  const text = plainSize(kind, Math.abs(value));
  return decimal(Number(text) === 0 ? text : (value < 0 ? "−" : "+") + text);
}

export function age(seconds) {
  if (seconds < 1) return t("< 1 s");
  if (seconds < 100) return t`${Math.floor(seconds)} s`;
  if (seconds < 6000) return t`${Math.floor(seconds / 60)} min`;
  return t`${Math.floor(seconds / 3600)} h`;
}

export function bytes(count) {
  for (const [step, name] of [[1e12, "TB"], [1e9, "GB"], [1e6, "MB"], [1e3, "kB"]]) {
    if (count >= step) return `${decimal((count / step).toFixed(1))} ${name}`;
  }
  return `${count} B`;
}

export function clock(stampNs, withDate = false) {
  if (!stampNs) return "";
  const text = new Date(stampNs / 1e6).toISOString();
  return withDate ? `${text.slice(0, 10)} ${text.slice(11, 19)} UTC` : text.slice(11, 19);
}

export function duration(seconds) {
  const whole = Math.max(0, Math.floor(seconds));
  const two = (n) => String(n).padStart(2, "0");
  return `${Math.floor(whole / 3600)}:${two(Math.floor(whole / 60) % 60)}:${two(whole % 60)}`;
}
