// Making elements from words; what traces and results say only ever becomes text.

/** An element with attributes and children; null and undefined among them are left out. */
export function element(name, attributes = {}, ...children) {
  const node = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (value !== null && value !== undefined && value !== false) node.setAttribute(key, value);
  }
  node.append(...children.filter((child) => child !== null && child !== undefined));
  return node;
}

export const byId = (id) => document.getElementById(id);

/** Words for a name: underscores become blanks. */
export const spoken = (name) => (name ?? "").toString().replaceAll("_", " ");

export const seconds = (time) => `${time.toFixed(2).replace("-", "−")} s`;

/** Decimals of units that have not one, as in every report (safestage_eval/units.py). */
const DECIMALS = { "N": 2, "N m": 2, "s": 2, "m/s^2": 2, "rad/s^2": 2, "m^2/s^5": 2, "rad^2/s^5": 2, "cm s": 2, "W": 2, "K/s": 2, "rad/s": 3, "N s": 3, "1/s": 3 };

/** A number with its unit as reports print it: below 1 mm in mm. */
export function amount(value, unit) {
  if (value === null || value === undefined) return "–";
  if (unit === "cm" && value !== 0 && Math.abs(value) < 0.1) return `${withMinus((10 * value).toFixed(2))} mm`;
  const text = unit ? value.toFixed(DECIMALS[unit] ?? 1) : Number(value.toPrecision(6)).toString();
  return `${withMinus(text)}${unit ? ` ${unit}` : ""}`;
}

/** By how much a finding missed its limit: "2.6 of 8.0 cm @ 5.13 s"; what has no number is its moment alone. */
export function howMuch({ signal, value, limit, unit, time, worst }) {
  const moment = worst ?? time, at = moment === null ? "" : ` @ ${seconds(moment)}`;
  if ((signal ?? "").startsWith("committed(")) return limit === null ? `never freed${at}` : `${seconds(limit - value)} too early${at}`;
  if (value === null || limit === null) return at.trim();
  const [measured, allowed] = [amount(value, unit), amount(limit, unit)], bare = measured.endsWith(` ${unit}`) && allowed.endsWith(` ${unit}`);
  const number = bare ? measured.slice(0, -unit.length - 1) : measured;
  return `${number} ${value > limit ? "over" : "of"} ${allowed.replace(/\.0+ /, " ")}${at}`;
}

const withMinus = (text) => text.replace("-", "−");

/** The sign and word of a verdict; null says that nobody judged. */
export function badge(verdict, severity = null) {
  const word = verdict ? spoken(verdict) : "not judged";
  return element("span", { class: `verdict ${verdict ?? "none"}` }, severity ? `${word}, ${severity}` : word);
}

/** Say in words that something failed. */
export function alarm(text) {
  byId("alarm").textContent = text;
  byId("alarm").hidden = !text;
}
