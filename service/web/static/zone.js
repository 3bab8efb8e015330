// One zone: how it is, how it was, what it will be, what was learned, and why the model is doubted now.

import { KeyNeeded } from "./access.js";
import { get, getIfAny, zonePath } from "./api.js";
import { element, paced, set, tableRow } from "./dom.js";
import { historyChart } from "./history_chart.js";
import { showLearned } from "./learned.js";
import { nextHours } from "./next_hours.js";
import { roomCard } from "./room.js";
import { said } from "./said.js";
import { follow } from "./stream.js";
import { amount, capital, celsius, duration, number, share, t, unitText } from "./text.js";
import { timeNode, useTimeZone } from "./time.js";
import { channelText, doubts, faultText, saidNode, stateText, trustHead, trustText } from "./words.js";

const EXPERT = "thermogate-expert";
const LEARNED_MS = 60_000;
const NOW_MS = 1000;
const SHOW_MS = 250;

// Shows zone `id` in `place`; `frame` shows the site's name and the connection. Returns what ends it.
export function showZone(place, frame, id) {
  // The stream begins with what there is; it brings gain, trust and what is ahead only where they are known.
  const known = { zone: null, status: null, forecast: null, gain: null, skill: null, trust: null, ahead: null };
  const cards = { history: null, next: null, room: null };
  let ended = false;
  const dark = window.matchMedia("(prefers-color-scheme: dark)");

  const pill = element("span", { className: "pill" });
  const now = element("p", { className: "now" });
  const doubt = element("div", { className: "doubt", role: "status" });
  const figures = element("dl", { className: "figures" });
  const trouble = element("p", { className: "error", role: "alert", hidden: true });
  const skill = element("section", { className: "card" });
  const learned = element("section", { className: "card" });
  const expert = element("details", { className: "card expert", open: localStorage.getItem(EXPERT) === "yes" });
  const expertFigures = element("dl", { className: "figures" });
  const channels = element("div");
  expert.append(element("summary", { textContent: t("expert.title") }), expertFigures, channels);
  expert.addEventListener("toggle", () => {
    localStorage.setItem(EXPERT, expert.open ? "yes" : "no");
    cards.history?.redraw();
  });

  // What does not work now, by what it is.
  const troubles = new Map();
  function failing(what) {
    return (error) => {
      if (ended) return;
      if (error instanceof KeyNeeded) {
        frame.lost(error);
        return;
      }
      if (error) troubles.set(what, said(error.message).text);
      else troubles.delete(what);
      set(trouble, { hidden: troubles.size === 0, textContent: [...troubles.values()].join(" ") });
    };
  }

  async function load() {
    const path = zonePath(id);
    const overview = known.zone ? null : get("overview");
    const [zone, forecast, found, site] = await Promise.all([get(path), getIfAny(`${path}/forecast`), getIfAny(`${path}/skill`), overview]);
    if (ended) return;
    if (site) {
      frame.site(site.site);
      useTimeZone(site.time_zone);
    }
    Object.assign(known, { zone, status: zone.status, forecast, skill: found });
    if (!cards.history) {
      build(zone);
      learned.replaceChildren(element("h2", { textContent: t("learned.title") }), element("p", { className: "muted", textContent: t("loading") }));
      learn();
    }
    show();
    sampled();
    frame.connected();
  }

  function build(zone) {
    cards.history = historyChart(id, known.zone.period_s * 1000, { expert: () => expert.open, failed: failing("history") });
    cards.next = nextHours(id, zone, failing("next"));
    cards.room = roomCard(id, () => (Date.parse(known.status.last_sample_time) || Date.now()) + zone.period_s * 1000, failing("room"));
    place.replaceChildren(
      element("nav", { "aria-label": t("zone.back") }, element("a", { href: "#/", textContent: `← ${t("zone.back")}` })),
      element("div", { className: "zone-head" }, element("h1", { textContent: id }), pill, now),
      trouble,
      doubt,
      cards.room.node,
      figures,
      element("div", { className: "columns" }, cards.history.node, cards.next.node, skill, learned),
      expert,
    );
  }

  function show() {
    const { zone, status, forecast, gain } = known;
    set(pill, { textContent: stateText(status.state), className: `pill ${status.state}` });
    showDoubt();
    // Of a room that has stopped, what was said of the hours ahead is for hours that may be over; so it is until the next look ahead.
    const heating = known.ahead?.quality === "bad" ? null : known.ahead?.heating;
    cards.room.heating(heating && Date.parse(heating.by) > Date.parse(status.last_sample_time) ? heating : null);
    const interval = forecast?.intervals[0];
    const horizons = known.trust?.horizons ?? [];
    const alike = horizons.every((one) => one.trust === horizons[0].trust);
    const trust = alike && known.trust?.beaten && horizons[0]?.trust === "trusted" ? [trustText("partly")] : alike ? horizons.slice(0, 1).map((one) => trustText(one.trust)) : horizons.map((one) => `${duration(one.lead_s)}: ${trustText(one.trust)}`);
    fill(figures, [
      [t("zone.newest"), status.last_sample_time ? timeNode(Date.parse(status.last_sample_time)) : "–"],
      [t("zone.next"), interval ? `${celsius(forecast.mean, 2)} (${number(interval.lower, 2)} … ${number(interval.upper, 2)})` : "–"],
      [t("zone.trust"), trust.length ? trust.join(", ") : "–"],
      [t("zone.gain"), gain && gain.median !== null ? t("zone.gain_value", { value: amount(gain.median, 2), low: amount(gain.lower, 2), high: amount(gain.upper, 2) }) : t("zone.gain_unknown")],
      ...(forecast?.inputs ?? []).map((one) => [channelText(one.channel), `${one.unit === "degC" ? celsius(one.value) : `${amount(one.value)} ${unitText(one.unit)}`}${one.held ? ` (${t("zone.held", { age: duration(one.age_s) })})` : ""}`]),
    ]);
    fill(expertFigures, [
      [t("expert.network"), zone.network],
      [t("expert.estimator"), zone.estimator],
      [t("expert.period"), duration(zone.period_s)],
      ["α", forecast?.volatility ? `${number(forecast.volatility.median, 2)} (${number(forecast.volatility.lower, 2)} … ${number(forecast.volatility.upper, 2)})` : "–"],
      ["F_k", number(forecast?.volatility?.cdf, 2)],
      ["gate", forecast ? `${number(forecast.gate, 2)} ${forecast.regime}` : "–"],
      ["N_eff", number(forecast?.n_eff, 0)],
      [t("expert.quality"), forecast?.quality ?? "–"],
      [t("expert.samples"), number(status.samples)],
      [t("expert.delay"), duration(status.delay_s)],
    ]);
    const faults = Object.entries(status.faults).filter(([, count]) => count > 0);
    channels.replaceChildren(
      element("table", {}, element("thead", {}, tableRow("th", [t("expert.channel"), t("expert.last_good")])), element("tbody", {}, ...status.channels.map((one) => tableRow("td", [one.channel, one.last_good ? t("expert.ago", { age: duration(one.age_s) }) : t("expert.never")])))),
      element("p", { className: "muted", textContent: faults.length ? t("expert.faults", { list: faults.map(([kind, count]) => `${number(count)} ${faultText(kind)}`).join(", ") }) : t("expert.no_faults") }),
    );
    showSkill();
  }

  function showDoubt() {
    const found = doubts(known);
    const running = known.status.state === "running";
    const head = running ? trustHead(known, found) : null;
    const items = found.map(({ text, own }) => element("li", {}, text, ...(own ? [" ", saidNode(text.endsWith(".") ? capital(own) : own)] : [])));
    const next = [...(head ? [element("strong", { textContent: head })] : []), ...(items.length ? [element("ul", {}, ...items)] : [])];
    const text = next.map(({ textContent }) => textContent).join("");
    // What has not changed is not read out again.
    if (doubt.textContent !== text) doubt.replaceChildren(...next);
    doubt.className = `doubt ${running ? (found.length ? "warned" : "fine") : known.status.state}`;
  }

  function showSkill() {
    const windows = known.skill?.windows ?? [];
    const week = windows.find(({ days }) => days === 7);
    const [horizons, issued] = [week?.horizons, week?.as_issued].map((found) => found?.filter(({ forecasts }) => forecasts > 0) ?? []);
    const title = element("h2", { textContent: t("skill.title") });
    if (!horizons.length) {
      skill.replaceChildren(title, element("p", { className: "muted", textContent: t("skill.none") }));
      return;
    }
    const parts = skillTable("known", ["persistence", "arx"], horizons);
    if (issued.length) parts.push(...skillTable("issued", ["persistence", "yesterday"], issued));
    skill.replaceChildren(title, ...parts, element("p", { className: "muted", textContent: t("skill.note") }));
  }

  // The scores that answer one question: the question as a sentence, and a row for each horizon.
  function skillTable(question, references, horizons) {
    const heads = ["ahead", "error", "coverage", ...references].map((name) => t(`skill.${name}`));
    const rows = horizons.map((one) => tableRow("td", [duration(one.lead_s), one.rmse === null ? "–" : `${number(one.rmse, 2)} K`, share(one.coverage), ...references.map((name) => better(one.rmse, one[`${name}_rmse`]))]));
    const table = element("table", {}, element("thead", {}, tableRow("th", heads)), element("tbody", {}, ...rows));
    return [element("p", { textContent: t(`skill.${question}`) }), element("div", { className: "scroll", tabIndex: 0, role: "region", "aria-label": t(`skill.${question}`) }, table)];
  }

  function sampled() {
    const last = known.status.last_sample_time;
    if (!last) return;
    const time = Date.parse(last) + known.zone.period_s * 1000;
    cards.room.ask();
    measure();
    cards.history.sample(time);
    if (known.forecast) cards.next.sample(time);
  }

  // The newest sample, which no event has.
  const measure = paced(async () => {
    try {
      const [row] = (await get(`${zonePath(id)}/history?limit=1`)).rows;
      if (ended || !row) return;
      const values = { temperature: celsius(row.y), setpoint: celsius(row.setpoint) };
      set(now, { textContent: t(row.setpoint === null ? "zone.now" : "zone.now.meant", values) });
      failing("now")(null);
    } catch (error) {
      failing("now")(error);
    }
  }, NOW_MS);

  // Parameters move slowly; asking the estimator for them takes a while.
  const learn = paced(async () => {
    try {
      const parameters = await getIfAny(`${zonePath(id)}/parameters`);
      if (ended) return;
      const open = learned.querySelector("details")?.open;
      showLearned(learned, known.zone, parameters);
      if (open) learned.querySelector("details").open = true;
      if (parameters?.thermostat.length) cards.next?.obeys();
      failing("learned")(null);
    } catch (error) {
      failing("learned")(error);
    }
  }, LEARNED_MS);

  const showSoon = paced(() => {
    if (!known.zone) return;
    show();
    sampled();
    learn();
  }, SHOW_MS);
  const stop = follow(`${zonePath(id)}/stream`, {
    opened: load,
    event(kind, data) {
      if (kind in known) known[kind] = data;
      frame.connected();
      if (known.zone) showSoon();
    },
    lost(error) {
      frame.lost(error);
      if (!known.zone && !(error instanceof KeyNeeded)) load().catch((why) => place.replaceChildren(element("p", { className: "error", role: "alert", textContent: why.message }), element("a", { href: "#/", textContent: t("zone.back") })));
    },
  });
  const restyle = () => {
    cards.history?.redraw();
    cards.next?.redraw();
  };
  dark.addEventListener("change", restyle);

  return () => {
    ended = true;
    stop();
    showSoon.cancel();
    measure.cancel();
    learn.cancel();
    cards.history?.end();
    cards.next?.end();
    cards.room?.end();
    dark.removeEventListener("change", restyle);
  };
}

// How the zone's error compares with that of a simpler forecast; up to 0.05 K, or 5 %, they are alike.
function better(own, other) {
  if (own === null || !(other > 0)) return "–";
  if (Math.abs(own - other) <= 0.05 * Math.max(1, Math.min(own, other))) return t("skill.alike");
  return own < other ? t("skill.better", { share: share(1 - own / other) }) : t("skill.worse", { share: share(own / other - 1) });
}

function fill(list, entries) {
  list.replaceChildren(...entries.map(([name, value]) => element("div", {}, element("dt", { textContent: name }), element("dd", {}, value))));
}
