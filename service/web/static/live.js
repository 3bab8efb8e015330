// The live page: one card per zone, refreshed from the REST interface of the same daemon.

import { KeyNeeded, askForKey, request } from "./access.js";
import { draw } from "./chart.js";

const POLL_MS = 4000;
const WINDOW_S = 48 * 3600;
const MAX_ROWS = 2000;

const cards = new Map();
let waitsForKey = false;

async function get(path) {
  const response = await request(path, { headers: { Accept: "application/json" }, cache: "no-store" });
  if (response.status === 503) return null;
  if (!response.ok) throw new Error(`${path}: ${response.status} ${response.statusText}`);
  return response.json();
}

function element(tag, properties = {}, ...children) {
  const node = Object.assign(document.createElement(tag), properties);
  node.append(...children);
  return node;
}

function number(value, digits, unit = "") {
  return value === null || value === undefined ? "–" : `${value.toFixed(digits)}${unit && ` ${unit}`}`;
}

function clock(time) {
  return time ? `${time.slice(0, 10)} ${time.slice(11, 16)}` : "–";
}

function age(seconds) {
  if (seconds === null || seconds === undefined) return "–";
  for (const [size, unit] of [[86400, "d"], [3600, "h"], [60, "min"]]) {
    if (seconds >= 2 * size) return `${Math.round(seconds / size)} ${unit}`;
  }
  return `${Math.round(seconds)} s`;
}

function makeCard(id) {
  const card = {
    rows: [],
    title: element("h2", { textContent: id }),
    pill: element("span", { className: "pill" }),
    about: element("span", { className: "muted" }),
    reason: element("p", { className: "reason", hidden: true }),
    numbers: element("dl", { className: "numbers" }),
    key: element("p", { className: "key muted", hidden: true }),
    plot: element("div", { className: "plot", hidden: true }),
    skill: element("table", { className: "skill", hidden: true }),
    skillHour: "",
    trust: element("p", { className: "faults", hidden: true }),
    findings: element("ul", { className: "findings", hidden: true }),
    faults: element("p", { className: "faults muted" }),
  };
  card.node = element(
    "section",
    { className: "card" },
    element("div", { className: "card-head" }, card.title, card.pill, card.about),
    card.reason,
    card.numbers,
    card.key,
    card.plot,
    card.skill,
    card.trust,
    card.findings,
    card.faults,
  );
  card.key.append(
    element("span", { className: "key-measured", textContent: "— measured" }),
    element("span", { className: "key-forecast", textContent: "— forecast before it, with interval" }),
  );
  document.getElementById("zones").append(card.node);
  return card;
}

function showNumbers(card, forecast) {
  const interval = forecast?.intervals[0];
  const entries = [
    ["forecast for", forecast ? clock(forecast.valid_time) : "–"],
    [forecast ? `${forecast.output} mean` : "mean", number(forecast?.mean, 2, "°C")],
    [
      interval ? `${number(interval.level * 100, 0)} % interval` : "interval",
      interval ? `${number(interval.lower, 2)} … ${number(interval.upper, 2)}` : "–",
    ],
    ["volatility α", number(forecast?.volatility?.median, 2)],
    ["learning gate", forecast ? `${number(forecast.gate, 2)} ${forecast.regime}` : "–"],
    ["N_eff", number(forecast?.n_eff, 0)],
    ["quality", forecast?.quality ?? "–"],
  ];
  card.numbers.replaceChildren(
    ...entries.map(([name, value]) =>
      element("div", {}, element("dt", { textContent: name }), element("dd", { textContent: value })),
    ),
  );
}

function showStatus(card, summary, status) {
  card.pill.textContent = summary.state;
  card.pill.className = `pill ${summary.state}`;
  card.about.textContent = `${summary.network} · ${summary.estimator} · every ${age(summary.period_s)} · ${summary.samples} samples`;
  card.reason.textContent = summary.reason;
  card.reason.hidden = !summary.reason;
  const findings = status.findings ?? [];
  card.findings.replaceChildren(
    ...findings.map(({ subject, sentence }) =>
      element("li", { textContent: subject === "zone" ? sentence : `${subject}: ${sentence}` }),
    ),
  );
  card.findings.hidden = !findings.length;
  const faults = Object.entries(status.faults).filter(([, count]) => count > 0);
  const old = status.channels
    .filter((channel) => channel.age_s > 3 * summary.period_s)
    .map((channel) => `${channel.channel} last good ${age(channel.age_s)} ago`);
  card.faults.textContent = [
    faults.length ? `Faults: ${faults.map(([kind, count]) => `${count} ${kind.replaceAll("_", " ")}`).join(", ")}` : "No faults",
    ...old,
  ].join(" · ");
}

// What the forecasts of the last seven days were worth; it changes once an hour.
async function refreshSkill(card, summary) {
  const hour = summary.last_sample_time?.slice(0, 13) ?? "";
  if (hour === card.skillHour) return;
  const skill = await get(`zones/${summary.id}/skill`);
  const horizons = skill?.windows.find(({ days }) => days === 7)?.horizons.filter(({ forecasts }) => forecasts > 0) ?? [];
  card.skillHour = hour;
  card.skill.hidden = !horizons.length;
  const share = (value) => (value === null ? "–" : `${Math.round(100 * value)} %`);
  card.skill.replaceChildren(
    element("caption", { textContent: "Forecasts of the last 7 days" }),
    tableRow("th", ["ahead", "in the 95 % interval", "typical error", "better than persistence", "better than a regression"]),
    ...horizons.map((one) =>
      tableRow("td", [
        lead(one.lead_s),
        share(one.coverage),
        number(one.rmse, 2, "K"),
        share(one.skill_against_persistence),
        share(one.skill_against_arx),
      ]),
    ),
  );
}

// How far a controller may rely on the forecasts.
async function refreshTrust(card, summary) {
  const horizons = (await get(`zones/${summary.id}/trust`))?.horizons ?? [];
  card.trust.hidden = !horizons.length;
  card.trust.textContent = `Trust: ${horizons.map((one) => `${lead(one.lead_s)} ${one.trust}`).join(", ")}`;
  card.trust.title = horizons.filter((one) => one.reason).map((one) => `${lead(one.lead_s)}: ${one.reason}`).join("\n");
}

function lead(seconds) {
  return seconds % 3600 === 0 ? `${seconds / 3600} h` : `${Math.round(seconds / 60)} min`;
}

function tableRow(tag, texts) {
  return element("tr", {}, ...texts.map((textContent) => element(tag, { textContent })));
}

async function refreshRows(card, summary) {
  const known = card.rows.at(-1);
  const limit = Math.max(1, Math.min(MAX_ROWS, Math.ceil(WINDOW_S / summary.period_s)));
  const start = known ? `&start=${encodeURIComponent(known.time)}` : "";
  const history = await get(`zones/${summary.id}/history?limit=${limit}${start}`);
  const news = history?.rows ?? [];
  // A zone that was reset begins anew, earlier than what is shown.
  if (known && !news.length) card.rows = [];
  else card.rows = [...(known ? card.rows.slice(0, -1) : []), ...news].slice(-limit);
}

async function refreshZone(summary) {
  const isNew = !cards.has(summary.id);
  if (isNew) cards.set(summary.id, makeCard(summary.id));
  const card = cards.get(summary.id);
  const before = card.rows.at(-1)?.time;
  const [zone, forecast] = await Promise.all([
    get(`zones/${summary.id}`),
    get(`zones/${summary.id}/forecast`),
    refreshRows(card, summary),
    refreshSkill(card, summary),
    refreshTrust(card, summary),
  ]);
  showStatus(card, summary, zone.status);
  showNumbers(card, forecast);
  if (isNew || card.rows.at(-1)?.time !== before || card.restyle) {
    card.restyle = false;
    card.plot.hidden = card.key.hidden = !card.rows.length;
    if (card.rows.length) await draw(card.plot, card.rows, forecast, summary.period_s);
  }
}

async function refresh() {
  const connection = document.getElementById("connection");
  try {
    const listing = await get("zones");
    document.getElementById("site").textContent = listing.site;
    document.title = `${listing.site} – Thermogate`;
    const results = await Promise.allSettled(listing.zones.map(refreshZone));
    const failure = results.find((result) => result.status === "rejected");
    if (failure) throw failure.reason;
    connection.textContent = `updated ${new Date().toISOString().slice(11, 19)}`;
    connection.className = "muted";
  } catch (error) {
    if (error instanceof KeyNeeded) {
      connection.textContent = "an API key is needed";
      connection.className = "muted";
      waitsForKey = true;
      askForKey(error.message, () => {
        waitsForKey = false;
        refresh();
      });
      return;
    }
    connection.textContent = `no answer from the daemon (${error.message}); trying again`;
    connection.className = "error";
  }
}

async function poll() {
  if (!document.hidden && !waitsForKey) await refresh();
  setTimeout(poll, POLL_MS);
}

window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
  for (const card of cards.values()) card.restyle = true;
});
poll();
