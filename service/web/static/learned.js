// What the model has learned of a zone: what is wrong, in sentences, then for experts every parameter within its bounds.

import { element, svg, tableRow } from "./dom.js";
import { pressing } from "./ranking.js";
import { amount, t } from "./text.js";
import { channelText, findingSentence, findingText, saidNode } from "./words.js";

// Fills `place` from the zone's description and its parameters, which may be null.
export function showLearned(place, zone, parameters) {
  place.replaceChildren(element("h2", { textContent: t("learned.title") }));
  if (!parameters) {
    place.append(element("p", { className: "muted", textContent: t("learned.none") }));
    return;
  }
  const plain = pressing(parameters);
  place.append(...findingList(plain));
  const bounds = new Map(zone.parameters.map((one) => [one.name, one]));
  const rows = parameters.parameters.filter(({ free }) => free).map((one) => parameterRow(one, bounds.get(one.name), parameters.findings));
  place.append(
    element(
      "details",
      {},
      element("summary", { textContent: t("learned.all", { count: rows.length }) }),
      ...parameters.thermostat.map((law) => element("p", { className: "muted", textContent: lawText(law) })),
      ...parameters.variants.slice(0, 3).map(({ variant, weight }) => element("p", { className: "muted", textContent: t("learned.variant", { variant, share: amount(100 * weight, 2) }) })),
      ...findingList(parameters.findings.filter((finding) => !plain.includes(finding))),
      element("div", { className: "scroll", tabIndex: 0, role: "region", "aria-label": t("learned.title") }, element("table", {}, element("thead", {}, tableRow("th", [t("learned.name"), t("learned.value"), t("learned.interval"), t("learned.bounds"), t("learned.where")])), element("tbody", {}, ...rows))),
    ),
  );
}

function lawText({ channel, side, law, power, offset, band }) {
  const [full, half, over] = [power, offset, band].map(({ mean, lower, upper }) => `${amount(mean, 2)} (${amount(lower, 2)} … ${amount(upper, 2)})`);
  return t(`learned.law.${side}`, { channel: channelText(channel), law: t(`law.${law}`), power: full, offset: half, band: over });
}

function findingList(findings) {
  if (!findings.length) return [];
  const items = findings.map((finding) => element("li", {}, element("strong", { textContent: `${findingSentence(finding)} ` }), saidNode(finding.sentence)));
  return [element("h3", { textContent: t("learned.findings") }), element("ul", { className: "findings" }, ...items)];
}

function parameterRow({ name, unit, quantiles }, prior, findings) {
  const [low, middle, high] = quantiles;
  const found = findings.filter(({ subject }) => subject === name).map((finding) => findingText(finding));
  return tableRow("td", [
    name,
    `${amount(middle)} ${unit}`,
    low === null ? t("learned.collapsed") : `${amount(low)} … ${amount(high)}`,
    `${amount(prior.lower)} … ${amount(prior.upper)}`,
    element("span", {}, place(prior, quantiles), found.length ? ` ${found.join("; ")}` : ""),
  ]);
}

// Where the interval lies between the bounds, on the prior's logarithmic scale.
function place({ lower, upper }, [low, middle, high]) {
  // A collapsed interval has no ends: its middle alone is shown.
  if (low === null) [low, high] = [middle, middle];
  const width = 120;
  const at = (value) => (value > 0 && upper > lower ? (width * Math.log(value / lower)) / Math.log(upper / lower) : 0);
  const from = Math.max(0, at(low));
  return svg(
    "svg",
    { viewBox: `0 0 ${width} 12`, width, height: 12, class: "place", "aria-hidden": "true" },
    svg("rect", { x: 0, y: 5, width, height: 2, class: "track" }),
    svg("rect", { x: from, y: 3, width: Math.max(2, Math.min(width, at(high)) - from), height: 6, class: "bar" }),
    svg("rect", { x: Math.min(width - 2, at(middle)), y: 0, width: 2, height: 12, class: "middle" }),
  );
}
