// The daemon's own sentences in the reader's language. It says them in English; `said-<language>.json` has them by that
// English, with {gaps} for numbers and names. A gap in capitals holds another such sentence. What is not found stays as it is.

const GAP = /\{\{|\}\}|\{(\w+)\}/g;
const REMEMBERED = 2000;
// "; " parts sentences: a number or a name does not reach beyond it.
const WITHIN = "((?:(?!; ).)+?)";

let catalogue = [];
const known = new Map();

const escaped = (text) => text.replace(/[.*+?^${}()|[\]\\]/g, "\\$&");

function compiled(english, translated) {
  const names = [];
  let pattern = "";
  let end = 0;
  for (const gap of english.matchAll(GAP)) {
    pattern += escaped(english.slice(end, gap.index)) + (gap[1] === undefined ? escaped(gap[0][0]) : gap[1] === gap[1].toUpperCase() ? "(.+?)" : WITHIN);
    if (gap[1] !== undefined) names.push(gap[1]);
    end = gap.index + gap[0].length;
  }
  return { names, pattern: new RegExp(`^${pattern}${escaped(english.slice(end))}$`, "s"), translated, literal: english.replace(GAP, "").length };
}

export async function loadSaid(language) {
  catalogue = [];
  known.clear();
  if (language === "en") return;
  const response = await fetch(`static/said-${language}.json`);
  if (!response.ok) throw new Error(`static/said-${language}.json: ${response.status}`);
  const found = Object.entries(await response.json()).map(([english, translated]) => compiled(english, translated));
  // What says more is tried first.
  catalogue = found.toSorted((one, other) => other.literal - one.literal);
}

// A number with the reader's decimal sign.
const localised = (value) => (/^-?\d+\.\d+$/.test(value) ? value.replace(".", (0.5).toLocaleString(document.documentElement.lang).charAt(1)) : value);

function translation(text) {
  for (const { names, pattern, translated } of catalogue) {
    const match = pattern.exec(text);
    if (!match) continue;
    const values = Object.fromEntries(names.map((name, index) => [name, name === name.toUpperCase() ? said(match[index + 1]).text : localised(match[index + 1])]));
    return translated.replace(GAP, (all, name) => (name === undefined ? all[0] : values[name]));
  }
  // A sentence that begins with a capital may be in the file as a part of others.
  const small = text.charAt(0).toLowerCase() + text.slice(1);
  const told = small === text ? null : translation(small);
  if (told !== null) return told.charAt(0).toUpperCase() + told.slice(1);
  // Several reasons stand one after the other.
  for (let at = text.indexOf("; "); at >= 0; at = text.indexOf("; ", at + 1)) {
    const first = translation(text.slice(0, at));
    if (first !== null) return `${first}; ${said(text.slice(at + 2)).text}`;
  }
  return null;
}

// The sentence, and the language that it then is in.
export function said(text) {
  if (!catalogue.length) return { text, lang: "en" };
  if (!known.has(text)) {
    // A thousand rooms say much the same; what they said before is let go of.
    if (known.size >= REMEMBERED) known.clear();
    known.set(text, translation(text));
  }
  const found = known.get(text);
  return found === null ? { text, lang: "en" } : { text: found, lang: document.documentElement.lang };
}
