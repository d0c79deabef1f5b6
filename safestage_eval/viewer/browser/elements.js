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

/** A number with its unit, in three digits. */
export function amount(value, unit) {
  if (value === null || value === undefined) return "–";
  const size = Math.abs(value);
  const text = size >= 100 ? value.toFixed(0) : size >= 1 || size === 0 ? value.toFixed(1) : value.toPrecision(2);
  return `${text.replace("-", "−")}${unit ? ` ${unit}` : ""}`;
}

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
