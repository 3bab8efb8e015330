// The next 24 hours of a zone: the fan as it is with everything held, and under a plan made by hand.

import { Refused, get, post, zonePath } from "./api.js";
import { element, paced } from "./dom.js";
import { changeTold, demandTold } from "./energy.js";
import { planEditor } from "./plan_editor.js";
import { chartClock, chartConfig, colour, fanRange, layout, legend, line, loadPlotly } from "./plotting.js";
import { celsius, duration, t, unitText } from "./text.js";
import { moment, offset, utcText } from "./time.js";
import { channelText, originText } from "./words.js";

const HOUR = 3600_000;
const HORIZON = 24 * HOUR;
const MOST_STEPS = 2000;
// So many steps ahead go zones with periods of seconds, which a day would overwhelm.
const SHORT_STEPS = 288;
const SLOTS = 24;
const LEVELS = [0.95, 0.5];
const ASK_MS = 250;
const RENEW_MS = 10_000;
const SET_POINT = { channel: "T_set", unit: "degC" };
const COOLEST = 5;
const WARMEST = 30;

// The card of zone `id` as `zone` describes it; `failed(error)` is told what went wrong, and null once it works again.
export function nextHours(id, zone, failed) {
  const plot = element("div", { className: "plot fan", role: "img", tabIndex: -1 });
  const lines = element("ul", { className: "legend muted", "aria-label": t("chart.lines") });
  const [result, change] = [0, 1].map(() => element("p", { role: "status", className: "result" }));
  const demand = element("p", { className: "result" });
  const origins = element("ul", { className: "origins muted", "aria-label": t("origin.title") });
  const planPlace = element("div");
  const heating = zone.channels.filter(({ role, unit }) => role === "input" && unit === "W");
  const period = zone.period_s * 1000;
  const day = Math.max(1, Math.round(HORIZON / period));
  const steps = day > MOST_STEPS ? SHORT_STEPS : day;
  const horizon = `${Math.round((steps * period) / 1000)}s`;
  const slot = Math.max((steps * period) / SLOTS, period);
  let newest = null;
  let held = null;
  let planned = null;
  let before = null;
  let editor = null;
  let channel = heating[0];
  let asked = null;
  let edges = [];
  const ended = new AbortController();
  const choice = element("select", { "aria-label": t("plan.channel") });
  function offer() {
    choice.replaceChildren(...heating.map((one) => element("option", { value: one.channel, textContent: channelText(one.channel), selected: one === channel })));
    choice.hidden = heating.length < 2;
  }
  offer();
  choice.addEventListener("change", () => {
    channel = heating.find((one) => one.channel === choice.value);
    if (held) edit();
    forget();
  });
  const node = element("section", { className: "card" }, element("h2", { textContent: t("fan.title", { hours: duration((steps * period) / 1000) }) }), plot, lines, result, demand, origins, choice, planPlace, change);

  // The fan with everything held, which a newer sample has changed.
  const renew = paced(async () => {
    try {
      const [fan, recent] = await Promise.all([get(`${zonePath(id)}/forecast?${heldQuery()}`), get(`${zonePath(id)}/series?${recentQuery()}`), loadPlotly()]);
      held = fan;
      before = recent;
      if (editor === null) edit();
      else {
        edges = slots(Date.parse(held.valid_time));
        editor.move(edges, valueNow());
      }
      if (editor?.planned) await ask(editor.planned);
      else await forget();
      await call();
    } catch (error) {
      if (error instanceof Refused && error.status === 503) none();
      else if (error.name !== "AbortError") failed(error);
    }
  }, RENEW_MS);

  function none() {
    result.textContent = t("fan.none");
    demand.replaceChildren();
  }

  // There is no plan, or none any more.
  async function forget() {
    asked?.abort();
    askPaced.cancel();
    planned = null;
    await draw();
    failed(null);
  }

  // What the thermostat will call for, once its law is known.
  async function call() {
    if (heating.includes(SET_POINT)) demand.replaceChildren(await demandTold(id, horizon, ended.signal));
  }

  function heldQuery() {
    return new URLSearchParams([["horizon", horizon], ...LEVELS.map((level) => ["level", level])]);
  }

  // As much of the past as gives the measured line its lead, and the plan its scale.
  function recentQuery() {
    return new URLSearchParams(day > MOST_STEPS ? { start: new Date(newest - steps * period).toISOString(), points: "300" } : { points: "300" });
  }

  // Hours of the site's clock; the first may have begun.
  function slots(start) {
    const ahead = offset(start);
    const found = [start];
    for (let time = (Math.floor((start + ahead) / slot) + 1) * slot - ahead; time < start + steps * period; time += slot) found.push(time);
    return found;
  }

  function valueNow() {
    if (channel === SET_POINT) return before.setpoint?.findLast((value) => value !== null) ?? COOLEST;
    return Math.max(0, held.inputs.find((one) => one.channel === channel.channel)?.value ?? 0);
  }

  function edit() {
    planPlace.replaceChildren();
    editor = null;
    if (!channel) return;
    const past = before.inputs.find((one) => one.channel === channel.channel)?.values.filter((value) => value !== null) ?? [];
    const now = valueNow();
    edges = slots(Date.parse(held.valid_time));
    editor = planEditor({
      channel: channelText(channel.channel),
      unit: unitText(channel.unit),
      times: edges,
      now,
      usual: past.length ? past.reduce((a, b) => a + b, 0) / past.length : 0,
      most: past.reduce((a, b) => Math.max(a, b), now),
      ...(channel === SET_POINT ? { least: COOLEST, most: WARMEST, grain: 0.5 } : {}),
      changed(values) {
        if (values === null) forget();
        else askSoon(values);
      },
    });
    planPlace.append(editor.node);
  }

  let wanted = null;
  const askPaced = paced(() => ask(wanted), ASK_MS);
  function askSoon(values) {
    wanted = values;
    askPaced();
  }

  async function ask(values) {
    asked?.abort();
    const own = new AbortController();
    asked = own;
    const start = Date.parse(held.valid_time);
    const perStep = Array.from({ length: steps }, (_, index) => {
      const time = start + index * period;
      let at = edges.length - 1;
      while (at > 0 && edges[at] > time) at -= 1;
      return values[at];
    });
    try {
      const answer = await post(`${zonePath(id)}/forecast`, { horizon, levels: LEVELS, inputs: { [channel.channel]: perStep } }, own.signal);
      if (own !== asked) return;
      planned = answer;
      // A sample has come meanwhile: both fans begin where the newer one does.
      if (planned.valid_time !== held.valid_time) held = await get(`${zonePath(id)}/forecast?${heldQuery()}`, own.signal);
      if (own === asked) await draw();
      if (channel === SET_POINT) change.replaceChildren(await changeTold(id, horizon, perStep, start + 2 * steps * period, own.signal));
      failed(null);
    } catch (error) {
      if (error.name === "AbortError") return;
      // What was forecast under other bars must not stand beside these.
      planned = null;
      await draw();
      if (error instanceof Refused && error.status === 503) none();
      else failed(error);
    }
  }

  async function draw() {
    if (!planned) change.replaceChildren();
    if (!held || !node.isConnected) return;
    const shown = planned ?? held;
    const start = Date.parse(held.valid_time);
    const clock = chartClock(start);
    const fan = read(shown);
    const base = read(held);
    const past = before.times.map((time) => Date.parse(time));
    const recent = past.findIndex((time) => time >= start - (steps * period) / 4);
    const times = recent < 0 ? [] : past.slice(recent);
    const measured = recent < 0 ? [] : before.y.slice(recent);
    const x = fan.times.map(clock.x);
    const area = (level, fill) => ({ type: "scatter", mode: "lines", x: [...x, ...x.toReversed()], y: [...fan.bounds[level].upper, ...fan.bounds[level].lower.toReversed()], fill: "toself", fillcolor: fill, line: { width: 0 }, hoverinfo: "skip" });
    const traces = [
      area(0.95, colour("--band")),
      area(0.5, colour("--band")),
      { type: "scatter", mode: "lines", x, y: fan.mean, text: fan.times.map(utcText), line: { color: colour("--accent"), width: 2 }, customdata: fan.times.map((_, index) => [fan.bounds[0.95].lower[index], fan.bounds[0.95].upper[index]]), hovertemplate: `%{y:.1f} °C (%{customdata[0]:.1f} … %{customdata[1]:.1f}) · %{text}<extra>${t(planned ? "series.planned" : "series.expected")}</extra>` },
      line(clock, times, before.bucket_s * 1000, measured, { utc: true, line: { color: colour("--ink"), width: 1.5 }, hovertemplate: `%{y:.2f} °C · %{text}<extra>${t("series.measured")}</extra>` }),
    ];
    if (planned) traces.push({ type: "scatter", mode: "lines", x: base.times.map(clock.x), y: base.mean, line: { color: colour("--muted"), width: 1.5, dash: "dot" }, hovertemplate: `%{y:.1f} °C<extra>${t("series.held")}</extra>` });
    const drawn = [...measured, ...fan.mean, ...(planned ? base.mean : [])];
    const { range, cut } = fanRange(drawn, [...fan.bounds[0.5].lower, ...fan.bounds[0.5].upper], fan.bounds[0.95]);
    await window.Plotly.react(plot, traces, { ...layout({ xaxis: { type: "date", fixedrange: true, nticks: Math.max(3, Math.floor(plot.clientWidth / 90)) }, yaxis: { range } }, { yaxis: "°C" }), dragmode: false }, chartConfig());
    legend(lines, [
      { label: t("series.measured"), colour: colour("--ink") },
      { label: t(planned ? "series.planned" : "series.expected"), colour: colour("--accent") },
      ...(planned ? [{ label: t("series.held"), colour: colour("--muted"), dash: "dot" }] : []),
    ]);
    origins.replaceChildren(...shown.origins.map((one) => element("li", { textContent: `${channelText(one.channel)}: ${originText(one)}` })));
    const text = sentence(fan, planned ? base : null, shown.origins) + (cut ? ` ${t("fan.cut")}` : "");
    result.textContent = text;
    plot.setAttribute("aria-label", text);
  }

  return {
    node,
    redraw: draw,
    // The law of the thermostat is known: set-points can be planned as well.
    obeys() {
      if (heating.includes(SET_POINT) || zone.channels.some((one) => one.channel === SET_POINT.channel)) return;
      heating.push(SET_POINT);
      offer();
      if (held) call().catch(failed);
    },
    // There is a sample up to `time`.
    sample(time) {
      if (newest === null) result.textContent = t("loading");
      newest = time;
      renew();
    },
    end() {
      asked?.abort();
      ended.abort();
      renew.cancel();
      askPaced.cancel();
      if (window.Plotly && held) window.Plotly.purge(plot);
    },
  };
}

function read(answer) {
  const first = answer.fan.map(({ outputs }) => outputs[0]);
  const bounds = Object.fromEntries(
    LEVELS.map((level) => {
      const at = first.map(({ intervals }) => intervals.find((one) => one.level === level));
      return [level, { lower: at.map(({ lower }) => lower), upper: at.map(({ upper }) => upper) }];
    }),
  );
  return { times: answer.fan.map(({ valid_time }) => Date.parse(valid_time)), mean: first.map(({ mean }) => mean), bounds };
}

// The lowest temperature that is expected, and what a plan changes about it.
function sentence(fan, base, origins) {
  const lowest = fan.mean.reduce((best, value, index) => (value < fan.mean[best] ? index : best), 0);
  const last = fan.mean.length - 1;
  const values = {
    low: celsius(fan.mean[lowest]),
    when: moment(fan.times[lowest]),
    from: celsius(fan.bounds[0.95].lower[lowest]),
    to: celsius(fan.bounds[0.95].upper[lowest]),
    end: celsius(fan.mean[last]),
    ends: moment(fan.times[last]),
  };
  if (base) return t("fan.planned", { ...values, held: celsius(base.mean[lowest]) });
  return t(origins.every(({ origin }) => origin === "held") ? "fan.held" : "fan.foreseen", values);
}
