// What the page says, in the reader's language: one file for each, `text-en.json` and `text-de.json`.

import { loadSaid } from "./said.js";

const STORED = "thermogate-language";
export const LANGUAGES = ["en", "de"];

let texts = {};
export let language = "en";

function preferred() {
  const chosen = localStorage.getItem(STORED);
  if (LANGUAGES.includes(chosen)) return chosen;
  return navigator.languages.map((one) => one.slice(0, 2)).find((one) => LANGUAGES.includes(one)) ?? "en";
}

export async function loadTexts(choice = preferred()) {
  const [response] = await Promise.all([fetch(`static/text-${choice}.json`), loadSaid(choice)]);
  if (!response.ok) throw new Error(`static/text-${choice}.json: ${response.status}`);
  texts = await response.json();
  language = choice;
  document.documentElement.lang = choice;
}

export function chooseLanguage(choice) {
  localStorage.setItem(STORED, choice);
  return loadTexts(choice);
}

// The text called `key`, with {names} filled in. A text that is missing shows as its key, which a test finds.
export function t(key, values = {}) {
  return filled(texts[key] ?? key, values);
}

// The same as the beginning of a sentence; a name that is filled in stays as it is written.
export function sentence(key, values = {}) {
  return filled(capital(texts[key] ?? key), values);
}

function filled(text, values) {
  return text.replace(/\{(\w+)\}/g, (all, name) => values[name] ?? all);
}

export const capital = (text) => text.charAt(0).toLocaleUpperCase(language) + text.slice(1);

export function has(key) {
  return key in texts;
}

export function number(value, digits = 0) {
  if (value === null || value === undefined) return "–";
  return value.toLocaleString(language, { minimumFractionDigits: digits, maximumFractionDigits: digits });
}

// The same as a difference, with its sign.
export function signed(value, digits) {
  return value.toLocaleString(language, { signDisplay: "exceptZero", minimumFractionDigits: digits, maximumFractionDigits: digits });
}

// With so many significant digits, as people write quantities: 178, 0.42, 3,400,000.
export function amount(value, digits = 3) {
  if (value === null || value === undefined) return "–";
  return value.toLocaleString(language, { maximumSignificantDigits: digits });
}

export function unitText(unit) {
  return { degC: "°C", "W/m2": "W/m²" }[unit] ?? unit;
}

export function celsius(value, digits = 1) {
  return value === null || value === undefined ? "–" : `${number(value, digits)} °C`;
}

export function share(value) {
  return value === null || value === undefined ? "–" : value.toLocaleString(language, { style: "percent", maximumFractionDigits: 0 });
}

// A length of time in its natural unit.
export function duration(seconds) {
  if (seconds === null || seconds === undefined) return "–";
  for (const [size, unit] of [[86400, "days"], [3600, "hours"], [60, "minutes"]]) {
    if (seconds >= 2 * size || (unit === "hours" && seconds >= size)) return t(`unit.${unit}`, { value: amount(seconds / size, 2) });
  }
  return t("unit.seconds", { value: number(seconds) });
}
