// What a zone's state, findings and parameters mean, in words.

import { element } from "./dom.js";
import { said } from "./said.js";
import { coldBy, outdone, pressing } from "./ranking.js";
import { celsius, duration, has, number, sentence, share, t } from "./text.js";

export function stateText(state) {
  return has(`state.${state}`) ? t(`state.${state}`) : state;
}

export function trustText(trust) {
  if (!trust) return "–";
  return has(`trust.${trust}`) ? t(`trust.${trust}`) : trust;
}

// What the daemon says, marked as English where it stays so.
export function saidNode(own) {
  const { text, lang } = said(own);
  return element("span", { lang, textContent: text });
}

// A channel in the words of people who have no model; others are called as they are.
export function channelText(channel) {
  const kind = /^(T_out|T_adj|u_heat|u_cool|I_sol|cloud_cover|T_set)(?:_(.+))?$/.exec(channel);
  if (!kind) return channel;
  return t(`channel.${kind[1]}${kind[2] ? ".of" : ""}`, { name: kind[2] });
}

// Why readings were refused, by the kind of fault.
export function faultText(kind) {
  return has(`fault.${kind}`) ? t(`fault.${kind}`) : kind.replaceAll("_", " ");
}

export function findingText({ finding, subject }, tell = t) {
  return has(`finding.${finding}`) ? tell(`finding.${finding}`, { subject: parameterName(subject) }) : `${subject}: ${finding}`;
}

// The same as a sentence.
export function findingSentence(finding) {
  return `${findingText(finding, sentence)}.`;
}

function parameterName(name) {
  return name === "heat_loss" ? t("parameter.heat_loss") : name;
}

// The first thing to know of a zone in the table, and the language that it is in: why it does not run, else what is wrong with
// its telemetry, heating or model, else why it is not trusted, else what happens in it, else how its last days were.
export function rowTold(row) {
  if (row.state !== "running" || row.reason) return row.reason ? said(row.reason) : { text: stateText(row.state), lang: "" };
  const [first, ...others] = pressing(row);
  if (first) return { text: others.length ? t("finding.more", { text: findingText(first), count: number(others.length) }) : findingText(first), lang: "" };
  if (row.trust_reason && row.trust !== "learning" && !outdone(row)) return said(row.trust_reason);
  if (row.disturbed) return { text: t("finding.disturbed"), lang: "" };
  if (coldBy(row)) return { text: t("finding.cold", { by: number(coldBy(row), 1) }), lang: "" };
  if (row.often) return { text: t(`finding.too_${row.often}`, { hours: number(row.often_h) }), lang: "" };
  // At which horizon is told with the trust.
  return { text: t(outdone(row) ? "finding.outdone" : "finding.none"), lang: "" };
}

export function rowText(row) {
  return rowTold(row).text;
}

// Why the model is doubted now: sentences, the gravest first; `own` is what follows in the daemon's words.
export function doubts({ status, forecast, trust }) {
  const found = [];
  if (status.state === "failed" || status.state === "stalled" || status.state === "waiting") {
    found.push({ text: t(`doubt.${status.state}`), own: status.reason });
    return found;
  }
  if (status.reason) found.push({ text: "", own: status.reason });
  const horizons = trust?.horizons ?? [];
  const distrusted = horizons.filter(({ trust: level, reason }) => (level === "doubtful" || level === "untrusted") && !trust.beaten.includes(reason));
  for (const reason of new Set(distrusted.map(({ reason: why }) => why))) {
    const alike = distrusted.filter(({ reason: why }) => why === reason);
    const lead = alike.map(({ lead_s: ahead }) => duration(ahead)).join(", ");
    found.push({ text: t("doubt.trust", { lead, trust: trustText(alike[0].trust) }), own: reason });
  }
  if (forecast?.regime === "high" && !trust?.disturbed) found.push({ text: t("doubt.disturbed", { gate: share(forecast.gate) }) });
  if (trust?.beaten) found.push({ text: "", own: trust.beaten });
  if (horizons.every(({ trust: level }) => level === "learning")) found.push({ text: t("doubt.young", { samples: number(status.samples) }) });
  return found;
}

// What heads the doubts `found`: how far ahead the forecast is good, or where it is not.
export function trustHead({ status, forecast, trust }, found) {
  const leads = (...levels) => (trust?.horizons ?? []).filter(({ trust: level }) => levels.includes(level)).map(({ lead_s: lead }) => duration(lead));
  const good = leads("trusted");
  if (!found.length) return t("doubt.nothing", { lead: good.at(-1) });
  const doubted = leads("doubtful", "untrusted").join(", ");
  if (status.reason || (forecast?.regime === "high" && !trust?.disturbed) || (!doubted && !trust?.beaten)) return t("doubt.title");
  if (!doubted) return t("doubt.beaten");
  return good.length && !trust.beaten ? t("doubt.good", { doubted, good: good.join(", ") }) : t("doubt.some", { doubted });
}

// Where the values of an input in a forecast come from.
export function originText({ origin, source, age_s: age, quality }) {
  const text = has(`origin.${origin}`) ? t(`origin.${origin}`, { source, age: duration(age) }) : origin;
  return origin === "weather" && quality !== "good" ? `${text}, ${t("origin.part")}` : text;
}
